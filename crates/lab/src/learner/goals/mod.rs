//! Learners of tasks with goals: planning in a map of goals, affine laws from it, and the controls beside them.

mod controls;
mod planning;

pub(super) use controls::{Constants, Integral, Inverse, Raw};
pub(super) use planning::{Affine, Planning};

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use stridemap_learn::{
    ActionRole, AffinePiece, Correction, GoalAffine, GoalCost, LinearTerm, PlanSettings, Quantity, SquaredTerm,
};
use stridemap_map::{GoalMap, GoalMapConfig, GoalSample};
use stridemap_process::{ActionLimits, StrideEnd};
use stridemap_record::{StrideRole, Transition};

use super::{Known, invalid};
use crate::error::LabError;
use crate::goal::{Measure, measures};
use crate::reward::RewardQuantity;
use crate::task::Task;

/// The version of policy files.
const FORMAT: u32 = 1;

/// Parameters of the learners that follow goals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GoalLearning {
    /// Newest strides that a map is fitted to.
    pub rows: usize,
    /// Candidates among which the robot's constants are chosen.
    pub candidates: usize,
    /// Recorded states and goals by which a candidate is judged.
    pub pairs: usize,
    /// Standard deviations of what the map does not know that are charged of linear terms of the reward.
    pub doubt: f64,
    /// Per measure, what a fall adds to what was measured of the stride before it, so that the map sees what falls cost.
    pub fall_adds: BTreeMap<String, f64>,
    /// Whether constants are learned; without, they stay neutral, for the controls and for comparison.
    pub constants: bool,
    /// Integral action: change of a command per stride, as a share of the error.
    pub integral_gain: f64,
    /// Integral action: most that a command is moved, in the goal's own unit of measure.
    pub integral_limit: f64,
    /// Affine laws along each component of the goal.
    pub laws: usize,
    /// How plans are searched.
    pub plan: PlanSettings,
}

impl Default for GoalLearning {
    fn default() -> Self {
        Self {
            rows: 120,
            candidates: 250,
            pairs: 40,
            doubt: 0.5,
            fall_adds: BTreeMap::new(),
            constants: true,
            integral_gain: 0.2,
            integral_limit: 0.5,
            laws: 2,
            plan: PlanSettings::default(),
        }
    }
}

/// The squared lean as a reward has it: of these measures, over this unit.
const LEAN: ([&str; 2], f64) = (["mean_roll_rad", "mean_pitch_rad"], 0.1);

/// What a learner of goals knows of its task.
pub(super) struct Goals<'a> {
    pub(super) task: &'a Task,
    pub(super) learning: GoalLearning,
    pub(super) limits: Vec<ActionLimits>,
    /// What is foretold of a stride: the goals' measures first.
    pub(super) measures: Vec<Measure>,
    pub(super) cost: GoalCost,
}

impl<'a> Goals<'a> {
    pub(super) fn of(task: &'a Task) -> Result<Self, LabError> {
        if task.goal.is_empty() {
            return invalid("goal", "is needed by a learner that follows goals: at least one [[goal]]");
        }
        let learning = task.learner.goals.clone().unwrap_or_default();
        let mut this = Self {
            task,
            limits: task.action_limits()?,
            measures: task.goal.iter().map(|g| g.name).collect(),
            cost: GoalCost::default(),
            learning,
        };
        for (i, term) in task.reward.iter().enumerate() {
            this.price(i, term.quantity, term.weight)?;
        }
        for name in this.learning.fall_adds.keys() {
            if !this.measures.iter().any(|m| m.name == name) {
                return invalid("learner.goals.fall_adds", format!("{name:?} is no measure that the reward looks at"));
            }
        }
        Ok(this)
    }

    fn measure(&mut self, name: &str) -> Option<usize> {
        if let Some(at) = self.measures.iter().position(|m| m.name == name) {
            return Some(at);
        }
        self.measures.push(Measure(measures().find(name)?));
        Some(self.measures.len() - 1)
    }

    /// Adds a term of the reward to the cost.
    fn price(&mut self, i: usize, quantity: RewardQuantity, weight: f64) -> Result<(), LabError> {
        if quantity == RewardQuantity::GOAL_SQUARED_ERROR {
            for (g, goal) in self.task.goal.iter().enumerate() {
                let in_state = self.task.state.iter().position(|c| c.name() == goal.name.name);
                let of = in_state.map_or(Quantity::Measure(g), Quantity::State);
                self.cost.squared.push(SquaredTerm { of, goal: Some(g), weight: weight / (goal.unit * goal.unit) });
            }
            return Ok(());
        }
        if quantity == RewardQuantity::LEAN_SQUARED {
            let (names, unit) = LEAN;
            for name in names {
                if let Some(at) = self.measure(name) {
                    let of = Quantity::Measure(at);
                    self.cost.squared.push(SquaredTerm { of, goal: None, weight: weight / (unit * unit) });
                }
            }
            return Ok(());
        }
        let Some(measure) = self.measure(quantity.name) else {
            return invalid(
                &format!("reward.{i}.quantity"),
                format!("{} is not what a map of goals foretells", quantity.name),
            );
        };
        self.cost.linear.push(LinearTerm { measure, weight: -weight, doubt: self.learning.doubt });
        Ok(())
    }

