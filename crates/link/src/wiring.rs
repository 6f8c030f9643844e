//! Which number on the wire belongs to which joint: names, order, offsets, units.

use stridemap_robot::{AngleUnit, JointState as JointReading, RobotError, Ros2Config};

use crate::error::LinkError;
use crate::messages::{Header, JointState};

/// From the robot's joint states to the machine's joints, and from the machine's command to the robot's.
///
/// ```text
/// machine angle = unit · message angle − offset        message angle = (machine angle + offset) / unit
/// ```
///
/// The robot's joints may come in any order; the command goes out in the order of `link.command_joints`, or,
/// where that is empty, of the robot's own joint states (as `ros2_control` has it). A robot that lacks a joint
/// of the map, names one twice or has one that the map does not know is refused: its commands would land on
/// other joints.
#[derive(Clone, Debug)]
pub(crate) struct Wiring {
    names: Vec<String>,
    offset_rad: Vec<f64>,
    unit_rad: f64,
    /// For each number of a command, the machine's joint.
    commanded: Vec<usize>,
    fixed: bool,
    /// The robot's own names, as last seen, and for each of the machine's joints its place among them.
    seen: Vec<String>,
    places: Vec<usize>,
    /// Whether a joint's velocity, and whether its effort, was ever not told.
    untold: [bool; 2],
}

fn mismatch(joint: &str, why: &'static str) -> RobotError {
    RobotError::JointMap { joint: joint.to_owned(), why }
}

