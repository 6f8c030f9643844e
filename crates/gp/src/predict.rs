//! Prediction at new inputs, without allocating: moments, batches and gradients.

use pulp::{Simd, WithSimd};

use crate::batch::{GROUP, GroupMoments};
use crate::dense::small_forward;
use crate::error::{GpError, Result, check_finite, check_len};
use crate::gp::{Gp, dot};
use crate::kernel::{Profile, with_profile};
use crate::mean::Mean;
use crate::panels::NormSquared;
use crate::points::Points;

/// Largest negative latent variance, relative to the prior variance, that is put down to rounding
/// and reported as zero: `|L⁻¹ k|²` loses `ε √cond(K)` of it, and `cond(K)` may be 10¹⁶.
const VARIANCE_ROUND_OFF: f64 = 1e-7;

/// Mean and variance of the latent function at one input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// `f̄*`, in the unit of `y` \[MA09, eq. (12)\].
    pub mean: f64,
    /// `V[f*]`, in (unit of `y`)², never negative. The variance of the next *observation*, that of
    /// \[MA09, eq. (13)\], is larger by the noise variance.
    pub latent_variance: f64,
}

/// Memory for predictions, kept between calls so that none of them allocates. One a thread.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    pub(crate) buffer: Vec<f64>,
}

impl Scratch {
    /// Empty scratch memory, which grows at the first call that needs it.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    pub(crate) fn take(&mut self, length: usize) -> &mut [f64] {
        if self.buffer.len() < length {
            self.buffer.resize(length, 0.0);
        }
        &mut self.buffer[..length]
    }
}

impl Gp {
    /// Predicts the latent function at one input.
    ///
    /// ```text
    /// f̄*    = h*ᵀβ + k*ᵀα                        [RW06, eqs. (2.25), (2.41)], [MA09, eq. (12)]
    /// V[f*] = k** − |L⁻¹k*|² + |L_A⁻¹(h* − HᵀK⁻¹k*)|²  [RW06, eqs. (2.26), (2.41)], [MA09, eq. (13)]
    /// ```
    ///
    /// # Arguments
    ///
    /// - `x` – the input, shape `(D,)`, in the units of the training inputs.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::NotFinite`]; [`GpError::Variance`] if rounding has eaten the
    /// variance (below −10⁻⁷ of the prior variance).
    ///
    /// # Cost
    ///
    /// `½N² + O(ND)` multiply-adds. Works on the stack up to 1,000 points and allocates beyond;
    /// [`predict_with`](Self::predict_with) never does.
    ///
    /// # Example
    ///
    /// See [`Gp::condition`].
    pub fn predict(&self, x: &[f64]) -> Result<Prediction> {
        match self.stride + self.dims {
            0..=64 => self.moments(x, &mut [0.0; 64]),
            65..=160 => self.moments(x, &mut [0.0; 160]),
            161..=1056 => self.moments(x, &mut [0.0; 1056]),
            length => self.moments(x, &mut vec![0.0; length]),
        }
    }

