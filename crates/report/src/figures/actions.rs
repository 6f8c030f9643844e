//! What the robot was asked to do: the action of every stride, and where it was allowed to lie.

use super::check::some;
use super::names::{label, quantity};
use crate::draw::{Anchor, Axis, Dash, Key, Mark, Panel, Sheet, extent, plain, plural, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::{Columns, GuardWarning, Region, StridePhase, Transition, Verdict, Warning};

/// What is known of an iteration beside its strides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionIteration {
    /// From 1.
    pub iteration: usize,
    /// Where its policy was allowed to lie.
    pub region: Option<Region>,
    /// What became of its policy on the robot: `proven`, `slower`, `warned`, ...
    pub verdict: Option<Verdict>,
    /// Warnings of the guard.
    pub warnings: Vec<GuardWarning>,
}

/// The actions of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionFigure {
    /// Names of state and action.
    pub columns: Columns,
    /// Training and evaluation strides, in order.
    pub strides: Vec<Transition>,
    /// What is known of the iterations; may be empty.
    pub iterations: Vec<ActionIteration>,
    /// The action of the policy that the run recommends, where it was proven.
    pub proven: Option<Vec<f64>>,
}

/// Strides of one iteration: from, to (not included).
fn spans(strides: &[Transition]) -> Vec<(usize, usize, usize)> {
    let mut from = 0;
    strides
        .chunk_by(|a, b| a.iteration == b.iteration)
        .map(|chunk| {
            from += chunk.len();
            (chunk[0].iteration, from - chunk.len(), from)
        })
        .collect()
}

/// Plain words for what the guard saw.
pub(crate) const fn warning_words(warning: Warning) -> &'static str {
    match warning {
        Warning::Flip => "left and right strides differ more and more",
        Warning::Turn => "the robot turns",
        Warning::LowRoll => "the mass is near the outer edge of the foot",
        Warning::HighMeanRoll => "the mass sways less and less far over the foot",
    }
}

/// Plain words for what became of a policy.
pub(crate) const fn verdict_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Proven => "proven",
        Verdict::Slower => "no faster than the best one",
        Verdict::Warned => "turned back by the guard",
        Verdict::Fell => "fell",
        Verdict::Unfinished => "not finished: no strides left",
    }
}

/// Draws each component of the action over the strides on the robot, with the trust region of each
/// iteration, the warnings of the guard, and the proven action.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) without a stride.
pub fn actions(data: &ActionFigure) -> Result<Figure> {
    let stem = "actions";
    some(stem, "no stride", data.strides.len())?;
    some(stem, "no action", data.columns.action.len())?;
    let n = data.strides.len();
    let mut sheet = Sheet::new(stem, "What the robot was asked to do, stride by stride");
    let several = data.columns.action.len() > 1;
    let per_row = if several { 2 } else { 1 };
    let indices: Vec<usize> = (0..data.columns.action.len()).collect();
    let rows = indices.len().div_ceil(per_row);
    for (r, chunk) in indices.chunks(per_row).enumerate() {
        let titles: Vec<String> = chunk.iter().map(|a| label(&data.columns.action[*a], "")).collect();
        let specs = chunk
            .iter()
            .zip(&titles)
            .map(|(a, title)| {
                let values = data.strides.iter().filter_map(|s| s.action.get(*a).copied());
                let edges = data.iterations.iter().filter_map(|i| i.region.as_ref());
                let edges = edges.flat_map(|g| [g.lower.get(*a), g.upper.get(*a)]);
                let (lo, hi) = extent(values.chain(edges.flatten().copied()));
                let most = if several { 4.0 } else { 6.0 };
                let air = if hi - lo > 1e-6 { 0.06 * (hi - lo) } else { 0.3 };
                // Head room for the warnings, or for the names of the iterations.
                let y = Axis::linear_with("", lo - air, hi + 3.0 * air, most);
                let last = r + 1 == rows;
                let x = Axis::counting(if last { "stride on the robot" } else { "" }, 0.5, n as f64 + 0.5);
                (1.0, x, y, Some(title.as_str()))
            })
            .collect();
        let height = if several { 104.0 } else { 200.0 };
        for (a, mut p) in chunk.iter().zip(sheet.row(height, specs)) {
            component(&mut p, data, *a);
            sheet.add(p);
        }
    }
    Ok(sheet.finish(&caption(data), &alt(data), csv(data)))
}

