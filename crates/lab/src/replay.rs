//! One recorded episode of a simulated run, run again alone.
//!
//! The generator's state at its start puts the robot where it was, and the recorded actions, as they were applied,
//! lead it to the same rows, to the byte.

use std::collections::BTreeMap;

use serde::Serialize;
use stridemap_process::{Action, Actor, Made, Next, ProcessError, Situation, StrideEnd, roll_out};
use stridemap_record::{
    Columns, EPISODE_BEGUN, EpisodeStart, Fall, Pace, Recording, Rows, StridePhase, Transition, episode_starts,
};
use stridemap_robot::Side;

use crate::error::LabError;
use crate::plant::Batch;
use crate::plant::Plant;
use crate::poses::Filming;
use crate::run::FinishedRun;
use crate::seed::resumed;

/// An episode of a run: strides without a reset between them.
#[derive(Clone, Debug, Serialize)]
pub struct Episode {
    /// From 1, in the order of `transitions.csv`, then of `record.csv`.
    pub episode: usize,
    /// Iteration of Algorithm 1.
    pub iteration: usize,
    /// In which phase it was made.
    pub phase: StridePhase,
    /// The policy that was measured by it, where it was one.
    pub what: Option<String>,
    /// Strides.
    pub strides: usize,
    /// How its last stride ended.
    pub end: StrideEnd,
    /// Why, if it was a fall.
    pub fall: Option<Fall>,
    /// The generator's state at its start, where the run kept it.
    #[serde(skip)]
    start: Option<EpisodeStart>,
    #[serde(skip)]
    transitions: Vec<Transition>,
}

/// The episodes of a run up to its last checkpoint.
///
/// # Errors
///
/// [`LabError::Record`] if a log cannot be read.
pub fn episodes(run: &FinishedRun) -> Result<Vec<Episode>, LabError> {
    let table = Columns::new(&run.task.process_spec()?);
    // Of a phase that was made anew after a crash, the last start counts.
    let starts: BTreeMap<(String, usize), EpisodeStart> =
        episode_starts(&run.path).into_iter().map(|s| ((s.log.clone(), s.row), s)).collect();
    let mut all: Vec<Episode> = Vec::new();
    for (log, rows) in [("transitions.csv", run.rows[0]), ("record.csv", run.rows[1])] {
        for (row, t) in table.read(&run.path.join(log), Rows::First(rows))?.into_iter().enumerate() {
            if t.k == 0 || all.is_empty() {
                let start = starts.get(&(log.to_owned(), row)).cloned();
                all.push(Episode {
                    episode: all.len() + 1,
                    iteration: t.iteration,
                    phase: t.phase,
                    what: start.as_ref().and_then(|s| s.what.clone()),
                    strides: 0,
                    end: t.end,
                    fall: t.fall,
                    start,
                    transitions: Vec::new(),
                });
            }
            if let Some(last) = all.last_mut() {
                (last.strides, last.end, last.fall) = (last.strides + 1, t.end, t.fall);
                last.transitions.push(t);
            }
        }
    }
    Ok(all)
}

/// Asks for the recorded actions, and makes a record of what comes of them.
struct Again<'a> {
    recorded: &'a [Transition],
    made: Vec<Transition>,
    stance: Option<Side>,
}

impl Actor<Plant, ProcessError> for Again<'_> {
    fn act(
        &mut self,
        plant: &mut Plant,
        _: &Situation,
        _: &mut rand_chacha::ChaCha8Rng,
    ) -> Result<Action, ProcessError> {
        self.stance = plant.stance();
        Ok(self.recorded[self.made.len()].action.clone())
    }

    fn saw(&mut self, plant: &mut Plant, made: Made<'_>) -> Result<Next, ProcessError> {
        let then = &self.recorded[self.made.len()];
        let (iteration, phase, role) = (then.iteration, then.phase, then.role);
        let batch = Batch { iteration, phase, role, strides: self.recorded.len() };
        self.made.push(plant.transition(batch, then.episode, self.stance, made));
        Ok(if made.stride.end == StrideEnd::Crossing { Next::Go } else { Next::Stop })
    }
}

/// What came of an episode that was run again.
pub struct Replayed {
    /// Its strides.
    pub transitions: Vec<Transition>,
    /// Its motion, from the start of the robot.
    pub recording: Option<Recording>,
}

/// Runs an episode again, alone.
///
/// # Errors
///
/// [`LabError::RunDirectory`] if the robot is behind a link, if version, model, seed or task are not those of the run, or
/// if it kept no generator states; [`LabError::NotTheSame`] with what differs;
/// [`LabError`] of the room at fault.
pub fn replay(run: &FinishedRun, episode: &Episode) -> Result<Replayed, LabError> {
    let refuse = |problem: String| LabError::RunDirectory { path: run.path.clone(), problem };
    let differs = |problem: String| LabError::NotTheSame { path: run.path.clone(), problem };
    if run.task.link.is_some() {
        return Err(refuse(
            "its robot is behind a link, and cannot repeat what it did; `stridemap view` shows it".into(),
        ));
    }
    let others = run.differences()?;
    if !others.is_empty() {
        return Err(refuse(format!("its episodes cannot come out the same: {}", others.join("; "))));
    }
    let start = episode.start.as_ref().ok_or_else(|| {
        refuse(format!(
            "events.ndjson holds no {EPISODE_BEGUN:?} for episode {}: the run is of an earlier version, or they were lost",
            episode.episode
        ))
    })?;
    // Actions are recorded as they were applied: the law of the task has done its work on them.
    let mut free = run.task.clone();
    for action in &mut free.action {
        (action.gain, action.rate_per_stride) = (1.0, None);
    }
    let mut plant = free.plant()?;
    let goals = episode.transitions.iter().map(|t| t.goal.clone());
    plant.ask_for((!run.task.goal.is_empty()).then(|| goals.collect()));
    let filming = Filming::begin(&mut plant, &[(Pace::Film, [0.0, f64::INFINITY])]);
    let mut again = Again { recorded: &episode.transitions, made: Vec::new(), stance: None };
    let mut rng = resumed(run.provenance.seed, start.stream, start.word);
    roll_out(&mut plant, episode.transitions.len(), &mut again, &mut rng)?;
    let recording = filming.end(&mut plant).film();
    let table = Columns::new(&run.task.process_spec()?);
    let names = table.header();
    for (then, now) in episode.transitions.iter().zip(&again.made) {
        let (then, now) = (table.row(then), table.row(now));
        let cells = names.split(',').zip(then.split(',').zip(now.split(',')));
        if let Some((name, (then, now))) = cells.into_iter().find(|(_, (then, now))| then != now) {
            let (n, k) = (episode.episode, again.made.len());
            return Err(differs(format!(
                "episode {n} did not come out the same in {k} strides: {name} was {then}, is {now}"
            )));
        }
    }
    if again.made.len() != episode.transitions.len() {
        let (n, then, now) = (episode.episode, episode.transitions.len(), again.made.len());
        return Err(differs(format!("episode {n} had {then} strides, and ended after {now}")));
    }
    Ok(Replayed { transitions: again.made, recording })
}
