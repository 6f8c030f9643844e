//! Strides made on the robot, one record each.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_learn::Policy;
use stridemap_process::{Action, Actor, Made, Next, Situation, StrideEnd, roll_out};
use stridemap_record::{StridePhase, StrideRole, Transition};
use stridemap_robot::Side;

use crate::error::LabError;
use crate::learner::IntegralAction;
use crate::plant::Plant;
use crate::task::ExploreRange;

/// Exploration without a policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Exploration {
    /// Where, per component of the action.
    pub ranges: Vec<ExploreRange>,
    /// Strides for which the centres are kept.
    pub hold: usize,
}

/// Where actions on the robot come from.
pub enum ActionSource<'a> {
    /// Exploration without a policy.
    Explore(Exploration),
    /// Draws from a policy, plus normal noise of these standard deviations.
    Sample(&'a dyn Policy, Vec<f64>),
    /// A policy's mean.
    Mean(&'a dyn Policy),
    /// Integral action, of tasks with one action.
    Integral(IntegralAction),
}

/// Acts on the robot, stride by stride, and sees how each one ended.
pub trait Act {
    /// The action wanted at a situation.
    fn act(&mut self, at: &Situation, rng: &mut ChaCha8Rng) -> Action;

    /// A stride ended (aborted ones are not shown). The batch ends when it is full, or when this says
    /// so.
    fn saw(&mut self, _transition: &Transition) -> Next {
        Next::Go
    }
}

/// Draws actions for one episode after another.
pub(crate) struct Source<'a> {
    source: &'a ActionSource<'a>,
    center: Vec<f64>,
    strides_at_center: usize,
}

impl<'a> Source<'a> {
    pub(crate) fn new(source: &'a ActionSource<'a>) -> Self {
        Self { source, center: Vec::new(), strides_at_center: 0 }
    }
}

impl Act for Source<'_> {
    fn act(&mut self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        let normal = |std: f64, rng: &mut ChaCha8Rng| {
            let z: f64 = StandardNormal.sample(rng);
            std * z
        };
        match self.source {
            ActionSource::Mean(policy) => policy.mean(at),
            ActionSource::Integral(law) => {
                let next = law.next(self.center.first().copied(), &at.state);
                self.center = vec![next];
                std::iter::once(next).collect()
            }
            ActionSource::Sample(policy, noise) => {
                let drawn = policy.sample(at, rng);
                drawn.iter().zip(noise).map(|(u, std)| u + normal(*std, rng)).collect()
            }
            ActionSource::Explore(explore) => {
                if self.strides_at_center == 0 {
                    let drawn = |&[low, high]: &[f64; 2]| low + (high - low) * rng.random::<f64>();
                    self.center = explore.ranges.iter().map(|range| &range.center).map(drawn).collect();
                }
                self.strides_at_center = (self.strides_at_center + 1) % explore.hold;
                let explored = self.center.iter().zip(&explore.ranges);
                explored.map(|(center, range)| center + normal(range.std, rng)).collect()
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
    drive(plant, &mut Source::new(source), batch, rng, before, observe)
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
    let mut driver = Driver {
        actor,
        batch,
        before,
        observe,
        transitions: Vec::with_capacity(batch.strides.min(1024)),
        first_episode: 0,
        aborts: 0,
        stance: None,
    };
    while driver.transitions.len() < batch.strides {
        let Some(stride) = plant.next_recalled(&batch) else {
            break;
        };
        // The actor draws and sees what it drew and saw then.
        driver.actor.act(&stride.situation(), rng);
        driver.first_episode = stride.episode + 1;
        if stride.end != StrideEnd::Aborted {
            let next = driver.actor.saw(&stride);
            driver.transitions.push(stride);
            if next == Next::Stop {
                return Ok(driver.transitions);
            }
        }
    }
    if !driver.is_done(plant) {
        roll_out(plant, usize::MAX, &mut driver, rng)?;
    }
    Ok(driver.transitions)
}

/// Makes a record of each stride that an actor makes on the plant.
struct Driver<'a> {
    actor: &'a mut dyn Act,
    batch: Batch,
    before: &'a mut dyn FnMut(&mut Plant, usize),
    observe: &'a mut dyn FnMut(&Transition) -> Result<(), LabError>,
    transitions: Vec<Transition>,
    first_episode: usize,
    aborts: usize,
    /// The leg that the robot stood on when the stride began.
    stance: Option<Side>,
}

impl Driver<'_> {
    fn is_done(&self, plant: &Plant) -> bool {
        self.transitions.len() >= self.batch.strides || plant.has_fallen_too_often()
    }
}

impl Actor<Plant, LabError> for Driver<'_> {
    fn act(&mut self, plant: &mut Plant, at: &Situation, rng: &mut ChaCha8Rng) -> Result<Action, LabError> {
        let action = self.actor.act(at, rng);
        self.stance = plant.stance();
        (self.before)(plant, self.transitions.len());
        Ok(action)
    }

    fn saw(&mut self, plant: &mut Plant, made: Made<'_>) -> Result<Next, LabError> {
        let transition = plant.transition(self.batch, self.first_episode, self.stance, made);
        (self.observe)(&transition)?;
        if transition.end == StrideEnd::Aborted {
            self.aborts += 1;
            if self.aborts == ABORTS_IN_A_ROW {
                let reason = plant.abort_reason().map(ToString::to_string).unwrap_or_default();
                return Err(LabError::Equipment { aborts: self.aborts, reason });
            }
        } else {
            self.aborts = 0;
            let next = self.actor.saw(&transition);
            self.transitions.push(transition);
            if next == Next::Stop {
                return Ok(next);
            }
        }
        Ok(if self.is_done(plant) { Next::Stop } else { Next::Go })
    }
}