    /// [`predict`](Self::predict) in the caller's scratch memory: never allocates once that has
    /// grown.
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict).
    pub fn predict_with(&self, x: &[f64], scratch: &mut Scratch) -> Result<Prediction> {
        self.moments(x, scratch.take(self.stride + self.dims))
    }

    /// Predicts at each row of `points`: `mean[i]` and `latent_variance[i]`.
    ///
    /// Eight queries at a time, so a value may differ from that of [`predict`](Self::predict) in
    /// its last digits; it does not depend on its place in the batch.
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict); [`GpError::Shape`] if the outputs are not one a point.
    ///
    /// # Example
    ///
    /// ```
    /// # use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points, Scratch};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// # let gp = Gp::condition(
    /// #     Points::new(&[0.0], 1)?, &[1.0], Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    /// let (mut mean, mut latent_variance) = ([0.0; 2], [0.0; 2]);
    /// let queries = Points::new(&[0.0, 40.0], 1)?;
    /// gp.predict_batch(queries, &mut mean, &mut latent_variance, &mut Scratch::new())?;
    /// // The prior returns far from the data.
    /// assert!((mean[0] - 0.8).abs() < 1e-15 && mean[1].abs() < 1e-15);
    /// assert!((latent_variance[1] - 1.0).abs() < 1e-15);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn predict_batch(
        &self,
        points: Points<'_>,
        mean: &mut [f64],
        latent_variance: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<()> {
        check_len("columns of points", self.dims, points.dims())?;
        check_len("length of mean", points.len(), mean.len())?;
        check_len("length of latent_variance", points.len(), latent_variance.len())?;
        if self.mean != Mean::Zero {
            for (i, x) in points.rows().enumerate() {
                let at = self.predict_with(x, scratch).map_err(|error| at_row(error, i))?;
                (mean[i], latent_variance[i]) = (at.mean, at.latent_variance);
            }
            return Ok(());
        }
        let buffer = scratch.take(GROUP * (self.stride + self.dims));
        let (k, z) = buffer.split_at_mut(GROUP * self.stride);
        for first in (0..points.len()).step_by(GROUP) {
            let count = GROUP.min(points.len() - first);
            for q in 0..GROUP {
                // The last group is filled up with its last query.
                let x = points.row(first + q.min(count - 1));
                for d in 0..self.dims {
                    z[d * GROUP + q] = self.frame.scaled(d, x[d], self.inverse_scales[d]);
                }
            }
            let (means, explained) = with_profile!(self.kernel, profile => {
                self.arch.dispatch(GroupMoments { profile, gp: self, z, k })
            });
            for q in 0..count {
                let variance = self.hyperparameters.signal_variance - explained[q];
                mean[first + q] = means[q] + self.offset;
                latent_variance[first + q] =
                    self.checked_variance(variance).map_err(|error| at_row(error, first + q))?;
            }
        }
        Ok(())
    }

    /// Mean and variance, with `buffer` of at least `stride + D` entries; leaves `k*` in its front.
    pub(crate) fn moments(&self, x: &[f64], buffer: &mut [f64]) -> Result<Prediction> {
        check_len("length of x", self.dims, x.len())?;
        check_finite("x", x, self.dims)?;
        let (k, z) = buffer.split_at_mut(self.stride);
        for d in 0..self.dims {
            z[d] = self.frame.scaled(d, x[d], self.inverse_scales[d]);
        }
        let (mean, explained) = with_profile!(self.kernel, profile => {
            self.arch.dispatch(Moments { profile, gp: self, z, k })
        });
        let mut prediction =
            Prediction { mean: mean + self.offset, latent_variance: self.hyperparameters.signal_variance - explained };
        if self.mean != Mean::Zero {
            let mut rest = [0.0; SMALL];
            self.with_trend(x, k, &mut rest, &mut prediction);
            check_finite("predicted mean", &[prediction.mean], 1)?;
        }
        prediction.latent_variance = self.checked_variance(prediction.latent_variance)?;
        Ok(prediction)
    }

    /// Adds what the mean function contributes at `x`.
    fn with_trend(&self, x: &[f64], k: &[f64], small: &mut [f64], to: &mut Prediction) {
        let m = self.trend.beta.len();
        let mut large = Vec::new();
        let rest = if m <= SMALL {
            &mut small[..m]
        } else {
            large.resize(m, 0.0);
            &mut large[..]
        };
        self.frame.basis(self.mean, x, rest);
        to.mean += dot(rest, &self.trend.beta);
        small_forward(&self.trend.factor, m, rest);
        for (rest, weights) in rest.iter_mut().zip(self.trend.weights.chunks_exact(self.stride)) {
            *rest -= dot(weights, k);
        }
        to.latent_variance += dot(rest, rest);
    }

    /// Rounds a variance that is negative by rounding up to zero, and refuses any worse.
    pub(crate) fn checked_variance(&self, variance: f64) -> Result<f64> {
        // NaN must not reach `max`, which would turn it into zero.
        let signal_variance = self.hyperparameters.signal_variance;
        if variance.is_finite() && variance >= -VARIANCE_ROUND_OFF * signal_variance {
            Ok(variance.max(0.0))
        } else {
            Err(GpError::Variance { row: 0, variance })
        }
    }

    /// Gradients of mean and latent variance by the input, both of shape `(D,)`, beside the
    /// prediction itself.
    ///
    /// ```text
    /// ∂k*/∂x_d    = −h(r) (x_d − X_d) / ℓ_d²
    /// ∂f̄*/∂x_d    = β_d + αᵀ ∂k*/∂x_d
    /// ∂V[f*]/∂x_d = −2 (K⁻¹k*)ᵀ ∂k*/∂x_d + 2 uᵀ L_A⁻¹ ∂(h* − HᵀK⁻¹k*)/∂x_d
    /// ```
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict); [`GpError::Shape`] if a gradient is not of length `D`.
    ///
    /// # Cost
    ///
    /// `N² + O(ND)` multiply-adds.
    ///
    /// # Example
    ///
    /// ```
    /// # use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points, Scratch};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// # let gp = Gp::condition(
    /// #     Points::new(&[0.0], 1)?, &[1.0], Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    /// // The mean is 0.8 e^(−x²/2), the variance 1 − 0.8 e^(−x²).
    /// let (mut mean, mut variance) = ([0.0], [0.0]);
    /// gp.predict_gradient(&[1.0], &mut mean, &mut variance, &mut Scratch::new())?;
    /// assert!((mean[0] + 0.8 * f64::exp(-0.5)).abs() < 1e-14);
    /// assert!((variance[0] - 1.6 * f64::exp(-1.0)).abs() < 1e-14);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn predict_gradient(
        &self,
        x: &[f64],
        mean_gradient: &mut [f64],
        latent_variance_gradient: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<Prediction> {
        check_len("length of mean_gradient", self.dims, mean_gradient.len())?;
        check_len("length of latent_variance_gradient", self.dims, latent_variance_gradient.len())?;
        let (n, stride, m) = (self.y.len(), self.stride, self.trend.beta.len());
        let buffer = scratch.take(3 * stride + 2 * self.dims + 2 * m);
        let (front, rest) = buffer.split_at_mut(stride + self.dims);
        let prediction = self.moments(x, front)?;
        let (product, rest) = rest.split_at_mut(stride);
        let (weights, rest) = rest.split_at_mut(stride);
        let k = &front[..stride];
        let z = &front[stride..];
        self.factor.product(k, product);
        self.factor.transposed_product(product, weights);

        let (u, step) = rest.split_at_mut(m);
        self.frame.basis(self.mean, x, u);
        small_forward(&self.trend.factor, m, u);
        for (u, w) in u.iter_mut().zip(self.trend.weights.chunks_exact(stride)) {
            *u -= dot(w, k);
        }
        for d in 0..self.dims {
            let row = &self.z[d * stride..d * stride + n];
            let inverse_scale = self.inverse_scales[d];
            // ∂h*/∂x_d, then L_A⁻¹ of it
            let step = &mut step[..m];
            step.fill(0.0);
            let mut mean = 0.0;
            if self.mean == Mean::Linear {
                step[1 + d] = 1.0 / self.frame.spread_or_one(d);
                mean = self.trend.beta[1 + d] * step[1 + d];
            }
            small_forward(&self.trend.factor, m, step);
            let mut variance = 0.0;
            for i in 0..n {
                let slope = -self.slope_at(i, z) * (z[d] - row[i]) * inverse_scale;
                mean += self.alpha[i] * slope;
                variance -= 2.0 * weights[i] * slope;
                for (step, w) in step.iter_mut().zip(self.trend.weights.chunks_exact(stride)) {
                    *step -= w[i] * slope;
                }
            }
            mean_gradient[d] = mean;
            latent_variance_gradient[d] = variance + 2.0 * dot(u, step);
        }
        Ok(prediction)
    }

    /// `σ_f² h(r)` between training point `i` and the scaled input `z`.
    fn slope_at(&self, i: usize, z: &[f64]) -> f64 {
        let squared: f64 = (0..self.dims).map(|d| (self.z[d * self.stride + i] - z[d]).powi(2)).sum();
        self.kernel.slope(squared, self.hyperparameters.signal_variance)
    }
}

