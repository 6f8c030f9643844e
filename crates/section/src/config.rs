//! How a section is found.

use serde::{Deserialize, Serialize};
use stridemap_robot::Side;

use crate::event::SectionEvent;
use crate::pendulum::PendulumBase;
use crate::stance::StanceConfig;

/// What can go wrong in a section's configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SectionError {
    /// A parameter lies outside its domain.
    #[error("section.{name} = {value}: {requirement}")]
    Parameter {
        /// Key in the configuration.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What it must satisfy.
        requirement: &'static str,
    },
}

/// How the section is detected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionConfig {
    /// What makes a section.
    #[serde(default, skip_serializing_if = "SectionEvent::is_default")]
    pub event: SectionEvent,
    /// The gait's phase at a section of its clock, as the stance leg sees it, deg.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clock_phase_deg: f64,
    /// Sections of this leg alone, so that a stride is two steps: those of its stance, or with `gait_clock` those of the gait's
    /// phase as it sees it, whichever leg stands. Left out: of both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leg: Option<Side>,
    /// The foot of the pendulum.
    pub pendulum_base: PendulumBase,
    /// When the stance passes from leg to leg.
    pub stance: StanceConfig,
    /// Time constant of the first-order filter on the roll rate.
    pub roll_rate_filter_s: f64,
    /// Least time between two sections; crossings that come sooner are passed over.
    pub refractory_s: f64,
    /// Finds the section as the turning point of the sway instead, for robots whose sensors are too
    /// noisy for a roll rate; the roll rate's filter is then not used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lateral: Option<LateralConfig>,
}

fn is_zero(value: &f64) -> bool {
    value.to_bits() == 0
}

impl Default for SectionConfig {
    fn default() -> Self {
        Self {
            event: SectionEvent::ROLL_RATE,
            clock_phase_deg: 0.0,
            leg: None,
            pendulum_base: PendulumBase::StanceFoot,
            stance: StanceConfig { load_share: 0.6 },
            roll_rate_filter_s: 0.01,
            refractory_s: 0.0,
            lateral: None,
        }
    }
}

impl SectionConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`SectionError::Parameter`] that names the key at fault.
    pub fn validate(&self) -> Result<(), SectionError> {
        let share = self.stance.load_share;
        if !(share > 0.5 && share < 1.0) {
            return Err(SectionError::Parameter {
                name: "stance.load_share",
                value: share,
                requirement: "must lie between 0.5 and 1",
            });
        }
        if !(-180.0..=180.0).contains(&self.clock_phase_deg) {
            return Err(SectionError::Parameter {
                name: "clock_phase_deg",
                value: self.clock_phase_deg,
                requirement: "must lie in [-180, 180]",
            });
        }
        for (name, value, most) in
            [("roll_rate_filter_s", self.roll_rate_filter_s, 1.0), ("refractory_s", self.refractory_s, 10.0)]
        {
            if !(0.0..=most).contains(&value) {
                return Err(SectionError::Parameter { name, value, requirement: "must be 0 or a short time" });
            }
        }
        self.lateral.as_ref().map_or(Ok(()), LateralConfig::validate)
    }
}

/// How the turning point of the sway is found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LateralConfig {
    /// Time constant of the first-order filter on the velocity of the centre of mass.
    pub velocity_filter_s: f64,
    /// Time constant of the first-order filter on the load ratio.
    pub load_filter_s: f64,
    /// Least `|F_right − F_left| / (F_right + F_left)`, filtered, at a section.
    pub least_load_ratio: f64,
}

impl LateralConfig {
    /// Checks every value.
    pub(crate) fn validate(&self) -> Result<(), SectionError> {
        for (name, value, most, requirement) in [
            ("lateral.velocity_filter_s", self.velocity_filter_s, 1.0, "must be 0 or a short time"),
            ("lateral.load_filter_s", self.load_filter_s, 1.0, "must be 0 or a short time"),
            ("lateral.least_load_ratio", self.least_load_ratio, 0.99, "must lie between 0 and 0.99"),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(SectionError::Parameter { name, value, requirement });
            }
        }
        Ok(())
    }
}
