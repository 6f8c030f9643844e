//! Return maps: under pushes (Fig. 10 of the paper), and of gaits that were not pushed.

use super::check::{column, some};
use super::names::{label, quantity};
use super::of_run::{measured, recorded, target};
use super::paper::PSI;
use crate::draw::{Anchor, Axis, Dash, Key, Mark, N, Panel, Sheet, extent, plural, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::{PushOutcome, ReturnMapLine, Run, Transition};

/// A return map under pushes, `lag` strides on: pairs of states, and slope and fixed point of the line through them.
struct Pushed<'a> {
    name: &'a str,
    /// ψ at the section after the push, ψ `lag` strides later, the force.
    pairs: Vec<[f64; 3]>,
    line: Option<(f64, f64)>,
    falls: usize,
}

impl<'a> Pushed<'a> {
    fn of(name: &'a str, outcome: &PushOutcome, lag: usize) -> Self {
        let after = |pair: &stridemap_record::PushPair| match lag {
            1 => pair.psi_roll_after_1_deg,
            _ => pair.psi_roll_after_2_deg,
        };
        let pairs = outcome.data.iter().map(|pair| [pair.psi_roll_deg, after(pair), pair.force_n]);
        Self {
            name,
            // Tables of earlier versions do not know the section between.
            pairs: pairs.filter(|[_, next, _]| lag != 1 || next.is_finite()).collect(),
            line: match lag {
                1 => outcome.after_1.and_then(|line| Some((line.slope, line.fixed_point_deg?))),
                _ => outcome.slope.zip(outcome.fixed_point_deg),
            },
            falls: outcome.falls,
        }
    }

    fn draw(&self, p: &mut Panel, target: Option<f64>) {
        identity_and_target(p, target);
        let points: Vec<(f64, f64)> = self.pairs.iter().map(|[psi, next, _]| (*psi, *next)).collect();
        p.marks(&points, "s0", Mark::Dot, 4.2);
        for pair in &self.pairs {
            let [psi, next, force] = pair.map(N);
            p.hover(psi.0, next.0, format!("{}: {psi:.2} to {next:.2} deg, push {force:.1} N", self.name));
        }
        if let Some((slope, fixed)) = self.line {
            let at = |x: f64| fixed + slope * (x - fixed);
            p.line(&[(p.x.min, at(p.x.min)), (p.x.max, at(p.x.max))], "s1", Dash::Dashed, 2.2);
            p.marks(&[(fixed, fixed)], "s1", Mark::Circle, 6.0);
            p.hover(fixed, fixed, format!("{}: fixed point {:.2} deg", self.name, N(fixed)));
            let (x, y) = (p.left + p.width - 6.0, p.top + p.height - 26.0);
            p.note_px(x, y, Anchor::End, "", &format!("slope {:.2}", N(slope)));
            p.note_px(x, y + 16.0, Anchor::End, "", &format!("fixed point {:.2}°", N(fixed)));
        }
        p.key("pairs", Key::Mark("s0", Mark::Dot));
        p.key("linear fit", Key::Line("s1", Dash::Dashed));
        p.key("fixed point", Key::Mark("s1", Mark::Circle));
        p.key("identity", Key::Line("ref", Dash::Solid));
    }

    fn said(&self) -> String {
        let line = match self.line {
            Some((slope, fixed)) => format!("slope {:.2}, fixed point {:.2} deg", N(slope), N(fixed)),
            None => "too few pairs for a line".to_owned(),
        };
        let falls = if self.falls == 0 { "no fall".to_owned() } else { plural(self.falls, "fall") };
        format!("{}: {line} (n = {} pairs, {falls})", self.name, self.pairs.len())
    }
}

fn identity_and_target(p: &mut Panel, target: Option<f64>) {
    p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 1.1);
    if let Some(target) = target {
        p.upward(target, "ref", Dash::Dotted);
        p.across(target, "ref", Dash::Dotted);
        p.key("desired state", Key::Line("ref", Dash::Dotted));
    }
}

/// Draws Fig. 10: pairs two strides apart, linear fit (dashed), identity, fixed point (circle), all panels on equal
/// axes. `pushed` names what was pushed, at most three; `target_deg` is the desired state, if the task has one.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no pair, or a value that is not finite.
pub fn fig10(pushed: &[(&str, &PushOutcome)], target_deg: Option<f64>) -> Result<Figure> {
    under_pushes("fig10", 2, pushed, target_deg)
}

/// The same as [`fig10`] one stride after the push.
///
/// # Errors
///
/// As [`fig10`].
pub fn pushed_one_stride(pushed: &[(&str, &PushOutcome)], target_deg: Option<f64>) -> Result<Figure> {
    under_pushes("push-1", 1, pushed, target_deg)
}

