//! A task: what a TOML file under `experiments/` says.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use stridemap_gait::{Gait, GaitConfig};
use stridemap_learn::{ActorCriticConfig, ConstantPolicy, SavedPolicy};
use stridemap_mujoco::MujocoConfig;
use stridemap_returnmap::{ActionDimension, ActionLimits, MapConfig, ProcessSpec, StateDimension};
use stridemap_robot::{Robot, RobotDescription, Ros2Config};
use stridemap_section::SectionConfig;

use crate::caution::CautionConfig;
use crate::error::{Invalid, LabError};
use crate::fall::{FailureConfig, RobotFall};
use crate::gaits::gaits;
use crate::learner::{ControlsConfig, IntegralConfig, LearnerKind, SearchSettings};
use crate::plant::{Plant, PlantAction, PlantTask};
use crate::reward::RewardTerm;
use crate::state::StateComponent;
use crate::strides::StridePhase;
use crate::success::SuccessConfig;
use crate::walk::WalkTimes;

/// One component of the action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionConfig {
    /// The gait's modulation that it sets, by name; its unit is in the name.
    pub modulates: String,
    /// Smallest and largest value, on the robot and in the map.
    pub bounds: [f64; 2],
    /// Largest change from one stride to the next; no limit if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_per_stride: Option<f64>,
    /// Share of the way to the wanted value that is gone in one stride, in (0, 1].
    #[serde(default = "one")]
    pub gain: f64,
}

/// Where a task says the value that a modulation has in the nominal gait; `None` for one that is zero there.
fn gait_key(modulation: &str) -> Option<&'static str> {
    match modulation {
        "walk_amplitude_deg" => Some("gait.amplitude_deg.walk"),
        "roll_amplitude_deg" => Some("gait.amplitude_deg.hip_roll"),
        "pitch_amplitude_deg" => Some("gait.amplitude_deg.pitch"),
        "natural_frequency_rad_s" => Some("gait.natural_frequency_rad_s"),
        _ => None,
    }
}

const fn one() -> f64 {
    1.0
}

/// How the first batch explores.
///
/// Every `hold` strides a centre is drawn, uniform in `center`; the action is the centre plus normal
/// noise of standard deviation `std`, both per component of the action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExploreConfig {
    /// Range of the centre, per component.
    pub center: Vec<[f64; 2]>,
    /// Standard deviation about the centre, per component.
    pub std: Vec<f64>,
    /// Strides for which a centre is kept.
    pub hold: usize,
}

/// Step 2 of Algorithm 1: strides on the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CollectConfig {
    /// Strides per iteration; the last entry serves all later iterations.
    pub strides: Vec<usize>,
    /// Sections passed with the nominal gait after its start-up, before an episode begins.
    pub warm_up_strides: usize,
    /// Standard deviation of normal noise, per component of the action, added to what the policy
    /// draws from the second iteration on.
    pub later_noise_std: Vec<f64>,
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
    /// Parameters of the search in the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub search: Option<SearchSettings>,
    /// Parameters of the controls that search on the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controls: Option<ControlsConfig>,
    /// Parameters of a learner of one's own, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub own: BTreeMap<String, f64>,
    /// Parameters of integral action, for tasks with one action that moves `ψ_roll`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub integral: Option<IntegralConfig>,
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
    /// Seconds of motion recorded of the nominal gait and of the final policy, to be looked at.
    pub pose_seconds: f64,
}

impl RecordConfig {
    /// How long the nominal gait and the final policy walk; `None` if they are measured by strides.
    #[must_use]
    pub fn walk(&self) -> Option<WalkTimes> {
        let walk_s = self.walk_s?;
        Some(WalkTimes {
            walk_s,
            speed_s: self.speed_s.unwrap_or(walk_s),
        })
    }

    /// How long an iteration's policy walks.
    #[must_use]
    pub fn iteration_walk(&self) -> Option<WalkTimes> {
        self.walk().map(|w| WalkTimes {
            walk_s: w.speed_s,
            ..w
        })
    }
}

