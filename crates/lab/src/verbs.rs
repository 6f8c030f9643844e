//! The verbs of Algorithm 1 on a run directory, as every front end gives them: the command, Python.
//!
//! A front end loads the task, builds the plant (in this process or behind a link), watches and shows; what a verb
//! does to a run is said here, once.

use std::path::{Path, PathBuf};

use stridemap_learn::Policy;
use stridemap_record::{Asked, Performance, Phase, Provenance, StridePhase, StrideRole, Summary, Walk};

use crate::algorithm::Algorithm;
use crate::builtin::LoadedTask;
use crate::error::LabError;
use crate::nominal::nominal_gait;
use crate::plant::{Batch, Plant};
use crate::preflight::refuse_miswired;
use crate::provenance::provenance_of;
use crate::recorder::Progress;
use crate::robots::RobotChoice;
use crate::run::{FinishedRun, RunDirectory};
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, drive, make_strides};
use crate::task::Task;
use crate::walk::Walker;

/// What a user asked for: a task, by name or file, with overrides.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The task as the user named it, with the options that are part of it.
    pub name: &'a str,
    /// `key=value` overrides.
    pub sets: &'a [String],
    /// Another robot than the task's own.
    pub robot: Option<RobotChoice>,
    /// The seed.
    pub seed: u64,
    /// The git revision of the program.
    pub revision: Option<&'a str>,
}

impl Request<'_> {
    /// The command line that repeats a run, for its record: without the place where it was put.
    #[must_use]
    pub fn command_line(&self, verb: &str) -> String {
        let mut words = vec!["stridemap".to_owned(), verb.into(), self.name.into()];
        words.push(format!("--seed {}", self.seed));
        words.extend(self.robot.map(|robot| format!("--robot {}", robot.name())));
        words.extend(self.sets.iter().map(|set| format!("--set {set}")));
        words.join(" ")
    }

    /// The record of a run of the loaded task that begins now with a verb.
    ///
    /// # Errors
    ///
    /// [`LabError::Mujoco`] if the robot cannot be built.
    pub fn provenance(&self, verb: &str, loaded: &LoadedTask) -> Result<Provenance, LabError> {
        Ok(Provenance {
            asked: loaded.file.clone().map(|file| Asked {
                file,
                sets: self.sets.to_vec(),
                robot: self.robot.map(|robot| robot.name().into()),
            }),
            ..provenance_of(&loaded.task, self.seed, self.revision, self.command_line(verb))?
        })
    }
}

/// The directory of a run: as asked for, or `runs/TASK-SEED`.
#[must_use]
pub fn run_path(out: Option<&Path>, task: &Task, seed: u64) -> PathBuf {
    out.map_or_else(|| PathBuf::from("runs").join(format!("{}-{seed}", task.name)), Path::to_path_buf)
}

/// Refuses a task whose thresholds or prices do not fit its robot, before anything is written. A robot behind
/// a link is asked by the nominal measurement of its run.
///
/// # Errors
///
/// [`LabError`] at the key at fault.
pub fn refuse_misfit(task: &Task, seed: u64) -> Result<(), LabError> {
    if task.link.is_none() {
        refuse_miswired(task, seed).map_err(|error| task.located(error))?;
        let gait = nominal_gait(task, seed)?;
        gait.refuse(&task.failure).map_err(|error| task.located(error))?;
    }
    Ok(())
}

/// `learn`: makes what is missing of a run and writes its summary, also when something goes wrong on the way.
///
/// # Errors
///
/// As [`Algorithm::learn`].
pub fn finish(algorithm: &mut Algorithm<'_>, directory: &mut RunDirectory) -> Result<Summary, LabError> {
    let result = algorithm.learn(directory);
    let summary = directory.write_summary(&algorithm.progress);
    match result {
        Ok(()) => {
            directory.end()?;
            summary
        }
        Err(error) => {
            // The first error is the one to tell; what was gathered is in the directory.
            let _ = directory.event("stopped", serde_json::json!({ "reason": error.to_string() }));
            Err(error)
        }
    }
}

/// Whether a run was begun by `learn`, which measures and evaluates between its batches.
fn is_learned(run: &FinishedRun) -> bool {
    run.provenance.command.starts_with("stridemap learn ")
}

/// Refuses to `collect` the next batch of a run that awaits something else.
///
/// # Errors
///
/// [`LabError::RunDirectory`] that says what.
pub fn refuse_batch(run: &FinishedRun, progress: &Progress) -> Result<(), LabError> {
    let refuse = |why: &str| Err(LabError::RunDirectory { path: run.path.clone(), problem: why.into() });
    if progress.policies.len() < progress.iterations.len() {
        return refuse("this batch is collected; `stridemap improve` the policy in its map first");
    }
    if is_learned(run) && progress.final_performance.is_some() {
        return refuse("the run is finished, and its final policy measured; start another");
    }
    Ok(())
}

/// `collect`: makes the next batch of a run that goes on, unless it has its last. A run that `learn` began is
/// measured and evaluated between its batches, as `learn` does it, so that the same run comes of it.
///
/// # Errors
///
/// As [`Algorithm::collect`].
pub fn next_batch(
    run: &FinishedRun,
    algorithm: &mut Algorithm<'_>,
    directory: &mut RunDirectory,
) -> Result<bool, LabError> {
    directory.goes_on()?;
    if is_learned(run) && !algorithm.catch_up(directory)? {
        return Ok(false);
    }
    algorithm.collect(directory)?;
    directory.write_summary(&algorithm.progress)?;
    Ok(true)
}

/// `improve`: fits the map to the strides of a run that goes on and improves its policy there. Returns the summary
/// and how many strides the map holds.
///
/// # Errors
///
/// [`LabError::RunDirectory`] if there is nothing new to learn from; as [`Algorithm::fit`] and
/// [`Algorithm::improve`].
pub fn improve(algorithm: &mut Algorithm<'_>, directory: &mut RunDirectory) -> Result<(Summary, usize), LabError> {
    if algorithm.progress.policies.len() == algorithm.progress.iterations.len() {
        let problem = "nothing new to learn from; `stridemap collect` a batch first".into();
        return Err(LabError::RunDirectory { path: directory.path().into(), problem });
    }
    directory.goes_on()?;
    let map = algorithm.fit(directory)?;
    algorithm.improve(&map, directory)?;
    let summary = directory.write_summary(&algorithm.progress)?;
    directory.event("verb", serde_json::json!({ "verb": "improve", "phase": Phase::Improve }))?;
    Ok((summary, map.samples().len()))
}

/// Strides left out of the means of `evaluate`: the start-up transient.
const DISCARD: usize = 10;

/// `evaluate`: measures a policy on the robot, by so many strides, or by a walk where the task says how long.
///
/// # Errors
///
/// As [`make_strides`].
pub fn evaluate(
    task: &Task,
    plant: &mut Plant,
    policy: &dyn Policy,
    strides: usize,
    seed: u64,
) -> Result<Performance, LabError> {
    let batch =
        Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: strides + DISCARD };
    let mut rng = stream(seed, Role::Run, 0);
    if let Some(times) = task.record.walk() {
        // Time ends the walk, whatever number of strides was asked for.
        let batch = Batch { strides: usize::MAX, ..batch };
        let mut walker = Walker::new(policy, times.walk_s);
        let transitions = drive(plant, &mut walker, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
        return Ok(Performance { walk: Some(Walk::of(&transitions, times)), ..Performance::of(&transitions, DISCARD) });
    }
    let source = ActionSource::Mean(policy);
    let transitions = make_strides(plant, &source, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
    Ok(Performance::of(&transitions, DISCARD))
}
