//! Two legs of five joints each, and a value for every joint.

use serde::{Deserialize, Serialize};

/// A side of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The robot's left, +y.
    Left,
    /// The robot's right, −y.
    Right,
}

impl Side {
    /// Both sides, in the order in which arrays over sides are laid out.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// 0 for the left, 1 for the right.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::Left => 0,
            Self::Right => 1,
        }
    }

    /// The other side.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }

    /// +1 on the left, −1 on the right: the sign of y on that side.
    #[must_use]
    pub const fn lateral_sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

/// A joint of a leg, from the hip down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LegJoint {
    /// Roll of the hip about +x.
    HipRoll,
    /// Pitch of the hip; + swings the thigh forward.
    HipPitch,
    /// Pitch of the knee; flexion is negative.
    Knee,
    /// Pitch of the ankle; + lifts the toes.
    AnklePitch,
    /// Roll of the ankle about +x.
    AnkleRoll,
}

/// Every joint of a leg, in the order in which arrays over joints are laid out.
pub const LEG_JOINTS: [LegJoint; 5] = [
    LegJoint::HipRoll,
    LegJoint::HipPitch,
    LegJoint::Knee,
    LegJoint::AnklePitch,
    LegJoint::AnkleRoll,
];

impl LegJoint {
    /// Position in [`LEG_JOINTS`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name used in task files, e.g. `"hip_roll"`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::HipRoll => "hip_roll",
            Self::HipPitch => "hip_pitch",
            Self::Knee => "knee",
            Self::AnklePitch => "ankle_pitch",
            Self::AnkleRoll => "ankle_roll",
        }
    }
}

/// One value for each of the ten leg joints.
///
/// # Example
///
/// ```
/// use stridemap_robot::{LegJoint, Legs, Side};
///
/// let mut angle_rad = Legs::default();
/// angle_rad[(Side::Right, LegJoint::Knee)] = -0.7;
/// assert_eq!(angle_rad.iter().filter(|(_, _, a)| **a != 0.0).count(), 1);
/// assert_eq!(angle_rad[(Side::Left, LegJoint::Knee)], 0.0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Legs<T> {
    /// Values by side ([`Side::index`]) and joint ([`LegJoint::index`]).
    pub values: [[T; 5]; 2],
}

impl<T> Legs<T> {
    /// A value for each joint from a function of side and joint.
    pub fn from_fn(mut value: impl FnMut(Side, LegJoint) -> T) -> Self {
        Self {
            values: Side::BOTH.map(|side| LEG_JOINTS.map(|joint| value(side, joint))),
        }
    }

    /// Every side, joint and value: the left leg from the hip down, then the right.
    pub fn iter(&self) -> impl Iterator<Item = (Side, LegJoint, &T)> {
        Side::BOTH.into_iter().flat_map(move |side| {
            LEG_JOINTS
                .into_iter()
                .map(move |joint| (side, joint, &self[(side, joint)]))
        })
    }
}

impl<T> std::ops::Index<(Side, LegJoint)> for Legs<T> {
    type Output = T;
    fn index(&self, (side, joint): (Side, LegJoint)) -> &T {
        &self.values[side.index()][joint.index()]
    }
}

impl<T> std::ops::IndexMut<(Side, LegJoint)> for Legs<T> {
    fn index_mut(&mut self, (side, joint): (Side, LegJoint)) -> &mut T {
        &mut self.values[side.index()][joint.index()]
    }
}

/// What a gait asks of the joints for the next control period.
///
/// Joints beyond the legs (arms, neck) hold the rest angles of the robot's own configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTargets {
    /// Desired angle of each leg joint.
    pub position_rad: Legs<f64>,
}

impl JointTargets {
    /// Refuses targets that are not finite, naming the first.
    ///
    /// # Errors
    ///
    /// [`RobotError::NotFinite`](crate::RobotError::NotFinite).
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_robot::{JointTargets, LegJoint, Side};
    ///
    /// let mut targets = JointTargets::default();
    /// assert!(targets.check_finite().is_ok());
    /// targets.position_rad[(Side::Left, LegJoint::Knee)] = f64::NAN;
    /// assert!(targets.check_finite().is_err());
    /// ```
    pub fn check_finite(&self) -> Result<(), crate::RobotError> {
        for (side, joint, &value_rad) in self.position_rad.iter() {
            if !value_rad.is_finite() {
                return Err(crate::RobotError::NotFinite {
                    side,
                    joint: joint.name(),
                    value_rad,
                });
            }
        }
        Ok(())
    }
}