/// A task, resolved: every value known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// The experiment's name.
    pub name: String,
    /// What it is, in a sentence.
    pub about: String,
    /// Components of the state at the section.
    pub state: Vec<StateComponent>,
    /// The robot.
    pub robot: MujocoConfig,
    /// Where the robot is, if it is another process or a real one; left out: simulated in this process.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub link: Option<Ros2Config>,
    /// The nominal gait.
    pub gait: GaitConfig,
    /// The Poincaré section.
    pub section: SectionConfig,
    /// Components of the action.
    pub action: Vec<ActionConfig>,
    /// Terms of the reward; it is their sum.
    pub reward: Vec<RewardTerm>,
    /// When a stride counts as a fall or a stall.
    pub failure: FailureConfig,
    /// Strides on the robot.
    pub collect: CollectConfig,
    /// The learned map.
    pub map: MapConfig,
    /// The learner.
    pub learner: LearnerConfig,
    /// What keeps the robot off its cliff; left out: nothing, as in the paper.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub caution: Option<CautionConfig>,
    /// The loop.
    pub algorithm: AlgorithmConfig,
    /// Strides run only to report.
    pub record: RecordConfig,
    /// When a run counts as a success.
    pub success: SuccessConfig,
    /// Where it was written.
    #[serde(skip)]
    pub written: crate::builtin::Written,
}

impl Task {
    /// The wanted `ψ_roll`, where the reward has one.
    #[must_use]
    pub fn target_deg(&self) -> Option<f64> {
        self.reward.iter().find_map(|term| term.target_deg)
    }

