//! What a user says about a simulated robot.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use stridemap_robot::{JointDescription, JointLimits, LegJoint, LegRole, Legs, RobotDescription, Side};

use crate::changes::ChangesConfig;
use crate::error::{MujocoError, check, nearest};
use crate::hardware::HardwareConfig;
use crate::per_joint::{PerJoint, Posture, RestAngle};
use crate::sensors::SensorConfig;

/// Where a model comes from.
///
/// In a file it is one string: `"biped"`, `"op3"`, or the path of an MJCF file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum ModelSource {
    /// The 1.6 m, 95 kg biped that is part of this crate ([`BIPED_XML`](crate::BIPED_XML)).
    #[default]
    Biped,
    /// The 0.52 m, 3.15 kg humanoid ROBOTIS OP3 ([`OP3_XML`](crate::OP3_XML)).
    Op3,
    /// An MJCF file.
    File(PathBuf),
}

impl From<String> for ModelSource {
    fn from(text: String) -> Self {
        match text.as_str() {
            "biped" => Self::Biped,
            "op3" => Self::Op3,
            path => Self::File(path.into()),
        }
    }
}

impl From<ModelSource> for String {
    fn from(source: ModelSource) -> Self {
        source.to_string()
    }
}

impl std::fmt::Display for ModelSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Biped => write!(f, "biped"),
            Self::Op3 => write!(f, "op3"),
            Self::File(path) => write!(f, "{}", path.display()),
        }
    }
}

/// The model's names for one leg.
///
/// A minus before a joint's name says that the model's axis points against Stridemap's: hip pitch +
/// swings the thigh forward, knee flexion is negative, ankle pitch + lifts the toes, rolls turn about +x, yaws
/// about +z. A joint that is left out, or `""` where a task that is extended names one, is none of the gait's: the
/// robot may lack it, or hold it at rest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LegMap {
    /// Joint that turns the hip about the vertical.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hip_yaw: Option<String>,
    /// Joint that rolls the hip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hip_roll: Option<String>,
    /// Joint that pitches the hip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hip_pitch: Option<String>,
    /// Knee.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub knee: Option<String>,
    /// Joint that pitches the ankle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ankle_pitch: Option<String>,
    /// Joint that rolls the ankle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ankle_roll: Option<String>,
    /// Body of the foot; bodies below it (toes) count as part of the foot. On a robot of four legs the bodies of both feet
    /// of the side, with a space between them.
    pub foot: String,
}

impl LegMap {
    /// The names of the built-in biped.
    #[must_use]
    pub fn biped(side: Side) -> Self {
        let name = |part: &str| format!("{}_{part}", side.name());
        let joint = |joint: LegJoint| Some(name(joint.name()));
        Self {
            hip_yaw: None,
            hip_roll: joint(LegJoint::HipRoll),
            hip_pitch: joint(LegJoint::HipPitch),
            knee: joint(LegJoint::Knee),
            ankle_pitch: joint(LegJoint::AnklePitch),
            ankle_roll: joint(LegJoint::AnkleRoll),
            foot: name("foot"),
        }
    }

    /// A leg of which only the foot is named.
    #[must_use]
    pub fn of_foot(foot: impl Into<String>) -> Self {
        Self {
            hip_yaw: None,
            hip_roll: None,
            hip_pitch: None,
            knee: None,
            ankle_pitch: None,
            ankle_roll: None,
            foot: foot.into(),
        }
    }

    /// The names of ROBOTIS OP3. Its pitch joints turn the other way on the other leg, and its hips roll
    /// about −x.
    #[must_use]
    pub fn op3(side: Side) -> Self {
        let (prefix, left, right) = match side {
            Side::Left => ("l", "-", ""),
            Side::Right => ("r", "", "-"),
        };
        Self {
            hip_yaw: None,
            hip_roll: Some(format!("-{prefix}_hip_roll")),
            hip_pitch: Some(format!("{left}{prefix}_hip_pitch")),
            knee: Some(format!("{left}{prefix}_knee")),
            ankle_pitch: Some(format!("{right}{prefix}_ank_pitch")),
            ankle_roll: Some(format!("{prefix}_ank_roll")),
            foot: format!("{prefix}_ank_roll_link"),
        }
    }

    /// The entry of a joint.
    pub(crate) fn joint_mut(&mut self, joint: LegJoint) -> &mut Option<String> {
        match joint {
            LegJoint::HipYaw => &mut self.hip_yaw,
            LegJoint::HipRoll => &mut self.hip_roll,
            LegJoint::HipPitch => &mut self.hip_pitch,
            LegJoint::Knee => &mut self.knee,
            LegJoint::AnklePitch => &mut self.ankle_pitch,
            LegJoint::AnkleRoll => &mut self.ankle_roll,
        }
    }