fn under_pushes(stem: &str, lag: usize, pushed: &[(&str, &PushOutcome)], target: Option<f64>) -> Result<Figure> {
    let mut maps: Vec<Pushed<'_>> = pushed.iter().map(|(name, outcome)| Pushed::of(name, outcome, lag)).collect();
    maps.retain(|map| lag != 1 || !map.pairs.is_empty());
    some(stem, "pairs", maps.iter().map(|m| m.pairs.len()).sum())?;
    let states = |map: &Pushed<'_>| -> Vec<f64> { map.pairs.iter().flat_map(|q| [q[0], q[1]]).collect() };
    for map in &maps {
        column(stem, map.name, &states(map), 2 * map.pairs.len())?;
    }
    let axis = |label: String| Axis::covering(&label, maps.iter().flat_map(states));
    let panels = maps
        .iter()
        .map(|m| (1.0, axis(format!("{PSI}(k) (deg)")), axis(format!("{PSI}(k + {lag}) (deg)")), Some(m.name)))
        .collect();
    let on = if lag == 1 { ", one stride on" } else { "" };
    let mut sheet = Sheet::new(stem, &format!("Return map under pushes{on}"));
    let drawn = sheet.row(if maps.len() > 2 { 200.0 } else { 285.0 }, panels);
    for (mut p, map) in drawn.into_iter().zip(&maps) {
        map.draw(&mut p, target);
        sheet.add(p);
    }
    let mut csv = format!("map,psi_roll_deg,psi_roll_after_{lag}_deg,force_n\n");
    for (name, [psi, next, force]) in maps.iter().flat_map(|m| m.pairs.iter().map(move |q| (m.name, q))) {
        csv += &format!("{},{psi},{next},{force}\n", name.replace(',', " "));
    }
    let outcome = pushed[0].1;
    let push = format!(
        " Lateral pushes, uniform within ±{} N, for {} s.",
        signed(outcome.force_n, 0),
        signed(outcome.duration_s, 1)
    );
    let said: Vec<String> = maps.iter().map(Pushed::said).collect();
    let target = target.map_or_else(String::new, |t| format!(" Dotted: the desired state, {:.1} deg.", N(t)));
    let (figure, later, paper) = match lag {
        1 => ("", "one stride later, on the other leg", ""),
        _ => (
            "Fig. 10 of the paper. ",
            "two strides later",
            " The paper: \u{201c}coefficient much smaller than one\u{201d}, fixed point 2.3 deg for a target of 2.0 deg.",
        ),
    };
    let caption = format!(
        "{figure}State at a section against the state {later}, k being the first section after a push.{push} Each point is \
         one pair, without averaging; dashed: least squares; circle: where it meets the identity. {}.{target}{paper}",
        said.join("; ")
    );
    let each: Vec<String> = maps
        .iter()
        .map(|m| match m.line {
            Some((slope, _)) => format!("{} with slope {:.2}", m.name, N(slope)),
            None => m.name.to_owned(),
        })
        .collect();
    let later = later.trim_end_matches(", on the other leg");
    let alt = format!("Scatter plots of psi_roll {later} against psi_roll after a push: {}.", each.join("; "));
    Ok(sheet.finish(&caption, &alt, csv))
}

/// Unbroken stretches of the first component of the state at successive sections.
fn stretches(strides: &[&Transition]) -> Vec<Vec<f64>> {
    let crossed: Vec<(&&Transition, f64)> = strides
        .iter()
        .filter(|s| s.end == StrideEnd::Crossing)
        .filter_map(|s| Some((s, *s.next_state.first()?)))
        .collect();
    let stretches = crossed.chunk_by(|(a, _), (b, _)| a.episode == b.episode && b.k == a.k + 1);
    stretches.map(|stretch| stretch.iter().map(|s| s.1).collect()).collect()
}

fn pairs(stretches: &[Vec<f64>], lag: usize) -> Vec<(f64, f64)> {
    stretches
        .iter()
        .flat_map(|s| s.iter().zip(s.iter().skip(lag)).map(|(a, b)| (*a, *b)))
        .filter(|(a, b)| a.is_finite() && b.is_finite())
        .collect()
}

/// A gait that was not pushed: its name, its states, the lines of its return maps, and how it is drawn.
struct Undisturbed {
    name: &'static str,
    stretches: Vec<Vec<f64>>,
    lines: [Option<ReturnMapLine>; 2],
    class: &'static str,
    mark: Mark,
    dash: Dash,
}

