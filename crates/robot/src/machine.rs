//! What a real machine offers: readings of its sensors, and a command for every servo.

use rand_chacha::ChaCha8Rng;

use crate::error::RobotError;
use crate::legs::{JointTargets, LegJoint, Legs, Side};
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
    fn reset(
        &mut self,
        command_rad: &[f64],
        rng: &mut ChaCha8Rng,
    ) -> Result<&SensorFrame, RobotError>;

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
        Err(RobotError::Unsupported {
            what: "pushing the torso",
        })
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

    fn reset(
        &mut self,
        command_rad: &[f64],
        rng: &mut ChaCha8Rng,
    ) -> Result<&SensorFrame, RobotError> {
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
/// [`RobotError::CommandLength`] or [`RobotError::JointNotFinite`].
pub fn check_command(command_rad: &[f64], joints: &[String]) -> Result<(), RobotError> {
    if command_rad.len() != joints.len() {
        return Err(RobotError::CommandLength {
            expected: joints.len(),
            found: command_rad.len(),
        });
    }
    match command_rad.iter().position(|angle| !angle.is_finite()) {
        Some(i) => Err(RobotError::JointNotFinite {
            joint: joints[i].clone(),
            value_rad: command_rad[i],
        }),
        None => Ok(()),
    }
}

/// Where one of Stridemap's leg joints is on a machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MappedJoint {
    /// Position among the machine's joints.
    pub index: usize,
    /// +1 if the machine's axis agrees with Stridemap's, −1 if not.
    pub sign: f64,
    /// The machine's angle where Stridemap's is zero.
    pub offset_rad: f64,
}

/// From Stridemap's ten leg joints to all joints of a machine, and back.
///
/// ```text
/// machine angle = sign · Stridemap angle + offset
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct JointMap {
    /// The leg joints.
    pub legs: Legs<MappedJoint>,
    /// The command of every joint of the machine; those of the legs are overwritten.
    pub hold_rad: Vec<f64>,
}

impl JointMap {
    /// Finds the leg joints by their names.
    ///
    /// `name` gives sign and name of a leg joint on the machine; `offset_rad` the machine's angle
    /// where Stridemap's is zero; `hold_rad` the angle of each joint beyond the legs.
    ///
    /// # Errors
    ///
    /// [`RobotError::JointMap`] that names a joint which the machine does not have, or which is named
    /// twice.
    pub fn find<'a>(
        joints: &[String],
        name: impl Fn(Side, LegJoint) -> (f64, &'a str),
        offset_rad: impl Fn(&str) -> f64,
        hold_rad: impl Fn(&str) -> f64,
    ) -> Result<Self, RobotError> {
        let mut fault = None;
        let mut taken = vec![false; joints.len()];
        let legs = Legs::from_fn(|side, joint| {
            let (sign, wanted) = name(side, joint);
            let index = joints.iter().position(|have| have == wanted);
            match index {
                Some(index) if !taken[index] => {
                    taken[index] = true;
                    MappedJoint {
                        index,
                        sign,
                        offset_rad: offset_rad(wanted),
                    }
                }
                found => {
                    let why = if found.is_some() {
                        "is named twice"
                    } else {
                        "is not a joint of the robot"
                    };
                    fault.get_or_insert_with(|| RobotError::JointMap {
                        joint: wanted.to_owned(),
                        why,
                    });
                    MappedJoint::default()
                }
            }
        });
        match fault {
            Some(fault) => Err(fault),
            None => Ok(Self {
                legs,
                hold_rad: joints.iter().map(|j| hold_rad(j)).collect(),
            }),
        }
    }

    /// The command of every joint of the machine.
    #[must_use]
    pub fn command(&self, targets: &JointTargets) -> Vec<f64> {
        let mut command = self.hold_rad.clone();
        for (side, leg_joint, at) in self.legs.iter() {
            command[at.index] = at.sign * targets.position_rad[(side, leg_joint)] + at.offset_rad;
        }
        command
    }

