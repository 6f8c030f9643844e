//! What happened during a run: rewards per trial and stride, states per stride.

use super::check::{present, some};
use super::names::{label, quantity, reward_axis, scale_note};
use super::of_run::{iterations, mean_reward, measured, recorded, target};
use crate::draw::{Anchor, Axis, Dash, Key, Mark, N, Panel, Sheet, extent, number, numbered, plain, plural, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::{LearningRow, Run, StridePhase, StrideRole, Transition, World};

/// Separators and numbers of iterations along a sequence.
fn part_iterations(p: &mut Panel, of: impl IntoIterator<Item = usize>) {
    let of: Vec<usize> = of.into_iter().collect();
    let mut end = 0;
    for chunk in of.chunk_by(|a, b| a == b) {
        let start = end;
        end += chunk.len();
        if start > 0 {
            p.upward(start as f64 + 0.5, "ref", Dash::Dotted);
        }
        let x = p.px(start as f64 + 0.5) + 5.0;
        let room = p.px(end as f64 + 0.5) - x;
        let text = if room > 66.0 { format!("iteration {}", chunk[0]) } else { chunk[0].to_string() };
        if room > 10.0 {
            p.note_px(x, p.top + 12.0, Anchor::Start, "mut", &text);
        }
    }
}

/// Head room above some values for the names of the iterations.
fn head_room(values: &[f64], share: f64) -> f64 {
    let (lo, hi) = extent(values.iter().copied());
    hi + share * (hi - lo)
}

/// The paper's number for what the task rewards, if it has one.
fn paper_says(run: &Run) -> &'static str {
    match run.reward_quantity().as_deref() {
        Some("speed_m_s") => {
            " The paper's simulated robot walked at 0.14 m/s (sec. 8.1); here the reward of a stride is its speed in m/s."
        }
        // Eq. (27) with a target of 2 deg.
        None if run.target_deg().is_some_and(|t| (t - 2.0).abs() < 1e-9) => {
            " The paper's Fig. 8 ends at about 0 after 15 trials in a map of 20 strides."
        }
        _ => "",
    }
}

/// Mean reward on the robot of the nominal gait, the best iteration and the final policy.
fn levels(run: &Run) -> [Option<f64>; 3] {
    let [nominal, last] = measured(run).map(mean_reward);
    let best = iterations(run).iter().filter_map(|i| i.mean_reward).max_by(f64::total_cmp);
    [nominal, best, last]
}