impl Undisturbed {
    /// Nominal gait and final policy, as far as the run measured them.
    fn of(run: &Run) -> Vec<Self> {
        let [nominal, last] = measured(run);
        let is_psi = run.columns.state.first().is_some_and(|name| name.starts_with("psi_roll"));
        [
            ("nominal", "nominal gait", nominal, "s1", Mark::Diamond, Dash::Dashed),
            ("final", "final policy", last, "s2", Mark::Disc, Dash::Solid),
        ]
        .into_iter()
        .map(|(what, name, measured, class, mark, dash)| {
            // The lines are those of psi_roll.
            let p = measured.filter(|_| is_psi).map(|m| m.performance);
            let lines = p.map_or([None; 2], |p| [p.return_map_1, p.return_map_2]);
            Self { name, stretches: stretches(&recorded(run, what)), lines, class, mark, dash }
        })
        .filter(|gait| !gait.stretches.is_empty())
        .collect()
    }

    /// Draws it `lag` strides on, and says its numbers.
    fn draw(&self, p: &mut Panel, lag: usize, unit: &str) -> String {
        let points = pairs(&self.stretches, lag);
        let line = self.lines[lag - 1].and_then(|l| Some((l, l.fixed_point_deg?)));
        if let Some((line, fixed)) = line {
            let (lo, hi) = extent(points.iter().map(|q| q.0));
            let air = 0.05 * (hi - lo);
            let at = |x: f64| (x, fixed + line.slope * (x - fixed));
            p.line(&[at(lo - air), at(hi + air)], self.class, self.dash, 1.8);
        }
        p.marks(&points, self.class, self.mark, 3.2);
        for (a, b) in &points {
            p.hover(*a, *b, format!("{}: {:.2} to {:.2} after {lag}", self.name, N(*a), N(*b)));
        }
        let n = points.len();
        let said = match line {
            Some((line, fixed)) => {
                let [slope, error, at] = [line.slope, line.slope_std_error, fixed].map(N);
                p.marks(&[(fixed, fixed)], self.class, Mark::Circle, 6.0);
                let text = format!("{}: fixed point {at:.2} {unit}, slope {slope:.2} ± {error:.2}", self.name);
                p.hover(fixed, fixed, text);
                p.key("fixed point", Key::Mark("s6", Mark::Circle));
                format!("slope {slope:.2} ± {error:.2}, fixed point {at:.2} {unit} (n = {n} pairs)")
            }
            None => format!("no line (n = {n} pairs)"),
        };
        p.key(self.name, Key::Both(self.class, self.dash, self.mark));
        format!("{} to k + {lag}: {said}", self.name)
    }
}

/// Draws the return maps k to k + 1 and k to k + 2 of nominal gait and final policy without pushes: the pairs, their
/// lines and fixed points, and the identity.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if no gait has two strides in a row.
pub fn undisturbed_return_maps(run: &Run) -> Result<Figure> {
    let stem = "return-map";
    let (gaits, target) = (Undisturbed::of(run), target(run));
    some(stem, "no two strides in a row", gaits.iter().map(|g| pairs(&g.stretches, 1).len()).sum())?;
    let name = run.columns.state.first().map_or("", String::as_str);
    let values = || gaits.iter().flat_map(|g| g.stretches.iter().flatten().copied()).chain(target);
    let axis = |argument: &str| Axis::covering(&label(name, argument), values());
    let mut sheet = Sheet::new(stem, "Return maps without pushes");
    let specs = [("(k + 1)", "One stride on"), ("(k + 2)", "Two strides on")];
    let specs = specs.map(|(next, title)| (1.0, axis("(k)"), axis(next), Some(title)));
    let mut csv = format!("run,lag,{name},next_{name}\n");
    let unit = quantity(name).1;
    let mut said = Vec::new();
    for (lag, mut p) in (1..).zip(sheet.row(285.0, specs.into())) {
        identity_and_target(&mut p, target);
        for gait in &gaits {
            said.push(gait.draw(&mut p, lag, unit));
            for (a, b) in pairs(&gait.stretches, lag) {
                csv += &format!("{},{lag},{a},{b}\n", gait.name);
            }
        }
        p.key("identity", Key::Line("ref", Dash::Solid));
        sheet.add(p);
    }
    let said = said.join("; ");
    let caption = format!(
        "State at a section against the state one (left) and two (right) strides later, without pushes, deterministic policy, \
         strides run only to report, the start-up included; each point is one pair, without averaging. Lines: least squares, \
         slope ± its standard error; circles: where they meet the identity, the state to which the gait returns. {said}. A slope \
         within ±1 says that it does return; little spread, as in a gait that has settled, makes it uncertain."
    );
    let alt = format!("Return maps one and two strides on, without pushes. {said}.");
    Ok(sheet.finish(&caption, &alt, csv))
}
