//! Leave-one-out predictions in closed form, and scores of a prediction's honesty.

use serde::{Deserialize, Serialize};

use crate::error::{GpError, Result};
use crate::evidence::LOG_2_PI;
use crate::gp::Gp;

/// Below this share of `[K⁻¹]ᵢᵢ`, `Pᵢᵢ` is zero to rounding: without point `i` the mean's
/// coefficients are not determined.
const UNDETERMINED: f64 = 1e-10;

/// What each training point would have been predicted to be from the others.
#[derive(Clone, Debug, PartialEq)]
pub struct LeaveOneOut {
    /// `yᵢ − μ₋ᵢ`, shape `(N,)`, in the unit of `y` \[RW06, eq. (5.12)\].
    pub residuals: Vec<f64>,
    /// Variance of the left-out *observation*, shape `(N,)` \[RW06, eq. (5.12)\].
    pub variances: Vec<f64>,
}

/// Scores of leave-one-out predictions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeaveOneOutScores {
    /// Root mean square residual, in the unit of `y`.
    pub rmse: f64,
    /// Mean log predictive density, in nats a point \[RW06, eq. (5.11)\].
    pub mean_log_density: f64,
    /// Mean square standardized residual: 1 when the variances are honest, more when they are too
    /// small.
    pub mean_square_standardized: f64,
    /// Share of residuals inside the central 50 % interval.
    pub coverage_50: f64,
    /// Share of residuals inside the central 90 % interval.
    pub coverage_90: f64,
}

impl LeaveOneOut {
    /// Residuals over their predicted standard deviations, shape `(N,)`.
    #[must_use]
    pub fn standardized_residuals(&self) -> Vec<f64> {
        self.residuals.iter().zip(&self.variances).map(|(r, v)| r / v.sqrt()).collect()
    }

    /// Log predictive density of each left-out observation, in nats, shape `(N,)`
    /// \[RW06, eq. (5.10)\].
    #[must_use]
    pub fn log_densities(&self) -> Vec<f64> {
        self.residuals.iter().zip(&self.variances).map(|(r, v)| log_density(*r, *v)).collect()
    }

    /// Share of the observations inside the central interval that should hold `level` of them.
    #[must_use]
    pub fn coverage(&self, level: f64) -> f64 {
        coverage(&self.standardized_residuals(), level)
    }

    /// The scores in one place.
    #[must_use]
    pub fn scores(&self) -> LeaveOneOutScores {
        let points = self.residuals.len() as f64;
        let standardized = self.standardized_residuals();
        LeaveOneOutScores {
            rmse: (self.residuals.iter().map(|r| r * r).sum::<f64>() / points).sqrt(),
            mean_log_density: self.log_densities().iter().sum::<f64>() / points,
            mean_square_standardized: standardized.iter().map(|z| z * z).sum::<f64>() / points,
            coverage_50: coverage(&standardized, 0.5),
            coverage_90: coverage(&standardized, 0.9),
        }
    }
}

impl Gp {
    /// Predicts each training point from the others, without refitting the hyperparameters.
    ///
    /// ```text
    /// yᵢ − μ₋ᵢ = [P y]ᵢ / Pᵢᵢ,   σ²₋ᵢ = 1 / Pᵢᵢ          [RW06, eq. (5.12)]
    /// ```
    ///
    /// With a constant or linear mean its coefficients are estimated anew without the point.
    ///
    /// # Errors
    ///
    /// [`GpError::MeanNotIdentifiable`] if the others do not determine the mean's coefficients.
    ///
    /// # Cost
    ///
    /// `O(N²)`.
    ///
    /// # Example
    ///
    /// Two points farther apart than any correlation: each is predicted by the prior, mean 0 and
    /// variance `1 + 1/4`.
    ///
    /// ```
    /// # use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// # let gp = Gp::condition(Points::new(&[0.0, 50.0], 1)?, &[1.0, -2.0],
    /// #     Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    /// let loo = gp.leave_one_out()?;
    /// assert!((loo.residuals[0] - 1.0).abs() < 1e-15 && (loo.residuals[1] + 2.0).abs() < 1e-15);
    /// assert!((loo.variances[0] - 1.25).abs() < 1e-15);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn leave_one_out(&self) -> Result<LeaveOneOut> {
        let n = self.y.len();
        let mut residuals = Vec::with_capacity(n);
        let mut variances = Vec::with_capacity(n);
        for (i, inverse) in self.factor.inverse_diagonal().into_iter().enumerate() {
            let trend: f64 = self.trend.weights.chunks_exact(self.stride).map(|w| w[i] * w[i]).sum();
            let precision = inverse - trend;
            if precision.is_nan() || precision <= UNDETERMINED * inverse {
                return Err(GpError::MeanNotIdentifiable { points: n - 1, coefficients: self.trend.beta.len() });
            }
            residuals.push(self.alpha[i] / precision);
            variances.push(1.0 / precision);
        }
        Ok(LeaveOneOut { residuals, variances })
    }
}

/// `log N(residual; 0, variance)`.
pub(crate) fn log_density(residual: f64, variance: f64) -> f64 {
    -0.5 * (LOG_2_PI + variance.ln() + residual * residual / variance)
}

/// Share of standardized residuals inside the central interval of probability `level`.
///
/// # Example
///
/// ```
/// // ±0.5 lie inside the central half of a normal distribution (±0.674), ±1 outside.
/// assert!((stridemap_gp::coverage(&[-1.0, -0.5, 0.5, 1.0], 0.5) - 0.5).abs() < 1e-15);
/// ```
#[must_use]
pub fn coverage(standardized_residuals: &[f64], level: f64) -> f64 {
    let inside = standardized_residuals.iter().filter(|z| central_probability(z.abs()) <= level);
    inside.count() as f64 / standardized_residuals.len() as f64
}

/// `P(|Z| ≤ z)` of a standard normal `Z`, to about 1e-12, for `z ≥ 0`.
fn central_probability(z: f64) -> f64 {
    if z > 8.0 {
        return 1.0;
    }
    // Marsaglia's series: Φ(z) − ½ = φ(z) (z + z³/3 + z⁵/15 + …)
    let (mut term, mut sum, mut odd) = (z, z, 1.0);
    while term > 1e-16 * sum {
        odd += 2.0;
        term *= z * z / odd;
        sum += term;
    }
    (2.0 * sum * (-0.5 * z * z - 0.5 * LOG_2_PI).exp()).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn central_probabilities_are_the_table_s() {
        for (z, p) in [(0.674_489_750_196_082, 0.5), (1.959_963_984_540_054, 0.95), (3.0, 0.997_300_203_936_740)] {
            assert!((central_probability(z) - p).abs() < 1e-12);
        }
        assert!(central_probability(0.0).abs() < 1e-15);
    }
}
