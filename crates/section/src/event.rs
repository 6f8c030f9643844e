//! What makes a section. Adding an event is one entry here and its name in [`SectionEvent::ALL`].

use std::f64::consts::PI;
use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use stridemap_robot::Side;

use crate::pendulum::Pendulum;

/// The robot at a tick, as an event sees it.
pub struct Look<'a> {
    /// The pendulum on the stance foot.
    pub pendulum: &'a Pendulum,
    /// The gait's phase as a leg sees it, where it has one.
    pub phase_rad: &'a dyn Fn(Side) -> Option<f64>,
    /// `section.clock_phase_deg`.
    pub clock_phase_rad: f64,
}

/// What kind of scalar it is whose zero makes a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// A rate, which is filtered within a stance: `section.roll_rate_filter_s`.
    Rate,
    /// An angle in [−π, π): its jump from π to −π is no zero.
    Angle,
    /// None: the section is where the stance itself changes, the share of the load on the foot that takes it over less
    /// `section.stance.load_share`.
    Stance,
}

/// What makes a section: a scalar that passes zero from below, once in each stance.
#[derive(Clone, Copy)]
pub struct SectionEvent {
    /// The name in task files.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// The scalar at a tick; `None` where it is not known.
    pub scalar: fn(&Look<'_>) -> Option<f64>,
    /// Of which kind it is.
    pub kind: Scalar,
}

impl SectionEvent {
    /// The roll rate of the pendulum \[MA09, sec. 3\]; with `lateral` the velocity of the sway.
    pub const ROLL_RATE: Self = Self {
        name: "roll_rate",
        about: "the mass comes nearest to the outer side: the pendulum's roll rate is zero (MA09, sec. 3)",
        scalar: |at| Some(at.pendulum.roll_rate_rad_s),
        kind: Scalar::Rate,
    };
    /// The load passes from foot to foot.
    pub const TOUCHDOWN: Self = Self {
        name: "touchdown",
        about: "the load passes to the other foot",
        scalar: |_| Some(0.0),
        kind: Scalar::Stance,
    };
    /// The gait's phase as the stance leg sees it, less `clock_phase_deg`.
    pub const GAIT_CLOCK: Self = Self {
        name: "gait_clock",
        about: "the gait's phase passes section.clock_phase_deg",
        scalar: |at| Some(wrapped((at.phase_rad)(at.pendulum.stance)? - at.clock_phase_rad)),
        kind: Scalar::Angle,
    };
    /// Every one.
    pub const ALL: [Self; 3] = [Self::ROLL_RATE, Self::TOUCHDOWN, Self::GAIT_CLOCK];

    const NAMES: [&'static str; Self::ALL.len()] = {
        let (mut names, mut i) = ([""; Self::ALL.len()], 0);
        while i < names.len() {
            names[i] = Self::ALL[i].name;
            i += 1;
        }
        names
    };

    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// An angle brought into [−π, π).
fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(2.0 * PI) - PI
}

impl Default for SectionEvent {
    fn default() -> Self {
        Self::ROLL_RATE
    }
}

impl PartialEq for SectionEvent {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for SectionEvent {}

impl fmt::Debug for SectionEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Serialize for SectionEvent {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

impl<'de> Deserialize<'de> for SectionEvent {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let known = Self::ALL.into_iter().find(|event| event.name == name);
        known.ok_or_else(|| serde::de::Error::unknown_variant(&name, &Self::NAMES))
    }
}
