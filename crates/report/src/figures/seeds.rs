//! Several runs on the same axes, and the spread over seeds.

use super::check::some;
use super::names::{reward_axis, scale_note};
use crate::draw::{Axis, Dash, Key, Mark, Panel, Sheet, number, plural};
use crate::error::Result;
use crate::figure::Figure;

/// From how many runs on a median and quartiles are drawn.
const FEWEST_FOR_SPREAD: usize = 3;
/// Up to how many runs each has a colour and a name of its own.
const MOST_NAMED: usize = 7;

/// One run among several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunCurve {
    /// Name of the run.
    pub name: String,
    /// Mean reward of the nominal gait.
    pub nominal: Option<f64>,
    /// Training and evaluation strides so far, and the mean reward of the policy then.
    pub iterations: Vec<(f64, f64)>,
    /// Mean reward of the final policy.
    pub final_policy: Option<f64>,
    /// Average reward of each trial imagined in the map, in order over the iterations.
    pub trials: Vec<f64>,
    /// Falls on the robot while learning.
    pub falls: u64,
}

impl RunCurve {
    /// Nominal gait at 0 strides, then each iteration's policy.
    fn points(&self) -> Vec<(f64, f64)> {
        let nominal = self.nominal.map(|n| (0.0, n));
        nominal.into_iter().chain(self.iterations.iter().copied()).collect()
    }
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

/// Spread over runs at one place: abscissa, lower quartile, median, upper quartile, runs.
type Spread = (f64, [f64; 3], usize);

/// Median and quartiles of the i-th point of every run, at the median of its abscissae.
fn spread(curves: &[Vec<(f64, f64)>]) -> Vec<Spread> {
    let longest = curves.iter().map(Vec::len).max().unwrap_or(0);
    (0..longest)
        .filter_map(|i| {
            let at: Vec<(f64, f64)> = curves.iter().filter_map(|c| c.get(i).copied()).collect();
            if at.len() < FEWEST_FOR_SPREAD {
                return None;
            }
            let x = quartiles(&at.iter().map(|p| p.0).collect::<Vec<_>>())?[1];
            let y = quartiles(&at.iter().map(|p| p.1).collect::<Vec<_>>())?;
            Some((x, y, at.len()))
        })
        .collect()
}

fn draw_spread(p: &mut Panel, spread: &[Spread], marks: bool) {
    let of = |k: usize| spread.iter().map(|s| s.1[k]).collect::<Vec<f64>>();
    let x: Vec<f64> = spread.iter().map(|s| s.0).collect();
    p.band(&x, &of(0), &of(2), "s0", 0.24);
    let median: Vec<(f64, f64)> = x.iter().copied().zip(of(1)).collect();
    p.line(&median, "s6", Dash::Solid, if marks { 2.6 } else { 1.5 });
    if marks {
        p.marks(&median, "s6", Mark::Disc, 4.0);
    }
    for (x, [low, middle, high], n) in spread.iter().step_by((spread.len() / 200).max(1)) {
        p.hover(
            *x,
            *middle,
            format!(
                "median {} at {}, quartiles {} to {}, n = {n} runs",
                number(*middle, 3),
                number(*x, 3),
                number(*low, 3),
                number(*high, 3)
            ),
        );
    }
    p.key("median", Key::Line("s6", Dash::Solid));
    p.key("quartiles", Key::Band("s0", 0.3));
}

/// Draws the learning curves of several runs, in the map and on the robot: each run as a thin line, and
/// from three runs on the median and the quartiles. `reward` names the reward (`mean reward`, `speed (m/s)`).
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if no run has an iteration.
pub fn runs_compared(runs: &[RunCurve], reward: &str) -> Result<Figure> {
    let stem = "runs";
    some(stem, "no iteration", runs.iter().map(|r| r.iterations.len()).sum())?;
    let title = if runs.len() < FEWEST_FOR_SPREAD { "Runs beside each other" } else { "Learning over the runs" };
    let mut sheet = Sheet::new(stem, title);
    let mut notes = imagined(&mut sheet, runs, reward);
    let spread_on_robot = on_robot(&mut sheet, runs, reward, &mut notes);
    let many = runs.len() >= FEWEST_FOR_SPREAD;
    let finals: Vec<f64> = runs.iter().filter_map(|r| r.final_policy).collect();
    let last = match quartiles(&finals) {
        Some([low, middle, high]) if many => format!(
            " Final policies: median {} (quartiles {} to {}, n = {}).",
            number(middle, 3),
            number(low, 3),
            number(high, 3),
            plural(finals.len(), "run")
        ),
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
         gait. One thin line per run (n = {}), {} while learning in all.{how}{last}{notes}",
        if runs.iter().any(|r| !r.trials.is_empty()) {
            "Above: average of each trial imagined in the learned map, over all iterations in order. Below: m"
        } else {
            "M"
        },
        plural(runs.len(), "run"),
        plural(runs.iter().map(|r| r.falls).sum::<u64>() as usize, "fall")
    );
    let mut csv = String::from("run,world,strides_or_trials_so_far,reward,lower_quartile,upper_quartile,runs\n");
    for r in runs {
        let name = r.name.replace(',', " ");
        for (x, y) in r.points() {
            csv.push_str(&format!("{name},robot,{x},{y},,,1\n"));
        }
        for (i, y) in r.trials.iter().enumerate() {
            csv.push_str(&format!("{name},map,{},{y},,,1\n", i + 1));
        }
    }
    for (x, [low, middle, high], n) in &spread_on_robot {
        csv.push_str(&format!("median,robot,{x},{middle},{low},{high},{n}\n"));
    }
    let alt = format!("{reward} against strides for {}, with median and quartiles.{last}", plural(runs.len(), "run"));
    Ok(sheet.finish(&caption, &alt, csv))
}

/// The panel of the trials in the map; returns what its axis needs said.
fn imagined(sheet: &mut Sheet, runs: &[RunCurve], reward: &str) -> String {
    let curves: Vec<Vec<(f64, f64)>> =
        runs.iter().map(|r| r.trials.iter().enumerate().map(|(i, v)| (i as f64 + 1.0, *v)).collect()).collect();
    let longest = curves.iter().map(Vec::len).max().unwrap_or(0);
    if longest == 0 {
        return String::new();
    }
    let y = reward_axis(reward, &runs.iter().flat_map(|r| r.trials.iter().copied()).collect::<Vec<_>>());
    let note = scale_note(&y);
    let x = Axis::counting("trial in the learned map", 0.5, longest as f64 + 0.5);
    let row = sheet.row(160.0, vec![(1.0, x, y, Some("In the learned map"))]);
    for mut p in row {
        for (i, curve) in curves.iter().enumerate() {
            p.line(curve, thin(runs.len(), i).0, thin(runs.len(), i).1, 0.7);
        }
        let spread = spread(&curves);
        if !spread.is_empty() {
            draw_spread(&mut p, &spread, false);
        }
        sheet.add(p);
    }
    note
}

/// Colour and dash of one run: its own while there are few.
fn thin(runs: usize, i: usize) -> (&'static str, Dash) {
    const CLASSES: [&str; MOST_NAMED] = ["s0", "s1", "s2", "s3", "s4", "s5", "s6"];
    const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::Chain, Dash::Dotted];
    if runs > MOST_NAMED { ("ref", Dash::Solid) } else { (CLASSES[i % CLASSES.len()], DASHES[i % DASHES.len()]) }
}