    /// Checks what the types cannot, first fault first.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] with the key at fault, which the caller can place in a file; or the
    /// error of the room that owns the value.
    pub fn validate(&self) -> Result<(), LabError> {
        let invalid =
            |key: String, requirement: String| Err(LabError::Invalid(Invalid { key, requirement }));
        crate::numbers::check(self)?;
        // It names directories.
        let plain = |c: char| c.is_alphanumeric() || " ._+=,@()-".contains(c);
        let ends = |c: char| c == ' ' || c == '.';
        if self.name.is_empty()
            || self.name.len() > 100
            || self.name.starts_with(ends)
            || self.name.ends_with(' ')
            || !self.name.chars().all(plain)
        {
            return invalid(
                "name".into(),
                format!(
                    "is {:?}; must be a name of at most 100 bytes: letters, digits and any of \"._+=,@()-\", with \
                     spaces between them and no point in front; it names directories",
                    self.name
                ),
            );
        }
        self.robot.validate()?;
        self.gait(&self.robot.outline())?;
        self.section.validate()?;
        if self.state.is_empty() {
            return invalid("state".into(), "needs at least one component".into());
        }
        if let Some(i) = (1..self.state.len()).find(|&i| self.state[..i].contains(&self.state[i])) {
            return invalid(
                "state".into(),
                format!("names {} twice", self.state[i].name()),
            );
        }
        self.plant_actions()?;
        if !self.map.invariant.is_empty() {
            return invalid(
                "map.invariant".into(),
                "is said by the components of the state (heading_deg); leave it out".into(),
            );
        }
        if self.reward.is_empty() {
            return invalid("reward".into(), "needs at least one [[reward]] term".into());
        }
        for (i, term) in self.reward.iter().enumerate() {
            let needs_target = term.quantity.has_target;
            if needs_target != term.target_deg.is_some() {
                let word = if needs_target {
                    "needs"
                } else {
                    "has no use for"
                };
                return invalid(
                    format!("reward.{i}"),
                    format!("this quantity {word} target_deg"),
                );
            }
            if !term.weight.is_finite() {
                return invalid(format!("reward.{i}.weight"), "must be finite".into());
            }
        }
        let f = &self.failure;
        for (key, value, low, high) in [
            ("failure.reward", f.reward, -1e6, 0.0),
            (
                "failure.psi_roll_below_deg",
                f.psi_roll_below_deg,
                -90.0,
                90.0,
            ),
            ("failure.com_height_below", f.com_height_below, 0.0, 1.0),
            ("failure.tilt_above_deg", f.tilt_above_deg, 1.0, 180.0),
            ("failure.no_section_s", f.no_section_s, 0.1, 60.0),
        ] {
            if !(low..=high).contains(&value) {
                return invalid(
                    key.into(),
                    format!("is {value}, must lie in [{low}, {high}]"),
                );
            }
        }
        let (n, m) = (self.state.len(), self.action.len());
        let actor_critic = self.learner.kind == LearnerKind::ACTOR_CRITIC;
        let explore = &self.collect.explore;
        for (key, found, expected, what) in [
            (
                "collect.explore.center",
                explore.center.len(),
                m,
                "component of the action",
            ),
            (
                "collect.explore.std",
                explore.std.len(),
                m,
                "component of the action",
            ),
            (
                "collect.later_noise_std",
                self.collect.later_noise_std.len(),
                m,
                "component of the action",
            ),
            (
                "learner.actor_critic.basis_widths",
                self.learner.actor_critic.basis_widths.len(),
                n,
                "component of the state",
            ),
            (
                "learner.actor_critic.action_unit",
                self.learner.actor_critic.action_unit.len(),
                m,
                "component of the action",
            ),
        ] {
            // A learner that is not chosen may have been left to what the task stands on.
            if found != expected && (actor_critic || !key.starts_with("learner.")) {
                return invalid(
                    key.into(),
                    format!("has {found} entries, needs one per {what}: {expected}"),
                );
            }
        }
        if explore.hold == 0 {
            return invalid(
                "collect.explore.hold".into(),
                "must be at least 1 stride".into(),
            );
        }
        for [low, high] in &explore.center {
            if !(low.is_finite() && high.is_finite() && low <= high) {
                return invalid(
                    "collect.explore.center".into(),
                    format!("[{low}, {high}] must be finite and in order"),
                );
            }
        }
        for (key, stds) in [
            ("collect.explore.std", &explore.std),
            ("collect.later_noise_std", &self.collect.later_noise_std),
        ] {
            if let Some(std) = stds.iter().find(|s| !(s.is_finite() && **s >= 0.0)) {
                return invalid(key.into(), format!("{std} must be finite and not negative"));
            }
        }
        if self.collect.strides.is_empty() || self.collect.strides[0] == 0 {
            return invalid(
                "collect.strides".into(),
                "must begin with at least 1 stride".into(),
            );
        }
        if self
            .collect
            .until_error
            .is_some_and(|e| !(e > 0.0 && e < 1.0))
        {
            return invalid(
                "collect.until_error".into(),
                "must lie between 0 and 1, in spreads of the data".into(),
            );
        }
        if self.algorithm.iterations == 0 {
            return invalid("algorithm.iterations".into(), "must be at least 1".into());
        }
        let a = &self.algorithm;
        if a.evaluation_strides > 0 && a.evaluation_discard >= a.evaluation_strides {
            return invalid(
                "algorithm.evaluation_discard".into(),
                format!(
                    "must leave some of the {} evaluation strides",
                    a.evaluation_strides
                ),
            );
        }
        if a.stop_below_improvement.is_some() && a.evaluation_strides == 0 {
            return invalid(
                "algorithm.stop_below_improvement".into(),
                "needs evaluation_strides, or there is nothing to compare".into(),
            );
        }
        if self.record.strides == 0 || self.record.iteration_strides == 0 {
            return invalid("record.strides".into(), "must be at least 1".into());
        }
        if self
            .record
            .walk_s
            .is_some_and(|s| !(1.0..=3600.0).contains(&s))
        {
            return invalid("record.walk_s".into(), "must be 1 to 3600 s".into());
        }
        if let Some(speed_s) = self.record.speed_s
            && !(speed_s >= 1.0 && self.record.walk_s.is_some_and(|walk_s| speed_s <= walk_s))
        {
            return invalid(
                "record.speed_s".into(),
                format!("is {speed_s}, must be at least 1 s and at most record.walk_s"),
            );
        }
        if let Some(caution) = &self.caution {
            caution.validate(m)?;
        }
        self.validate_learner()?;
        if !(0.0..=600.0).contains(&self.record.pose_seconds) {
            return invalid(
                "record.pose_seconds".into(),
                "must lie in [0, 600] s".into(),
            );
        }
        self.map_config().validate(n, m)?;
        crate::suffices::check(self)
    }

