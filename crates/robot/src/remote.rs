//! Where a robot behind ROS 2 is, and how far it is trusted. Data only: the link itself is another room.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::robot::JointLimits;

/// The unit of a robot's angles and rates on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AngleUnit {
    /// Radians, as REP-103 has it.
    #[default]
    Rad,
    /// Degrees.
    Deg,
}

/// Limits of a joint that are tighter than those of its model; what is left out stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TighterLimits {
    /// Smallest angle of the robot's joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lower_deg: Option<f64>,
    /// Largest angle of the robot's joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upper_deg: Option<f64>,
    /// Largest rate, either way, > 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_rad_s: Option<f64>,
    /// Largest torque, either way, > 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_nm: Option<f64>,
}

impl TighterLimits {
    /// A model's limits, tightened. Angles count from the robot's own zero, as the model's do.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_robot::{JointLimits, TighterLimits};
    ///
    /// let model = JointLimits { lower_rad: -1.0, upper_rad: 1.0, velocity_rad_s: 5.0, torque_nm: 4.0 };
    /// let tighter = TighterLimits { torque_nm: Some(2.0), velocity_rad_s: Some(9.0), ..Default::default() };
    /// let limits = tighter.of(model);
    /// assert_eq!((limits.torque_nm, limits.velocity_rad_s), (2.0, 5.0));
    /// ```
    #[must_use]
    pub fn of(&self, model: JointLimits) -> JointLimits {
        let least = |own: f64, tighter: Option<f64>| tighter.map_or(own, |t| own.min(t));
        let rad = |deg: Option<f64>| deg.map(f64::to_radians);
        JointLimits {
            lower_rad: rad(self.lower_deg).map_or(model.lower_rad, |t| model.lower_rad.max(t)),
            upper_rad: least(model.upper_rad, rad(self.upper_deg)),
            velocity_rad_s: least(model.velocity_rad_s, self.velocity_rad_s),
            torque_nm: least(model.torque_nm, self.torque_nm),
        }
    }
}

/// A robot behind ROS 2: address, topics, and the bounds of the guards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2Config {
    /// Domain of the DDS network, 0 to 232.
    pub domain: u16,
    /// Address of the network interface. Loopback by default: nothing leaves this machine.
    pub interface: String,
    /// `sensor_msgs/JointState`.
    pub joint_states: String,
    /// `sensor_msgs/Imu`.
    pub imu: String,
    /// `geometry_msgs/WrenchStamped` of the left foot.
    pub left_foot: String,
    /// `geometry_msgs/WrenchStamped` of the right foot.
    pub right_foot: String,
    /// `std_msgs/Float64MultiArray`, one angle per joint in the order of `command_joints`.
    pub commands: String,
    /// The joints that the commands' topic takes, in its order; empty: all, in the order in which the robot
    /// names them in its joint states.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub command_joints: Vec<String>,
    /// Unit of angles and rates in joint states and commands.
    pub angle_unit: AngleUnit,
    /// `rosgraph_msgs/Clock`.
    pub clock: String,
    /// Stamps of joint states, inertial unit and feet that are this far apart at most belong to one reading;
    /// under half a control period. Default: 0.45 of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pair_within_s: Option<f64>,
    /// The machine's angle, in degrees, where the model's is zero; joints not named: 0.
    pub offset_deg: BTreeMap<String, f64>,
    /// Limits of joints, by their names, that are tighter than the model's.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub limits: BTreeMap<String, TighterLimits>,
    /// Seconds within which the robot must be found.
    pub connect_s: f64,
    /// Seconds of silence, on this machine's clock, after which the link counts as lost.
    pub silence_s: f64,
    /// Seconds of robot time between two states beyond which a stride is given up.
    pub gap_s: f64,
    /// Seconds of robot time over which the robot is brought from its measured pose to its posture.
    pub ramp_s: f64,
    /// Largest tilt at which a robot counts as upright.
    pub upright_deg: f64,
    /// Largest joint rate at which a robot counts as still.
    pub still_rad_s: f64,
    /// Whether the robot may be asked to put itself on its feet: a simulated one can; a real one is set
    /// up by hand.
    pub sets_itself_up: bool,
}

impl Default for Ros2Config {
    fn default() -> Self {
        Self {
            domain: 0,
            interface: "127.0.0.1".into(),
            joint_states: "/joint_states".into(),
            imu: "/imu".into(),
            left_foot: "/left_foot/wrench".into(),
            right_foot: "/right_foot/wrench".into(),
            commands: "/forward_command_controller/commands".into(),
            command_joints: Vec::new(),
            angle_unit: AngleUnit::Rad,
            clock: "/clock".into(),
            pair_within_s: None,
            offset_deg: BTreeMap::new(),
            limits: BTreeMap::new(),
            connect_s: 10.0,
            silence_s: 2.0,
            gap_s: 0.05,
            ramp_s: 1.0,
            upright_deg: 15.0,
            still_rad_s: 0.3,
            sets_itself_up: true,
        }
    }
}
