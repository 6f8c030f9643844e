//! Strides from a robot's log, with no robot at all.

use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Batch, LabError, Plant, Task, builtin};
use stridemap_link::{LogReport, LoggedAction, Repeated, ReplayMachine, read_log};
use stridemap_mujoco::estimator;
use stridemap_process::{
    Action, ActionLaw, ActionLimits, Actor, Made, Next, ProcessError, Situation, StrideEnd, roll_out,
};
use stridemap_record::{Columns, StridePhase, StrideRole, Transition, files};
use stridemap_robot::{EstimatedRobot, Side};

use super::linked;
use crate::args::Common;
use crate::failure::Failure;
use crate::output;

/// Strides of a log that are left out, and why.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct LeftOut {
    /// Nothing says what was asked for at their beginning.
    without_action: usize,
    /// The action before theirs is not known, and theirs depends on it.
    after_unknown_action: usize,
    /// Actions that were logged where no stride begins, or after the readings of their episode end.
    actions_without_stride: usize,
}

/// What came of a log.
#[derive(Debug, Serialize)]
struct FromLog {
    strides: usize,
    aborted: usize,
    left_out: LeftOut,
    log: LogReport,
}

/// Makes strides from a robot's log.
pub fn collect_from(task: &Path, log: &Path, out: Option<&Path>, common: &Common) -> Result<(), Failure> {
    let task =
        builtin::load(super::verbs::text(task)?, &common.sets)?.on(common.robot.map(Into::into), common.seed)?.task;
    if let Some(out) = out {
        files::check_file(out)?;
    }
    let table = Columns::new(&task.process_spec()?);
    let (transitions, found) = strides_of_log(&task, log)?;
    output::note(summary(&found));
    if found.strides == 0 {
        let why = match &found.log.notes[..] {
            [] => "no action was logged where a stride begins".to_owned(),
            notes => notes.join("; "),
        };
        let log = log.display();
        return Err(Failure::working(format!("{log}: gives no strides: {why}")));
    }
    for note in &found.log.notes {
        output::note(format!("{}: {note}", log.display()));
    }
    let mut rows = vec![table.header()];
    rows.extend(transitions.iter().map(|t| table.row(t)));
    match out {
        Some(path) => {
            files::write_whole(path, (rows.join("\n") + "\n").as_bytes())?;
            let (strides, path, name) = (found.strides, path.display(), &task.name);
            output::note(format!("{strides} strides; next: stridemap fit {path} --task {name}"));
        }
        None if common.json => {}
        None => rows.iter().for_each(output::line),
    }
    if common.json {
        return output::json(&found);
    }
    Ok(())
}

