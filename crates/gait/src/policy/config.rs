//! What a file says of a pretrained policy: the tables `[policy]`, `[clock]` and `[model]`.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// A value that is written in the file, or taken from the network's metadata (JSON, or a list with commas).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Source<T> {
    /// From the metadata of the network.
    Metadata {
        /// The key there.
        metadata: String,
    },
    /// Here.
    Here(T),
}

/// A number for every joint, or one for each, in the policy's order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Each {
    /// The same for all.
    All(f64),
    /// One for each.
    PerJoint(Vec<f64>),
}

impl Each {
    /// The numbers of `count` joints; how many there are, where that is another number.
    ///
    /// # Errors
    ///
    /// The number found.
    pub fn of(&self, count: usize) -> Result<Vec<f64>, usize> {
        match self {
            Self::All(value) => Ok(vec![*value; count]),
            Self::PerJoint(values) if values.len() == count => Ok(values.clone()),
            Self::PerJoint(values) => Err(values.len()),
        }
    }
}

/// What a term of the observation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TermKind {
    /// The network's last answer, clipped, not scaled; one number per joint.
    LastAction,
    /// Angular velocity of the base in its axes, rad/s.
    BaseAngularVelocity,
    /// Velocity of the base in its axes, m/s: an estimate, on a real robot.
    BaseLinearVelocity,
    /// Direction of gravity in the base's axes: (0, 0, −1) upright.
    Gravity,
    /// Commanded speed forward and to the left, m/s.
    CommandVelocity,
    /// Commanded yaw rate, rad/s.
    CommandYawRate,
    /// Commanded speed forward, to the left, and yaw rate.
    Command,
    /// Angle of each joint less its rest, rad.
    JointPosition,
    /// Rate of each joint, rad/s.
    JointVelocity,
    /// Cosine of the clock's phase, one per foot.
    ClockCos,
    /// Sine of the clock's phase, one per foot.
    ClockSin,
}

impl TermKind {
    /// The word in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::LastAction => "last_action",
            Self::BaseAngularVelocity => "base_angular_velocity",
            Self::BaseLinearVelocity => "base_linear_velocity",
            Self::Gravity => "gravity",
            Self::CommandVelocity => "command_velocity",
            Self::CommandYawRate => "command_yaw_rate",
            Self::Command => "command",
            Self::JointPosition => "joint_position",
            Self::JointVelocity => "joint_velocity",
            Self::ClockCos => "clock_cos",
            Self::ClockSin => "clock_sin",
        }
    }

    /// Numbers of it, for a policy with so many joints and feet.
    #[must_use]
    pub const fn width(self, joints: usize, feet: usize) -> usize {
        match self {
            Self::LastAction | Self::JointPosition | Self::JointVelocity => joints,
            Self::BaseAngularVelocity | Self::BaseLinearVelocity | Self::Gravity | Self::Command => 3,
            Self::CommandVelocity => 2,
            Self::CommandYawRate => 1,
            Self::ClockCos | Self::ClockSin => feet,
        }
    }
}

/// One term of the observation; their order is the network's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TermConfig {
    /// What it is.
    pub term: TermKind,
    /// Factor on its numbers, or one for each.
    #[serde(default = "unit")]
    pub scale: Each,
    /// How many of the newest observations of it the network sees, oldest first.
    #[serde(default = "one")]
    pub history: usize,
    /// Largest size of its numbers, after the scale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<f64>,
}

fn unit() -> Each {
    Each::All(1.0)
}

const fn one() -> usize {
    1
}

/// What a history holds before there is one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryFill {
    /// The first observation, as often as needed.
    #[default]
    First,
    /// Zeros.
    Zero,
}

/// A joint of the robot that the policy does not drive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldJoint {
    /// Its name in the robot's model.
    pub joint: String,
    /// Where it is held.
    #[serde(default)]
    pub rest_rad: f64,
    /// Stiffness, N m/rad.
    pub kp: f64,
    /// Damping, N m s/rad.
    pub kd: f64,
}

/// The table `[policy]`: a network, what it sees, what its answer means.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyConfig {
    /// The network's file.
    pub onnx: PathBuf,
    /// SHA-256 of the file, in hex; another file is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Under which licence the file came; for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub licence: Option<String>,
    /// Answers per second.
    pub rate_hz: f64,
    /// The joints that it drives, by their names in the model, in the network's order.
    pub joints: Source<Vec<String>>,
    /// Stiffness of each joint, N m/rad.
    pub kp: Source<Each>,
    /// Damping of each joint, N m s/rad.
    pub kd: Source<Each>,
    /// Rest angle of each joint: angles are seen, and answers meant, from there.
    pub rest_rad: Each,
    /// Radians per unit of the answer.
    pub action_scale: Each,
    /// Largest size of an answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_clip: Option<f64>,
    /// Largest size of any number that the network sees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub observation_clip: Option<f64>,
    /// What the network sees.
    pub observation: Vec<TermConfig>,
    /// What a history holds before there is one.
    #[serde(default)]
    pub history_fill: HistoryFill,
    /// Commands on which it was trained: speed forward, to the left (m/s), yaw rate (rad/s); ±1 where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command_range: Option<[[f64; 2]; 3]>,
    /// Body or site in whose axes it sees angular velocity and gravity; left out: the base.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gyro_frame: Option<String>,
    /// Joints of the robot that it does not drive.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<HeldJoint>,
}

/// The table `[clock]`: phases that the network sees, one per foot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockConfig {
    /// Time of a full cycle: two steps.
    pub period_s: f64,
    /// Phase of each foot at the start, left first.
    pub start_rad: Vec<f64>,
    /// Below this speed (m/s) and yaw rate (rad/s) commanded, every phase that the network sees is `still_rad`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub still_below: Option<f64>,
    /// Phase of a robot that stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub still_rad: Option<f64>,
}

/// The table `[model]`: the robot that the policy was trained on, in MuJoCo. It becomes the task's `[robot]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// The model's file; its meshes and actuators are not used.
    pub mjcf: PathBuf,
    /// Bodies of the feet; left and right, for more than two in turn.
    pub feet: Vec<String>,
    /// Time between two physics steps.
    pub time_step_s: f64,
    /// Inertia of each motor as its joint feels it, kg m².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub armature: Option<Each>,
    /// Dry friction of every joint, N m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_friction: Option<f64>,
    /// Damping of every joint beside the servo's, N m s/rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_damping: Option<f64>,
    /// Whether the servo's damping is integrated implicitly, as a property of the joint, outside of the torque's limit.
    #[serde(default)]
    pub implicit_damping: bool,
    /// Largest torque of each joint, N m; left out: the model's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque_limit: Option<Each>,
    /// Sliding friction of the feet on the floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foot_friction: Option<f64>,
    /// A base lower than this has fallen.
    pub fallen_below_m: f64,
}
