//! In what a robot differs from its model: payloads, weak joints, late commands, a tilted inertial unit.

use std::collections::BTreeMap;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};

use crate::error::{MujocoError, check};

/// The stream of what is drawn for an individual.
pub(crate) const STREAM: u64 = 2;

/// Changes of which studies are made, by a letter (docs/pretrained.md).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ChangePreset {
    /// As its model.
    N,
    /// 10 kg at the front right of the torso.
    A,
    /// The inertial unit pitched by 0.05 rad.
    B,
    /// 6 kg at the torso, the left leg's gains times 0.75, commands 15 ms late.
    C,
    /// Drawn at random, an individual for each seed.
    R,
}

/// In what the robot differs from its model. The controller is not told.
///
/// # Example
///
/// ```
/// use stridemap_mujoco::{ChangePreset, ChangesConfig};
///
/// let own = ChangesConfig { preset: Some(ChangePreset::C), payload_kg: Some(3.0), ..ChangesConfig::default() };
/// let all = own.resolved();
/// assert_eq!((all.payload_kg, all.gain_left, all.action_delay_s), (Some(3.0), Some(0.75), Some(0.015)));
/// let random = ChangesConfig { random: 1, individual: Some(7), ..ChangesConfig::default() };
/// assert_eq!(random.resolved(), random.resolved());
/// assert_ne!(random.resolved().payload_kg, ChangesConfig { individual: Some(8), ..random }.resolved().payload_kg);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ChangesConfig {
    /// Changes by a letter; the keys beside it go first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<ChangePreset>,
    /// 1: what no key says is drawn at random, as by the preset R.
    #[serde(skip_serializing_if = "is_zero")]
    pub random: u32,
    /// Which individual is drawn; left out: the seed of the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub individual: Option<u64>,
    /// Mass of a point that rides on a body.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload_kg: Option<f64>,
    /// The body; left out: the heaviest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload_body: Option<String>,
    /// Where on it, in the body's frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload_offset_m: Option<[f64; 3]>,
    /// Factor on stiffness and damping of every joint of the left leg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_left: Option<f64>,
    /// The same of the right leg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_right: Option<f64>,
    /// The same of joints by name; multiplied with those of the legs.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub gains: BTreeMap<String, f64>,
    /// By how much commands are late, rounded to whole physics steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub action_delay_s: Option<f64>,
    /// Forward pitch of the inertial unit on the base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu_pitch_rad: Option<f64>,
    /// Its roll to the right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu_roll_rad: Option<f64>,
    /// What encoders of joints, by name, tell beyond the angle; servos go by them.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub joint_offset_rad: BTreeMap<String, f64>,
    /// Standard deviation of such an offset of every joint, drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_offset_sd_rad: Option<f64>,
    /// Sliding friction between feet and floor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Factor on the noise of every sensor ([`SensorConfig`](crate::SensorConfig)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor_noise: Option<f64>,
}

#[expect(clippy::trivially_copy_pass_by_ref)] // As serde asks for it.
const fn is_zero(value: &u32) -> bool {
    *value == 0
}

impl ChangesConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`MujocoError::BadValue`] that names the field at fault.
    pub fn validate(&self) -> Result<(), MujocoError> {
        let within = |field, value: Option<f64>, low: f64, high: f64, allowed| {
            value.map_or(Ok(()), |value| check(field, value, (low..=high).contains(&value), allowed))
        };
        check("changes.random", f64::from(self.random), self.random < 2, "0 or 1")?;
        within("changes.payload_kg", self.payload_kg, 0.0, 1000.0, "0 to 1000 kg")?;
        for offset in self.payload_offset_m.into_iter().flatten() {
            within("changes.payload_offset_m", Some(offset), -5.0, 5.0, "-5 to 5 m")?;
        }
        let gains = [self.gain_left, self.gain_right].into_iter().flatten().chain(self.gains.values().copied());
        for gain in gains {
            within("changes.gains", Some(gain), 0.0, 10.0, "0 to 10")?;
        }
        within("changes.action_delay_s", self.action_delay_s, 0.0, 0.5, "0 to 0.5 s")?;
        within("changes.imu_pitch_rad", self.imu_pitch_rad, -0.5, 0.5, "-0.5 to 0.5 rad")?;
        within("changes.imu_roll_rad", self.imu_roll_rad, -0.5, 0.5, "-0.5 to 0.5 rad")?;
        for offset in self.joint_offset_rad.values() {
            within("changes.joint_offset_rad", Some(*offset), -0.5, 0.5, "-0.5 to 0.5 rad")?;
        }
        within("changes.joint_offset_sd_rad", self.joint_offset_sd_rad, 0.0, 0.2, "0 to 0.2 rad")?;
        within("changes.friction", self.friction, 0.01, 5.0, "0.01 to 5")?;
        within("changes.sensor_noise", self.sensor_noise, 0.0, 100.0, "0 to 100")
    }

    /// What the preset, and the individual drawn, add to the keys that are given.
    #[must_use]
    pub fn resolved(&self) -> Self {
        let random = self.random > 0 || self.preset == Some(ChangePreset::R);
        let of = match self.preset {
            _ if random => Self::drawn(self.individual.unwrap_or(0)),
            Some(ChangePreset::A) => {
                Self { payload_kg: Some(10.0), payload_offset_m: Some([0.135, -0.10, 0.20]), ..Self::default() }
            }
            Some(ChangePreset::B) => Self { imu_pitch_rad: Some(0.05), ..Self::default() },
            Some(ChangePreset::C) => Self {
                payload_kg: Some(6.0),
                payload_offset_m: Some([0.15, -0.05, 0.20]),
                gain_left: Some(0.75),
                action_delay_s: Some(0.015),
                ..Self::default()
            },
            None | Some(ChangePreset::N | ChangePreset::R) => Self::default(),
        };
        Self {
            payload_kg: self.payload_kg.or(of.payload_kg),
            payload_offset_m: self.payload_offset_m.or(of.payload_offset_m),
            gain_left: self.gain_left.or(of.gain_left),
            gain_right: self.gain_right.or(of.gain_right),
            action_delay_s: self.action_delay_s.or(of.action_delay_s),
            imu_pitch_rad: self.imu_pitch_rad.or(of.imu_pitch_rad),
            imu_roll_rad: self.imu_roll_rad.or(of.imu_roll_rad),
            joint_offset_sd_rad: self.joint_offset_sd_rad.or(of.joint_offset_sd_rad),
            friction: self.friction.or(of.friction),
            ..self.clone()
        }
    }

    /// A robot drawn at random: up to 8 kg anywhere about the torso, each leg's gains times 0.75 to 1.1, commands up to 20 ms
    /// late, the inertial unit off by up to 0.05 rad in pitch and 0.02 in roll, encoders by 0.01 rad (sd), friction 0.5 to 1.
    fn drawn(individual: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(individual);
        rng.set_stream(STREAM);
        let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        Self {
            payload_kg: Some(between(0.0, 8.0)),
            payload_offset_m: Some([between(-0.1, 0.1), between(-0.1, 0.1), between(0.0, 0.2)]),
            gain_left: Some(between(0.75, 1.1)),
            gain_right: Some(between(0.75, 1.1)),
            action_delay_s: Some(between(0.0, 0.02)),
            imu_pitch_rad: Some(between(-0.05, 0.05)),
            imu_roll_rad: Some(between(-0.02, 0.02)),
            joint_offset_sd_rad: Some(0.01),
            friction: Some(between(0.5, 1.0)),
            ..Self::default()
        }
    }
}