    /// The learner has what it needs.
    fn validate_learner(&self) -> Result<(), LabError> {
        let kind = self.learner.kind;
        if kind.needs_caution() && self.caution.is_none() {
            return Err(LabError::Invalid(Invalid {
                key: "learner.kind".into(),
                requirement: format!(
                    "{} searches within a trust region, and its policies are proven on the robot: it needs a [caution] \
                     section, which task {} has not (`compare {1} --controls` sets the task's learner beside \
                     simple controls)",
                    kind.name(),
                    self.name
                ),
            }));
        }
        kind.check(self)
    }

    /// Parameters of the search in the map.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] if the task has none.
    pub fn search(&self) -> Result<&SearchSettings, LabError> {
        self.learner.search.as_ref().ok_or_else(|| {
            LabError::Invalid(Invalid {
                key: "learner.search".into(),
                requirement: "is needed by learner.kind = \"search\"".into(),
            })
        })
    }

    /// Parameters of the controls that search on the robot.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] if the task has none.
    pub fn controls(&self) -> Result<&ControlsConfig, LabError> {
        self.learner.controls.as_ref().ok_or_else(|| {
            LabError::Invalid(Invalid {
                key: "learner.controls".into(),
                requirement: "is needed by the searches on the robot".into(),
            })
        })
    }

    /// Builds the nominal gait for a robot.
    ///
    /// # Errors
    ///
    /// [`LabError::Gait`] for a configuration outside its domain, or a robot that lacks a joint which the gait moves; [`LabError::Invalid`] for a kind that is not
    /// in the registry.
    pub fn gait(&self, robot: &RobotDescription) -> Result<Box<dyn Gait>, LabError> {
        (gaits().find(&self.gait.kind))
            .ok_or_else(|| {
                let names: Vec<&str> = gaits().all().iter().map(|g| g.name).collect();
                LabError::Invalid(Invalid {
                    key: "gait.kind".into(),
                    requirement: format!(
                        "there is no gait {:?} (allowed: {})",
                        self.gait.kind,
                        names.join(", ")
                    ),
                })
            })
            .and_then(|part| (part.build)(self, robot))
    }

    /// The components of the action, resolved against the gait's modulations.
    fn plant_actions(&self) -> Result<Vec<PlantAction>, LabError> {
        let invalid =
            |key: String, requirement: String| LabError::Invalid(Invalid { key, requirement });
        if self.action.is_empty() {
            return Err(invalid(
                "action".into(),
                "needs at least one [[action]]".into(),
            ));
        }
        let gait = self.gait(&self.robot.outline())?;
        let modulations = gait.modulations();
        let mut actions: Vec<PlantAction> = Vec::with_capacity(self.action.len());
        for (i, action) in self.action.iter().enumerate() {
            let Some(index) = modulations.iter().position(|m| m.name == action.modulates) else {
                let names: Vec<_> = modulations.iter().map(|m| m.name).collect();
                return Err(LabError::UnknownModulation {
                    key: format!("action.{i}.modulates"),
                    found: action.modulates.clone(),
                    allowed: names,
                });
            };
            if actions.iter().any(|a| a.modulation == index) {
                return Err(invalid(
                    format!("action.{i}.modulates"),
                    format!("names {} twice", action.modulates),
                ));
            }
            let m = &modulations[index];
            let [lower, upper] = action.bounds;
            if !(m.lower <= lower && lower <= upper && upper <= m.upper) {
                return Err(invalid(
                    format!("action.{i}.bounds"),
                    format!(
                        "[{lower}, {upper}] must lie in order within [{}, {}]",
                        m.lower, m.upper
                    ),
                ));
            }
            if !(lower..=upper).contains(&m.neutral) {
                return Err(invalid(
                    gait_key(m.name).map_or_else(|| format!("action.{i}.bounds"), str::to_owned),
                    format!(
                        "the gait's own {} lies outside of action.{i}.bounds = [{lower}, {upper}] of {}, so the \
                         nominal gait would be another one; widen the bounds (an [[action]] list of your own takes the \
                         place of an inherited one) or change the gait",
                        m.neutral, m.name
                    ),
                ));
            }
            if action
                .rate_per_stride
                .is_some_and(|r| r.is_nan() || r <= 0.0)
            {
                return Err(invalid(
                    format!("action.{i}.rate_per_stride"),
                    "must be positive".into(),
                ));
            }
            if !(action.gain > 0.0 && action.gain <= 1.0) {
                return Err(invalid(
                    format!("action.{i}.gain"),
                    "must lie in (0, 1]".into(),
                ));
            }
            actions.push(PlantAction {
                modulation: index,
                limits: ActionLimits {
                    lower,
                    upper,
                    rate_per_stride: action.rate_per_stride.unwrap_or(f64::INFINITY),
                    gain: action.gain,
                    neutral: m.neutral,
                },
            });
        }
        Ok(actions)
    }

