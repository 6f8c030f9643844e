//! Several runs on the same axes, and the spread over seeds.

use super::check::some;
use super::names::{label, reward_axis, scale_note};
use super::of_run::{iterations, mean_reward, measured};
use crate::draw::{Axis, Dash, Key, Mark, N, Panel, Sheet, numbered, pairs, plural};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::{Run, World};

/// From how many runs on a median and quartiles are drawn.
const FEWEST_FOR_SPREAD: usize = 3;
/// Up to how many runs each has a colour and a name of its own.
const MOST_NAMED: usize = 7;

/// Nominal gait at 0 strides, then each iteration's policy at the strides spent by then.
fn on_robot(run: &Run) -> Vec<(f64, f64)> {
    let nominal = mean_reward(measured(run)[0]).map(|n| (0.0, n));
    let later = iterations(run).iter().filter_map(|i| Some((i.strides_so_far as f64, i.mean_reward?)));
    nominal.into_iter().chain(later).collect()
}

/// Average reward of each trial imagined in the map, in order over the iterations.
fn in_map(run: &Run) -> Vec<(f64, f64)> {
    let trials = run.learning.iter().filter(|t| t.world == World::Map);
    numbered(&trials.map(|t| t.average_reward).collect::<Vec<_>>())
}

/// Lower quartile, median and upper quartile of some values, by linear interpolation between the sorted ones;
/// `None` without any.
///
/// ```
/// use stridemap_report::figures::quartiles;
/// // Of 1, 2, 3, 4 the median is 2.5, and the quartiles lie a quarter of the way in: 1.75 and 3.25.
/// assert_eq!(quartiles(&[4.0, 1.0, 3.0, 2.0]), Some([1.75, 2.5, 3.25]));
/// assert_eq!(quartiles(&[]), None);
/// ```
#[must_use]
pub fn quartiles(values: &[f64]) -> Option<[f64; 3]> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    Some([0.25, 0.5, 0.75].map(|q| {
        let at = q * last as f64;
        let (low, high) = (at.floor() as usize, at.ceil() as usize);
        sorted[low] + (at - low as f64) * (sorted[high] - sorted[low])
    }))
}

/// Spread over runs at one place: abscissa, lower quartile, median and upper quartile, runs.
type Spread = (f64, [f64; 3], usize);

/// Median and quartiles of the i-th point of every run, at the median of its abscissae.
fn spread(curves: &[Vec<(f64, f64)>]) -> Vec<Spread> {
    let longest = curves.iter().map(Vec::len).max().unwrap_or(0);
    let at = |i: usize| {
        let at: Vec<(f64, f64)> = curves.iter().filter_map(|c| c.get(i).copied()).collect();
        let (x, y): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
        Some((quartiles(&x)?[1], quartiles(&y)?, at.len())).filter(|s| s.2 >= FEWEST_FOR_SPREAD)
    };
    (0..longest).filter_map(at).collect()
}

fn draw_spread(p: &mut Panel, spread: &[Spread], marks: bool) {
    if spread.is_empty() {
        return;
    }
    let of = |k: usize| spread.iter().map(|s| s.1[k]).collect::<Vec<f64>>();
    let x: Vec<f64> = spread.iter().map(|s| s.0).collect();
    p.band(&x, &of(0), &of(2), "s0", 0.24);
    let median = pairs(&x, &of(1));
    p.line(&median, "s6", Dash::Solid, if marks { 2.6 } else { 1.5 });
    if marks {
        p.marks(&median, "s6", Mark::Disc, 4.0);
    }
    for (x, quartiles, n) in spread.iter().step_by((spread.len() / 200).max(1)) {
        let [low, middle, high] = quartiles.map(N);
        let quartiles = format!("quartiles {low:#.3} to {high:#.3}, n = {n} runs");
        p.hover(*x, middle.0, format!("median {middle:#.3} at {:#.3}, {quartiles}", N(*x)));
    }
    p.key("median", Key::Line("s6", Dash::Solid));
    p.key("quartiles", Key::Band("s0", 0.3));
}

