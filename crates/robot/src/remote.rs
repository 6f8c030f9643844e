//! Where a robot behind ROS 2 is, and how far it is trusted. Data only: the link itself is another room.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

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
    /// `std_msgs/Float64MultiArray`, one angle per joint in the order of the joint states.
    pub commands: String,
    /// `rosgraph_msgs/Clock`.
    pub clock: String,
    /// The machine's angle, in degrees, where the model's is zero; joints not named: 0.
    pub offset_deg: BTreeMap<String, f64>,
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
            clock: "/clock".into(),
            offset_deg: BTreeMap::new(),
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