/// What was read and what was left out, in a line.
fn summary(found: &FromLog) -> String {
    let (log, out) = (&found.log, &found.left_out);
    let counted = |n: u64, what: &str| (n > 0).then(|| format!("{n} {what}"));
    let told = [
        Some(format!("{} readings in {} episodes", log.readings, log.episodes)),
        counted(log.missed, "periods without a reading"),
        counted(log.unpaired, "joint states without the other sensors"),
        counted(log.doubled, "messages that came twice"),
        counted(log.late, "joint states too late"),
        counted(log.unusable, "unusable messages"),
        counted(log.unreadable, "unreadable messages"),
        counted(log.outside, "messages outside of an episode"),
        counted(log.lost, "joint states lost"),
        Some(format!("{} strides", found.strides)),
        counted(found.aborted as u64, "aborted"),
        counted(out.without_action as u64, "left out for want of an action"),
        counted(out.after_unknown_action as u64, "left out after such a one"),
        counted(out.actions_without_stride as u64, "actions without a stride"),
    ];
    told.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Between which values the last action lies: one value, until an action is not known.
struct Applied {
    low: ActionLaw,
    high: ActionLaw,
}

impl Applied {
    fn new(limits: &[ActionLimits]) -> Result<Self, ProcessError> {
        let law = ActionLaw::new(limits.to_vec())?;
        Ok(Self { low: law.clone(), high: law })
    }

    fn is_known(&self) -> bool {
        /// What a law that forgets may leave of a difference.
        const SAME: f64 = 1e-9;
        let apart = self.low.last().iter().zip(self.high.last());
        apart.into_iter().all(|(low, high)| (high - low).abs() <= SAME)
    }

    fn apply(&mut self, wanted: Option<&[f64]>) -> Result<(), ProcessError> {
        match wanted {
            Some(wanted) => {
                self.low.apply(wanted)?;
                self.high.apply(wanted)?;
            }
            None => {
                let bounds =
                    |of: fn(&ActionLimits) -> f64, law: &ActionLaw| -> Action { law.limits().iter().map(of).collect() };
                self.low.reset_to(bounds(|l| l.lower, &self.low));
                self.high.reset_to(bounds(|l| l.upper, &self.high));
            }
        }
        Ok(())
    }
}

/// What was asked for where a stride begins; `None` if nothing was logged there, or two different actions were.
fn asked(actions: &[LoggedAction], now_s: f64, within_s: f64) -> Option<&LoggedAction> {
    let near = |a: &&LoggedAction| (a.time_s - now_s).abs() <= within_s;
    let nearest =
        actions.iter().filter(near).min_by(|a, b| (a.time_s - now_s).abs().total_cmp(&(b.time_s - now_s).abs()))?;
    let rival = |a: &LoggedAction| a.time_s.total_cmp(&nearest.time_s).is_eq() && a != nearest;
    (!actions.iter().any(rival)).then_some(nearest)
}

fn held(repeated: &Mutex<Repeated>) -> MutexGuard<'_, Repeated> {
    repeated.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Strides from a log; what could not be used is told.
pub fn strides(task: &Task, log: &Path) -> Result<Vec<Transition>, Failure> {
    let (strides, found) = strides_of_log(task, log)?;
    output::note(summary(&found));
    found.log.notes.iter().for_each(|note| output::note(format!("{}: {note}", log.display())));
    Ok(strides)
}

/// Strides from a log, and what could not be used.
fn strides_of_log(task: &Task, log: &Path) -> Result<(Vec<Transition>, FromLog), Failure> {
    let link = task.link.clone().unwrap_or_default();
    let (names, limits) = linked::joints(task)?;
    let period_s = task.robot.control_period_s;
    let (episodes, report) = read_log(log, &link, names.clone(), limits.clone(), period_s)?;
    let machine = ReplayMachine::new(episodes, names, limits, period_s);
    let repeated = machine.repeated();
    let estimator = estimator(&linked::here(task).robot).map_err(LabError::from)?;
    let robot = EstimatedRobot::new(machine, estimator).map_err(LabError::from)?;
    let mut plant = task.plant_on(Box::new(robot))?;
    let mut made = FromEpisodes {
        limits: task.action_limits()?,
        within_s: link.gap_s,
        sections: 0,
        unlike: 0,
        unlike_by_deg: 0.0,
        transitions: Vec::new(),
        left_out: LeftOut::default(),
        notes: report.notes.clone(),
    };
    let mut episode = 0;
    while held(&repeated).left > 0 {
        made.episode(&mut plant, episode, &repeated)?;
        episode += 1;
    }
    if 2 * made.unlike > made.sections {
        return Err(Failure::working(format!(
            "{}: {} of {} sections have another psi_roll than the log says, by up to {:.2} deg: the task has another \
             model, unit, offset, sign or section than when the log was written; nothing was taken from it",
            log.display(),
            made.unlike,
            made.sections,
            made.unlike_by_deg
        )));
    }
    let aborted = |t: &&Transition| t.end == StrideEnd::Aborted;
    let aborted = made.transitions.iter().filter(aborted).count();
    let found = FromLog {
        strides: made.transitions.len() - aborted,
        aborted,
        left_out: made.left_out,
        log: LogReport { notes: made.notes, ..report },
    };
    Ok((made.transitions, found))
}

/// The strides made so far from a log.
struct FromEpisodes {
    limits: Vec<ActionLimits>,
    /// An action belongs to the section that is this near in time.
    within_s: f64,
    /// Sections that the log has as well, and how far those of another `ψ_roll` are off at most.
    sections: usize,
    unlike: usize,
    unlike_by_deg: f64,
    transitions: Vec<Transition>,
    left_out: LeftOut,
    notes: Vec<String>,
}

impl FromEpisodes {
    /// Takes note of why an episode's strides end, and of the actions that have none.
    fn over(&mut self, episode: usize, why: Option<String>, without_stride: usize) {
        self.left_out.actions_without_stride += without_stride;
        let lost = match without_stride {
            0 => String::new(),
            1 => "; 1 action has no stride".into(),
            n => format!("; {n} actions have no stride"),
        };
        if let Some(why) = why {
            self.notes.push(format!("episode {episode}: {why}{lost}"));
        }
    }

    /// Compares the section just found with the log's own.
    fn compare(&mut self, plant: &Plant, sections: &[(f64, f64)]) {
        /// More than a lost message makes of a section.
        const LIKE_DEG: f64 = 0.1;
        let now_s = plant.robot().state().time_s;
        let psi_deg = plant.last_measures().psi_roll_deg;
        let near = sections.iter().filter(|(at, _)| (at - now_s).abs() <= self.within_s);
        let off = near.map(|(_, logged)| (logged - psi_deg).abs()).min_by(f64::total_cmp);
        if let Some(off_deg) = off {
            self.sections += 1;
            self.unlike += usize::from(off_deg > LIKE_DEG);
            self.unlike_by_deg = self.unlike_by_deg.max(off_deg);
        }
    }

    /// The strides of the next episode.
    fn episode(&mut self, plant: &mut Plant, episode: usize, repeated: &Mutex<Repeated>) -> Result<(), Failure> {
        let applied = Applied::new(&self.limits).map_err(LabError::from)?;
        let mut again = Again {
            made: self,
            repeated,
            applied,
            script: None,
            episode,
            used: 0,
            why: None,
            known: (true, true),
            stance: None,
        };
        let result = roll_out(plant, usize::MAX, &mut again, &mut stream(0, Role::Collect, 0));
        let Again { script, used, why, .. } = again;
        let Repeated { actions, after_end, .. } = script.unwrap_or_else(|| held(repeated).clone());
        let why = result.err().map(|error: ProcessError| error.to_string()).or(why);
        self.over(episode, why, actions.len() - used + after_end);
        Ok(())
    }
}

/// An episode of a log, walked again.
struct Again<'a> {
    made: &'a mut FromEpisodes,
    repeated: &'a Mutex<Repeated>,
    applied: Applied,
    /// What the log says of this episode.
    script: Option<Repeated>,
    episode: usize,
    /// Actions that a stride began with.
    used: usize,
    why: Option<String>,
    /// Whether the log says what is asked for, and whether the action before was known.
    known: (bool, bool),
    stance: Option<Side>,
}