    /// What each component of the action is for; without learned constants those stay as they are.
    pub(super) fn roles(&self) -> Vec<ActionRole> {
        self.task.action.iter().map(|a| a.role).collect()
    }

    /// Per component of the action the component of the goal that its command names.
    pub(super) fn follows(&self) -> Vec<Option<usize>> {
        let goal = |name: &String| self.task.goal.iter().position(|g| g.command.as_ref() == Some(name));
        self.task.action.iter().map(|a| goal(&a.modulates)).collect()
    }

    pub(super) fn neutral(&self) -> Vec<f64> {
        self.limits.iter().map(|l| l.neutral).collect()
    }

    /// The strides for a map, oldest first.
    pub(super) fn samples(&self, transitions: &[Transition]) -> Vec<GoalSample> {
        let mut samples = Vec::new();
        let mut before: Option<&Transition> = None;
        for t in transitions.iter().filter(|t| t.role == StrideRole::Training) {
            let measured = |t: &Transition| -> Vec<f64> { self.measures.iter().map(|m| (m.of)(&t.measures)).collect() };
            let sample =
                |measures, next| GoalSample { state: t.state.to_vec(), action: t.action.to_vec(), measures, next };
            match t.end {
                StrideEnd::Crossing => samples.push(sample(measured(t), Some(t.next_state.to_vec()))),
                StrideEnd::Fell | StrideEnd::NoCrossing => {
                    if let Some(before) = before.filter(|b| b.episode == t.episode && b.end == StrideEnd::Crossing) {
                        let mut measures = measured(before);
                        for (m, value) in self.measures.iter().zip(&mut measures) {
                            *value += self.learning.fall_adds.get(m.name).copied().unwrap_or(0.0);
                        }
                        samples.push(sample(measures, None));
                    }
                }
                StrideEnd::Aborted => {}
            }
            before = Some(t);
        }
        samples
    }

    pub(super) fn map(
        &self,
        samples: &[GoalSample],
        (sees_state, bends): (bool, bool),
        prior: Option<Arc<GoalMap>>,
    ) -> Result<GoalMap, LabError> {
        let invariant = self.task.state.iter().enumerate().filter(|(_, c)| c.invariant).map(|(i, _)| i).collect();
        let config = GoalMapConfig {
            measures: self.measures.iter().map(|m| m.name.to_owned()).collect(),
            units: self.task.action.iter().map(|a| a.unit).collect(),
            invariant,
            sees_state,
            bends,
            rows: self.learning.rows,
        };
        Ok(GoalMap::fit(config, samples, prior)?)
    }

    /// A law without a map: `u = u₀ + K (g − b)`.
    pub(super) fn law(
        &self,
        action: Vec<f64>,
        of_goal: Vec<Vec<f64>>,
        correction: Correction,
    ) -> Result<GoalAffine, LabError> {
        let spec = self.task.process_spec()?;
        let piece = AffinePiece {
            goal: vec![0.0; spec.goal.len()],
            state: vec![0.0; spec.state.len()],
            action,
            of_goal,
            ..AffinePiece::default()
        };
        let measures = self.task.goal.iter().map(|g| g.name.name.to_owned()).collect();
        Ok(GoalAffine { format: FORMAT, spec, measures, correction, pieces: vec![piece] })
    }

    /// The raw command: what the goal names directly is set to it, the rest is neutral.
    pub(super) fn raw(&self, correction: Correction) -> Result<GoalAffine, LabError> {
        let follows = self.follows();
        let mut action = self.neutral();
        let mut of_goal = vec![vec![0.0; self.task.goal.len()]; action.len()];
        for (j, follow) in follows.iter().enumerate() {
            if let Some(g) = follow {
                action[j] = 0.0;
                of_goal[j][*g] = 1.0;
            }
        }
        self.law(action, of_goal, correction)
    }
}

impl Task {
    /// The policy of a task with goals that sets what they name directly to them, and leaves the rest of the gait alone.
    pub(crate) fn raw_command(&self) -> Result<GoalAffine, LabError> {
        Goals::of(self)?.raw(Correction::None)
    }
}

/// Training strides of the task so far.
pub(super) fn strides<'k>(known: &'k Known<'_>) -> &'k [Transition] {
    &known.progress.transitions
}

/// The map of goals of strides, of the newest `rows`.
pub(crate) fn goal_map(task: &Task, strides: &[Transition], rows: usize) -> Result<GoalMap, LabError> {
    let mut goals = Goals::of(task)?;
    goals.learning.rows = rows;
    goals.map(&goals.samples(strides), (true, true), None)
}
