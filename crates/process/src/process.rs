//! The trait that the robot, the learned map and the exact maps share.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;

/// A state at the section, in the units of [`ProcessSpec::state`].
pub type State = SmallVec<[f64; 8]>;

/// An action, in the units of [`ProcessSpec::action`].
pub type Action = SmallVec<[f64; 8]>;

/// What the robot is asked to do in the next stride, such as a speed. Tasks with one purpose have none: it is empty.
pub type Goal = SmallVec<[f64; 4]>;

/// All that the choice of the next action may depend on, and with it what a map predicts from.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Situation {
    /// x(k).
    pub state: State,
    /// u(k−1), as it was applied.
    pub last_action: Action,
    /// What the next stride is asked to do.
    pub goal: Goal,
}

impl Clone for Situation {
    /// Slice by slice: number by number it is a tenth of an imagined stride.
    #[inline]
    fn clone(&self) -> Self {
        Self {
            state: State::from_slice(&self.state),
            last_action: Action::from_slice(&self.last_action),
            goal: Goal::from_slice(&self.goal),
        }
    }
}

impl<const N: usize> From<[f64; N]> for Situation {
    /// In a state, for who looks at nothing else.
    fn from(state: [f64; N]) -> Self {
        Self::of_state(&state)
    }
}

impl Situation {
    /// In a state, for who looks at nothing else.
    #[must_use]
    pub fn of_state(state: &[f64]) -> Self {
        Self { state: State::from_slice(state), ..Self::default() }
    }
}

/// One component of the state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StateDimension {
    /// Name with unit, e.g. `"psi_roll_deg"`.
    pub name: String,
}

/// One component of the action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionDimension {
    /// Name with unit, e.g. `"step_amplitude_deg"`.
    pub name: String,
    /// Smallest value that is ever applied.
    pub lower: f64,
    /// Largest value that is ever applied.
    pub upper: f64,
}

/// One component of the goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalDimension {
    /// Name with unit, e.g. `"forward_speed_m_s"`.
    pub name: String,
    /// Smallest value that is asked for.
    pub lower: f64,
    /// Largest value that is asked for.
    pub upper: f64,
}

/// What a learner may know of a process: how many numbers go in and out, and what they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessSpec {
    /// Components of the state.
    pub state: Vec<StateDimension>,
    /// Components of the action.
    pub action: Vec<ActionDimension>,
    /// Components of the goal; none where a task has one purpose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub goal: Vec<GoalDimension>,
}

/// How a stride ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrideEnd {
    /// The next section was reached.
    #[default]
    Crossing,
    /// The robot fell. Terminal.
    Fell,
    /// No section was reached within the time allowed. Terminal.
    NoCrossing,
    /// The equipment failed (link lost, emergency stop, simulator warning). Never training data.
    Aborted,
}

impl StrideEnd {
    /// Whether nothing follows this stride: its value is its reward alone, with no bootstrap.
    #[must_use]
    pub const fn is_terminal(self) -> bool {
        matches!(self, Self::Fell | Self::NoCrossing)
    }

    /// The word used in files, e.g. `"crossing"`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Crossing => "crossing",
            Self::Fell => "fell",
            Self::NoCrossing => "no_crossing",
            Self::Aborted => "aborted",
        }
    }
}

/// One stride: from one section to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Stride {
    /// Where it ended: the state at the next section (where the stride ended otherwise, the last state
    /// known), the action as it was applied, after bounds and rate limits, and the goal of the next stride.
    pub next: Situation,
    /// r(k+1).
    pub reward: f64,
    /// How it ended.
    pub end: StrideEnd,
}

impl Stride {
    /// The action as it was applied.
    #[must_use]
    pub const fn action(&self) -> &Action {
        &self.next.last_action
    }
}

