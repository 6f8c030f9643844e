//! Parts of a task file that are the loop's own: collection, learner, algorithm, record.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use stridemap_learn::{ActorCriticConfig, CrossEntropyConfig, GpDpConfig, PathwiseConfig, PolicyGradientConfig};
use stridemap_record::WalkTimes;

use crate::learner::{ControlsConfig, GoalLearning, IntegralConfig, LearnerKind, SearchSettings};

/// How the first batch explores: for how long a centre is kept. Which centres and how far about them, each
/// [`ActionConfig`](super::ActionConfig) says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExploreConfig {
    /// Strides for which a centre is kept.
    pub hold: usize,
    /// Share of its noise that a stride keeps from the one before, where goals are explored; left out: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<f64>,
    /// Strides over which exploration about goals is faded in; left out: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fade_in: Option<usize>,
}

/// Step 2 of Algorithm 1: strides on the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CollectConfig {
    /// Strides per iteration; the last entry serves all later iterations.
    pub strides: Vec<usize>,
    /// Sections passed with the nominal gait after its start-up, before an episode begins.
    pub warm_up_strides: usize,
    /// The first batch goes on, 20 strides at a time, until the map of the strides before predicts the
    /// newest 20 with a one-step error under this: root mean square over their spread, the largest over
    /// the components of the state \[MA09, sec. 8.1\]. Left out: one batch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until_error: Option<f64>,
    /// How the first batch explores.
    pub explore: ExploreConfig,
}

/// Step 4 of Algorithm 1: the learner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnerConfig {
    /// Which one.
    pub kind: LearnerKind,
    /// Whether each iteration starts from the policy before it instead of from scratch.
    pub warm_start: bool,
    /// Trials in the map from the second iteration on; left out: as many as in the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub later_trials: Option<usize>,
    /// Parameters of the actor-critic.
    pub actor_critic: ActorCriticConfig,
    /// Parameters of the natural actor-critic and of Bayesian policy gradient, which share the policy's shape, its limits
    /// and the discount with the actor-critic, as the next two do.
    #[serde(default, skip_serializing_if = "is_default")]
    pub policy_gradient: PolicyGradientConfig,
    /// Parameters of the pathwise gradient.
    #[serde(default, skip_serializing_if = "is_default")]
    pub pathwise: PathwiseConfig,
    /// Parameters of dynamic programming in the map.
    #[serde(default, skip_serializing_if = "is_default")]
    pub gp_dp: GpDpConfig,
    /// Parameters of the cross-entropy method, whose units are the actor-critic's.
    #[serde(default, skip_serializing_if = "is_default")]
    pub cem: CrossEntropyConfig,
    /// Parameters of the search in the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub search: Option<SearchSettings>,
    /// Parameters of the controls that search on the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controls: Option<ControlsConfig>,
    /// Parameters of the learners that follow goals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goals: Option<GoalLearning>,
    /// Parameters of a learner of one's own, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub own: BTreeMap<String, f64>,
    /// Parameters of integral action, for tasks with one action that moves `ψ_roll`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub integral: Option<IntegralConfig>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Algorithm 1 itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlgorithmConfig {
    /// Most iterations.
    pub iterations: usize,
    /// Strides of the deterministic policy on the robot after each improvement. They choose the best
    /// policy, and count as training too when `evaluation_trains`. 0: no policy is tried, and the nominal
    /// gait stays final.
    pub evaluation_strides: usize,
    /// First evaluation strides that are left out of the mean (start-up transient).
    pub evaluation_discard: usize,
    /// Whether evaluation strides are offered to the map.
    pub evaluation_trains: bool,
    /// Step 5: stop when the evaluated mean reward has not risen by more than this; left out: run all
    /// iterations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop_below_improvement: Option<f64>,
    /// Most training and evaluation strides; an iteration that cannot make its trial is not begun.
    /// Left out: as many as the iterations make.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strides_at_most: Option<usize>,
    /// Most falls and stalls on the robot in a run; the next one ends it. Those of training and evaluation
    /// strides and of their starts count; on a robot behind a link those of record strides as well.
    #[serde(default = "falls_at_most")]
    pub falls_at_most: usize,
}

const fn yes() -> bool {
    true
}

const fn falls_at_most() -> usize {
    3
}

/// Strides run only to report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordConfig {
    /// Strides averaged for `nominal` and `final`.
    pub strides: usize,
    /// Strides averaged for each iteration's policy.
    pub iteration_strides: usize,
    /// First strides that are not averaged.
    pub discard: usize,
    /// Measures policies by walking this long from stepping on the spot, instead of by a number of
    /// strides; left out: by strides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walk_s: Option<f64>,
    /// The speed is that of the first so many seconds of a walk, and an iteration's policy walks no
    /// longer; left out: all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_s: Option<f64>,
    /// Whether the nominal gait and the final policy of a task with goals also make a sweep and a straight walk.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub sweep: bool,
    /// Seconds of motion recorded of the nominal gait and of the final policy, to be looked at.
    pub pose_seconds: f64,
}

impl RecordConfig {
    /// How long the nominal gait and the final policy walk; `None` if they are measured by strides.
    #[must_use]
    pub fn walk(&self) -> Option<WalkTimes> {
        let walk_s = self.walk_s?;
        Some(WalkTimes { walk_s, speed_s: self.speed_s.unwrap_or(walk_s) })
    }

    /// How long an iteration's policy walks.
    #[must_use]
    pub fn iteration_walk(&self) -> Option<WalkTimes> {
        self.walk().map(|w| WalkTimes { walk_s: w.speed_s, ..w })
    }
}

/// When a run counts as a success, in the summary over seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuccessConfig {
    /// Least mean reward of the final policy; left out: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_reward_at_least: Option<f64>,
    /// Largest deviation of the final policy's mean `ψ_roll` from the target of the reward; left out:
    /// any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psi_roll_within_deg: Option<f64>,
    /// Least speed on the ground of the final policy, upright to the end; left out where it is not
    /// measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_m_s_at_least: Option<f64>,
    /// Most falls on the robot while learning.
    pub falls_at_most: usize,
    /// Most training and evaluation strides.
    pub strides_at_most: usize,
}
