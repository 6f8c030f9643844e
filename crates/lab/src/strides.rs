//! Strides made on the robot, one record each.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_learn::{Acting, Policy, Seen};
use stridemap_process::{Action, ActionLimits, Actor, Made, Next, Situation, StrideEnd, roll_out};
use stridemap_record::Transition;
use stridemap_robot::Side;

use crate::dither::{Dither, Dithering};
use crate::error::LabError;
use crate::goal::{MeasurePart, measures};
use crate::plant::{Batch, Plant};

/// How the first batch explores a component: every `collect.explore.hold` strides a centre is drawn, uniform in `center`; the
/// value is the centre plus normal noise of standard deviation `std`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExploreRange {
    /// Range of the centre.
    pub center: [f64; 2],
    /// Standard deviation about the centre; left out: 0.15 units.
    pub std: f64,
}

/// Exploration without a policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Exploration {
    /// Where, per component of the action.
    pub ranges: Vec<ExploreRange>,
    /// Strides for which the centres are kept.
    pub hold: usize,
}

/// Integral action while it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegralAction {
    /// Component of the state that is `ψ_roll`.
    pub component: usize,
    /// The wanted `ψ_roll`, deg.
    pub target_deg: f64,
    /// Change of the action per stride and degree.
    pub gain_per_deg: f64,
    /// Bounds of the action, and where it starts.
    pub limits: ActionLimits,
}

impl IntegralAction {
    /// The action after one more section; `last` is the one before, `None` at the beginning.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::IntegralAction;
    /// use stridemap_process::ActionLimits;
    ///
    /// let limits =
    ///     ActionLimits { lower: 0.0, upper: 6.0, rate_per_stride: 2.0, gain: 1.0, neutral: 0.0 };
    /// let law = IntegralAction { component: 0, target_deg: 4.0, gain_per_deg: 0.5, limits };
    /// assert_eq!(law.next(None, &[5.0]), 0.5); // one degree too high
    /// assert_eq!(law.next(Some(0.5), &[3.0]), 0.0); // one too low
    /// assert_eq!(law.next(Some(0.0), &[3.0]), 0.0); // at its bound
    /// ```
    #[must_use]
    pub fn next(&self, last: Option<f64>, state: &[f64]) -> f64 {
        let from = last.unwrap_or(self.limits.neutral);
        let moved = from + self.gain_per_deg * (state[self.component] - self.target_deg);
        moved.clamp(self.limits.lower, self.limits.upper)
    }
}

/// Where actions on the robot come from.
pub enum ActionSource<'a> {
    /// Exploration without a policy.
    Explore(Exploration),
    /// Exploration around a policy's mean: centres a quarter as far apart, and the same noise.
    Around(&'a dyn Policy, Exploration),
    /// Draws from a policy, plus normal noise of these standard deviations.
    Sample(&'a dyn Policy, Vec<f64>),
    /// A policy's mean.
    Mean(&'a dyn Policy),
    /// Integral action, of tasks with one action.
    Integral(IntegralAction),
    /// A policy that follows goals, with noise about it.
    About(&'a dyn Policy, Dither),
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
    /// A policy that remembers, and the measures that it wants to see.
    acting: Option<Box<dyn Acting>>,
    wants: Vec<Option<&'static MeasurePart>>,
    dithering: Dithering,
}

impl<'a> Source<'a> {
    pub(crate) fn new(source: &'a ActionSource<'a>) -> Self {
        let policy = match source {
            ActionSource::Mean(policy) | ActionSource::About(policy, _) => Some(*policy),
            _ => None,
        };
        let wants = policy.map_or_else(Vec::new, |p| p.measures().iter().map(|name| measures().find(name)).collect());
        let acting = policy.and_then(Policy::acting);
        Self { source, center: Vec::new(), strides_at_center: 0, acting, wants, dithering: Dithering::default() }
    }

    fn ask(&mut self, policy: &dyn Policy, at: &Situation) -> Action {
        self.acting.as_mut().map_or_else(|| policy.mean(at), |acting| acting.act(at))
    }
}

impl Act for Source<'_> {
    fn act(&mut self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        let normal = |std: f64, rng: &mut ChaCha8Rng| {
            let z: f64 = StandardNormal.sample(rng);
            std * z
        };
        match self.source {
            ActionSource::Mean(policy) => self.ask(*policy, at),
            ActionSource::About(policy, dither) => {
                let asked = self.ask(*policy, at);
                self.dithering.about(&asked, dither, rng)
            }
            ActionSource::Integral(law) => {
                let next = law.next(self.center.first().copied(), &at.state);
                self.center = vec![next];
                std::iter::once(next).collect()
            }
            ActionSource::Sample(policy, noise) => {
                let drawn = policy.sample(at, rng);
                drawn.iter().zip(noise).map(|(u, std)| u + normal(*std, rng)).collect()
            }
            ActionSource::Explore(explore) | ActionSource::Around(_, explore) => {
                if self.strides_at_center == 0 {
                    let drawn = |&[low, high]: &[f64; 2]| low + (high - low) * rng.random::<f64>();
                    self.center = explore.ranges.iter().map(|range| &range.center).map(drawn).collect();
                }
                self.strides_at_center = (self.strides_at_center + 1) % explore.hold;
                let explored = self.center.iter().zip(&explore.ranges);
                let explored: Action = explored.map(|(center, range)| center + normal(range.std, rng)).collect();
                match self.source {
                    ActionSource::Around(policy, _) => {
                        policy.mean(at).iter().zip(&explored).map(|(u, off)| u + off).collect()
                    }
                    _ => explored,
                }
            }
        }
    }

    fn saw(&mut self, t: &Transition) -> Next {
        let fell = t.end != StrideEnd::Crossing;
        if let Some(acting) = &mut self.acting {
            let measured = self.wants.iter().map(|wanted| wanted.map_or(0.0, |part| (part.of)(&t.measures)));
            let measures: Vec<f64> = measured.collect();
            acting.saw(&Seen { state: &t.state, action: &t.action, goal: &t.goal, measures: &measures, fell });
        }
        if fell {
            self.dithering.fell();
        }
        Next::Go
    }
}

/// Strides in a row that the equipment may abort before a batch is given up.
const ABORTS_IN_A_ROW: usize = 5;

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