fn component(p: &mut Panel, data: &ActionFigure, a: usize) {
    let top = p.y.max - 0.06 * (p.y.max - p.y.min);
    for (iteration, from, to) in spans(&data.strides) {
        let (begin, end) = (from as f64 + 0.5, to as f64 + 0.5);
        if from > 0 {
            p.upward(begin, "ref", Dash::Dotted);
        }
        let known = data.iterations.iter().find(|i| i.iteration == iteration);
        let proof = data.strides[from..to]
            .iter()
            .position(|s| s.phase == StridePhase::Evaluate)
            .map(|i| (from + i) as f64 + 0.5);
        let region = known.and_then(|k| k.region.as_ref());
        if let (Some(g), Some(begin)) = (region, proof)
            && let (Some(lo), Some(hi)) = (g.lower.get(a), g.upper.get(a))
        {
            p.band(&[begin, end], &[*lo; 2], &[*hi; 2], "s5", 0.28);
            p.key("trust region", Key::Band("s5", 0.28));
        }
        // The iterations are named where there is room.
        let room = p.px(end) - p.px(begin);
        if data.columns.action.len() == 1 && room > 66.0 {
            let (x, y) = (p.px(begin) + 5.0, p.top + 12.0);
            p.note_px(x, y, Anchor::Start, "mut", &format!("iteration {iteration}"));
        }
    }
    if let Some(u) = data.proven.as_ref().and_then(|u| u.get(a)) {
        p.across(*u, "s2", Dash::Dashed);
        p.key("final policy, mean as proven", Key::Line("s2", Dash::Dashed));
    }
    // Among hundreds of strides rims would hide what is behind them; the trust region then tells apart, too.
    let many = data.strides.len() > 120;
    let r = if many { 2.6 } else { 3.2 };
    let shape = |mark| if many { Mark::Dot } else { mark };
    for (evaluate, class, mark, name) in [
        (false, "s0", shape(Mark::Disc), "exploring or sampling"),
        (true, "s1", shape(Mark::Diamond), "trying a policy"),
    ] {
        let points: Vec<(f64, f64)> = data
            .strides
            .iter()
            .enumerate()
            .filter(|(_, s)| (s.phase == StridePhase::Evaluate) == evaluate && s.end == StrideEnd::Crossing)
            .filter_map(|(i, s)| Some((i as f64 + 1.0, *s.action.get(a)?)))
            .collect();
        if !points.is_empty() {
            p.marks(&points, class, mark, r);
            p.key(name, Key::Mark(class, mark));
        }
    }
    let falls: Vec<(f64, f64)> = data
        .strides
        .iter()
        .enumerate()
        .filter(|(_, s)| s.end != StrideEnd::Crossing)
        .filter_map(|(i, s)| Some((i as f64 + 1.0, *s.action.get(a)?)))
        .collect();
    if !falls.is_empty() {
        p.marks(&falls, "s6", Mark::Cross, 4.0);
        p.key("fall or stall", Key::Mark("s6", Mark::Cross));
    }
    let (name, unit) = quantity(&data.columns.action[a]);
    for (i, s) in data.strides.iter().enumerate() {
        let Some(u) = s.action.get(a) else { continue };
        p.hover(
            i as f64 + 1.0,
            *u,
            format!("stride {}, iteration {}: {name} = {} {unit}, {}", i + 1, s.iteration, signed(*u, 2), s.end.name()),
        );
    }
    for (at, warning) in warnings(data) {
        p.marks(&[(at, top)], "s3", Mark::Triangle, 4.0);
        p.key("guard warned", Key::Mark("s3", Mark::Triangle));
        p.hover(at, top, format!("stride {at}: the guard warned, {}", warning_words(warning)));
    }
}

