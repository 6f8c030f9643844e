//! The joint distribution at several inputs, and draws from it.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::dense::small_forward;
use crate::error::{GpError, Result, check_len};
use crate::gp::{Gp, dot};
use crate::hyper::Hyperparameters;
use crate::points::Points;

/// What a draw contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Draw {
    /// The latent function.
    Latent,
    /// The next observation: the latent function and the noise \[MA09, eq. (13)\].
    Observation,
}

/// Pivots below this share of the prior variance are rounding: the draw has no part along them.
const PIVOT_ROUND_OFF: f64 = 1e-12;

/// Joint distribution of the latent function at `Q` inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPrediction {
    /// Means, shape `(Q,)`.
    pub mean: Vec<f64>,
    /// Latent covariance, row-major, shape `(Q, Q)`, symmetric.
    pub covariance: Vec<f64>,
}

impl Gp {
    /// Joint mean and latent covariance at the rows of `points` \[RW06, eqs. (2.23), (2.24)\].
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`] if `points` does not have `D` columns; [`GpError::Variance`] as in
    /// [`Gp::predict`].
    ///
    /// # Cost
    ///
    /// `O(Q N² + Q² N)` time, `O(Q N + Q²)` memory.
    pub fn predict_joint(&self, points: Points<'_>) -> Result<JointPrediction> {
        check_len("columns of points", self.dims, points.dims())?;
        let (count, stride, m) = (points.len(), self.stride, self.trend.beta.len());
        let mut mean = vec![0.0; count];
        let mut whitened = vec![0.0; count * stride];
        let mut rest = vec![0.0; count * m];
        let mut buffer = vec![0.0; stride + self.dims];
        let mut covariance = vec![0.0; count * count];
        for (i, x) in points.rows().enumerate() {
            let at = self.moments(x, &mut buffer).map_err(|error| crate::predict::at_row(error, i))?;
            mean[i] = at.mean;
            covariance[i * count + i] = at.latent_variance;
            let k = &buffer[..stride];
            self.factor.product(k, &mut whitened[i * stride..(i + 1) * stride]);
            let u = &mut rest[i * m..(i + 1) * m];
            self.frame.basis(self.mean, x, u);
            small_forward(&self.trend.factor, m, u);
            for (u, w) in u.iter_mut().zip(self.trend.weights.chunks_exact(stride)) {
                *u -= dot(w, k);
            }
        }
        for i in 0..count {
            for j in 0..i {
                let (a, b) = (points.row(i), points.row(j));
                let squared: f64 = (0..self.dims).map(|d| ((a[d] - b[d]) * self.inverse_scales[d]).powi(2)).sum();
                let prior = self.kernel.covariance(squared, self.hyperparameters.signal_variance);
                let value = prior
                    - dot(&whitened[i * stride..(i + 1) * stride], &whitened[j * stride..(j + 1) * stride])
                    + dot(&rest[i * m..(i + 1) * m], &rest[j * m..(j + 1) * m]);
                covariance[i * count + j] = value;
                covariance[j * count + i] = value;
            }
        }
        Ok(JointPrediction { mean, covariance })
    }

    /// Draws the function (or observations of it) at the rows of `points` together.
    ///
    /// The covariance of close points is singular to rounding, so its square root is taken by a
    /// pivoted Cholesky factorisation that stops where the rest is below 10⁻¹² of the prior
    /// variance; nothing is added to the diagonal.
    ///
    /// # Arguments
    ///
    /// - `out` – the draw, shape `(Q,)`.
    ///
    /// # Errors
    ///
    /// As [`predict_joint`](Self::predict_joint); [`GpError::Shape`] if `out` is not of length `Q`.
    ///
    /// # Cost
    ///
    /// As [`predict_joint`](Self::predict_joint), and `O(Q³)`.
    ///
    /// # Example
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use stridemap_gp::{Draw, Gp, Hyperparameters, Kernel, Mean, Points};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 1e-6 };
    /// # let gp = Gp::condition(
    /// #     Points::new(&[0.0], 1)?, &[1.0], Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    /// // One point twice, and the datum (0, 1): the twins agree, the datum is met.
    /// let points = Points::new(&[3.0, 3.0, 0.0], 1)?;
    /// let mut draw = [0.0; 3];
    /// gp.sample_joint(points, Draw::Latent, &mut ChaCha8Rng::seed_from_u64(1), &mut draw)?;
    /// assert!((draw[0] - draw[1]).abs() < 1e-5 && (draw[2] - 1.0).abs() < 1e-2);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn sample_joint<R: Rng + ?Sized>(
        &self,
        points: Points<'_>,
        draw: Draw,
        rng: &mut R,
        out: &mut [f64],
    ) -> Result<()> {
        self.predict_joint(points)?.draw(&self.hyperparameters, draw, rng, out)
    }
}

impl JointPrediction {
    /// Draws from the distribution of a model with these hyperparameters, as [`Gp::sample_joint`] does.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`] if `out` is not of length `Q`; [`GpError::Variance`] for a variance that is NaN.
    pub fn draw<R: Rng + ?Sized>(
        self,
        hyperparameters: &Hyperparameters,
        draw: Draw,
        rng: &mut R,
        out: &mut [f64],
    ) -> Result<()> {
        let count = self.mean.len();
        check_len("length of out", count, out.len())?;
        let Self { mean, mut covariance } = self;
        let normals: Vec<f64> = (0..count).map(|_| StandardNormal.sample(rng)).collect();
        out.copy_from_slice(&mean);
        let mut diagonal: Vec<f64> = (0..count).map(|i| covariance[i * count + i]).collect();
        let least = PIVOT_ROUND_OFF * hyperparameters.signal_variance;
        let mut used = vec![false; count];
        for normal in &normals {
            let largest = (0..count).filter(|&i| !used[i]).max_by(|&a, &b| diagonal[a].total_cmp(&diagonal[b]));
            let Some(pivot) = largest else { break };
            if diagonal[pivot].is_nan() {
                return Err(GpError::Variance { row: pivot, variance: diagonal[pivot] });
            }
            if diagonal[pivot] <= least {
                break;
            }
            used[pivot] = true;
            // This pivot's column of the factor; what is left is the covariance given it.
            let root = diagonal[pivot].sqrt();
            let column: Vec<f64> =
                (0..count).map(|i| if i == pivot { root } else { covariance[i * count + pivot] / root }).collect();
            for i in 0..count {
                if used[i] && i != pivot {
                    continue;
                }
                out[i] += column[i] * normal;
                diagonal[i] -= column[i] * column[i];
                for j in 0..count {
                    covariance[i * count + j] -= column[i] * column[j];
                }
            }
        }
        if draw == Draw::Observation {
            let noise_std = hyperparameters.noise_variance.sqrt();
            for value in out {
                let normal: f64 = StandardNormal.sample(rng);
                *value += noise_std * normal;
            }
        }
        Ok(())
    }
}
