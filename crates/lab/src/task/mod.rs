//! A task: what a TOML file under `experiments/` says.

mod action;
mod check;
mod parts;
mod scale;

pub use action::ActionConfig;
pub(crate) use action::COMPONENTS;
pub use parts::{AlgorithmConfig, CollectConfig, ExploreConfig, LearnerConfig, RecordConfig, SuccessConfig};

pub use scale::ScaleConfig;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use stridemap_config::Document;
use stridemap_gait::GaitConfig;
use stridemap_learn::{ConstantPolicy, KeptPolicy, SavedPolicy};
use stridemap_map::MapConfig;
use stridemap_mujoco::MujocoConfig;
use stridemap_process::{ActionDimension, ActionLimits, ProcessSpec, StateDimension};
use stridemap_record::{RobotFall, StridePhase};
use stridemap_robot::{Robot, Ros2Config};
use stridemap_section::SectionConfig;

use crate::caution::CautionConfig;
use crate::error::{Invalid, LabError};
use crate::fall::FailureConfig;
use crate::goal::GoalConfig;
use crate::learner::{ControlsConfig, SearchSettings};
use crate::limits::VerdictConfig;
use crate::plant::{Plant, PlantAction, PlantTask};
use crate::reward::RewardTerm;
use crate::state::StateComponent;

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
    /// Components of the goal; left out: the task has one purpose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub goal: Vec<GoalConfig>,
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
    /// Limits of a deployment; left out: those of `stridemap verdict`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<VerdictConfig>,
    /// The gait for which the actions were chosen, where they are to be scaled to this task's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<ScaleConfig>,
    /// Keys whose values the robot's own nominal gait has still to tell (`"auto"` in a file).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub auto: Vec<String>,
    /// Where values came from that the robot told: a line each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub told: Vec<String>,
    /// The policy that was proven before on a robot that is now another, from which it begins: it takes the place of the
    /// nominal gait as the mark to beat, and exploration goes around it. Kept in the run as `policy/0.json`.
    #[serde(skip)]
    pub proven: Option<SavedPolicy>,
    /// Where it was written.
    #[serde(skip)]
    pub written: Written,
}

/// Where a task was written, for faults that are found once its robot is built; no part of its value.
#[derive(Clone, Debug, Default)]
pub struct Written(pub(crate) Option<Arc<Document>>);

impl PartialEq for Written {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Task {
    /// The wanted `ψ_roll`, where the reward has one.
    #[must_use]
    pub fn target_deg(&self) -> Option<f64> {
        self.reward.iter().find_map(|term| term.target_deg)
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

    /// The components of the action, resolved against the gait's modulations.
    fn plant_actions(&self) -> Result<Vec<PlantAction>, LabError> {
        let invalid = |key: String, requirement: String| LabError::Invalid(Invalid { key, requirement });
        if self.action.is_empty() {
            return Err(invalid("action".into(), "needs at least one [[action]]".into()));
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
                return Err(invalid(format!("action.{i}.modulates"), format!("names {} twice", action.modulates)));
            }
            let m = &modulations[index];
            let [lower, upper] = action.bounds;
            if !(m.lower <= lower && lower <= upper && upper <= m.upper) {
                return Err(invalid(
                    format!("action.{i}.bounds"),
                    format!("[{lower}, {upper}] must lie in order within [{}, {}]", m.lower, m.upper),
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
            action.check(i)?;
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
        Ok(self.plant_actions()?.into_iter().map(|a| a.limits).collect())
    }

    /// The policy that leaves the nominal gait alone; with goals, the raw command; where a task begins from a proven policy, that.
    ///
    /// # Errors
    ///
    /// As [`Self::validate`].
    pub fn nominal_policy(&self) -> Result<SavedPolicy, LabError> {
        if let Some(proven) = &self.proven {
            return Ok(proven.clone());
        }
        if !self.goal.is_empty() {
            return Ok(self.raw_command()?.to_saved());
        }
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
            state: self.state.iter().map(|c| StateDimension { name: c.name().into() }).collect(),
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
            goal: self.goal.iter().map(GoalConfig::dimension).collect(),
        })
    }

    /// How the map is fitted, with what the components of the state say of it.
    #[must_use]
    pub fn map_config(&self) -> MapConfig {
        let components = self.state.iter().enumerate();
        MapConfig { invariant: components.filter(|(_, c)| c.invariant).map(|(i, _)| i).collect(), ..self.map.clone() }
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
            goals: self.goal.clone(),
            reward: self.reward.clone(),
            failure: self.failure,
            section: self.section,
            warm_up_strides: self.collect.warm_up_strides,
        };
        let gait = self.gait(robot.description())?;
        Plant::new(robot, gait, self.process_spec()?, task)
    }
}