    /// Sign (+1 or −1) and name of a joint; `None` if the map names none.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_mujoco::LegMap;
    /// use stridemap_robot::{LegJoint, Side};
    ///
    /// let map = LegMap { knee: Some("-kneeL".into()), ..LegMap::biped(Side::Left) };
    /// assert_eq!(map.joint(LegJoint::Knee), Some((-1.0, "kneeL")));
    /// assert_eq!(map.joint(LegJoint::HipRoll), Some((1.0, "left_hip_roll")));
    /// assert_eq!(map.joint(LegJoint::HipYaw), None);
    /// ```
    #[must_use]
    pub fn joint(&self, joint: LegJoint) -> Option<(f64, &str)> {
        let name = match joint {
            LegJoint::HipYaw => &self.hip_yaw,
            LegJoint::HipRoll => &self.hip_roll,
            LegJoint::HipPitch => &self.hip_pitch,
            LegJoint::Knee => &self.knee,
            LegJoint::AnklePitch => &self.ankle_pitch,
            LegJoint::AnkleRoll => &self.ankle_roll,
        };
        let name = name.as_deref().filter(|name| !name.is_empty())?;
        Some(match name.strip_prefix('-') {
            Some(rest) => (-1.0, rest.trim_start()),
            None => (1.0, name),
        })
    }
}

/// What a model can lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Missing {
    /// The joint by which it moves and falls.
    FreeJoint,
    /// What it stands on.
    Floor,
    /// Its meshes: no mesh file is read, and geoms that are meshes are left out. What it weighs is then in its
    /// `<inertial>` elements or nowhere.
    Meshes,
}

#[expect(clippy::trivially_copy_pass_by_ref)] // As serde asks for it.
const fn is_true(value: &bool) -> bool {
    *value
}

/// What a user says about a simulated robot. `None` always means the model's own value.
///
/// The default is the built-in biped as its model file says: 1 ms physics, 500 Hz control, position servos
/// with 3000 N m/rad, 105 N m s/rad and at most 600 N m.
///
/// # Example
///
/// ```
/// use stridemap_mujoco::{ModelSource, MujocoConfig};
///
/// let config: MujocoConfig = toml::from_str("mass_scale = 1.05\nfriction = 0.6")?;
/// assert_eq!(config.model, ModelSource::Biped);
/// assert_eq!(config.friction, Some(0.6));
/// assert!(config.validate().is_ok());
/// assert!(toml::from_str::<MujocoConfig>("mas_scale = 1.05").is_err());
/// # Ok::<(), toml::de::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MujocoConfig {
    /// The model: `"biped"`, `"op3"` or the path of an MJCF file.
    pub model: ModelSource,
    /// Names of the left leg.
    pub left: LegMap,
    /// Names of the right leg.
    pub right: LegMap,
    /// Time between two physics steps, > 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_step_s: Option<f64>,
    /// Time between two commands: a whole multiple of the time step.
    pub control_period_s: f64,
    /// Factor on every mass and moment of inertia of the robot, > 0.
    pub mass_scale: f64,
    /// Sliding friction coefficient between feet and floor, > 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Stiffness of the leg joints, > 0. Required if one has no position actuator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kp_nm_rad: Option<PerJoint>,
    /// Damping of the leg joints, >= 0. Required if one has no position actuator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kv_nms_rad: Option<PerJoint>,
    /// Largest torque of a leg joint, either way, > 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_limit_nm: Option<PerJoint>,
    /// Inertia of a leg joint's rotor as its joint feels it, >= 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub armature_kg_m2: Option<PerJoint>,
    /// Dry friction in every hinge of the robot, >= 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_friction_nm: Option<f64>,
    /// Largest rate of a leg joint, either way, > 0: what the robot's description says; the simulated
    /// joints do not enforce it.
    pub velocity_limit_rad_s: f64,
    /// Shift of the torso's centre of mass in the torso's frame (x, y, z).
    pub torso_offset_m: [f64; 3],
    /// Standard deviation of a normal disturbance of each leg joint's angle at reset, >= 0.
    pub start_joint_noise_deg: f64,
    /// Standard deviation of a normal disturbance of the base's horizontal velocity at reset, >= 0.
    pub start_velocity_noise_m_s: f64,
    /// Direction in which the robot looks in the model's reference posture, counted from +x to the left. Left out: from
    /// the places of its hips, where they are not within 20 deg of +x or −x (which names alone could tell apart).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_deg: Option<f64>,
    /// A keyframe of the model, whose angles are the rest posture of every joint that `rest_deg` does not name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keyframe: Option<String>,
    /// Rest angles in degrees: a leg joint's Stridemap name (`hip_pitch`, Stridemap's sign; both legs, or
    /// `{ left = 4.0, right = -4.0 }`), or the model's name of a hinge beyond the legs, which is held there (the model's
    /// sign).
    ///
    /// Leg joints not named rest at (hip, knee, ankle) pitch = (20, −40, 20) deg and rolls 0; other joints at
    /// the model's reference angle.
    pub rest_deg: BTreeMap<String, RestAngle>,
    /// What joints beyond the legs do, by the model's name: held at an angle, or driven to and fro with the gait. Goes before
    /// `rest_deg` and the keyframe.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub posture: BTreeMap<String, Posture>,
    /// What the model lacks and gets: `"free_joint"` (on its heaviest tree), `"floor"` (a plane at z = 0). A URDF, which can
    /// say neither, gets both unasked. `"meshes"`: nothing in their place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub add: Vec<Missing>,
    /// Whether parts of the robot other than its feet touch anything.
    #[serde(skip_serializing_if = "is_true")]
    pub body_contacts: bool,
    /// Whether the model's actuators are used. `false`: every joint is under a PD law of ours, and the tables of gains,
    /// limits and rotors are those of every joint, each by its name in the model.
    #[serde(skip_serializing_if = "is_true")]
    pub actuators: bool,
    /// Damping of the joints themselves, integrated implicitly and told as part of their torque, >= 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_damping_nms_rad: Option<PerJoint>,
    /// What the robot senses, and how well; left out: the simulator's truth, or [`estimated`](Self::estimated).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensors: Option<SensorConfig>,
    /// In what the robot differs from its model: for studies of a controller on another robot than its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub changes: Option<ChangesConfig>,
    /// Whether the state is estimated from what a robot can measure itself, instead of taken from the
    /// simulator.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub estimated: bool,
    /// Hardware effects; left out: none. With them the state is always estimated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hardware: Option<HardwareConfig>,
}

