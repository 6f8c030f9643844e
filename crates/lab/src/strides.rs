//! Strides made on the robot, one record each.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_learn::Policy;
use stridemap_returnmap::{Action, State, StrideEnd, StrideProcess};
use stridemap_robot::Side;

use crate::compare::Spread;
use crate::error::LabError;
use crate::fall::Fall;
use crate::learner::IntegralAction;
use crate::measure::StrideMeasures;
use crate::plant::Plant;
use crate::return_line::ReturnMapLine;
use crate::task::ExploreConfig;
use crate::walk::Walk;

/// Why a stride was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrideRole {
    /// Offered to the map.
    Training,
    /// Run to choose, prove or stop.
    Evaluation,
    /// Run only to report.
    Record,
}

impl StrideRole {
    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Evaluation => "evaluation",
            Self::Record => "record",
        }
    }
}

/// In which phase of a run a stride was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StridePhase {
    /// Exploring, or drawing from the stochastic policy.
    Collect,
    /// Running the policy's mean to see how good it is.
    Evaluate,
    /// Running a policy's mean to report.
    Record,
}

impl StridePhase {
    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Collect => "collect",
            Self::Evaluate => "evaluate",
            Self::Record => "record",
        }
    }
}

/// One stride on the robot: (x, u, x′, reward, how it ended), and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Transition {
    /// Iteration of Algorithm 1, from 1.
    pub iteration: usize,
    /// In which phase it was made.
    pub phase: StridePhase,
    /// What it is for. Evaluation strides that are offered to the map have the training role.
    pub role: StrideRole,
    /// Episode within its phase, from 0; a new one begins with each fresh start.
    pub episode: usize,
    /// Stride within its episode, from 0.
    pub k: usize,
    /// Robot time at its end, since the fresh start.
    pub time_s: f64,
    /// The leg that carried the robot at the section where it began.
    pub stance: Option<Side>,
    /// x(k).
    pub state: State,
    /// u(k−1), as applied.
    pub last_action: Action,
    /// u(k), as applied.
    pub action: Action,
    /// x(k+1); the last state known where the stride did not reach the section.
    pub next_state: State,
    /// r(k+1).
    pub reward: f64,
    /// How it ended.
    pub end: StrideEnd,
    /// Why, if it was a fall or a stall; unknown in tables of earlier versions.
    pub fall: Option<Fall>,
    /// What was measured of it.
    pub measures: StrideMeasures,
    /// `ψ_roll` at its end as a simulator knows it, where the robot only estimates it. Not in files.
    pub true_psi_roll_deg: Option<f64>,
    /// Way of the centre of mass along the episode's first heading, likewise. Not in files.
    pub true_forward_m: Option<f64>,
}

/// Where actions on the robot come from.
pub enum ActionSource<'a> {
    /// Exploration without a policy.
    Explore(&'a ExploreConfig),
    /// Draws from a policy, plus normal noise of these standard deviations.
    Sample(&'a dyn Policy, &'a [f64]),
    /// A policy's mean.
    Mean(&'a dyn Policy),
    /// Integral action, of tasks with one action.
    Integral(IntegralAction),
}

/// What the robot is to do after a stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Go on.
    Go,
    /// End the batch here.
    Stop,
}

/// Acts on the robot, stride by stride, and sees how each one ended.
pub trait Act {
    /// The action wanted at a state.
    fn act(&mut self, state: &[f64], rng: &mut ChaCha8Rng) -> Action;

    /// A stride ended (aborted ones are not shown). The batch ends when it is full, or when this says
    /// so.
    fn saw(&mut self, _transition: &Transition) -> Next {
        Next::Go
    }
}

/// Draws actions for one episode after another.
pub(crate) struct Actor<'a> {
    source: &'a ActionSource<'a>,
    center: Vec<f64>,
    strides_at_center: usize,
}

impl<'a> Actor<'a> {
    pub(crate) fn new(source: &'a ActionSource<'a>) -> Self {
        Self {
            source,
            center: Vec::new(),
            strides_at_center: 0,
        }
    }
}

