//! What happened during a run: rewards per trial and stride, states per stride, runs beside each other.

use super::check::some;
use super::names::{label, reward_axis, scale_note};
use crate::draw::{Axis, Dash, Key, Mark, Panel, Sheet, extent, number, plain, plural, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::{LearningRow, StridePhase, StrideRole, Transition, World};

/// Rewards of a run, in the map and on the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LearningCurves {
    /// Trials, in order; those with world `map` are drawn as curves.
    pub trials: Vec<LearningRow>,
    /// Training and evaluation strides on the robot, in order.
    pub strides: Vec<Transition>,
    /// Mean reward of the nominal gait on the robot.
    pub nominal: Option<f64>,
    /// Mean reward of the final policy on the robot.
    pub final_policy: Option<f64>,
    /// Best mean reward of an iteration's policy on the robot.
    pub best: Option<f64>,
    /// What the paper reports for such a task, as a sentence.
    pub paper: Option<String>,
}

/// Separators and numbers of iterations along a sequence of `(iteration, position)`.
fn iterations(p: &mut Panel, of: &[usize]) {
    let mut start = 0;
    for i in 1..=of.len() {
        if i == of.len() || of[i] != of[start] {
            if start > 0 {
                p.upward(start as f64 + 0.5, "ref", Dash::Dotted);
            }
            let x = p.px(start as f64 + 0.5) + 5.0;
            let room = p.px(i as f64 + 0.5) - x;
            let text = if room > 66.0 { format!("iteration {}", of[start]) } else { of[start].to_string() };
            if room > 10.0 {
                p.note_px(x, p.top + 12.0, crate::draw::Anchor::Start, "mut", &text);
            }
            start = i;
        }
    }
}

fn levels(p: &mut Panel, data: &LearningCurves) {
    for (value, name, class, dash) in [
        (data.nominal, "nominal", "s1", Dash::Dashed),
        (data.best, "best iteration", "s3", Dash::Dotted),
        (data.final_policy, "final", "s2", Dash::Solid),
    ] {
        if let Some(value) = value {
            p.across(value, class, dash);
            p.key(&format!("{name} ({})", number(value, 3)), Key::Line(class, dash));
        }
    }
}