impl Default for MujocoConfig {
    fn default() -> Self {
        Self {
            model: ModelSource::Biped,
            left: LegMap::biped(Side::Left),
            right: LegMap::biped(Side::Right),
            time_step_s: None,
            control_period_s: 0.002,
            mass_scale: 1.0,
            friction: None,
            kp_nm_rad: None,
            kv_nms_rad: None,
            torque_limit_nm: None,
            armature_kg_m2: None,
            joint_friction_nm: None,
            velocity_limit_rad_s: 12.0,
            torso_offset_m: [0.0; 3],
            start_joint_noise_deg: 0.0,
            start_velocity_noise_m_s: 0.0,
            heading_deg: None,
            keyframe: None,
            rest_deg: BTreeMap::new(),
            posture: BTreeMap::new(),
            add: Vec::new(),
            body_contacts: true,
            actuators: true,
            joint_damping_nms_rad: None,
            sensors: None,
            changes: None,
            estimated: false,
            hardware: None,
        }
    }
}

impl MujocoConfig {
    /// The names of a leg.
    #[must_use]
    pub fn leg(&self, side: Side) -> &LegMap {
        match side {
            Side::Left => &self.left,
            Side::Right => &self.right,
        }
    }

    /// Angle of a leg joint at rest, in Stridemap's sign, where the file says one.
    pub(crate) fn given_rest_rad(&self, side: Side, joint: LegJoint) -> Option<f64> {
        self.rest_deg.get(joint.name()).map(|angle| angle.of(side).to_radians())
    }

    /// Angle of a leg joint at rest, in Stridemap's sign, whatever the model says.
    pub(crate) fn rest_rad(&self, side: Side, joint: LegJoint) -> f64 {
        let default_deg = match joint {
            LegJoint::HipPitch | LegJoint::AnklePitch => 20.0_f64,
            LegJoint::Knee => -40.0,
            LegJoint::HipYaw | LegJoint::HipRoll | LegJoint::AnkleRoll => 0.0,
        };
        self.given_rest_rad(side, joint).unwrap_or(default_deg.to_radians())
    }

    /// What can be said of the robot without its model: its leg joints by name and role, and their rest angles. Limits,
    /// mass and the joints beyond the legs are those of [`MujocoRobot`](crate::MujocoRobot).
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_mujoco::MujocoConfig;
    /// use stridemap_robot::{LegJoint, Side};
    ///
    /// let mut config = MujocoConfig::default();
    /// config.rest_deg.insert("knee".into(), (-30.0).into());
    /// config.left.ankle_roll = None;
    /// let robot = config.outline();
    /// assert_eq!(robot.joints.len(), 9);
    /// let knee = &robot.joints[robot.legs[(Side::Left, LegJoint::Knee)].unwrap().joint];
    /// assert_eq!((knee.name.as_str(), knee.rest_rad), ("left_knee", (-30.0_f64).to_radians()));
    /// ```
    #[must_use]
    pub fn outline(&self) -> RobotDescription {
        let mut joints = Vec::new();
        let legs = Legs::from_fn(|side, joint| {
            let (sign, name) = self.leg(side).joint(joint)?;
            joints.push(JointDescription {
                name: name.to_owned(),
                limits: JointLimits::default(),
                rest_rad: sign * self.rest_rad(side, joint),
            });
            let joint = joints.len() - 1;
            Some(LegRole { joint, sign })
        });
        RobotDescription {
            name: self.model.to_string(),
            control_period_s: self.control_period_s,
            mass_kg: 0.0,
            joints,
            legs,
        }
    }

