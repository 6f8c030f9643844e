//! The fitted model: a prior conditioned on data.

use pulp::Arch;

use crate::aligned::Aligned;
use crate::dense::{DenseScratch, cholesky, small_backward, small_cholesky, small_forward, triangular_inverse};
use crate::error::{GpError, Result, check_finite, check_len};
use crate::evidence::{Fill, LOG_2_PI};
use crate::hyper::Hyperparameters;
use crate::kernel::{Kernel, with_profile};
use crate::mean::{Frame, Mean};
use crate::memory::check_memory;
use crate::optimize::FitReport;
use crate::panels::InverseFactor;
use crate::points::Points;
use crate::vector::padded;

/// A Gaussian process conditioned on `N` observations of `D` inputs: exact regression.
///
/// Made by [`Gp::fit`], which finds the hyperparameters, or [`Gp::condition`], which is given them.
/// All answers are in the user's units. A `Gp` is immutable under prediction and can be shared
/// between threads.
#[derive(Clone, Debug)]
pub struct Gp {
    pub(crate) arch: Arch,
    pub(crate) kernel: Kernel,
    pub(crate) mean: Mean,
    pub(crate) hyperparameters: Hyperparameters,
    /// Constant subtracted from `y`.
    pub(crate) offset: f64,
    pub(crate) frame: Frame,
    pub(crate) dims: usize,
    /// Training inputs, row-major, as given.
    pub(crate) x: Vec<f64>,
    /// Training targets, as given.
    pub(crate) y: Vec<f64>,
    /// Points padded to whole panels.
    pub(crate) stride: usize,
    /// `1/ℓ`.
    pub(crate) inverse_scales: Vec<f64>,
    /// Inputs centred and in length scales, one padded row a dimension.
    pub(crate) z: Aligned,
    /// `M = L⁻¹`.
    pub(crate) factor: InverseFactor,
    /// `α = P y`, padded.
    pub(crate) alpha: Aligned,
    pub(crate) trend: Trend,
    pub(crate) log_marginal_likelihood: f64,
    pub(crate) report: Option<FitReport>,
    /// Points added or dropped since the last factorisation.
    pub(crate) updates: usize,
}

/// The mean function after conditioning.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trend {
    /// `K⁻¹ H L_A⁻ᵀ`, one padded row a coefficient.
    pub(crate) weights: Vec<f64>,
    /// `L_A`, row-major.
    pub(crate) factor: Vec<f64>,
    /// Coefficients `β` in the frame's basis.
    pub(crate) beta: Vec<f64>,
}

