//! What a real machine offers: readings of its sensors, and a command for every servo.

use std::any::Any;

use rand_chacha::ChaCha8Rng;

use crate::error::RobotError;
use crate::robot::JointLimits;
use crate::shape::{Pose, Shape};
use crate::state::{JointState, RobotState};

/// One reading of every sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorFrame {
    /// Time on the machine's own clock since its reset.
    pub time_s: f64,
    /// Every joint, in the machine's order and signs.
    pub joints: Vec<JointState>,
    /// Orientation of the base in the world as the inertial unit tells it, quaternion (w, x, y, z).
    pub orientation: [f64; 4],
    /// Angular velocity in the base's own axes, as the gyroscope tells it.
    pub angular_velocity_rad_s: [f64; 3],
    /// Vertical load of the left and the right foot.
    pub loads_n: [f64; 2],
}

impl SensorFrame {
    /// The first field that is NaN or infinite, by name; `None` if all are finite.
    #[must_use]
    pub fn first_not_finite(&self) -> Option<&'static str> {
        let all = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let joint = |j: &JointState| all(&[j.position_rad, j.velocity_rad_s, j.torque_nm]);
        [
            ("time_s", self.time_s.is_finite()),
            ("joints", self.joints.iter().all(joint)),
            ("orientation", all(&self.orientation)),
            ("angular_velocity_rad_s", all(&self.angular_velocity_rad_s)),
            ("loads_n", all(&self.loads_n)),
        ]
        .into_iter()
        .find(|(_, finite)| !finite)
        .map(|(name, _)| name)
    }
}

/// What does not change while a machine runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MachineDescription {
    /// Name for reports.
    pub name: String,
    /// Names of the joints, in the order of commands and readings.
    pub joint_names: Vec<String>,
    /// Time between two commands.
    pub control_period_s: f64,
    /// Limits of each joint, in the machine's signs.
    pub limits: Vec<JointLimits>,
}

/// A machine with servos and sensors: what a robot is before anyone estimates where it stands.
///
/// Commands are angles of every joint, in the machine's own order and signs. The contract is that of
/// [`Robot`](crate::Robot): a reset comes first, each step advances the clock by one control period,
/// commands that are not finite or too few are refused and change nothing.
pub trait Machine: Send {
    /// What does not change while it runs.
    fn description(&self) -> &MachineDescription;

    /// Brings the machine to rest with these angles, standing on both feet, with time 0.
    ///
    /// # Errors
    ///
    /// [`RobotError`] if the posture is refused or cannot be reached.
    fn reset(&mut self, command_rad: &[f64], rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError>;

    /// The last reading.
    fn frame(&self) -> &SensorFrame;

    /// Commands every joint for one control period and returns the reading at its end.
    ///
    /// # Errors
    ///
    /// [`RobotError`] if the command is refused or the equipment fails.
    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError>;

    /// Where the machine truly is; `None` for every real one.
    fn true_state(&self) -> Option<&RobotState> {
        None
    }

    /// Sets a force on the torso, as [`Robot::set_push`](crate::Robot::set_push).
    ///
    /// # Errors
    ///
    /// [`RobotError::Unsupported`] on a machine that cannot push itself.
    fn set_push(&mut self, _force_n: [f64; 3]) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "pushing the torso" })
    }

    /// Names the body that is pushed, as [`Robot::push_on`](crate::Robot::push_on).
    ///
    /// # Errors
    ///
    /// [`RobotError::NoBody`], or [`RobotError::Unsupported`] on a machine that cannot push itself.
    fn push_on(&mut self, _body: &str) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "pushing a named body" })
    }

    /// Takes over the moment of another machine, as [`Robot::take_over`](crate::Robot::take_over).
    ///
    /// # Errors
    ///
    /// [`RobotError::Unsupported`] where either is no simulation in this process, or they differ in shape.
    fn take_over(&mut self, _from: &dyn Machine) -> Result<(), RobotError> {
        Err(RobotError::Unsupported { what: "being changed while it walks" })
    }

    /// Itself, for [`take_over`](Self::take_over).
    fn as_any(&self) -> Option<&dyn Any> {
        None
    }

    /// Seconds of computing spent in the physics engine; `None` for a real machine.
    fn engine_seconds(&self) -> Option<f64> {
        None
    }

    /// What the machine looks like; empty if it does not say.
    fn geometry(&self) -> Vec<Shape> {
        Vec::new()
    }

    /// Writes where each body is; clears `out` if the machine does not say.
    fn poses(&self, out: &mut Vec<Pose>) {
        out.clear();
    }
}

impl<M: Machine + ?Sized> Machine for Box<M> {
    fn description(&self) -> &MachineDescription {
        (**self).description()
    }

    fn reset(&mut self, command_rad: &[f64], rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        (**self).reset(command_rad, rng)
    }

    fn frame(&self) -> &SensorFrame {
        (**self).frame()
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        (**self).step(command_rad)
    }

    fn true_state(&self) -> Option<&RobotState> {
        (**self).true_state()
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        (**self).set_push(force_n)
    }

    fn push_on(&mut self, body: &str) -> Result<(), RobotError> {
        (**self).push_on(body)
    }

    fn take_over(&mut self, from: &dyn Machine) -> Result<(), RobotError> {
        (**self).take_over(from)
    }

    fn as_any(&self) -> Option<&dyn Any> {
        (**self).as_any()
    }

    fn engine_seconds(&self) -> Option<f64> {
        (**self).engine_seconds()
    }

    fn geometry(&self) -> Vec<Shape> {
        (**self).geometry()
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        (**self).poses(out);
    }
}

/// Refuses commands that are not finite or not one per joint.
///
/// # Errors
///
/// [`RobotError::CommandLength`] or [`RobotError::BadCommand`].
pub fn check_command(command_rad: &[f64], joints: &[String]) -> Result<(), RobotError> {
    if command_rad.len() != joints.len() {
        return Err(RobotError::CommandLength { expected: joints.len(), found: command_rad.len() });
    }
    match command_rad.iter().position(|angle| !angle.is_finite()) {
        Some(i) => {
            Err(RobotError::BadCommand { joint: joints[i].clone(), what: "position_rad", value: command_rad[i] })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_commands_are_refused() {
        let names = ["hip", "knee"].map(String::from);
        assert!(matches!(check_command(&[0.0; 3], &names), Err(RobotError::CommandLength { expected: 2, found: 3 })));
        assert!(matches!(
            check_command(&[0.0, f64::NAN], &names),
            Err(RobotError::BadCommand { joint, .. }) if joint == "knee"
        ));
    }
}