    /// Checks everything that can be checked without the model.
    ///
    /// # Errors
    ///
    /// [`MujocoError::BadValue`] or [`MujocoError::PeriodNotMultiple`], naming field, value and what is allowed.
    pub fn validate(&self) -> Result<(), MujocoError> {
        let positive = |field, value: f64| check(field, value, value.is_finite() && value > 0.0, "a finite number > 0");
        let not_negative =
            |field, value: f64| check(field, value, value.is_finite() && value >= 0.0, "a finite number >= 0");
        // A tick makes as many physics steps as go into it, and a delay as many ticks.
        for (field, value, least) in
            [("control_period_s", Some(self.control_period_s), 1e-4), ("time_step_s", self.time_step_s, 1e-6)]
        {
            let good = value.is_none_or(|value| (least..=1.0).contains(&value));
            let allowed = "a tenth of a millisecond (a physics step: a microsecond) to 1 s";
            check(field, value.unwrap_or(0.0), good, allowed)?;
        }
        positive("mass_scale", self.mass_scale)?;
        positive("velocity_limit_rad_s", self.velocity_limit_rad_s)?;
        self.friction.map_or(Ok(()), |value| positive("friction", value))?;
        let values = |numbers: &Option<PerJoint>| numbers.iter().flat_map(PerJoint::values).collect::<Vec<_>>();
        for (field, numbers) in [("kp_nm_rad", &self.kp_nm_rad), ("torque_limit_nm", &self.torque_limit_nm)] {
            values(numbers).into_iter().try_for_each(|value| positive(field, value))?;
        }
        for (field, numbers) in [
            ("kv_nms_rad", &self.kv_nms_rad),
            ("armature_kg_m2", &self.armature_kg_m2),
            ("joint_damping_nms_rad", &self.joint_damping_nms_rad),
        ] {
            values(numbers).into_iter().try_for_each(|value| not_negative(field, value))?;
        }
        self.joint_friction_nm.map_or(Ok(()), |value| not_negative("joint_friction_nm", value))?;
        self.hardware.as_ref().map_or(Ok(()), HardwareConfig::validate)?;
        self.sensors.as_ref().map_or(Ok(()), SensorConfig::validate)?;
        self.changes.as_ref().map_or(Ok(()), ChangesConfig::validate)?;
        not_negative("start_joint_noise_deg", self.start_joint_noise_deg)?;
        not_negative("start_velocity_noise_m_s", self.start_velocity_noise_m_s)?;
        for value in self.torso_offset_m {
            check("torso_offset_m", value, value.is_finite(), "finite")?;
        }
        for value in self.rest_deg.values().flat_map(|angle| Side::BOTH.map(|side| angle.of(side))) {
            check("rest_deg", value, value.is_finite(), "finite")?;
        }
        for value in self.posture.values().flat_map(|posture| posture.numbers()) {
            check("posture", value, value.abs() <= 720.0, "-720 to 720")?;
        }
        let heading_deg = self.heading_deg.unwrap_or(0.0);
        check("heading_deg", heading_deg, heading_deg.abs() <= 360.0, "-360 to 360")?;
        match self.time_step_s {
            Some(time_step_s) => steps_per_period(self.control_period_s, time_step_s).map(|_| ()),
            None => Ok(()),
        }
    }
}

/// Physics steps in a control period.
pub(crate) fn steps_per_period(control_period_s: f64, time_step_s: f64) -> Result<usize, MujocoError> {
    /// Decimal fractions like 0.002 / 0.001 miss a whole number by a few parts in 1e16.
    const ROUNDING: f64 = 1e-9;
    let ratio = control_period_s / time_step_s;
    let whole = ratio.round();
    if !(1.0..=1e6).contains(&whole) || (ratio - whole).abs() > ROUNDING * whole {
        return Err(MujocoError::PeriodNotMultiple { control_period_s, time_step_s });
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Between 1 and 1e6.
    Ok(whole as usize)
}

/// An error for a name that the model does not have.
pub(crate) fn no_such_name<'a>(
    field: String,
    what: &'static str,
    name: &str,
    among: impl Iterator<Item = &'a str>,
) -> MujocoError {
    MujocoError::NoSuchName { field, what, name: name.into(), near: nearest(name, among) }
}
