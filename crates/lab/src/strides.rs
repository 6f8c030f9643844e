//! Strides made on the robot, one record each.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_learn::Policy;
use stridemap_process::{Action, State, StrideEnd, StrideProcess};
use stridemap_record::{StridePhase, StrideRole, Transition};

use crate::error::LabError;
use crate::learner::IntegralAction;
use crate::plant::Plant;
use crate::task::ExploreConfig;

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
        Self { source, center: Vec::new(), strides_at_center: 0 }
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
                drawn.iter().zip(*noise).map(|(u, std)| u + normal(*std, rng)).collect()
            }
            ActionSource::Explore(explore) => {
                if self.strides_at_center == 0 {
                    self.center =
                        explore.center.iter().map(|[low, high]| low + (high - low) * rng.random::<f64>()).collect();
                }
                self.strides_at_center = (self.strides_at_center + 1) % explore.hold;
                let explored = self.center.iter().zip(&explore.std);
                explored.map(|(center, std)| center + normal(*std, rng)).collect()
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
                let reason = plant.abort_reason().map(ToString::to_string).unwrap_or_default();
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
