//! What the robot was asked to do: the action of every stride, and where it was allowed to lie.

use super::check::some;
use super::names::{label, quantity};
use super::of_run::iterations;
use crate::draw::{Anchor, Axis, Dash, Key, Mark, N, Panel, Sheet, extent, plain, plural, times};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::{IterationSummary, Region, Run, StridePhase, Transition, Verdict, Warning};

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
pub fn actions(run: &Run) -> Result<Figure> {
    let stem = "actions";
    let (strides, names) = (&run.transitions, &run.columns.action);
    some(stem, "no stride", strides.len())?;
    some(stem, "no action", names.len())?;
    let mut sheet = Sheet::new(stem, "What the robot was asked to do, stride by stride");
    let several = names.len() > 1;
    let (per_row, height, most) = if several { (2, 104.0, 4.0) } else { (1, 200.0, 6.0) };
    let titles: Vec<String> = names.iter().map(|name| label(name, "")).collect();
    let spec = |a: usize| {
        let values = strides.iter().filter_map(|s| s.action.get(a).copied());
        let edges = iterations(run).iter().filter_map(|i| i.trust_region.as_ref());
        let edges = edges.flat_map(|g| [g.lower.get(a), g.upper.get(a)]);
        let (lo, hi) = extent(values.chain(edges.flatten().copied()));
        let air = if hi - lo > 1e-6 { 0.06 * (hi - lo) } else { 0.3 };
        // Head room for the warnings, or for the names of the iterations.
        let y = Axis::linear_with("", lo - air, hi + 3.0 * air, most);
        let in_last_row = a / per_row == (names.len() - 1) / per_row;
        let x = if in_last_row { "stride on the robot" } else { "" };
        (1.0, Axis::counting(x, 0.5, strides.len() as f64 + 0.5), y, Some(titles[a].as_str()))
    };
    let components: Vec<usize> = (0..names.len()).collect();
    for chunk in components.chunks(per_row) {
        for (a, mut p) in chunk.iter().zip(sheet.row(height, chunk.iter().map(|a| spec(*a)).collect())) {
            component(&mut p, run, *a);
            sheet.add(p);
        }
    }
    let alt = format!(
        "Action over {} on the robot, {}; the guard warned {} times.",
        plural(strides.len(), "stride"),
        plural(names.len(), "component"),
        warnings(run).len()
    );
    Ok(sheet.finish(&caption(run), &alt, csv(run)))
}

fn component(p: &mut Panel, run: &Run, a: usize) {
    let top = p.y.max - 0.06 * (p.y.max - p.y.min);
    for (iteration, from, to) in spans(&run.transitions) {
        let (begin, end) = (from as f64 + 0.5, to as f64 + 0.5);
        if from > 0 {
            p.upward(begin, "ref", Dash::Dotted);
        }
        let known = iterations(run).iter().find(|i| i.iteration == iteration);
        let proof = run.transitions[from..to]
            .iter()
            .position(|s| s.phase == StridePhase::Evaluate)
            .map(|i| (from + i) as f64 + 0.5);
        let region = known.and_then(|k| k.trust_region.as_ref());
        if let (Some(g), Some(begin)) = (region, proof)
            && let (Some(lo), Some(hi)) = (g.lower.get(a), g.upper.get(a))
        {
            p.band(&[begin, end], &[*lo; 2], &[*hi; 2], "s5", 0.28);
            p.key("trust region", Key::Band("s5", 0.28));
        }
        // The iterations are named where there is room.
        let room = p.px(end) - p.px(begin);
        if run.columns.action.len() == 1 && room > 66.0 {
            let (x, y) = (p.px(begin) + 5.0, p.top + 12.0);
            p.note_px(x, y, Anchor::Start, "mut", &format!("iteration {iteration}"));
        }
    }
    if let Some(u) = proven(run).and_then(|u| u.get(a)) {
        p.across(*u, "s2", Dash::Dashed);
        p.key("final policy, mean as proven", Key::Line("s2", Dash::Dashed));
    }
    // Among hundreds of strides rims would hide what is behind them; the trust region then tells apart, too.
    let many = run.transitions.len() > 120;
    let r = if many { 2.6 } else { 3.2 };
    let shape = |mark| if many { Mark::Dot } else { mark };
    let points = |keep: &dyn Fn(&Transition) -> bool| -> Vec<(f64, f64)> {
        let kept = run.transitions.iter().enumerate().filter(|(_, s)| keep(s));
        kept.filter_map(|(i, s)| Some((i as f64 + 1.0, *s.action.get(a)?))).collect()
    };
    let crossed = |s: &Transition| s.end == StrideEnd::Crossing;
    let tried = |s: &Transition| s.phase == StridePhase::Evaluate;
    p.scatter("exploring or sampling", &points(&|s| crossed(s) && !tried(s)), "s0", shape(Mark::Disc), r);
    p.scatter("trying a policy", &points(&|s| crossed(s) && tried(s)), "s1", shape(Mark::Diamond), r);
    p.scatter("fall or stall", &points(&|s| !crossed(s)), "s6", Mark::Cross, 4.0);
    let (name, unit) = quantity(&run.columns.action[a]);
    for (i, s) in run.transitions.iter().enumerate() {
        let Some(u) = s.action.get(a) else { continue };
        let (k, iteration, end) = (i + 1, s.iteration, s.end.name());
        p.hover(k as f64, *u, format!("stride {k}, iteration {iteration}: {name} = {:.2} {unit}, {end}", N(*u)));
    }
    for (at, warning) in warnings(run) {
        p.marks(&[(at, top)], "s3", Mark::Triangle, 4.0);
        p.key("guard warned", Key::Mark("s3", Mark::Triangle));
        p.hover(at, top, format!("stride {at}: the guard warned, {}", warning_words(warning)));
    }
}