impl Gp {
    /// Conditions a prior with given hyperparameters on data \[RW06, Alg. 2.1\].
    ///
    /// # Arguments
    ///
    /// - `points` – inputs, shape `(N, D)`, `N ≥ 1`.
    /// - `y` – targets, shape `(N,)`.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::Empty`], [`GpError::NotFinite`] or [`GpError::Parameter`] for
    /// arguments that break the terms above; [`GpError::NotPositiveDefinite`] if the covariance has
    /// no Cholesky factor in double precision (nothing is added to make it have one);
    /// [`GpError::MeanNotIdentifiable`] if the data do not determine the mean's coefficients.
    ///
    /// # Cost
    ///
    /// `O(N³)` time, `O(N²)` memory.
    ///
    /// # Example
    ///
    /// One observation, `y = 1` at `x = 0`, with `σ_f² = ℓ = 1` and `σₙ² = 1/4`: at the datum the
    /// mean is `1/1.25` and the variance `1 − 1/1.25`.
    ///
    /// ```
    /// use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points};
    ///
    /// let hyperparameters = Hyperparameters {
    ///     length_scales: vec![1.0],
    ///     signal_variance: 1.0,
    ///     noise_variance: 0.25,
    /// };
    /// let points = Points::new(&[0.0], 1)?;
    /// let gp = Gp::condition(points, &[1.0], Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    ///
    /// let at = gp.predict(&[0.0])?;
    /// assert!((at.mean - 0.8).abs() < 1e-15 && (at.latent_variance - 0.2).abs() < 1e-15);
    /// // log N(1; 0, 1.25)
    /// let expected = -0.5 / 1.25 - 0.5 * (std::f64::consts::TAU * 1.25).ln();
    /// assert!((gp.log_marginal_likelihood() - expected).abs() < 1e-15);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn condition(
        points: Points<'_>,
        y: &[f64],
        kernel: Kernel,
        mean: Mean,
        hyperparameters: Hyperparameters,
    ) -> Result<Self> {
        check_data(points, y)?;
        let frame = Frame::of(points.values(), points.dims());
        Self::conditioned(points, y, kernel, mean, hyperparameters, 0.0, frame)
    }

    /// [`condition`](Self::condition) for checked data, with `offset` subtracted from `y`.
    pub(crate) fn conditioned(
        points: Points<'_>,
        y: &[f64],
        kernel: Kernel,
        mean: Mean,
        hyperparameters: Hyperparameters,
        offset: f64,
        frame: Frame,
    ) -> Result<Self> {
        hyperparameters.check(points.dims())?;
        check_memory(points.len(), 0)?;
        let mut gp = Self {
            arch: Arch::new(),
            kernel,
            mean,
            inverse_scales: hyperparameters.length_scales.iter().map(|l| 1.0 / l).collect(),
            hyperparameters,
            offset,
            frame,
            dims: points.dims(),
            x: points.values().to_vec(),
            y: y.to_vec(),
            stride: 0,
            z: Aligned::zeros(0),
            factor: InverseFactor::empty(),
            alpha: Aligned::zeros(0),
            trend: Trend::default(),
            log_marginal_likelihood: 0.0,
            report: None,
            updates: 0,
        };
        gp.scale_inputs();
        gp.factorise()?;
        gp.solve()?;
        Ok(gp)
    }

    /// Recomputes `z` from `x`.
    pub(crate) fn scale_inputs(&mut self) {
        self.stride = padded(self.y.len());
        self.z = Aligned::zeros(self.dims * self.stride);
        for (i, row) in self.x.chunks_exact(self.dims).enumerate() {
            for d in 0..self.dims {
                self.z[d * self.stride + i] = self.frame.scaled(d, row[d], self.inverse_scales[d]);
            }
        }
    }

    /// Recomputes the factor from `z`.
    fn factorise(&mut self) -> Result<()> {
        let (n, stride) = (self.y.len(), self.stride);
        let Hyperparameters { signal_variance, noise_variance, .. } = self.hyperparameters;
        let mut covariance = Aligned::zeros(stride * stride);
        let mut inverse = Aligned::zeros(stride * stride);
        with_profile!(self.kernel, profile => self.arch.dispatch(Fill {
            profile,
            z: &self.z,
            n,
            stride,
            signal_variance,
            noise_variance,
            covariance: &mut covariance,
            slopes: &mut inverse,
        }));
        cholesky(&mut covariance, n, stride, &mut DenseScratch::new(n))
            .map_err(|row| GpError::NotPositiveDefinite { points: n, row, signal_variance, noise_variance })?;
        triangular_inverse(&covariance, &mut inverse, n, stride);
        self.factor = InverseFactor::from_column_major(&inverse, n, stride);
        self.updates = 0;
        Ok(())
    }

    /// Recomputes everything that follows from factor and targets: `α`, mean, evidence.
    pub(crate) fn solve(&mut self) -> Result<()> {
        let (n, stride) = (self.y.len(), self.stride);
        let m = self.mean.coefficients(self.dims);
        let not_identifiable = GpError::MeanNotIdentifiable { points: n, coefficients: m };
        if n < m {
            return Err(not_identifiable);
        }
        let mut targets = vec![0.0; stride];
        for (target, y) in targets.iter_mut().zip(&self.y) {
            *target = y - self.offset;
        }
        let mut whitened = vec![0.0; stride];
        self.factor.product(&targets, &mut whitened);

        // W = M H, then W L_A⁻ᵀ
        let mut basis = vec![0.0; m * stride];
        let mut row = vec![0.0; m];
        for (i, x) in self.x.chunks_exact(self.dims).enumerate() {
            self.frame.basis(self.mean, x, &mut row);
            for b in 0..m {
                basis[b * stride + i] = row[b];
            }
        }
        let mut w = vec![0.0; m * stride];
        for (w, h) in w.chunks_exact_mut(stride).zip(basis.chunks_exact(stride)) {
            self.factor.product(h, w);
        }
        let column = |w: &[f64], b: usize| -> std::ops::Range<usize> {
            debug_assert!(b * stride < w.len());
            b * stride..(b + 1) * stride
        };
        let mut small = vec![0.0; m * m];
        for a in 0..m {
            for b in 0..m {
                small[a * m + b] = dot(&w[column(&w, a)], &w[column(&w, b)]);
            }
        }
        small_cholesky(&mut small, m).ok_or(not_identifiable)?;
        for i in 0..n {
            for b in 0..m {
                row[b] = w[b * stride + i];
            }
            small_forward(&small, m, &mut row);
            for b in 0..m {
                w[b * stride + i] = row[b];
            }
        }
        let mut beta = vec![0.0; m];
        for b in 0..m {
            let range = column(&w, b);
            beta[b] = dot(&w[range.clone()], &whitened);
            for (v, w) in whitened.iter_mut().zip(&w[range]) {
                *v -= beta[b] * w;
            }
        }
        small_backward(&small, m, &mut beta);

        let log_det_a = 2.0 * (0..m).map(|b| small[b * m + b].ln()).sum::<f64>()
            + if m > 0 { 2.0 * self.frame.log_det_to_user(self.mean) } else { 0.0 };
        self.log_marginal_likelihood = -0.5 * dot(&whitened, &whitened) + self.factor.log_det()
            - 0.5 * log_det_a
            - 0.5 * (n as f64 - m as f64) * LOG_2_PI;
        self.alpha = Aligned::zeros(stride);
        self.factor.transposed_product(&whitened, &mut self.alpha);
        let mut weights = vec![0.0; m * stride];
        for (out, w) in weights.chunks_exact_mut(stride).zip(w.chunks_exact(stride)) {
            self.factor.transposed_product(w, out);
        }
        self.trend = Trend { weights, factor: small, beta };
        check_finite("weights of the training points", &self.alpha, 1)?;
        check_finite("log marginal likelihood", &[self.log_marginal_likelihood], 1)
    }

    /// Number of training points `N`.
    #[must_use]
    pub fn len(&self) -> usize {
        self.y.len()
    }

    /// Always false: a model has at least one point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.y.is_empty()
    }

    /// Number of input dimensions `D`.
    #[must_use]
    pub fn dims(&self) -> usize {
        self.dims
    }

    /// The covariance function.
    #[must_use]
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Length scales, signal variance and noise variance, in the user's units.
    #[must_use]
    pub fn hyperparameters(&self) -> &Hyperparameters {
        &self.hyperparameters
    }

    /// Coefficients of the mean in the user's units: none, `[β₀]` or `[β₀, β₁ … β_D]`.
    #[must_use]
    pub fn mean_coefficients(&self) -> Vec<f64> {
        let mut user = self.frame.to_user(self.mean, &self.trend.beta);
        if let Some(first) = user.first_mut() {
            *first += self.offset;
        }
        user
    }

    /// Constant that was subtracted from `y` before anything else (its mean, when outputs were
    /// standardized; else zero). Predictions contain it.
    #[must_use]
    pub fn offset(&self) -> f64 {
        self.offset
    }

    /// `log p(y | X, θ)` in nats \[RW06, eqs. (2.30), (2.45)\], of `y` in the user's units.
    #[must_use]
    pub fn log_marginal_likelihood(&self) -> f64 {
        self.log_marginal_likelihood
    }

    /// Training inputs, row-major, shape `(N, D)`.
    #[must_use]
    pub fn inputs(&self) -> &[f64] {
        &self.x
    }

    /// Training targets, shape `(N,)`.
    #[must_use]
    pub fn targets(&self) -> &[f64] {
        &self.y
    }

    /// How the hyperparameters were found; `None` if they were given.
    #[must_use]
    pub fn report(&self) -> Option<&FitReport> {
        self.report.as_ref()
    }
}

