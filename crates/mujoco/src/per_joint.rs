//! Numbers that a file gives for all leg joints at once, or for each by name; angles for both legs, or for each.

use std::collections::BTreeMap;
use std::fmt::{Formatter, Result as Fmt};

use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use stridemap_robot::Side;

/// A number of every leg joint: one for all, or one for each by Stridemap's name (`knee`, both legs) or the model's. A joint
/// that a table leaves out keeps the model's own.
///
/// # Example
///
/// ```
/// use stridemap_mujoco::{MujocoConfig, PerJoint};
///
/// let config: MujocoConfig = toml::from_str("kp_nm_rad = { knee = 300.0, left_ankle = 40 }\nkv_nms_rad = 5")?;
/// let kp = config.kp_nm_rad.unwrap();
/// assert_eq!(kp.of("knee", "left_knee_joint"), Some(300.0));
/// assert_eq!(kp.of("ankle_pitch", "left_ankle"), Some(40.0));
/// assert_eq!(kp.of("hip_roll", "left_hip"), None);
/// assert_eq!(config.kv_nms_rad, Some(PerJoint::All(5.0)));
/// # Ok::<(), toml::de::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum PerJoint {
    /// The same for all.
    All(f64),
    /// By name.
    Each(BTreeMap<String, f64>),
}

impl PerJoint {
    /// The number of a joint, by its role (`knee`) and by its name in the model, which goes first.
    #[must_use]
    pub fn of(&self, role: &str, name: &str) -> Option<f64> {
        match self {
            Self::All(value) => Some(*value),
            Self::Each(values) => values.get(name).or_else(|| values.get(role)).copied(),
        }
    }

    /// Every number times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        match self {
            Self::All(value) => Self::All(factor * value),
            Self::Each(values) => Self::Each(values.into_iter().map(|(name, value)| (name, factor * value)).collect()),
        }
    }

    /// Every number.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        let (all, each) = match self {
            Self::All(value) => (Some(*value), None),
            Self::Each(values) => (None, Some(values.values().copied())),
        };
        all.into_iter().chain(each.into_iter().flatten())
    }

    /// The names of a table.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let each = match self {
            Self::All(_) => None,
            Self::Each(values) => Some(values.keys().map(String::as_str)),
        };
        each.into_iter().flatten()
    }
}

impl From<f64> for PerJoint {
    fn from(value: f64) -> Self {
        Self::All(value)
    }
}

/// A rest angle of a joint, in degrees: of both legs, or of each.
///
/// # Example
///
/// ```
/// use stridemap_mujoco::RestAngle;
/// use stridemap_robot::Side;
///
/// let wide = RestAngle::Each { left: 4.0, right: -4.0 };
/// assert_eq!((wide.of(Side::Left), wide.of(Side::Right)), (4.0, -4.0));
/// assert_eq!(RestAngle::from(20.0).of(Side::Right), 20.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RestAngle {
    /// Of both legs, or of a joint that is in no leg.
    Both(f64),
    /// Of each leg.
    Each {
        /// Of the left.
        left: f64,
        /// Of the right.
        right: f64,
    },
}

impl RestAngle {
    /// The angle of a side.
    #[must_use]
    pub const fn of(self, side: Side) -> f64 {
        match (self, side) {
            (Self::Both(angle), _) | (Self::Each { left: angle, .. }, Side::Left) => angle,
            (Self::Each { right, .. }, Side::Right) => right,
        }
    }
}

impl From<f64> for RestAngle {
    fn from(angle: f64) -> Self {
        Self::Both(angle)
    }
}