    /// The leg joints of a reading, in Stridemap's signs.
    #[must_use]
    pub fn legs_of(&self, joints: &[JointState]) -> Legs<JointState> {
        Legs::from_fn(|side, joint| {
            let at = self.legs[(side, joint)];
            let read = joints[at.index];
            JointState {
                position_rad: at.sign * (read.position_rad - at.offset_rad),
                velocity_rad_s: at.sign * read.velocity_rad_s,
                torque_nm: at.sign * read.torque_nm,
            }
        })
    }

    /// The limits of the leg joints, in Stridemap's signs.
    #[must_use]
    pub fn limits_of(&self, limits: &[JointLimits]) -> Legs<JointLimits> {
        Legs::from_fn(|side, joint| {
            let at = self.legs[(side, joint)];
            let own = limits[at.index];
            let [a, b] =
                [own.lower_rad, own.upper_rad].map(|angle| at.sign * (angle - at.offset_rad));
            JointLimits {
                lower_rad: a.min(b),
                upper_rad: a.max(b),
                ..own
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::legs::LEG_JOINTS;

    fn names() -> Vec<String> {
        let mut names = vec!["neck".to_owned()];
        for side in ["l", "r"] {
            names.extend(LEG_JOINTS.map(|j| format!("{side}_{}", j.name())));
        }
        names
    }

    fn map() -> JointMap {
        let names = names();
        let name = |side: Side, joint: LegJoint| {
            let at = 1 + 5 * side.index() + joint.index();
            (
                if joint == LegJoint::Knee { -1.0 } else { 1.0 },
                names[at].as_str(),
            )
        };
        let offset = |name: &str| if name == "l_knee" { 0.1 } else { 0.0 };
        JointMap::find(&names, name, offset, |_| 0.7).unwrap()
    }

    #[test]
    fn commands_and_readings_are_inverse() {
        let map = map();
        let targets = JointTargets {
            position_rad: Legs::from_fn(|s, j| 0.01 * (5 * s.index() + j.index()) as f64 - 0.03),
        };
        let command = map.command(&targets);
        assert!((command[0] - 0.7).abs() < 1e-15);
        let knee = targets.position_rad[(Side::Left, LegJoint::Knee)];
        assert!((command[3] - (0.1 - knee)).abs() < 1e-15);
        let joints: Vec<JointState> = command
            .iter()
            .map(|&position_rad| JointState {
                position_rad,
                velocity_rad_s: 1.0,
                torque_nm: 2.0,
            })
            .collect();
        let legs = map.legs_of(&joints);
        for (side, joint, read) in legs.iter() {
            assert!((read.position_rad - targets.position_rad[(side, joint)]).abs() < 1e-15);
            let sign = if joint == LegJoint::Knee { -1.0 } else { 1.0 };
            assert!((read.velocity_rad_s - sign).abs() < 1e-15);
        }
    }

    #[test]
    fn a_joint_that_is_missing_or_named_twice_is_refused_by_name() {
        let names = names();
        let missing = JointMap::find(&names, |_, _| (1.0, "elbow"), |_| 0.0, |_| 0.0);
        assert!(matches!(missing, Err(RobotError::JointMap { joint, .. }) if joint == "elbow"));
        let twice = JointMap::find(&names, |_, _| (1.0, "neck"), |_| 0.0, |_| 0.0);
        assert!(matches!(twice, Err(RobotError::JointMap { why, .. }) if why.contains("twice")));
    }

    #[test]
    fn limits_follow_the_sign_and_the_offset() {
        let own = JointLimits {
            lower_rad: -1.0,
            upper_rad: 2.0,
            velocity_rad_s: 3.0,
            torque_nm: 4.0,
        };
        let limits = map().limits_of(&[own; 11]);
        let knee = limits[(Side::Left, LegJoint::Knee)];
        assert!((knee.lower_rad + 1.9).abs() < 1e-15 && (knee.upper_rad - 1.1).abs() < 1e-15);
    }

    #[test]
    fn bad_commands_are_refused() {
        let names = names();
        assert!(matches!(
            check_command(&[0.0; 3], &names),
            Err(RobotError::CommandLength {
                expected: 11,
                found: 3
            })
        ));
        let mut command = vec![0.0; 11];
        command[2] = f64::NAN;
        assert!(matches!(
            check_command(&command, &names),
            Err(RobotError::JointNotFinite { joint, .. }) if joint == names[2]
        ));
    }
}
