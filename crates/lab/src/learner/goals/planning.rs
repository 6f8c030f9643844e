//! Planning in a map of goals, and affine laws about goals from its slopes.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{
    Correction, GoalAffine, GoalPlanner, KeptPolicy, SavedPolicy, TrialSummary, choose_constants, law_about,
};
use stridemap_map::GoalMap;
use stridemap_process::Goal;
use stridemap_record::Transition;

use super::{FORMAT, Goals, strides};
use crate::error::LabError;
use crate::learner::{Known, LearnerPart};
use crate::registry::part;
use crate::seed::{Role, stream};
use crate::task::Task;

/// What kind of map is planned in.
pub struct Planning {
    name: &'static str,
    about: &'static str,
    sees_state: bool,
    bends: bool,
    constants: bool,
}

impl Planning {
    /// The map that bends and sees the state, with the robot's constants.
    pub const MAP: Self = Self {
        name: "planning",
        about: "goals: planning over two strides in the map, the robot's constants chosen with it",
        sees_state: true,
        bends: true,
        constants: true,
    };
    /// The same, with constants left alone.
    pub const COMMANDS: Self = Self {
        name: "planning_commands",
        about: "goals: planning in the map with the robot's constants left neutral",
        constants: false,
        ..Self::MAP
    };
    /// A plane.
    pub const LINEAR: Self = Self {
        name: "linear_planning",
        about: "goals: control: planning in a linear map, constants neutral",
        bends: false,
        constants: false,
        ..Self::MAP
    };
    /// Without the state.
    pub const STATELESS: Self = Self {
        name: "stateless_planning",
        about: "goals: control: planning in a map that does not see the state, constants neutral",
        sees_state: false,
        constants: false,
        ..Self::MAP
    };

    /// A planner in a map of the strides so far.
    fn planner(&self, known: &Known<'_>, rng: &mut ChaCha8Rng) -> Result<GoalPlanner, LabError> {
        let goals = Goals::of(known.task)?;
        let prior = known.prior_map()?;
        let samples = goals.samples(strides(known));
        let map = goals.map(&samples, (self.sees_state, self.bends), prior)?;
        let chooses = self.constants && goals.learning.constants;
        plan_in(&goals, map, strides(known), chooses, rng)
    }
}

/// A planner in a map, with constants chosen on recorded states and goals.
fn plan_in(
    goals: &Goals<'_>,
    map: GoalMap,
    recorded: &[Transition],
    chooses: bool,
    rng: &mut ChaCha8Rng,
) -> Result<GoalPlanner, LabError> {
    let mut planner = GoalPlanner {
        format: FORMAT,
        spec: goals.task.process_spec()?,
        map: Arc::new(map),
        cost: goals.cost.clone(),
        roles: goals.roles(),
        values: goals.neutral(),
        follows: goals.follows(),
        measured: (0..goals.task.goal.len()).collect(),
        settings: goals.learning.plan,
        start: None,
    };
    let count = goals.learning.pairs.min(recorded.len());
    let pairs: Vec<(Vec<f64>, Goal)> =
        (0..count).map(|i| &recorded[i * recorded.len() / count]).map(|t| (t.state.to_vec(), t.goal.clone())).collect();
    let named = planner.follows.iter().zip(&planner.roles);
    let unnamed = named.into_iter().any(|(f, r)| f.is_none() && *r == stridemap_learn::ActionRole::Command);
    if let (true, Some((state, _))) = (unnamed, pairs.first()) {
        let middle: Vec<f64> = goals.task.goal.iter().map(|g| 0.5 * (g.range[0] + g.range[1])).collect();
        planner.start = Some(law_about(&planner, &middle, state));
    }
    if chooses {
        planner.values = choose_constants(&planner, &pairs, goals.learning.candidates, rng);
    }
    Ok(planner)
}

impl crate::registry::Part for Planning {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

impl LearnerPart for Planning {
    fn uses_map(&self) -> bool {
        false
    }

    fn needs_caution(&self) -> bool {
        false
    }

    fn follows_goals(&self) -> bool {
        true
    }

    fn moves_constants(&self) -> bool {
        self.constants
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        Goals::of(task).map(|_| ())
    }

    fn first_policy(&self, known: &Known<'_>) -> Result<Option<SavedPolicy>, LabError> {
        if known.prior_map()?.is_none() {
            return Ok(None);
        }
        let mut rng = stream(known.seed, Role::Improve, 0);
        Ok(Some(self.planner(known, &mut rng)?.to_saved()))
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        Ok(self.planner(known, rng)?.to_saved())
    }
}

/// Affine laws about goals, from the map's slopes.
pub struct Affine;

part!(Affine, "affine", "goals: affine laws about goals in closed form from the map's slopes, for who cannot plan");

impl LearnerPart for Affine {
    fn uses_map(&self) -> bool {
        false
    }

    fn needs_caution(&self) -> bool {
        false
    }

    fn follows_goals(&self) -> bool {
        true
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        Goals::of(task).map(|_| ())
    }

    fn first_policy(&self, known: &Known<'_>) -> Result<Option<SavedPolicy>, LabError> {
        Planning::MAP.first_policy(known)
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let planner = Planning::MAP.planner(known, rng)?;
        Ok(laws(known.task, &planner, strides(known))?.to_saved())
    }
}

/// Laws about the points of a grid over the goals.
fn laws(task: &Task, planner: &GoalPlanner, recorded: &[Transition]) -> Result<GoalAffine, LabError> {
    let goals = Goals::of(task)?;
    let per = goals.learning.laws.max(1);
    let n = recorded.len().max(1) as f64;
    let mean = |i: usize| recorded.iter().map(|t| t.state[i]).sum::<f64>() / n;
    let state: Vec<f64> = (0..task.state.len()).map(mean).collect();
    let mut grid: Vec<Vec<f64>> = vec![Vec::new()];
    for goal in &task.goal {
        let [low, high] = goal.range;
        let count = if low < high { per } else { 1 };
        let points: Vec<f64> = (0..count).map(|i| low + (high - low) * (i as f64 + 0.5) / count as f64).collect();
        let longer = |g: &Vec<f64>| points.iter().map(|p| [g.as_slice(), &[*p]].concat()).collect::<Vec<_>>();
        grid = grid.iter().flat_map(longer).collect();
    }
    let plan = planner.settings;
    Ok(GoalAffine {
        format: FORMAT,
        spec: planner.spec.clone(),
        measures: task.goal.iter().map(|g| g.name.name.to_owned()).collect(),
        correction: Correction::Bias { gain: plan.bias_gain, limit: plan.bias_limit },
        pieces: grid.iter().map(|goal| law_about(planner, goal, &state)).collect(),
    })
}