/// What a joint beyond the legs does while the robot walks: it is held at an angle, or driven to and fro with the gait. Angles
/// in degrees, in the model's sign.
///
/// # Example
///
/// ```
/// use stridemap_mujoco::{MujocoConfig, Posture};
///
/// let config: MujocoConfig = toml::from_str("posture = { elbow = 40, shoulder = { amplitude_deg = 15 } }")?;
/// assert_eq!(config.posture["elbow"], Posture::Held(40.0));
/// let swing = Posture::Driven { rest_deg: 0.0, amplitude_deg: 15.0, phase_deg: 0.0 };
/// assert_eq!(config.posture["shoulder"], swing);
/// assert!(toml::from_str::<MujocoConfig>("posture = { elbow = { amplitude = 15 } }").is_err());
/// # Ok::<(), toml::de::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Posture {
    /// Held there.
    Held(f64),
    /// `rest + amplitude sin(φ + phase)`, φ the phase of the gait as the right leg sees it: what swings with the left
    /// leg has a phase of 180 more.
    Driven {
        /// The middle.
        rest_deg: f64,
        /// How far either way.
        amplitude_deg: f64,
        /// The phase.
        phase_deg: f64,
    },
}

impl Posture {
    /// The angle about which it moves.
    #[must_use]
    pub const fn rest_deg(self) -> f64 {
        match self {
            Self::Held(rest_deg) | Self::Driven { rest_deg, .. } => rest_deg,
        }
    }

    /// Every number in it.
    pub(crate) const fn numbers(self) -> [f64; 3] {
        match self {
            Self::Held(rest_deg) => [rest_deg, 0.0, 0.0],
            Self::Driven { rest_deg, amplitude_deg, phase_deg } => [rest_deg, amplitude_deg, phase_deg],
        }
    }
}

impl<'de> Deserialize<'de> for Posture {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let driven = |mut numbers: BTreeMap<String, f64>| {
            let mut take = |key: &str| numbers.remove(key);
            let (rest, amplitude, phase) = (take("rest_deg"), take("amplitude_deg"), take("phase_deg"));
            match (amplitude, numbers.is_empty()) {
                (Some(amplitude_deg), true) => {
                    Ok(Self::Driven { rest_deg: rest.unwrap_or(0.0), amplitude_deg, phase_deg: phase.unwrap_or(0.0) })
                }
                _ => Err("must have amplitude_deg, and may have rest_deg and phase_deg, no others".to_owned()),
            }
        };
        from.deserialize_any(NumberOr(
            "an angle, or a table of rest_deg, amplitude_deg and phase_deg",
            Self::Held,
            driven,
        ))
    }
}

/// Reads a number, or a table of numbers. (An untagged enum would say of a typo only that nothing fits.)
struct NumberOr<T>(&'static str, fn(f64) -> T, fn(BTreeMap<String, f64>) -> Result<T, String>);

impl<'de, T> Visitor<'de> for NumberOr<T> {
    type Value = T;

    fn expecting(&self, f: &mut Formatter<'_>) -> Fmt {
        f.write_str(self.0)
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<T, E> {
        Ok(self.1(value))
    }

    #[expect(clippy::cast_precision_loss)] // As every integer that stands for a number.
    fn visit_i64<E: Error>(self, value: i64) -> Result<T, E> {
        Ok(self.1(value as f64))
    }

    #[expect(clippy::cast_precision_loss)]
    fn visit_u64<E: Error>(self, value: u64) -> Result<T, E> {
        Ok(self.1(value as f64))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<T, A::Error> {
        let mut values = BTreeMap::new();
        while let Some((name, value)) = map.next_entry()? {
            values.insert(name, value);
        }
        self.2(values).map_err(A::Error::custom)
    }
}

impl<'de> Deserialize<'de> for PerJoint {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(NumberOr("a number, or a table of numbers by joint", Self::All, |each| {
            Ok(Self::Each(each))
        }))
    }
}

impl<'de> Deserialize<'de> for RestAngle {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let each = |angles: BTreeMap<String, f64>| match (angles.len(), angles.get("left"), angles.get("right")) {
            (2, Some(&left), Some(&right)) => Ok(Self::Each { left, right }),
            _ => Err("must have the keys left and right, no others".to_owned()),
        };
        from.deserialize_any(NumberOr("a number", Self::Both, each))
    }
}
