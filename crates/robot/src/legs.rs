//! Two legs, their joints by role, and what is asked of every joint.

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

    /// The word in task files: `"left"` or `"right"`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
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
    /// Yaw of the hip about +z.
    HipYaw,
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
pub const LEG_JOINTS: [LegJoint; 6] = [
    LegJoint::HipYaw,
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
            Self::HipYaw => "hip_yaw",
            Self::HipRoll => "hip_roll",
            Self::HipPitch => "hip_pitch",
            Self::Knee => "knee",
            Self::AnklePitch => "ankle_pitch",
            Self::AnkleRoll => "ankle_roll",
        }
    }
}

/// Which joint of a robot plays the part of a leg joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegRole {
    /// Position among the robot's joints.
    pub joint: usize,
    /// +1 if the robot's axis agrees with Stridemap's, −1 if not.
    pub sign: f64,
}

/// One value for each part that a leg joint can play.
///
/// # Example
///
/// ```
/// use stridemap_robot::{LegJoint, Legs, Side};
///
/// let bent = Legs::from_fn(|_, joint| if joint == LegJoint::Knee { -0.7 } else { 0.0 });
/// assert_eq!(bent.iter().filter(|(_, _, a)| **a != 0.0).count(), 2);
/// assert_eq!(bent[(Side::Left, LegJoint::Knee)], -0.7);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Legs<T> {
    values: [[T; 6]; 2],
}

impl<T> Legs<T> {
    /// A value for each joint from a function of side and joint.
    pub fn from_fn(mut value: impl FnMut(Side, LegJoint) -> T) -> Self {
        Self { values: Side::BOTH.map(|side| LEG_JOINTS.map(|joint| value(side, joint))) }
    }

    /// Every side, joint and value: the left leg from the hip down, then the right.
    pub fn iter(&self) -> impl Iterator<Item = (Side, LegJoint, &T)> {
        Side::BOTH
            .into_iter()
            .flat_map(move |side| LEG_JOINTS.into_iter().map(move |joint| (side, joint, &self[(side, joint)])))
    }
}

impl Legs<Option<LegRole>> {
    /// The joints that the robot has, in the order of [`iter`](Self::iter).
    pub fn roles(&self) -> impl Iterator<Item = (Side, LegJoint, LegRole)> {
        self.iter().filter_map(|(side, joint, role)| Some((side, joint, (*role)?)))
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