/// Draws the learning curve of one run: imagined trials above, every stride on the robot below.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if there is neither a trial nor a stride.
pub fn learning_curves(data: &LearningCurves) -> Result<Figure> {
    let stem = "learning";
    let trials: Vec<&LearningRow> = data.trials.iter().filter(|t| t.world == World::Map).collect();
    some(stem, "no trial and no stride", trials.len() + data.strides.len())?;
    let mut sheet = Sheet::new(stem, "Reward in the map and on the robot");
    let mut notes = String::new();
    if !trials.is_empty() {
        let rewards: Vec<f64> = trials.iter().map(|t| t.average_reward).collect();
        let (lo, hi) = extent(rewards.iter().copied());
        let room = (hi > 0.0).then_some(hi + 0.14 * (hi - lo));
        let shown: Vec<f64> = rewards.iter().copied().chain(room).collect();
        let y = reward_axis("average reward", &shown);
        notes.push_str(&scale_note(&y));
        let x = Axis::counting("trial in the learned map", 0.5, trials.len() as f64 + 0.5);
        let mut panels = sheet.row(170.0, vec![(1.0, x, y, Some("In the learned map"))]);
        if let Some(mut p) = panels.pop() {
            let points: Vec<(f64, f64)> = rewards.iter().enumerate().map(|(i, r)| (i as f64 + 1.0, *r)).collect();
            iterations(&mut p, &trials.iter().map(|t| t.iteration).collect::<Vec<_>>());
            // A new iteration is a new learner: the line breaks there.
            for of in trials.chunk_by(|a, b| a.iteration == b.iteration).scan(0, |from, chunk| {
                *from += chunk.len();
                Some(*from - chunk.len()..*from)
            }) {
                p.line(&points[of], "s0", Dash::Solid, 1.3);
            }
            for (t, (x, y)) in trials.iter().zip(&points).step_by((trials.len() / 300).max(1)) {
                p.hover(
                    *x,
                    *y,
                    format!(
                        "iteration {}, trial {}: average reward {} over {}, {}",
                        t.iteration,
                        t.trial,
                        number(*y, 3),
                        plural(t.strides, "stride"),
                        plural(t.falls, "fall")
                    ),
                );
            }
            p.key("average reward of a trial in the map", Key::Line("s0", Dash::Solid));
            sheet.add(p);
        }
    }
    let falls = data.strides.iter().filter(|s| s.end != StrideEnd::Crossing).count();
    if !data.strides.is_empty() {
        let mut rewards: Vec<f64> = data.strides.iter().map(|s| s.reward).collect();
        rewards.extend(data.nominal.iter().chain(&data.final_policy).chain(&data.best));
        let (lo, hi) = extent(rewards.iter().copied());
        if hi > 0.0 {
            // Head room for the names of the iterations; an axis that ends at zero has it anyway.
            rewards.push(hi + 0.1 * (hi - lo));
        }
        let y = reward_axis("reward", &rewards);
        let x = Axis::counting("stride on the robot", 0.5, data.strides.len() as f64 + 0.5);
        let mut panels = sheet.row(190.0, vec![(1.0, x, y, Some("On the robot"))]);
        if let Some(mut p) = panels.pop() {
            iterations(&mut p, &data.strides.iter().map(|s| s.iteration).collect::<Vec<_>>());
            levels(&mut p, data);
            strides(&mut p, &data.strides, |s| s.reward, "reward");
            sheet.add(p);
        }
    }
    let each = |v: Option<f64>| v.map_or_else(|| "not measured".to_owned(), |v| number(v, 3));
    let above = match trials.len() {
        0 => "R".to_owned(),
        n => format!(
            "Above: average reward per stride of each trial imagined in the learned map (n = {}). Below: r",
            plural(n, "trial")
        ),
    };
    let paper = data.paper.as_ref().map_or_else(String::new, |p| format!(" {p}"));
    let caption = format!(
        "{above}eward of \
         each stride on the robot, training and evaluation, in order, without averaging (n = {}, {falls} ended \
         without a section). Lines: mean reward on the robot of the nominal gait ({}), the best iteration ({}) and the \
         final policy ({}). Dotted uprights part the iterations.{notes}{paper}",
        plural(data.strides.len(), "stride"),
        each(data.nominal),
        each(data.best),
        each(data.final_policy)
    );
    let mut csv = String::from("world,iteration,index,reward,falls,strides,end\n");
    for t in &trials {
        csv.push_str(&format!("map,{},{},{},{},{},\n", t.iteration, t.trial, t.average_reward, t.falls, t.strides));
    }
    for (i, s) in data.strides.iter().enumerate() {
        csv.push_str(&format!(
            "robot,{},{},{},{},1,{}\n",
            s.iteration,
            i + 1,
            s.reward,
            u8::from(s.end == StrideEnd::Fell),
            s.end.name()
        ));
    }
    let alt = format!(
        "Reward over {} trials in the learned map and over {} strides on the robot; nominal {}, final {}.",
        trials.len(),
        data.strides.len(),
        each(data.nominal),
        each(data.final_policy)
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// Which strides, colour, mark and name.
type MarkedSet<'a> = (&'a dyn Fn(&Transition) -> bool, &'static str, Mark, &'static str);

/// Strides on the robot as marks: training, evaluation, and those that ended badly.
fn strides(p: &mut Panel, rows: &[Transition], value: impl Fn(&Transition) -> f64, what: &str) {
    let pick = |keep: &dyn Fn(&Transition) -> bool| -> Vec<(f64, f64)> {
        rows.iter().enumerate().filter(|(_, s)| keep(s)).map(|(i, s)| (i as f64 + 1.0, value(s))).collect()
    };
    let ok = |s: &Transition| s.end == StrideEnd::Crossing;
    let tries = |s: &Transition| s.phase == StridePhase::Evaluate || s.role == StrideRole::Evaluation;
    let sets: [MarkedSet<'_>; 4] = [
        (&|s| ok(s) && !tries(s), "s0", Mark::Disc, "exploring or sampling"),
        (&|s| ok(s) && tries(s), "s4", Mark::Diamond, "trying the policy's mean"),
        (&|s| s.end == StrideEnd::Fell, "s1", Mark::Cross, "fall"),
        (&|s| matches!(s.end, StrideEnd::NoCrossing | StrideEnd::Aborted), "s6", Mark::Cross, "stall or abort"),
    ];
    for (keep, class, mark, name) in sets {
        let points = pick(keep);
        if !points.is_empty() {
            p.marks(&points, class, mark, 3.4);
            p.key(name, Key::Mark(class, mark));
        }
    }
    for (i, s) in rows.iter().enumerate() {
        p.hover(
            i as f64 + 1.0,
            value(s),
            format!(
                "stride {}, iteration {} ({}): {what} {}, {}",
                i + 1,
                s.iteration,
                if tries(s) { "trying" } else { "exploring" },
                number(value(s), 3),
                s.end.name()
            ),
        );
    }
}

/// One component of the state at the section, stride by stride.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StateOverStrides {
    /// Name of the component, with its unit: `psi_roll_deg`.
    pub name: String,
    /// Its index in the state.
    pub component: usize,
    /// The desired value, if the task has one for this component.
    pub target: Option<f64>,
    /// Training and evaluation strides, in order.
    pub strides: Vec<Transition>,
    /// Strides of the nominal gait, run only to report.
    pub nominal: Vec<Transition>,
    /// Strides of the final policy, run only to report.
    pub final_policy: Vec<Transition>,
}