/// Checks training data: some points, one target a point, all finite.
pub(crate) fn check_data(points: Points<'_>, y: &[f64]) -> Result<()> {
    if points.is_empty() {
        return Err(GpError::Empty { what: "points" });
    }
    check_len("length of y", points.len(), y.len())?;
    check_finite("y", y, 1)
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evidence::Evidence;
    use crate::predict::Scratch;
    use crate::vector::every_arch;

    /// Instruction sets round differently: fused or not, and in another order.
    const ARCH_TOLERANCE: f64 = 1e-11;

    #[test]
    fn every_instruction_set_gives_the_same_answer() {
        let dims = 3;
        let x: Vec<f64> = (0..37 * dims).map(|i| ((i * i * 5 + i) as f64).sin()).collect();
        let y: Vec<f64> = x.chunks_exact(dims).map(|x| (2.0 * x[0]).sin() + x[1] * x[2]).collect();
        let queries: Vec<f64> = (0..11 * dims).map(|i| (i as f64 * 0.7).cos()).collect();
        let (points, queries) = (Points::new(&x, dims).unwrap(), Points::new(&queries, dims).unwrap());
        for kernel in [Kernel::SquaredExponential, Kernel::Matern32, Kernel::Matern52] {
            let hyperparameters =
                Hyperparameters { length_scales: vec![0.7, 0.9, 1.1], signal_variance: 1.3, noise_variance: 0.05 };
            let h = &hyperparameters;
            let gp = Gp::condition(points, &y, kernel, Mean::Zero, hyperparameters.clone()).unwrap();
            let mut reference = vec![0.0; 2 + dims];
            for (run, arch) in every_arch().into_iter().enumerate() {
                let other = Gp { arch, ..gp.clone() };
                let (mut mean, mut variance) = ([0.0; 11], [0.0; 11]);
                other.predict_batch(queries, &mut mean, &mut variance, &mut Scratch::new()).unwrap();
                for (i, x) in queries.rows().enumerate() {
                    let (a, b) = (gp.predict(x).unwrap(), other.predict(x).unwrap());
                    for (found, expected) in [
                        (b.mean, a.mean),
                        (b.latent_variance, a.latent_variance),
                        (mean[i], a.mean),
                        (variance[i], a.latent_variance),
                    ] {
                        assert!((found - expected).abs() < ARCH_TOLERANCE, "{kernel:?} {arch:?}");
                    }
                }
                let frame = Frame::of(&x, dims);
                let mut evidence = Evidence::new(&x, dims, &y, kernel, Mean::Constant, &frame);
                evidence.arch = arch;
                evidence.value(&h.length_scales, h.signal_variance, h.noise_variance).unwrap();
                let mut gradient = vec![0.0; 2 + dims];
                evidence.gradient(&mut gradient);
                for (found, expected) in gradient.iter().zip(&reference) {
                    assert!(run == 0 || (found - expected).abs() < ARCH_TOLERANCE * 100.0);
                }
                reference = gradient;
            }
        }
    }
}