    /// The action law of the task, the same on the robot and in the map.
    ///
    /// # Errors
    ///
    /// As [`Self::validate`].
    pub fn action_limits(&self) -> Result<Vec<ActionLimits>, LabError> {
        Ok(self
            .plant_actions()?
            .into_iter()
            .map(|a| a.limits)
            .collect())
    }

    /// The policy that leaves the nominal gait alone.
    ///
    /// # Errors
    ///
    /// As [`Self::validate`].
    pub fn nominal_policy(&self) -> Result<SavedPolicy, LabError> {
        let limits = self.action_limits()?;
        let neutral: Vec<f64> = limits.iter().map(|l| l.neutral).collect();
        let policy = ConstantPolicy::new(self.process_spec()?, &neutral)?;
        Ok(SavedPolicy::Constant(policy))
    }

    /// Names and bounds of states and actions.
    ///
    /// # Errors
    ///
    /// As [`Self::validate`].
    pub fn process_spec(&self) -> Result<ProcessSpec, LabError> {
        Ok(ProcessSpec {
            state: self
                .state
                .iter()
                .map(|c| StateDimension {
                    name: c.name().into(),
                })
                .collect(),
            action: self
                .action
                .iter()
                .zip(self.plant_actions()?)
                .map(|(config, a)| ActionDimension {
                    name: config.modulates.clone(),
                    lower: a.limits.lower,
                    upper: a.limits.upper,
                })
                .collect(),
        })
    }

    /// How the map is fitted, with what the components of the state say of it.
    #[must_use]
    pub fn map_config(&self) -> MapConfig {
        let components = self.state.iter().enumerate();
        MapConfig {
            invariant: components
                .filter(|(_, c)| c.invariant)
                .map(|(i, _)| i)
                .collect(),
            ..self.map.clone()
        }
    }

    /// Whether falls in this phase count towards `algorithm.falls_at_most`: in simulation those of record
    /// strides, which only report, do not.
    #[must_use]
    pub fn counts_falls_in(&self, phase: StridePhase) -> bool {
        self.link.is_some() || phase != StridePhase::Record
    }

    /// Refuses to go on after more falls than the task allows.
    ///
    /// # Errors
    ///
    /// [`LabError::FallBudget`] with every fall that counts.
    pub fn check_fall_budget(&self, falls: &[RobotFall]) -> Result<(), LabError> {
        let counted = falls.iter().filter(|f| self.counts_falls_in(f.phase));
        let falls: Vec<RobotFall> = counted.cloned().collect();
        let at_most = self.algorithm.falls_at_most;
        if falls.len() > at_most {
            return Err(LabError::FallBudget { at_most, falls });
        }
        Ok(())
    }

    /// Builds the robot, simulated in this process, with its gait as a stride process.
    ///
    /// # Errors
    ///
    /// [`LabError::NotHere`] if the robot is behind a link; [`LabError`] of the room at fault.
    pub fn plant(&self) -> Result<Plant, LabError> {
        if self.link.is_some() {
            return Err(LabError::NotHere);
        }
        let robot = self.robot.build();
        self.plant_on(robot.map_err(|error| self.located(error))?)
    }

    /// Puts the gait on a robot: a stride process.
    ///
    /// # Errors
    ///
    /// [`LabError`] of the room at fault.
    pub fn plant_on(&self, robot: Box<dyn Robot>) -> Result<Plant, LabError> {
        let task = PlantTask {
            state: self.state.clone(),
            action: self.plant_actions()?,
            reward: self.reward.clone(),
            failure: self.failure,
            section: self.section,
            warm_up_strides: self.collect.warm_up_strides,
        };
        let gait = self.gait(robot.description())?;
        Plant::new(robot, gait, self.process_spec()?, task)
    }
}