/// Stride of each warning, counted over the run, and what was seen.
fn warnings(data: &ActionFigure) -> Vec<(f64, Warning)> {
    let spans = spans(&data.strides);
    data.iterations
        .iter()
        .flat_map(|i| {
            let from = spans.iter().find(|s| s.0 == i.iteration).map(|s| s.1);
            i.warnings.iter().filter_map(move |w| Some(((from? + w.stride) as f64, w.warning)))
        })
        .filter(|w| w.0 <= data.strides.len() as f64)
        .collect()
}

fn caption(data: &ActionFigure) -> String {
    let names: Vec<String> = data.columns.action.iter().map(|a| plain(&label(a, ""))).collect();
    let tried = data.strides.iter().filter(|s| s.phase == StridePhase::Evaluate).count();
    let mut text = format!(
        "Action of each stride on the robot, as applied, without averaging (n = {}, of which {tried} tried a policy); dotted \
         uprights part the iterations.",
        plural(data.strides.len(), "stride")
    );
    if data.columns.action.len() > 1 {
        text.push_str(&format!(" One panel per component: {}.", names.join(", ")));
    }
    if data.iterations.iter().any(|i| i.region.is_some()) {
        text.push_str(
            " Bands: where the policy of the iteration was allowed to lie; a policy climbs to its action by a bounded step a \
             stride, and backs off after a warning.",
        );
    }
    let warned = warnings(data);
    if !warned.is_empty() {
        let mut kinds: Vec<Warning> = warned.iter().map(|w| w.1).collect();
        kinds.sort_unstable_by_key(|kind| kind.name());
        let counts: Vec<String> =
            kinds.chunk_by(|a, b| a == b).map(|c| format!("{}, {}", warning_words(c[0]), times(c.len()))).collect();
        text.push_str(&format!(" Triangles: the guard warned ({}).", counts.join("; ")));
    }
    let verdicts: Vec<String> = data
        .iterations
        .iter()
        .filter_map(|i| Some((i.iteration, i.verdict?)))
        .map(|(i, v)| format!("{i} {}", verdict_words(v)))
        .collect();
    if !verdicts.is_empty() {
        text.push_str(&format!(" What became of the policy of each iteration: {}.", verdicts.join("; ")));
    }
    text
}

fn times(n: usize) -> String {
    match n {
        1 => "once".to_owned(),
        2 => "twice".to_owned(),
        n => format!("{n} times"),
    }
}

fn alt(data: &ActionFigure) -> String {
    format!(
        "Action over {} on the robot, {}; the guard warned {} times.",
        plural(data.strides.len(), "stride"),
        plural(data.columns.action.len(), "component"),
        warnings(data).len()
    )
}

fn csv(data: &ActionFigure) -> String {
    let mut header = vec!["stride".to_owned(), "iteration".to_owned(), "phase".to_owned()];
    header.extend(data.columns.action.iter().cloned());
    header.extend(data.columns.action.iter().flat_map(|a| [format!("trust_lower_{a}"), format!("trust_upper_{a}")]));
    header.extend(["warning".to_owned(), "end".to_owned()]);
    let mut csv = header.join(",") + "\n";
    let warned = warnings(data);
    for (i, s) in data.strides.iter().enumerate() {
        csv.push_str(&format!("{},{},{}", i + 1, s.iteration, s.phase.name()));
        for u in &s.action {
            csv.push_str(&format!(",{u}"));
        }
        let region = data
            .iterations
            .iter()
            .find(|k| k.iteration == s.iteration && s.phase == StridePhase::Evaluate)
            .and_then(|k| k.region.as_ref());
        for a in 0..data.columns.action.len() {
            let edge = |of: fn(&Region) -> &Vec<f64>| {
                region.and_then(|g| of(g).get(a)).map_or_else(String::new, f64::to_string)
            };
            csv.push_str(&format!(",{},{}", edge(|g| &g.lower), edge(|g| &g.upper)));
        }
        let warning = warned.iter().find(|w| w.0 as usize == i + 1);
        let warning = warning.map_or("", |w| w.1.name());
        csv.push_str(&format!(",{warning},{}\n", s.end.name()));
    }
    csv
}