impl Act for Actor<'_> {
    fn act(&mut self, state: &[f64], rng: &mut ChaCha8Rng) -> Action {
        let normal = |std: f64, rng: &mut ChaCha8Rng| {
            let z: f64 = StandardNormal.sample(rng);
            std * z
        };
        match self.source {
            ActionSource::Mean(policy) => policy.mean(state),
            ActionSource::Integral(law) => {
                let next = law.next(self.center.first().copied(), state);
                self.center = vec![next];
                std::iter::once(next).collect()
            }
            ActionSource::Sample(policy, noise) => {
                let drawn = policy.sample(state, rng);
                drawn
                    .iter()
                    .zip(*noise)
                    .map(|(u, std)| u + normal(*std, rng))
                    .collect()
            }
            ActionSource::Explore(explore) => {
                if self.strides_at_center == 0 {
                    self.center = explore
                        .center
                        .iter()
                        .map(|[low, high]| low + (high - low) * rng.random::<f64>())
                        .collect();
                }
                self.strides_at_center = (self.strides_at_center + 1) % explore.hold;
                let explored = self.center.iter().zip(&explore.std);
                explored
                    .map(|(center, std)| center + normal(*std, rng))
                    .collect()
            }
        }
    }
}

/// Strides in a row that the equipment may abort before a batch is given up.
const ABORTS_IN_A_ROW: usize = 5;

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

/// Makes a batch of strides on the robot, from a fresh start, starting afresh after each fall.
///
/// `before` is called before each stride with the plant and the stride's index in the batch (to push,
/// say); `observe` sees each stride as it ends. Aborted strides are shown, but neither returned nor
/// counted.
///
/// # Errors
///
/// [`LabError::Process`] if the plant cannot be started or driven; [`LabError::Equipment`] after
/// several aborted strides in a row. What `observe` has seen stays valid.
///
/// Strides that the plant [recalls](Plant::recall) come first, are returned and counted, and not observed again.
pub fn make_strides(
    plant: &mut Plant,
    source: &ActionSource<'_>,
    batch: Batch,
    rng: &mut ChaCha8Rng,
    before: &mut dyn FnMut(&mut Plant, usize),
    observe: &mut dyn FnMut(&Transition) -> Result<(), LabError>,
) -> Result<Vec<Transition>, LabError> {
    drive(plant, &mut Actor::new(source), batch, rng, before, observe)
}

/// Makes strides as [`make_strides`] does, by an actor that sees how each one ended and may end the
/// batch before it is full. It ends as well when the robot has fallen more often than it may.
///
/// # Errors
///
/// As [`make_strides`].
pub fn drive(
    plant: &mut Plant,
    actor: &mut dyn Act,
    batch: Batch,
    rng: &mut ChaCha8Rng,
    before: &mut dyn FnMut(&mut Plant, usize),
    observe: &mut dyn FnMut(&Transition) -> Result<(), LabError>,
) -> Result<Vec<Transition>, LabError> {
    let mut transitions = Vec::with_capacity(batch.strides.min(1024));
    let (mut episode, mut k, mut aborts) = (0, 0, 0);
    let mut state: Option<State> = None;
    while transitions.len() < batch.strides {
        let Some(stride) = plant.next_recalled(&batch) else {
            break;
        };
        // The actor draws and sees what it drew and saw then.
        actor.act(&stride.state, rng);
        episode = stride.episode + 1;
        if stride.end != StrideEnd::Aborted {
            let next = actor.saw(&stride);
            transitions.push(stride);
            if next == Next::Stop {
                return Ok(transitions);
            }
        }
    }
    while transitions.len() < batch.strides && !plant.has_fallen_too_often() {
        let from = match state.take() {
            Some(state) => state,
            None => plant.reset(rng)?,
        };
        let action = actor.act(&from, rng);
        let (stance, last_action) = (plant.stance(), plant.last_action().clone());
        before(plant, transitions.len());
        let stride = plant.stride(&action, rng)?;
        let transition = Transition {
            iteration: batch.iteration,
            phase: batch.phase,
            role: batch.role,
            episode,
            k,
            time_s: plant.robot().state().time_s,
            stance,
            state: from,
            last_action,
            action: stride.action,
            next_state: stride.next_state,
            reward: stride.reward,
            end: stride.end,
            fall: plant.last_fall(),
            measures: *plant.last_measures(),
            true_psi_roll_deg: plant.true_psi_roll_deg(),
            true_forward_m: plant.true_forward_m(),
        };
        observe(&transition)?;
        if transition.end == StrideEnd::Crossing {
            state = Some(transition.next_state.clone());
            k += 1;
        } else {
            episode += 1;
            k = 0;
        }
        if transition.end == StrideEnd::Aborted {
            aborts += 1;
            if aborts == ABORTS_IN_A_ROW {
                let reason = plant
                    .abort_reason()
                    .map(ToString::to_string)
                    .unwrap_or_default();
                return Err(LabError::Equipment { aborts, reason });
            }
        } else {
            aborts = 0;
            let next = actor.saw(&transition);
            transitions.push(transition);
            if next == Next::Stop {
                break;
            }
        }
    }
    Ok(transitions)
}

