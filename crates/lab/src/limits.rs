//! Limits of a deployment: a task's `[verdict]`.

use serde::{Deserialize, Serialize};

use crate::error::{LabError, unless};

/// Limits of a deployment; what is left out has a default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerdictConfig {
    /// Most for the probability of a fall within 60 s; left out: 0.1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fall_probability_60_s_at_most: Option<f64>,
    /// Least for the smallest push survived over phases and directions, 0: not asked; left out: 0.05.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub survived_push_m_s_at_least: Option<f64>,
    /// Most for the root mean square of `ψ_roll` from its target, deg, or of the goals' errors in their units; left out: 0.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking_error_at_most: Option<f64>,
    /// Most for the largest multiplier; left out: 0.95, with which a disturbance halves in 14 strides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_multiplier_at_most: Option<f64>,
}

impl VerdictConfig {
    /// Most for the probability of a fall within 60 s.
    #[must_use]
    pub fn falls(&self) -> f64 {
        self.fall_probability_60_s_at_most.unwrap_or(0.1)
    }

    /// Least for the smallest push survived.
    #[must_use]
    pub fn push_m_s(&self) -> f64 {
        self.survived_push_m_s_at_least.unwrap_or(0.05)
    }

    /// Most for the tracking error.
    #[must_use]
    pub fn tracking(&self) -> f64 {
        self.tracking_error_at_most.unwrap_or(0.5)
    }

    /// Most for the largest multiplier.
    #[must_use]
    pub fn multiplier(&self) -> f64 {
        self.largest_multiplier_at_most.unwrap_or(0.95)
    }

    /// Refuses limits without meaning.
    pub(crate) fn check(&self) -> Result<(), LabError> {
        for (key, value, most) in [
            ("fall_probability_60_s_at_most", self.falls(), 1.0),
            ("survived_push_m_s_at_least", self.push_m_s(), 1.2),
            ("tracking_error_at_most", self.tracking(), 90.0),
            ("largest_multiplier_at_most", self.multiplier(), 1.0),
        ] {
            unless(
                (0.0..=most).contains(&value),
                format!("verdict.{key}"),
                format!("is {value}, must lie in [0, {most}]"),
            )?;
        }
        Ok(())
    }
}
