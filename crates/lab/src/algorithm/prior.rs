//! What a run with goals knows before the robot's first stride: a map of goals learned elsewhere.

use std::path::Path;
use std::sync::Arc;

use stridemap_learn::{KeptPolicy, SavedPolicy};
use stridemap_map::GoalMap;
use stridemap_record::{StridePhase, StrideRole, files};

use super::Algorithm;
use crate::error::{Invalid, LabError};
use crate::learner::goal_map;
use crate::plant::Batch;
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, make_strides};
use crate::task::Task;

/// The word for strides in simulation that come before.
const SIMULATE: &str = "simulate";
/// How many.
const STRIDES: usize = 300;

impl Algorithm<'_> {
    /// Gets the map that the task names as its prior, unless it is there.
    pub(super) fn take_prior(&mut self) -> Result<(), LabError> {
        if let (None, Some(named)) = (&self.progress.prior, &self.task.map.prior) {
            let map = if named == SIMULATE { simulated(self.task, self.seed)? } else { of_run(Path::new(named))? };
            self.progress.prior = Some(Arc::new(map));
        }
        Ok(())
    }

    /// Strides of an iteration's batch. With a prior there is a policy from the first stride on, so that the first batch,
    /// which else explores, is made in two halves with a fit between them.
    pub(super) fn batch_strides(&self, index: usize) -> usize {
        let counts = &self.task.collect.strides;
        let of = |i: usize| counts.get(i).or(counts.last()).copied().unwrap_or(0);
        match (self.task.map.prior.is_some() && self.task.learner.kind.follows_goals(), index) {
            (true, 0) => of(0) / 2,
            (true, 1) => of(0) - of(0) / 2,
            (true, i) => of(i - 1),
            (false, i) => of(i),
        }
    }
}

/// Strides on the simulated robot without its changes, explored as the first batch of the task is.
fn simulated(task: &Task, seed: u64) -> Result<GoalMap, LabError> {
    let mut twin = Task { link: None, ..task.clone() };
    twin.robot.changes = None;
    let neutral: Vec<f64> = twin.action_limits()?.iter().map(|l| l.neutral).collect();
    let mut plant = twin.plant()?;
    let raw = twin.raw_command()?.to_saved();
    let source = ActionSource::About(&raw, twin.dither(Some(&neutral), true));
    let batch = Batch { iteration: 0, phase: StridePhase::Collect, role: StrideRole::Training, strides: STRIDES };
    let mut rng = stream(seed, Role::Prior, 0);
    let made = make_strides(&mut plant, &source, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
    goal_map(&twin, &made, STRIDES)
}

/// The map of a run's newest planner.
fn of_run(run: &Path) -> Result<GoalMap, LabError> {
    let policy = |name: String| run.join("policy").join(name);
    let newest = (1..).map(|i| policy(format!("{i}.json"))).take_while(|path| path.exists()).last();
    for path in [Some(policy("final.json".into())), newest].into_iter().flatten().filter(|path| path.exists()) {
        if let SavedPolicy::GoalPlanner(planner) = files::read_json(&path)? {
            return Ok(planner.map.as_ref().clone());
        }
    }
    let requirement = format!(
        "is {:?}: neither \"{SIMULATE}\" nor the directory of a run that learned a map of goals (learner.kind = \"planning\")",
        run.display().to_string()
    );
    Err(Invalid { key: "map.prior".into(), requirement }.into())
}
