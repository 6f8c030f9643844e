//! The trait that every robot implements.

use std::any::Any;

use rand_chacha::ChaCha8Rng;

use crate::command::JointTargets;
use crate::error::RobotError;
use crate::legs::{LegRole, Legs};
use crate::shape::{Pose, Shape};
use crate::state::RobotState;

/// How far and how hard a joint may go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointLimits {
    /// Smallest angle.
    pub lower_rad: f64,
    /// Largest angle.
    pub upper_rad: f64,
    /// Largest rate, either way.
    pub velocity_rad_s: f64,
    /// Largest torque, either way.
    pub torque_nm: f64,
}

/// One joint of a robot, in the robot's own name and sign.
#[derive(Clone, Debug, PartialEq)]
pub struct JointDescription {
    /// The robot's name of it.
    pub name: String,
    /// How far and how hard it may go.
    pub limits: JointLimits,
    /// Its angle in the robot's rest posture.
    pub rest_rad: f64,
}

/// What does not change while a robot runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotDescription {
    /// Name for reports.
    pub name: String,
    /// Time between two commands.
    pub control_period_s: f64,
    /// Total mass.
    pub mass_kg: f64,
    /// Every joint that takes commands, in the order of [`JointTargets`] and [`RobotState::joints`].
    pub joints: Vec<JointDescription>,
    /// Which of them play the parts of leg joints.
    pub legs: Legs<Option<LegRole>>,
}

impl RobotDescription {
    /// The rest posture.
    #[must_use]
    pub fn rest(&self) -> JointTargets {
        JointTargets::positions(self.joints.iter().map(|joint| joint.rest_rad))
    }

    /// Refuses targets that no robot takes, naming the joint.
    ///
    /// # Errors
    ///
    /// As [`JointTargets::check`].
    pub fn check(&self, targets: &JointTargets) -> Result<(), RobotError> {
        targets.check(self.joints.iter().map(|joint| joint.name.as_str()))
    }
}

/// How a base is held, as by a strap and two hands: softly, near a place and an attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hold {
    /// Attitude relative to that of the last reset: roll, pitch, yaw.
    pub turned_rad: [f64; 3],
    /// Height above that of the last reset.
    pub raised_m: f64,
    /// Share of the weight that is carried.
    pub weight_share: f64,
}

/// A robot: takes joint targets once per control period, answers with its state.
///
/// # Contract
///
/// - [`reset`](Self::reset) comes first; before it [`state`](Self::state) is the state in which the
///   robot was built.
/// - Each [`step`](Self::step) advances the robot's clock by the control period.
/// - Targets that are not one per joint, or not finite, are refused with [`RobotError::CommandLength`] or
///   [`RobotError::BadCommand`] before they reach a joint; the state is then unchanged.
/// - So are gains, rates and torques on a joint that cannot take them, with [`RobotError::JointCannot`]. They are
///   never left out in silence.
/// - A simulated robot that is reset with equal generators and given equal targets passes through
///   equal states, to the bit.
/// - Falling is not an error: the state says where the base is, and the task decides.
pub trait Robot: Send {
    /// What does not change while the robot runs.
    fn description(&self) -> &RobotDescription;

    /// Brings the robot to rest in a posture, standing on both feet, with time 0.
    ///
    /// Random disturbances of the start, where the robot's configuration asks for them, come from
    /// `rng`.
    ///
    /// # Errors
    ///
    /// [`RobotError`] if the posture is refused or cannot be reached.
    fn reset(&mut self, posture: &JointTargets, rng: &mut ChaCha8Rng) -> Result<&RobotState, RobotError>;

    /// The state after the last reset or step.
    fn state(&self) -> &RobotState;

    /// Where the robot truly is, where a simulator knows it and [`state`](Self::state) is only an
    /// estimate. `None` where the state is the truth, and for every real robot.
    fn true_state(&self) -> Option<&RobotState> {
        None
    }

    /// Commands the joints for one control period and returns the state at its end.
    ///
    /// # Errors
    ///
    /// [`RobotError`] if the targets are refused or the equipment fails.
    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError>;

    /// Sets a force, in the world frame, on the centre of mass of the torso, or of the body that
    /// [`push_on`](Self::push_on) named; it acts in every following
    /// step until it is set anew. Zero at reset.
    ///
    /// # Errors
    ///
    /// [`RobotError::Unsupported`] on a robot that cannot push itself (every real one).
    fn set_push(&mut self, _force_n: [f64; 3]) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "pushing the torso" })
    }

    /// Holds the base from now on, or lets go of it. Let go at reset.
    ///
    /// # Errors
    ///
    /// [`RobotError::Unsupported`] on a robot that cannot hold itself (every real one).
    fn hold(&mut self, _hold: Option<Hold>) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "holding the base" })
    }

    /// Names the body on which pushes act from now on.
    ///
    /// # Errors
    ///
    /// [`RobotError::NoBody`] with its bodies; [`RobotError::Unsupported`] on a robot that cannot push itself.
    fn push_on(&mut self, _body: &str) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "pushing a named body" })
    }

    /// Takes over the moment at which another simulated robot is, which has other masses, gains or friction, but the same
    /// joints: so a robot is changed in the middle of a walk.
    ///
    /// # Errors
    ///
    /// [`RobotError::Unsupported`] where either is no simulation in this process, or they differ in shape.
    fn take_over(&mut self, _from: &dyn Robot) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "being changed while it walks" })
    }

    /// Itself, for [`take_over`](Self::take_over); `None` for a robot that no other can take over from.
    fn as_any(&self) -> Option<&dyn Any> {
        None
    }

    /// Seconds of computing spent in the physics engine alone since the robot was built; `None` for
    /// a robot that is not simulated.
    fn engine_seconds(&self) -> Option<f64> {
        None
    }

    /// What the robot looks like, for drawing; empty if it does not say.
    fn geometry(&self) -> Vec<Shape> {
        Vec::new()
    }

    /// Writes where each body is after the last reset or step, in the order to which
    /// [`Shape::body`] refers; clears `out` if the robot does not say. Reuses `out`'s memory.
    fn poses(&self, out: &mut Vec<Pose>) {
        out.clear();
    }
}