impl Wiring {
    /// The wiring of a machine with these joints.
    ///
    /// # Errors
    ///
    /// [`LinkError::Config`] if the configuration names a joint that the machine does not have.
    pub fn new(config: &Ros2Config, names: Vec<String>) -> Result<Self, LinkError> {
        let place = |field: &'static str, joint: &String| {
            names.iter().position(|n| n == joint).ok_or_else(|| LinkError::Config {
                field,
                value: joint.clone(),
                problem: format!("is not a joint of the robot; its joints are {names:?}"),
            })
        };
        let mut offset_rad = vec![0.0; names.len()];
        for (joint, degrees) in &config.offset_deg {
            offset_rad[place("offset_deg", joint)?] = degrees.to_radians();
        }
        let commanded =
            config.command_joints.iter().map(|joint| place("command_joints", joint)).collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            fixed: !commanded.is_empty(),
            commanded,
            offset_rad,
            unit_rad: match config.angle_unit {
                AngleUnit::Rad => 1.0,
                AngleUnit::Deg => std::f64::consts::PI / 180.0,
            },
            seen: Vec::new(),
            places: Vec::new(),
            untold: [false; 2],
            names,
        })
    }

    /// Finds the machine's joints among the robot's.
    ///
    /// # Errors
    ///
    /// [`RobotError::JointMap`].
    pub fn find(&mut self, robot: &[String]) -> Result<(), RobotError> {
        if self.seen == robot && !robot.is_empty() {
            return Ok(());
        }
        let mut places = Vec::with_capacity(self.names.len());
        for name in &self.names {
            let mut found = robot.iter().enumerate().filter(|(_, have)| *have == name);
            match (found.next(), found.next()) {
                (Some((at, _)), None) => places.push(at),
                (None, _) => return Err(mismatch(name, "is not a joint of the robot")),
                (Some(_), Some(_)) => return Err(mismatch(name, "is named twice by the robot")),
            }
        }
        if !self.fixed {
            let stranger = robot.iter().find(|have| !self.names.contains(have));
            if let Some(stranger) = stranger {
                return Err(mismatch(
                    stranger,
                    "is a joint of the robot that the task's model does not have; if it is not commanded, \
                     list the joints that are in link.command_joints",
                ));
            }
            self.commanded = vec![0; robot.len()];
            for (joint, at) in places.iter().enumerate() {
                self.commanded[*at] = joint;
            }
        }
        self.places = places;
        self.seen = robot.to_vec();
        Ok(())
    }

    /// What the robot does not tell of its joints and what counts as 0 therefore, in words.
    pub fn untold(&self) -> Option<&'static str> {
        match self.untold {
            [false, false] => None,
            [true, false] => Some("velocity"),
            [false, true] => Some("effort"),
            [true, true] => Some("velocity and effort"),
        }
    }

    /// The names of the machine's joints.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The machine's joints in a message. Rates and torques that are absent or NaN are not measured: 0.
    ///
    /// # Errors
    ///
    /// [`RobotError::JointMap`]; [`RobotError::CommandLength`] if an array has not one number per name.
    pub fn read(&mut self, message: &JointState) -> Result<Vec<JointReading>, RobotError> {
        let expected = message.name.len();
        let measured = [&message.velocity, &message.effort];
        let measured = measured.iter().filter(|v| !v.is_empty()).map(|v| v.len());
        if let Some(found) = std::iter::once(message.position.len()).chain(measured).find(|found| *found != expected) {
            return Err(RobotError::CommandLength { expected, found });
        }
        self.find(&message.name)?;
        let untold = |values: &[f64]| values.is_empty() || values.iter().any(|v| v.is_nan());
        self.untold[0] |= untold(&message.velocity);
        self.untold[1] |= untold(&message.effort);
        let unit = self.unit_rad;
        let read = self.places.iter().zip(&self.offset_rad);
        let measured = |values: &[f64], at: usize| {
            let value = values.get(at).copied();
            value.filter(|v| !v.is_nan()).unwrap_or(0.0)
        };
        Ok(read
            .map(|(&at, offset)| JointReading {
                position_rad: unit * message.position[at] - offset,
                velocity_rad_s: unit * measured(&message.velocity, at),
                torque_nm: measured(&message.effort, at),
            })
            .collect())
    }

    /// The machine's joints as a robot with this wiring would tell them.
    pub fn tell(&self, header: Header, joints: &[JointReading]) -> JointState {
        let told = joints.iter().zip(&self.offset_rad);
        JointState {
            header,
            name: self.names.clone(),
            position: told.map(|(j, offset)| (j.position_rad + offset) / self.unit_rad).collect(),
            velocity: joints.iter().map(|j| j.velocity_rad_s / self.unit_rad).collect(),
            effort: joints.iter().map(|j| j.torque_nm).collect(),
        }
    }

    /// The numbers of a command, in the robot's order; empty before the robot's joints were seen.
    pub fn write(&self, command_rad: &[f64]) -> Vec<f64> {
        self.commanded.iter().map(|&joint| (command_rad[joint] + self.offset_rad[joint]) / self.unit_rad).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(joints: &[&str]) -> Vec<String> {
        joints.iter().map(|&j| j.to_owned()).collect()
    }

    fn state(joints: &[&str], position: &[f64]) -> JointState {
        JointState { name: names(joints), position: position.to_vec(), ..JointState::default() }
    }

    fn read(wiring: &mut Wiring, message: &JointState) -> Vec<f64> {
        let read = wiring.read(message).unwrap();
        read.iter().map(|j| j.position_rad).collect()
    }

    #[test]
    fn another_order_on_the_wire_is_the_same_joints() {
        let config = Ros2Config { offset_deg: [("b".to_owned(), 90.0)].into(), ..Ros2Config::default() };
        let mut wiring = Wiring::new(&config, names(&["a", "b", "c"])).unwrap();
        let right = std::f64::consts::FRAC_PI_2;
        let angles = read(&mut wiring, &state(&["c", "a", "b"], &[0.3, 0.1, 0.2 + right]));
        assert!((angles[0] - 0.1).abs() < 1e-15 && (angles[1] - 0.2).abs() < 1e-15);
        let sent = wiring.write(&angles);
        assert!((sent[0] - 0.3).abs() < 1e-15, "c comes first");
        assert!((sent[1] - 0.1).abs() < 1e-15 && (sent[2] - 0.2 - right).abs() < 1e-15);
    }

    #[test]
    fn degrees_and_a_controller_of_some_joints() {
        let config =
            Ros2Config { angle_unit: AngleUnit::Deg, command_joints: names(&["c", "a"]), ..Ros2Config::default() };
        let mut wiring = Wiring::new(&config, names(&["a", "b", "c"])).unwrap();
        let message = state(&["neck", "a", "b", "c"], &[1.0, 180.0, 0.0, 90.0]);
        let angles = read(&mut wiring, &message);
        assert!((angles[0] - std::f64::consts::PI).abs() < 1e-12);
        let sent = wiring.write(&angles);
        assert!((sent[0] - 90.0).abs() < 1e-12 && (sent[1] - 180.0).abs() < 1e-12);
    }

    #[test]
    fn a_robot_with_other_joints_is_refused_by_name() {
        let mut wiring = Wiring::new(&Ros2Config::default(), names(&["a", "b"])).unwrap();
        for (joints, culprit) in [(&["a", "x"][..], "b"), (&["a", "b", "neck"], "neck"), (&["a", "b", "b"], "b")] {
            let error = wiring.read(&state(joints, &[0.0; 3][..joints.len()]));
            assert!(matches!(&error, Err(RobotError::JointMap { joint, .. }) if joint == culprit), "{error:?}");
        }
        let short = wiring.read(&state(&["a", "b"], &[0.0]));
        assert!(matches!(short, Err(RobotError::CommandLength { .. })));
        let config = Ros2Config { offset_deg: [("elbow".to_owned(), 1.0)].into(), ..Ros2Config::default() };
        let error = Wiring::new(&config, names(&["a"])).unwrap_err().to_string();
        assert!(error.contains("elbow") && error.contains("offset_deg"), "{error}");
    }
}