/// Mean coefficients that fit on the stack.
const SMALL: usize = 16;

/// The same error at row `row`.
pub(crate) fn at_row(error: GpError, row: usize) -> GpError {
    match error {
        GpError::Variance { variance, .. } => GpError::Variance { row, variance },
        other => other,
    }
}

/// `(k*ᵀα, |L⁻¹k*|²)` at a scaled input; leaves `k*` behind.
struct Moments<'a, P> {
    profile: P,
    gp: &'a Gp,
    z: &'a [f64],
    k: &'a mut [f64],
}

impl<P: Profile> WithSimd for Moments<'_, P> {
    type Output = (f64, f64);
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (f64, f64) {
        let Self { profile, gp, z, k } = self;
        let mean = CrossCovariance {
            profile,
            signal_variance: gp.hyperparameters.signal_variance,
            stride: gp.stride,
            points: &gp.z,
            weights: &gp.alpha,
            z,
            k,
        }
        .with_simd(simd);
        (mean, NormSquared { factor: &gp.factor, k }.with_simd(simd))
    }
}

/// Fills `k*` between `points` (one padded row a dimension, scaled) and the scaled input `z`, and
/// returns `k*ᵀ weights`.
pub(crate) struct CrossCovariance<'a, P> {
    pub(crate) profile: P,
    pub(crate) signal_variance: f64,
    pub(crate) stride: usize,
    pub(crate) points: &'a [f64],
    pub(crate) weights: &'a [f64],
    pub(crate) z: &'a [f64],
    pub(crate) k: &'a mut [f64],
}

impl<P: Profile> WithSimd for CrossCovariance<'_, P> {
    type Output = f64;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { profile, signal_variance, stride, points, weights, z, k } = self;
        let scale = simd.splat_f64s(signal_variance);
        let mut mean = simd.splat_f64s(0.0);
        let (k, _) = S::as_mut_simd_f64s(k);
        let (weights, _) = S::as_simd_f64s(weights);
        for (i, (k, &weight)) in k.iter_mut().zip(weights).enumerate() {
            let mut q = simd.splat_f64s(0.0);
            for (row, &z) in points.chunks_exact(stride).zip(z) {
                let (row, _) = S::as_simd_f64s(row);
                let difference = simd.sub_f64s(row[i], simd.splat_f64s(z));
                q = simd.mul_add_e_f64s(difference, difference, q);
            }
            *k = simd.mul_f64s(profile.value(simd, q), scale);
            mean = simd.mul_add_e_f64s(*k, weight, mean);
        }
        simd.reduce_sum_f64s(mean)
    }
}