impl Again<'_> {
    /// Whether the log has an action for the section at hand, or for a later one.
    fn goes_on(&self, plant: &Plant) -> Next {
        let now_s = plant.robot().state().time_s;
        let last = self.script.as_ref().and_then(|s| s.actions.last());
        if last.is_none_or(|a| a.time_s < now_s - self.made.within_s) { Next::Stop } else { Next::Go }
    }
}

impl Actor<Plant, ProcessError> for Again<'_> {
    fn begin(&mut self, plant: &mut Plant, _: &Situation) -> Result<Next, ProcessError> {
        self.script = Some(held(self.repeated).clone());
        Ok(self.goes_on(plant))
    }

    fn act(&mut self, plant: &mut Plant, at: &Situation, _: &mut ChaCha8Rng) -> Result<Action, ProcessError> {
        let now_s = plant.robot().state().time_s;
        let script = self.script.as_ref();
        let wanted = script.and_then(|s| asked(&s.actions, now_s, self.made.within_s)).map(|a| a.action.as_slice());
        self.used += usize::from(wanted.is_some());
        self.known = (wanted.is_some(), self.applied.is_known());
        self.stance = plant.stance();
        self.applied.apply(wanted)?;
        Ok(Action::from_slice(wanted.unwrap_or(&at.last_action)))
    }

    fn saw(&mut self, plant: &mut Plant, made: Made<'_>) -> Result<Next, ProcessError> {
        let end = made.stride.end;
        if end == StrideEnd::Aborted {
            self.why = plant.abort_reason().map(ToString::to_string);
        }
        let (asked, was_known) = self.known;
        let left_out = &mut self.made.left_out;
        if !self.applied.is_known() {
            left_out.without_action += usize::from(!asked);
            left_out.after_unknown_action += usize::from(asked);
        } else if !was_known {
            left_out.after_unknown_action += 1;
        } else {
            let batch =
                Batch { iteration: 1, phase: StridePhase::Collect, role: StrideRole::Training, strides: usize::MAX };
            let stride = plant.transition(batch, self.episode, self.stance, made);
            self.made.transitions.push(Transition { true_psi_roll_deg: None, true_forward_m: None, ..stride });
        }
        if end != StrideEnd::Crossing {
            return Ok(Next::Stop);
        }
        if let Some(script) = &self.script {
            self.made.compare(plant, &script.sections);
        }
        Ok(self.goes_on(plant))
    }
}
