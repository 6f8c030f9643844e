//! What a plant is made for, what it counts, and who may watch it.

use serde::{Deserialize, Serialize};
use stridemap_process::{ActionLimits, StrideEnd};
use stridemap_record::{Fall, StridePhase, StrideRole};
use stridemap_robot::{Robot, RobotState};
use stridemap_section::{Crossing, SectionConfig};

use crate::fall::FailureConfig;
use crate::goal::GoalConfig;
use crate::reward::RewardTerm;
use crate::state::StateComponent;

/// One modulation of the gait as a component of the action.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantAction {
    /// Index into [`Gait::modulations`](stridemap_gait::Gait::modulations).
    pub modulation: usize,
    /// Bounds, rate and smoothing.
    pub limits: ActionLimits,
}

/// What the plant needs to know of a task.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantTask {
    /// Components of the state.
    pub state: Vec<StateComponent>,
    /// Components of the action.
    pub action: Vec<PlantAction>,
    /// Components of the goal.
    pub goals: Vec<GoalConfig>,
    /// Reward of a stride that reached the next section.
    pub reward: Vec<RewardTerm>,
    /// When a stride counts as a fall or a stall.
    pub failure: FailureConfig,
    /// How the section is found.
    pub section: SectionConfig,
    /// Sections passed with the nominal gait after its start-up, before an episode begins.
    pub warm_up_strides: usize,
}

/// Where the strides of a batch belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Iteration of Algorithm 1, from 1.
    pub iteration: usize,
    /// In which phase they are made.
    pub phase: StridePhase,
    /// What they are for.
    pub role: StrideRole,
    /// How many.
    pub strides: usize,
}

/// Strides made on the robot since the plant was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlantCounters {
    /// Strides of the nominal gait at the beginning of episodes.
    pub warm_up: usize,
    /// Strides asked for by [`StrideProcess::stride`](stridemap_process::StrideProcess::stride).
    pub strides: usize,
    /// Falls, in warm-up as well.
    pub falls: usize,
    /// Stalls, in warm-up as well.
    pub stalls: usize,
}

impl PlantCounters {
    /// What was counted since an earlier reading.
    #[must_use]
    pub const fn since(self, before: Self) -> Self {
        Self {
            warm_up: self.warm_up - before.warm_up,
            strides: self.strides - before.strides,
            falls: self.falls - before.falls,
            stalls: self.stalls - before.stalls,
        }
    }
}

/// What a [`Plant`](super::Plant) does at every control tick besides walking.
pub trait TickObserver: Send {
    /// Called after each control period. `crossing` is set when a section was found in it, `push_n`
    /// while a force acts.
    fn tick(&mut self, robot: &dyn Robot, state: &RobotState, crossing: Option<&Crossing>, push_n: Option<[f64; 3]>);
}

/// Observes what the policy asked for and where the sections were: a log.
pub trait StrideObserver: Send {
    /// A stride begins with this action, as it was asked for.
    fn action(&mut self, action: &[f64]);
    /// A section was found.
    fn section(&mut self, crossing: &Crossing);
    /// A stride, or a start that did not come to a section, ended like this, and why if it was a fall.
    fn ended(&mut self, _end: StrideEnd, _fall: Option<&Fall>) {}
}