/// What can go wrong inside a process. A fall is not an error: see [`StrideEnd`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessError {
    /// An action has the wrong number of components.
    #[error("action has {found} components, the process takes {expected}")]
    ActionLength {
        /// Components of [`ProcessSpec::action`].
        expected: usize,
        /// Components given.
        found: usize,
    },
    /// A component of an action is NaN or infinite.
    #[error("component {component} of the action is {value}; actions must be finite")]
    ActionNotFinite {
        /// Zero-based component.
        component: usize,
        /// The value given.
        value: f64,
    },
    /// `stride` was called before `reset`, or after a stride that ended without a crossing.
    #[error("the process has no state to go on from; reset it first")]
    NotReset,
    /// A parameter of the process lies outside its domain.
    #[error("{name} = {value}: {requirement}")]
    Parameter {
        /// The parameter's name.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What it must satisfy.
        requirement: &'static str,
    },
    /// A list does not have one entry per component.
    #[error("{what} has {found} components, {expected} are needed")]
    Length {
        /// The list.
        what: &'static str,
        /// Components needed.
        expected: usize,
        /// Components found.
        found: usize,
    },
    /// A stride without noise does not reach the next section.
    #[error("the stride does not return to the section: {}", end.name())]
    NoReturn {
        /// How it ended.
        end: StrideEnd,
    },
    /// The world behind the process failed beyond what a stride can report.
    #[error("{0}")]
    World(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// A walking robot seen once per stride, or anything that behaves like one.
///
/// # Contract
///
/// - [`reset`](Self::reset) puts the process at the section and returns the situation there.
/// - [`stride`](Self::stride) applies an action until the next section. Actions outside
///   [`ProcessSpec::action`]'s bounds are clipped to them; the action that was applied is in the
///   answer.
/// - After a stride that did not end with [`StrideEnd::Crossing`] the process must be reset.
/// - Equal generators and equal actions give equal strides, to the bit.
pub trait StrideProcess {
    /// Names and bounds of states and actions.
    fn spec(&self) -> &ProcessSpec;

    /// Starts anew at the section.
    ///
    /// # Errors
    ///
    /// [`ProcessError`] if the process cannot be started.
    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError>;

    /// Applies an action until the next section.
    ///
    /// # Errors
    ///
    /// [`ProcessError`] for an action of the wrong length or not finite, for a process that was not
    /// reset, or if the world behind the process fails.
    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError>;

    /// The map behind the process, where there is one that foresees strides; a robot has none.
    fn foresight(&self) -> Option<&dyn Foresight> {
        None
    }
}

/// A map whose mean can be asked for at any state: the learned map, the exact maps; not a robot.
pub trait MeanMap {
    /// The next state without noise, `f(x, u)` of \[MA09, eq. (7)\]; the action is clipped to the
    /// process's bounds.
    ///
    /// # Errors
    ///
    /// [`ProcessError::NoReturn`] if the stride does not reach the next section; [`ProcessError`] for a
    /// bad state or action.
    fn mean_next_state(&self, at: &Situation, action: &[f64]) -> Result<State, ProcessError>;
}

/// The next stride as a map foresees it: a normal distribution, its components independent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Foreseen {
    /// The action as it would be applied.
    pub applied: Action,
    /// Mean of each component of the next state, in its unit.
    pub mean: State,
    /// Variance of what a stride draws of each, in its unit squared; zero for a map without noise.
    pub variance: State,
    /// Expected reward, the price of a fall included.
    pub reward: f64,
    /// Probability of a fall, from 0 to 1.
    pub fall: f64,
}

/// A map that can be asked for the distribution of the next stride from any situation: what learners need
/// that take expectations or differentiate instead of drawing strides.
pub trait Foresight {
    /// The stride from a situation by an action, which goes through bounds and action law as in
    /// [`StrideProcess::stride`].
    ///
    /// # Errors
    ///
    /// [`ProcessError`] for a bad state or action.
    fn foresee(&self, at: &Situation, action: &[f64]) -> Result<Foreseen, ProcessError>;

    /// Whether a stride depends on the last action beyond the state.
    fn remembers(&self) -> bool {
        false
    }
}

/// Checks an action against a process: length and finiteness; then clips it to the bounds.
///
/// # Errors
///
/// [`ProcessError::ActionLength`] or [`ProcessError::ActionNotFinite`].
pub fn clipped_action(spec: &ProcessSpec, action: &[f64]) -> Result<Action, ProcessError> {
    if action.len() != spec.action.len() {
        return Err(ProcessError::ActionLength { expected: spec.action.len(), found: action.len() });
    }
    if let Some(component) = action.iter().position(|a| !a.is_finite()) {
        return Err(ProcessError::ActionNotFinite { component, value: action[component] });
    }
    Ok(action.iter().zip(&spec.action).map(|(a, d)| a.clamp(d.lower, d.upper)).collect())
}
