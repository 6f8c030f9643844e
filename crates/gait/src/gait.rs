//! What a gait is.

use stridemap_robot::{JointTargets, RobotState, Side};

/// One way in which a policy may change a gait.
///
/// A modulation has a value at all times. It keeps the value given last until the next one, and
/// starts at [`neutral`](Self::neutral), with which the gait is the nominal one.
#[derive(Clone, Debug, PartialEq)]
pub struct Modulation {
    /// Name with unit, e.g. `"step_amplitude_deg"`.
    pub name: &'static str,
    /// Value of the nominal gait.
    pub neutral: f64,
    /// Smallest value that makes sense on any robot.
    pub lower: f64,
    /// Largest value that makes sense on any robot.
    pub upper: f64,
    /// What it does, in one line.
    pub about: &'static str,
}

/// What can go wrong in a gait.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GaitError {
    /// A parameter of the gait lies outside its domain.
    #[error("gait.{name} = {value}: {requirement}")]
    Parameter {
        /// Key in the configuration.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What it must satisfy.
        requirement: &'static str,
    },
    /// The robot lacks a joint that the gait moves.
    #[error("robot.{side}: names no {joint}; the gait moves it in each leg (hip_yaw and ankle_roll may be left out)")]
    NoJoint {
        /// `left` or `right`.
        side: &'static str,
        /// The part that no joint plays.
        joint: &'static str,
    },
    /// The tables of a pretrained policy, its network and the robot do not fit together.
    #[error("gait.{key}: {what}")]
    Policy {
        /// Key in the configuration.
        key: String,
        /// What is wrong with it.
        what: String,
    },
    /// There is no modulation of this index.
    #[error("modulation {index} does not exist; this gait has {count}")]
    NoSuchModulation {
        /// The index given.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A modulation was given a value outside its domain, or NaN.
    #[error("{name} = {value} is outside [{lower}, {upper}]")]
    ModulationOutOfRange {
        /// The modulation.
        name: &'static str,
        /// The value given.
        value: f64,
        /// Its smallest value.
        lower: f64,
        /// Its largest value.
        upper: f64,
    },
}

/// A nominal controller that can be modulated.
///
/// # Contract
///
/// - [`reset`](Self::reset) comes before the first [`targets`](Self::targets) of an episode; it puts
///   every modulation back to neutral.
/// - [`targets`](Self::targets) is called once per control period with the newest state; it may see
///   the whole state and may have a state of its own.
/// - Equal states and modulations give equal targets.
pub trait Gait: Send {
    /// The ways in which this gait may be changed. The order is fixed: an index into this slice
    /// names a modulation.
    fn modulations(&self) -> &[Modulation];

    /// The posture from which the gait starts.
    fn rest(&self) -> &JointTargets;

    /// Starts anew, with every modulation neutral.
    fn reset(&mut self);

    /// Sets a modulation from now on.
    ///
    /// # Errors
    ///
    /// [`GaitError::NoSuchModulation`] or [`GaitError::ModulationOutOfRange`]; the gait is then
    /// unchanged.
    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError>;

    /// Writes what is asked of every joint of the robot for the next control period of `dt_s`. Joints that the gait
    /// does not move are held at rest. Reuses `out`'s memory.
    fn targets(&mut self, state: &RobotState, dt_s: f64, out: &mut JointTargets);

    /// Seconds after a reset until the gait is at full amplitude.
    fn start_up_s(&self) -> f64;

    /// Phase of the gait as the leg on this side sees it, in any turn: equal for both legs at the
    /// moments when their parts are exchanged. `None` for a gait that has none.
    fn phase_rad(&self, _leg: Side) -> Option<f64> {
        None
    }
}