/// The action of the policy that the run recommends, where it was proven.
fn proven(run: &Run) -> Option<&Vec<f64>> {
    let chosen = run.summary.as_ref()?.final_iteration?;
    Some(&iterations(run).iter().find(|i| i.iteration == chosen)?.proof.as_ref()?.action)
}

/// Stride of each warning, counted over the run, and what was seen.
fn warnings(run: &Run) -> Vec<(f64, Warning)> {
    let spans = spans(&run.transitions);
    iterations(run)
        .iter()
        .flat_map(|i| {
            let from = spans.iter().find(|s| s.0 == i.iteration).map(|s| s.1);
            i.warnings.iter().filter_map(move |w| Some(((from? + w.stride) as f64, w.warning)))
        })
        .filter(|w| w.0 <= run.transitions.len() as f64)
        .collect()
}

fn caption(run: &Run) -> String {
    let names: Vec<String> = run.columns.action.iter().map(|a| plain(&label(a, ""))).collect();
    let tried = run.transitions.iter().filter(|s| s.phase == StridePhase::Evaluate).count();
    let mut text = format!(
        "Action of each stride on the robot, as applied, without averaging (n = {}, of which {tried} tried a policy); dotted \
         uprights part the iterations.",
        plural(run.transitions.len(), "stride")
    );
    if run.columns.action.len() > 1 {
        text.push_str(&format!(" One panel per component: {}.", names.join(", ")));
    }
    if iterations(run).iter().any(|i| i.trust_region.is_some()) {
        text.push_str(
            " Bands: where the policy of the iteration was allowed to lie; a policy climbs to its action by a bounded step a \
             stride, and backs off after a warning.",
        );
    }
    let warned = warnings(run);
    if !warned.is_empty() {
        let mut kinds: Vec<Warning> = warned.iter().map(|w| w.1).collect();
        kinds.sort_unstable_by_key(|kind| kind.name());
        let counts: Vec<String> =
            kinds.chunk_by(|a, b| a == b).map(|c| format!("{}, {}", warning_words(c[0]), times(c.len()))).collect();
        text.push_str(&format!(" Triangles: the guard warned ({}).", counts.join("; ")));
    }
    let tried = iterations(run).iter().filter_map(|i| Some((i.iteration, i.proof.as_ref()?.verdict)));
    let verdicts: Vec<String> = tried.map(|(i, v)| format!("{i} {}", verdict_words(v))).collect();
    if !verdicts.is_empty() {
        text.push_str(&format!(" What became of the policy of each iteration: {}.", verdicts.join("; ")));
    }
    text
}

fn csv(run: &Run) -> String {
    let mut header = vec!["stride".to_owned(), "iteration".to_owned(), "phase".to_owned()];
    header.extend(run.columns.action.iter().cloned());
    header.extend(run.columns.action.iter().flat_map(|a| [format!("trust_lower_{a}"), format!("trust_upper_{a}")]));
    header.extend(["warning".to_owned(), "end".to_owned()]);
    let mut csv = header.join(",") + "\n";
    let warned = warnings(run);
    for (i, s) in run.transitions.iter().enumerate() {
        csv += &format!("{},{},{}", i + 1, s.iteration, s.phase.name());
        s.action.iter().for_each(|u| csv += &format!(",{u}"));
        let tries = |k: &&IterationSummary| k.iteration == s.iteration && s.phase == StridePhase::Evaluate;
        let region = iterations(run).iter().find(tries).and_then(|k| k.trust_region.as_ref());
        for a in 0..run.columns.action.len() {
            let edge = |of: fn(&Region) -> &Vec<f64>| {
                region.and_then(|g| of(g).get(a)).map_or_else(String::new, f64::to_string)
            };
            csv += &format!(",{},{}", edge(|g| &g.lower), edge(|g| &g.upper));
        }
        let warning = warned.iter().find(|w| w.0 as usize == i + 1);
        let warning = warning.map_or("", |w| w.1.name());
        csv += &format!(",{warning},{}\n", s.end.name());
    }
    csv
}