/// What a policy achieved over a batch: the numbers of a measured policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Performance {
    /// Strides averaged.
    pub strides: usize,
    /// Mean reward over them; a fall scores its own reward.
    pub mean_reward: f64,
    /// Standard deviation of the reward over them, with n − 1; `None` for fewer than two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reward_sd: Option<f64>,
    /// Mean `ψ_roll` at the section over those that reached one; `None` if none did.
    pub mean_psi_roll_deg: Option<f64>,
    /// The same as a simulator knows it, where the robot only estimates it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_mean_psi_roll_deg: Option<f64>,
    /// Falls, among the strides left out of the mean as well.
    pub falls: usize,
    /// Stalls, likewise.
    pub stalls: usize,
    /// Speed on the ground, where the task measures it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walk: Option<Walk>,
    /// Return map k to k + 1 over all strides, the ones left out of the means as well: they show how the
    /// gait settles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub return_map_1: Option<ReturnMapLine>,
    /// Return map k to k + 2, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub return_map_2: Option<ReturnMapLine>,
}

impl Performance {
    /// Sums up a batch, leaving its first `discard` strides out of the means.
    ///
    /// # Example
    ///
    /// ```
    /// let nothing = stridemap_lab::Performance::of(&[], 0);
    /// assert_eq!((nothing.strides, nothing.mean_psi_roll_deg), (0, None));
    /// ```
    #[must_use]
    pub fn of(transitions: &[Transition], discard: usize) -> Self {
        let counted = |end| transitions.iter().filter(|t| t.end == end).count();
        let kept = transitions.get(discard..).unwrap_or(&[]);
        let mean = |values: Vec<f64>| {
            let count = values.len();
            (count > 0).then(|| values.into_iter().fold(0.0, |sum, v| sum + v) / count as f64)
        };
        let crossed = || kept.iter().filter(|t| t.end == StrideEnd::Crossing);
        let rewards: Vec<f64> = kept.iter().map(|t| t.reward).collect();
        let Spread {
            mean: mean_reward,
            sd: reward_sd,
        } = Spread::of(&rewards);
        let truth: Option<Vec<f64>> = crossed().map(|t| t.true_psi_roll_deg).collect();
        Self {
            true_mean_psi_roll_deg: truth.and_then(mean),
            strides: kept.len(),
            mean_reward,
            reward_sd,
            mean_psi_roll_deg: mean(crossed().map(|t| t.measures.psi_roll_deg).collect()),
            falls: counted(StrideEnd::Fell),
            stalls: counted(StrideEnd::NoCrossing),
            walk: None,
            return_map_1: ReturnMapLine::of(transitions, 1),
            return_map_2: ReturnMapLine::of(transitions, 2),
        }
    }

    /// Mean `ψ_roll` as one reads it.
    #[must_use]
    pub fn psi_roll(&self) -> String {
        self.mean_psi_roll_deg.map_or_else(
            || "psi_roll unknown: no stride reached the section".into(),
            |mean| format!("psi_roll {mean:.2} deg"),
        )
    }
}