/// Draws the learning curve of a run: imagined trials above, every stride on the robot below.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if there is neither a trial nor a stride.
pub fn learning_curves(run: &Run) -> Result<Figure> {
    let stem = "learning";
    let trials: Vec<&LearningRow> = run.learning.iter().filter(|t| t.world == World::Map).collect();
    let strides = &run.transitions;
    some(stem, "no trial and no stride", trials.len() + strides.len())?;
    let mut sheet = Sheet::new(stem, "Reward in the map and on the robot");
    let notes = imagined(&mut sheet, &trials);
    rewards_on_robot(&mut sheet, run);
    let falls = strides.iter().filter(|s| s.end != StrideEnd::Crossing).count();
    let [nominal, best, last] = levels(run).map(|v| v.map_or_else(|| "not measured".to_owned(), |v| number(v, 3)));
    let above = match trials.len() {
        0 => "R".to_owned(),
        n => format!(
            "Above: average reward per stride of each trial imagined in the learned map (n = {}). Below: r",
            plural(n, "trial")
        ),
    };
    let caption = format!(
        "{above}eward of \
         each stride on the robot, training and evaluation, in order, without averaging (n = {}, {falls} ended \
         without a section). Lines: mean reward on the robot of the nominal gait ({nominal}), the best iteration ({best}) \
         and the final policy ({last}). Dotted uprights part the iterations.{notes}{}",
        plural(strides.len(), "stride"),
        paper_says(run)
    );
    let mut csv = String::from("world,iteration,index,reward,falls,strides,end\n");
    for t in &trials {
        csv += &format!("map,{},{},{},{},{},\n", t.iteration, t.trial, t.average_reward, t.falls, t.strides);
    }
    for (i, s) in strides.iter().enumerate() {
        let fell = u8::from(s.end == StrideEnd::Fell);
        csv += &format!("robot,{},{},{},{fell},1,{}\n", s.iteration, i + 1, s.reward, s.end.name());
    }
    let alt = format!(
        "Reward over {} trials in the learned map and over {} strides on the robot; nominal {nominal}, final {last}.",
        trials.len(),
        strides.len()
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// The panel of the trials in the map; returns what its axis needs said.
fn imagined(sheet: &mut Sheet, trials: &[&LearningRow]) -> String {
    if trials.is_empty() {
        return String::new();
    }
    let rewards: Vec<f64> = trials.iter().map(|t| t.average_reward).collect();
    let room = Some(head_room(&rewards, 0.14)).filter(|_| rewards.iter().any(|r| *r > 0.0));
    let shown: Vec<f64> = rewards.iter().copied().chain(room).collect();
    let y = reward_axis("average reward", &shown);
    let note = scale_note(&y);
    let x = Axis::counting("trial in the learned map", 0.5, trials.len() as f64 + 0.5);
    let mut p = sheet.single(170.0, x, y, Some("In the learned map"));
    let points = numbered(&rewards);
    part_iterations(&mut p, trials.iter().map(|t| t.iteration));
    // A new iteration is a new learner: the line breaks there.
    let mut from = 0;
    for chunk in trials.chunk_by(|a, b| a.iteration == b.iteration) {
        p.line(&points[from..from + chunk.len()], "s0", Dash::Solid, 1.3);
        from += chunk.len();
    }
    for (t, (x, y)) in trials.iter().zip(&points).step_by((trials.len() / 300).max(1)) {
        let (iteration, trial, reward) = (t.iteration, t.trial, N(*y));
        let (strides, falls) = (plural(t.strides, "stride"), plural(t.falls, "fall"));
        let text = format!("iteration {iteration}, trial {trial}: average reward {reward:#.3} over {strides}, {falls}");
        p.hover(*x, *y, text);
    }
    p.key("average reward of a trial in the map", Key::Line("s0", Dash::Solid));
    sheet.add(p);
    note
}

fn rewards_on_robot(sheet: &mut Sheet, run: &Run) {
    if run.transitions.is_empty() {
        return;
    }
    let mut rewards: Vec<f64> = run.transitions.iter().map(|s| s.reward).collect();
    let [nominal, best, last] = levels(run);
    rewards.extend([nominal, last, best].into_iter().flatten());
    // An axis that ends at zero has head room anyway.
    rewards.extend(Some(head_room(&rewards, 0.1)).filter(|_| rewards.iter().any(|r| *r > 0.0)));
    let y = reward_axis("reward", &rewards);
    let x = Axis::counting("stride on the robot", 0.5, run.transitions.len() as f64 + 0.5);
    let mut p = sheet.single(190.0, x, y, Some("On the robot"));
    part_iterations(&mut p, run.transitions.iter().map(|s| s.iteration));
    for (value, name, class, dash) in [
        (nominal, "nominal", "s1", Dash::Dashed),
        (best, "best iteration", "s3", Dash::Dotted),
        (last, "final", "s2", Dash::Solid),
    ] {
        if let Some(value) = value {
            p.across(value, class, dash);
            p.key(&format!("{name} ({})", number(value, 3)), Key::Line(class, dash));
        }
    }
    strides(&mut p, &run.transitions, |s| s.reward, "reward");
    sheet.add(p);
}

/// Which strides, colour, mark and name.
type MarkedSet<'a> = (&'a dyn Fn(&Transition) -> bool, &'static str, Mark, &'static str);

/// Strides on the robot as marks: training, evaluation, and those that ended badly.
fn strides(p: &mut Panel, rows: &[Transition], value: impl Fn(&Transition) -> f64, what: &str) {
    let ok = |s: &Transition| s.end == StrideEnd::Crossing;
    let tries = |s: &Transition| s.phase == StridePhase::Evaluate || s.role == StrideRole::Evaluation;
    let sets: [MarkedSet<'_>; 4] = [
        (&|s| ok(s) && !tries(s), "s0", Mark::Disc, "exploring or sampling"),
        (&|s| ok(s) && tries(s), "s4", Mark::Diamond, "trying the policy's mean"),
        (&|s| s.end == StrideEnd::Fell, "s1", Mark::Cross, "fall"),
        (&|s| matches!(s.end, StrideEnd::NoCrossing | StrideEnd::Aborted), "s6", Mark::Cross, "stall or abort"),
    ];
    let points = numbered(&rows.iter().map(&value).collect::<Vec<_>>());
    for (keep, class, mark, name) in sets {
        let kept: Vec<(f64, f64)> = rows.iter().zip(&points).filter(|(s, _)| keep(s)).map(|(_, p)| *p).collect();
        p.scatter(name, &kept, class, mark, 3.4);
    }
    for (s, (k, v)) in rows.iter().zip(points) {
        let (iteration, doing) = (s.iteration, if tries(s) { "trying" } else { "exploring" });
        let (shown, end) = (N(v), s.end.name());
        p.hover(k, v, format!("stride {k}, iteration {iteration} ({doing}): {what} {shown:#.3}, {end}"));
    }
}

/// Draws the first component of the state over all strides on the robot, and nominal against final, as in Fig. 14.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if there is no stride.
pub fn state_over_strides(run: &Run) -> Result<Figure> {
    let stem = "state";
    let learning: Vec<&Transition> = run.transitions.iter().collect();
    let (nominal, last) = (recorded(run, "nominal"), recorded(run, "final"));
    let total = learning.len() + nominal.len() + last.len();
    let component = run.columns.state.first().filter(|_| total > 0);
    let component = present(stem, "no stride", component)?;
    let value = |s: &Transition| s.next_state.first().copied().unwrap_or(f64::NAN);
    let desired = target(run);
    let shown = [&learning, &nominal, &last].into_iter().flatten().filter(|s| s.end != StrideEnd::Aborted);
    let all: Vec<f64> = shown.map(|s| value(s)).chain(desired).collect();
    let name = label(component, "");
    let (quantity, _) = quantity(component);
    let printed = plain(&quantity);
    let mut sheet = Sheet::new(stem, &format!("{quantity} at the section, stride by stride"));
    let mark_target = |p: &mut Panel| {
        if let Some(target) = desired {
            p.across(target, "s6", Dash::Chain);
            p.key(&format!("desired, {}", signed(target, 1)), Key::Line("s6", Dash::Chain));
        }
    };
    if !learning.is_empty() {
        let x = Axis::counting("stride on the robot while learning", 0.5, learning.len() as f64 + 0.5);
        let y = Axis::covering(&name, all.iter().copied().chain([head_room(&all, 0.14)]));
        let mut p = sheet.single(175.0, x, y, Some("While learning"));
        part_iterations(&mut p, learning.iter().map(|s| s.iteration));
        mark_target(&mut p);
        strides(&mut p, &run.transitions, value, &printed);
        sheet.add(p);
    }
    let longest = nominal.len().max(last.len());
    if longest > 0 {
        let x = Axis::counting("stride from a fresh start", 0.5, longest as f64 + 0.5);
        let mut p = sheet.single(175.0, x, Axis::covering(&name, all), Some("Before and after"));
        mark_target(&mut p);
        for (rows, class, dash, what) in
            [(&nominal, "s1", Dash::Dashed, "nominal gait"), (&last, "s2", Dash::Solid, "final policy")]
        {
            let points = numbered(&rows.iter().map(|s| value(s)).collect::<Vec<_>>());
            let fell = rows.iter().zip(&points).filter(|(s, _)| s.end == StrideEnd::Fell);
            let falls: Vec<(f64, f64)> = fell.map(|(_, q)| *q).collect();
            if !points.is_empty() {
                p.line(&points, class, dash, 1.8);
                p.marks(&falls, class, Mark::Cross, 4.0);
                p.key(what, Key::Line(class, dash));
            }
            for (x, y) in points {
                p.hover(x, y, format!("{what}, stride {x}: {printed} {:.2}", N(y)));
            }
        }
        sheet.add(p);
    }
    let count = |rows: &[&Transition]| {
        let falls = rows.iter().filter(|s| s.end == StrideEnd::Fell).count();
        format!("n = {}, {}", rows.len(), plural(falls, "fall"))
    };
    let (wanted, paper) = match desired {
        Some(t) => (
            format!(", {}", signed(t, 1)),
            " The paper's Fig. 14 (real robot): mean of strides 10 to 40 is 0.12 deg for a target of 0.0 deg.",
        ),
        None => (" (none in this task)".to_owned(), ""),
    };
    let caption = format!(
        "{} at the end of each stride, without averaging. Above: strides on the robot while learning ({}). Below: strides run \
         only to report, nominal gait ({}) and final policy ({}). Dash-dotted: the desired value{wanted}. Crosses: falls.{paper}",
        plain(&name),
        count(&learning),
        count(&nominal),
        count(&last)
    );
    let mut csv = format!("what,stride,{component},end\n");
    for (what, rows) in [("learning", &learning), ("nominal", &nominal), ("final", &last)] {
        for (i, s) in rows.iter().enumerate() {
            csv += &format!("{what},{},{},{}\n", i + 1, value(s), s.end.name());
        }
    }
    let alt = format!("{} over {total} strides: while learning, and nominal gait against final policy.", plain(&name));
    Ok(sheet.finish(&caption, &alt, csv))
}