/// Draws the learning curves of several runs, in the map and on the robot: each run as a thin line, and
/// from three runs on the median and the quartiles.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if no run has a measured iteration.
pub fn runs_compared(runs: &[Run]) -> Result<Figure> {
    let stem = "runs";
    let measured_iterations = runs.iter().flat_map(iterations).filter(|i| i.mean_reward.is_some());
    some(stem, "no iteration", measured_iterations.count())?;
    let quantity = runs[0].reward_quantity();
    let name = quantity.filter(|quantity| runs.iter().all(|r| r.reward_quantity().as_ref() == Some(quantity)));
    let reward = &name.map_or_else(|| "mean reward".to_owned(), |q| label(&q, ""));
    let many = runs.len() >= FEWEST_FOR_SPREAD;
    let mut sheet = Sheet::new(stem, if many { "Learning over the runs" } else { "Runs beside each other" });
    let imagined: Vec<_> = runs.iter().map(in_map).collect();
    let robot: Vec<_> = runs.iter().map(on_robot).collect();
    let mut notes = draw_imagined(&mut sheet, &imagined, reward);
    let spread_on_robot = draw_robot(&mut sheet, runs, &robot, reward, &mut notes);
    let finals: Vec<f64> = runs.iter().filter_map(|r| mean_reward(measured(r)[1])).collect();
    let runs_in_words = plural(runs.len(), "run");
    let last = match quartiles(&finals).filter(|_| many) {
        Some(quartiles) => {
            let ([low, middle, high], n) = (quartiles.map(N), plural(finals.len(), "run"));
            format!(" Final policies: median {middle:#.3} (quartiles {low:#.3} to {high:#.3}, n = {n}).")
        }
        _ => String::new(),
    };
    let how = if many {
        " Thick line: median over the runs; band: lower to upper quartile, both of the i-th policy of each run, at the median \
         number of strides spent by then."
    } else {
        ""
    };
    let caption = format!(
        "{}ean on the robot of each iteration's policy against the training and evaluation strides spent so far; at 0 the nominal \
         gait. One thin line per run (n = {runs_in_words}), {} while learning in all.{how}{last}{notes}",
        if imagined.iter().any(|trials| !trials.is_empty()) {
            "Above: average of each trial imagined in the learned map, over all iterations in order. Below: m"
        } else {
            "M"
        },
        plural(runs.iter().map(|r| r.falls().0).sum(), "fall")
    );
    let mut csv = String::from("run,world,strides_or_trials_so_far,reward,lower_quartile,upper_quartile,runs\n");
    for ((run, robot), imagined) in runs.iter().zip(&robot).zip(&imagined) {
        for (world, points) in [("robot", robot), ("map", imagined)] {
            for (x, y) in points {
                csv += &format!("{},{world},{x},{y},,,1\n", run.name.replace(',', " "));
            }
        }
    }
    for (x, [low, middle, high], n) in &spread_on_robot {
        csv += &format!("median,robot,{x},{middle},{low},{high},{n}\n");
    }
    let alt = format!("{reward} against strides for {runs_in_words}, with median and quartiles.{last}");
    Ok(sheet.finish(&caption, &alt, csv))
}

/// The panel of the trials in the map; returns what its axis needs said.
fn draw_imagined(sheet: &mut Sheet, curves: &[Vec<(f64, f64)>], reward: &str) -> String {
    let longest = curves.iter().map(Vec::len).max().unwrap_or(0);
    if longest == 0 {
        return String::new();
    }
    let y = reward_axis(reward, &curves.iter().flatten().map(|p| p.1).collect::<Vec<_>>());
    let note = scale_note(&y);
    let x = Axis::counting("trial in the learned map", 0.5, longest as f64 + 0.5);
    let mut p = sheet.single(160.0, x, y, Some("In the learned map"));
    for (i, curve) in curves.iter().enumerate() {
        let (class, dash) = thin(curves.len(), i);
        p.line(curve, class, dash, 0.7);
    }
    draw_spread(&mut p, &spread(curves), false);
    sheet.add(p);
    note
}

/// Colour and dash of one run: its own while there are few.
fn thin(runs: usize, i: usize) -> (&'static str, Dash) {
    const CLASSES: [&str; MOST_NAMED] = ["s0", "s1", "s2", "s3", "s4", "s5", "s6"];
    const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::Chain, Dash::Dotted];
    if runs > MOST_NAMED { ("ref", Dash::Solid) } else { (CLASSES[i % CLASSES.len()], DASHES[i % DASHES.len()]) }
}

fn draw_robot(
    sheet: &mut Sheet,
    runs: &[Run],
    curves: &[Vec<(f64, f64)>],
    reward: &str,
    notes: &mut String,
) -> Vec<Spread> {
    let values: Vec<f64> = curves.iter().flatten().map(|p| p.1).collect();
    let last = curves.iter().flatten().map(|p| p.0).fold(1.0, f64::max);
    let y = reward_axis(&format!("{reward} on the robot"), &values);
    if notes.is_empty() {
        *notes = scale_note(&y);
    }
    let spread = spread(curves);
    let x = Axis::counting("strides on the robot so far", -0.02 * last, last * 1.02);
    let mut p = sheet.single(250.0, x, y, Some("On the robot"));
    draw_spread(&mut p, &spread, true);
    for (i, (r, points)) in runs.iter().zip(curves).enumerate() {
        let (class, dash) = thin(runs.len(), i);
        p.line(points, class, dash, if spread.is_empty() { 2.0 } else { 1.1 });
        if runs.len() <= MOST_NAMED {
            p.marks(points, class, Mark::Disc, 3.0);
            p.key(&r.name, Key::Both(class, dash, Mark::Disc));
        }
        for (x, y) in points {
            p.hover(*x, *y, format!("{}: {reward} {:#.3} after {x} strides", r.name, N(*y)));
        }
    }
    if runs.len() > MOST_NAMED {
        p.key("one run", Key::Line("ref", Dash::Solid));
    }
    sheet.add(p);
    spread
}
