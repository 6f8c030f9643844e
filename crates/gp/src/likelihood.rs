//! The log marginal likelihood as a function of the hyperparameters, for those who search
//! themselves.

use crate::error::{GpError, Result, check_len};
use crate::evidence::{Evidence, NoValue};
use crate::gp::check_data;
use crate::hyper::Hyperparameters;
use crate::kernel::Kernel;
use crate::mean::{Frame, Mean};
use crate::points::Points;

/// Log marginal likelihood of one set of data, evaluated again and again without allocating.
///
/// # Example
///
/// One observation `y = 1` with total variance `v = σ_f² + σₙ² = 5/4`: `log N(1; 0, v)`, and by
/// `log σₙ²` its derivative is `½ (1/v − 1) σₙ²/v`.
///
/// ```
/// use stridemap_gp::{Hyperparameters, Kernel, LogMarginalLikelihood, Mean, Points};
///
/// let points = Points::new(&[0.0], 1)?;
/// let kernel = Kernel::SquaredExponential;
/// let mut likelihood = LogMarginalLikelihood::new(points, &[1.0], kernel, Mean::Zero)?;
/// let hyperparameters = Hyperparameters {
///     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
/// let mut gradient = [0.0; 3];
/// let value = likelihood.evaluate(&hyperparameters, &mut gradient)?;
/// assert!((value + 0.4 + 0.5 * (std::f64::consts::TAU * 1.25).ln()).abs() < 1e-15);
/// assert!((gradient[1] - 0.5 * (0.8 - 1.0) * 0.2).abs() < 1e-15);
/// # Ok::<(), stridemap_gp::GpError>(())
/// ```
pub struct LogMarginalLikelihood {
    evidence: Evidence,
    points: usize,
    dims: usize,
    coefficients: usize,
}

impl LogMarginalLikelihood {
    /// Takes in the data: inputs of shape `(N, D)`, `N ≥ 1`, and `N` targets.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::Empty`], [`GpError::NotFinite`].
    pub fn new(points: Points<'_>, y: &[f64], kernel: Kernel, mean: Mean) -> Result<Self> {
        check_data(points, y)?;
        let dims = points.dims();
        let frame = Frame::of(points.values(), dims);
        Ok(Self {
            evidence: Evidence::new(points.values(), dims, y, kernel, mean, &frame),
            points: points.len(),
            dims,
            coefficients: mean.coefficients(dims),
        })
    }

    /// The value in nats, and its gradient by `(log σ_f², log σₙ², log ℓ₁ … log ℓ_D)`.
    ///
    /// # Arguments
    ///
    /// - `gradient` – filled in, shape `(2 + D,)`; if it is empty, only the value is computed, at a
    ///   third of the cost.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::Parameter`], [`GpError::NotPositiveDefinite`],
    /// [`GpError::MeanNotIdentifiable`].
    ///
    /// # Cost
    ///
    /// `O(N³)`.
    pub fn evaluate(&mut self, at: &Hyperparameters, gradient: &mut [f64]) -> Result<f64> {
        at.check(self.dims)?;
        if !gradient.is_empty() {
            check_len("length of gradient", 2 + self.dims, gradient.len())?;
        }
        let points = self.points;
        let value =
            self.evidence.value(&at.length_scales, at.signal_variance, at.noise_variance).map_err(|failure| {
                match failure {
                    NoValue::Covariance(row) => GpError::NotPositiveDefinite {
                        points,
                        row,
                        signal_variance: at.signal_variance,
                        noise_variance: at.noise_variance,
                    },
                    NoValue::Mean => GpError::MeanNotIdentifiable { points, coefficients: self.coefficients },
                }
            })?;
        if !gradient.is_empty() {
            self.evidence.gradient(gradient);
        }
        Ok(value)
    }
}
