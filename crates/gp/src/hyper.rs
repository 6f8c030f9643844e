//! Hyperparameters of kernel and noise.

use serde::{Deserialize, Serialize};

use crate::error::{Result, check_len, check_positive};

/// Hyperparameters of kernel and noise, in the user's units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hyperparameters {
    /// `ℓ`, shape `(D,)`; entry `d` in the unit of input `d`; positive.
    pub length_scales: Vec<f64>,
    /// `σ_f²`, in (unit of `y`)²; positive. `v₀` of \[MA09, eq. (10)\].
    pub signal_variance: f64,
    /// `σₙ²`, in (unit of `y`)²; positive. `v₁` of \[MA09, eq. (10)\].
    pub noise_variance: f64,
}

impl Hyperparameters {
    /// Requires `dims` length scales, and everything positive and finite.
    pub(crate) fn check(&self, dims: usize) -> Result<()> {
        check_len("length_scales", dims, self.length_scales.len())?;
        for &scale in &self.length_scales {
            check_positive("length scale", scale)?;
            check_positive("1 / length scale", 1.0 / scale)?;
        }
        check_positive("signal_variance", self.signal_variance)?;
        check_positive("noise_variance", self.noise_variance)?;
        check_positive("signal_variance + noise_variance", self.signal_variance + self.noise_variance)
    }

    /// `(log σ_f², log σₙ², log ℓ…)`.
    pub(crate) fn to_log(&self) -> Vec<f64> {
        [self.signal_variance, self.noise_variance].iter().chain(&self.length_scales).map(|value| value.ln()).collect()
    }

    /// The inverse of [`to_log`](Self::to_log).
    pub(crate) fn from_log(theta: &[f64]) -> Self {
        Self {
            signal_variance: theta[0].exp(),
            noise_variance: theta[1].exp(),
            length_scales: theta[2..].iter().map(|t| t.exp()).collect(),
        }
    }
}