/// Draws the state over all strides on the robot, and nominal against final, as in Fig. 14.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if there is no stride.
pub fn state_over_strides(data: &StateOverStrides) -> Result<Figure> {
    let stem = "state";
    let total = data.strides.len() + data.nominal.len() + data.final_policy.len();
    some(stem, "no stride", total)?;
    let value = |s: &Transition| s.next_state.get(data.component).copied().unwrap_or(f64::NAN);
    let shown = |s: &&Transition| s.end != StrideEnd::Aborted;
    let all: Vec<f64> = [&data.strides, &data.nominal, &data.final_policy]
        .iter()
        .flat_map(|rows| rows.iter().filter(shown).map(value))
        .chain(data.target)
        .collect();
    let name = label(&data.name, "");
    let (quantity, _) = super::names::quantity(&data.name);
    let mut sheet = Sheet::new(stem, &format!("{quantity} at the section, stride by stride"));
    let target = |p: &mut Panel| {
        if let Some(target) = data.target {
            p.across(target, "s6", Dash::Chain);
            p.key(&format!("desired, {}", signed(target, 1)), Key::Line("s6", Dash::Chain));
        }
    };
    if !data.strides.is_empty() {
        let x = Axis::counting("stride on the robot while learning", 0.5, data.strides.len() as f64 + 0.5);
        // Head room for the names of the iterations.
        let (lo, hi) = extent(all.iter().copied());
        let y = Axis::covering(&name, all.iter().copied().chain([hi + 0.14 * (hi - lo)]));
        let mut row = sheet.row(175.0, vec![(1.0, x, y, Some("While learning"))]);
        if let Some(mut p) = row.pop() {
            iterations(&mut p, &data.strides.iter().map(|s| s.iteration).collect::<Vec<_>>());
            target(&mut p);
            strides(&mut p, &data.strides, value, &plain(&quantity));
            sheet.add(p);
        }
    }
    let longest = data.nominal.len().max(data.final_policy.len());
    if longest > 0 {
        let x = Axis::counting("stride from a fresh start", 0.5, longest as f64 + 0.5);
        let y = Axis::covering(&name, all.iter().copied());
        let mut row = sheet.row(175.0, vec![(1.0, x, y, Some("Before and after"))]);
        if let Some(mut p) = row.pop() {
            target(&mut p);
            for (rows, class, dash, what) in [
                (&data.nominal, "s1", Dash::Dashed, "nominal gait"),
                (&data.final_policy, "s2", Dash::Solid, "final policy"),
            ] {
                if rows.is_empty() {
                    continue;
                }
                let points: Vec<(f64, f64)> =
                    rows.iter().enumerate().map(|(i, s)| (i as f64 + 1.0, value(s))).collect();
                p.line(&points, class, dash, 1.8);
                let falls: Vec<(f64, f64)> =
                    rows.iter().zip(&points).filter(|(s, _)| s.end == StrideEnd::Fell).map(|(_, q)| *q).collect();
                p.marks(&falls, class, Mark::Cross, 4.0);
                for (x, y) in &points {
                    p.hover(*x, *y, format!("{what}, stride {x}: {} {}", plain(&quantity), signed(*y, 2)));
                }
                p.key(what, Key::Line(class, dash));
            }
            sheet.add(p);
        }
    }
    let count = |rows: &[Transition]| {
        let falls = rows.iter().filter(|s| s.end == StrideEnd::Fell).count();
        format!("n = {}, {}", rows.len(), plural(falls, "fall"))
    };
    let caption = format!(
        "{} at the end of each stride, without averaging. Above: strides on the robot while learning ({}). Below: strides run \
         only to report, nominal gait ({}) and final policy ({}). Dash-dotted: the desired value{}. Crosses: falls.{}",
        plain(&name),
        count(&data.strides),
        count(&data.nominal),
        count(&data.final_policy),
        data.target.map_or_else(|| " (none in this task)".to_owned(), |t| format!(", {}", signed(t, 1))),
        if data.target.is_some() {
            " The paper's Fig. 14 (real robot): mean of strides 10 to 40 is 0.12 deg for a target of 0.0 deg."
        } else {
            ""
        }
    );
    let mut csv = format!("what,stride,{},end\n", data.name);
    for (what, rows) in [("learning", &data.strides), ("nominal", &data.nominal), ("final", &data.final_policy)] {
        for (i, s) in rows.iter().enumerate() {
            csv.push_str(&format!("{what},{},{},{}\n", i + 1, value(s), s.end.name()));
        }
    }
    let alt = format!("{} over {total} strides: while learning, and nominal gait against final policy.", plain(&name));
    Ok(sheet.finish(&caption, &alt, csv))
}