fn on_robot(sheet: &mut Sheet, runs: &[RunCurve], reward: &str, notes: &mut String) -> Vec<Spread> {
    let curves: Vec<Vec<(f64, f64)>> = runs.iter().map(RunCurve::points).collect();
    let values: Vec<f64> = curves.iter().flatten().map(|p| p.1).collect();
    let last = curves.iter().flatten().map(|p| p.0).fold(1.0, f64::max);
    let y = reward_axis(&format!("{reward} on the robot"), &values);
    if notes.is_empty() {
        *notes = scale_note(&y);
    }
    let spread = spread(&curves);
    let x = Axis::counting("strides on the robot so far", -0.02 * last, last * 1.02);
    let row = sheet.row(250.0, vec![(1.0, x, y, Some("On the robot"))]);
    for mut p in row {
        if !spread.is_empty() {
            draw_spread(&mut p, &spread, true);
        }
        for (i, (r, points)) in runs.iter().zip(&curves).enumerate() {
            let (class, dash) = thin(runs.len(), i);
            let stroke = if spread.is_empty() { 2.0 } else { 1.1 };
            p.line(points, class, dash, stroke);
            if runs.len() <= MOST_NAMED {
                p.marks(points, class, Mark::Disc, 3.0);
                p.key(&r.name, Key::Both(class, dash, Mark::Disc));
            }
            for (x, y) in points {
                p.hover(*x, *y, format!("{}: {reward} {} after {x} strides", r.name, number(*y, 3)));
            }
        }
        if runs.len() > MOST_NAMED {
            p.key("one run", Key::Line("ref", Dash::Solid));
        }
        sheet.add(p);
    }
    spread
}
