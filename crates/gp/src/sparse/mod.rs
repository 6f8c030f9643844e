//! Sparse regression: `M` inducing inputs stand for `N` points, `O(N M²)`.

mod bound;
mod cross;
mod fit;
mod saved;

use pulp::{Arch, Simd, WithSimd};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::aligned::Aligned;
use crate::dense::{BackwardSolve, solve_lower, triangular_inverse};
use crate::error::{GpError, Result, check_finite, check_len};
use crate::gp::{check_data, dot};
use crate::hyper::Hyperparameters;
use crate::kernel::{Kernel, Profile, with_profile};
use crate::mean::{FAR, Frame};
use crate::memory::room_for;
use crate::optimize::FitReport;
use crate::options::FitOptions;
use crate::panels::{InverseFactor, NormSquared};
use crate::points::Points;
use crate::predict::{CrossCovariance, Prediction, Scratch, at_row};
use crate::sample::Draw;
use crate::sample::JointPrediction;
use crate::scores::LeaveOneOut;

use bound::Bound;

/// How inducing inputs stand for the data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum SparseMethod {
    /// Variational free energy: a lower bound of the exact log marginal likelihood, so more inducing
    /// inputs never hurt. M. K. Titsias, *Variational learning of inducing variables in sparse
    /// Gaussian processes*, AISTATS 2009.
    #[default]
    Vfe,
    /// Fully independent training conditional: the likelihood of a model whose noise grows where
    /// the inducing inputs are far. E. Snelson and Z. Ghahramani, *Sparse Gaussian processes using
    /// pseudo-inputs*, NIPS 2006.
    Fitc,
}

/// How a sparse Gaussian process is fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SparseOptions {
    /// Kernel, start, bounds, priors and limits, as for an exact fit. The mean must be zero;
    /// `standardize_outputs` subtracts the mean of `y`.
    pub fit: FitOptions,
    /// Approximation.
    pub method: SparseMethod,
    /// Number of inducing inputs `M`, at most `N`; the first are training inputs drawn at random.
    pub inducing: usize,
    /// Whether the inducing inputs move, or only the hyperparameters.
    pub optimize_inducing: bool,
}

impl Default for SparseOptions {
    fn default() -> Self {
        Self {
            fit: FitOptions { tolerance_nats: 1e-3, ..FitOptions::default() },
            method: SparseMethod::default(),
            inducing: 100,
            optimize_inducing: true,
        }
    }
}

/// A sparse Gaussian process: `N` points seen through `M` inducing inputs.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "saved::SavedSparseGp", try_from = "saved::SavedSparseGp")]
pub struct SparseGp {
    arch: Arch,
    kernel: Kernel,
    method: SparseMethod,
    hyperparameters: Hyperparameters,
    offset: f64,
    points: usize,
    dims: usize,
    centre: Vec<f64>,
    /// Inducing inputs in the user's units, row-major.
    inducing: Vec<f64>,
    stride: usize,
    inverse_scales: Vec<f64>,
    z: Aligned,
    /// `L⁻¹` and `L_B⁻¹ L⁻¹`.
    factors: [InverseFactor; 2],
    /// `L⁻ᵀ β`.
    alpha: Aligned,
    bound: f64,
    bytes: usize,
    report: Option<FitReport>,
}

impl SparseGp {
    /// Conditions a prior with given hyperparameters and inducing inputs on data.
    ///
    /// # Arguments
    ///
    /// - `points` – inputs, shape `(N, D)`, `N ≥ 1`; `y` – targets, shape `(N,)`.
    /// - `inducing` – inducing inputs, shape `(M, D)`, `1 ≤ M`.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::Empty`], [`GpError::NotFinite`], [`GpError::Parameter`];
    /// [`GpError::NotPositiveDefinite`] if the approximation cannot be factorised.
    ///
    /// # Cost
    ///
    /// `O(N M²)` time, `O(N M)` memory.
    ///
    /// # Example
    ///
    /// With the data themselves as inducing inputs nothing is lost but the blur of 10⁻⁶.
    ///
    /// ```
    /// use stridemap_gp::{Hyperparameters, Kernel, Points, SparseGp, SparseMethod};
    ///
    /// let hyperparameters = Hyperparameters {
    ///     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// let points = Points::new(&[0.0], 1)?;
    /// let gp = SparseGp::condition(
    ///     points, &[1.0], Kernel::SquaredExponential, SparseMethod::Vfe, hyperparameters, points)?;
    /// let at = gp.predict(&[0.0])?;
    /// assert!((at.mean - 0.8).abs() < 1e-5 && (at.latent_variance - 0.2).abs() < 1e-5);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn condition(
        points: Points<'_>,
        y: &[f64],
        kernel: Kernel,
        method: SparseMethod,
        hyperparameters: Hyperparameters,
        inducing: Points<'_>,
    ) -> Result<Self> {
        check_data(points, y)?;
        check_len("columns of inducing", points.dims(), inducing.dims())?;
        if inducing.is_empty() {
            return Err(GpError::Empty { what: "inducing" });
        }
        check_memory(points.len(), inducing.len())?;
        let frame = Frame::of(points.values(), points.dims());
        let scaled = in_frame(points.values(), &frame);
        let mut bound = Bound::new(kernel, method, scaled, points.dims(), y.to_vec(), inducing.len());
        Self::from_bound(&mut bound, hyperparameters, inducing.values().to_vec(), 0.0, &frame)
    }

    /// The model at given parameters, with the bound's memory.
    fn from_bound(
        bound: &mut Bound,
        hyperparameters: Hyperparameters,
        inducing: Vec<f64>,
        offset: f64,
        frame: &Frame,
    ) -> Result<Self> {
        let dims = frame.centre.len();
        hyperparameters.check(dims)?;
        let (m, n) = (inducing.len() / dims, bound.points());
        let scales: Vec<f64> = (0..dims).map(|d| hyperparameters.length_scales[d] / frame.spread_or_one(d)).collect();
        let Some(value) = bound.value(&hyperparameters, &scales, &in_frame(&inducing, frame)) else {
            return Err(GpError::NotPositiveDefinite {
                points: n,
                row: 0,
                signal_variance: hyperparameters.signal_variance,
                noise_variance: hyperparameters.noise_variance,
            });
        };
        let arch = Arch::new();
        let stride = crate::vector::padded(m);
        let mut inverse = Aligned::zeros(stride * stride);
        triangular_inverse(&bound.factor, &mut inverse, m, stride);
        let first = InverseFactor::from_column_major(&inverse, m, stride);
        solve_lower(&bound.factor_b, &mut inverse, m, stride, m);
        let second = InverseFactor::from_column_major(&inverse, m, stride);
        let mut alpha = bound.beta.clone();
        arch.dispatch(BackwardSolve { factor: &bound.factor, n: m, stride, b: &mut alpha });
        check_finite("weights of the inducing inputs", &alpha, 1)?;
        let mut this = Self {
            arch,
            kernel: bound.kernel(),
            method: bound.method(),
            inverse_scales: hyperparameters.length_scales.iter().map(|l| 1.0 / l).collect(),
            hyperparameters,
            offset,
            points: n,
            dims,
            centre: frame.centre.clone(),
            inducing,
            stride,
            z: Aligned::zeros(dims * stride),
            factors: [first, second],
            alpha,
            bound: value,
            bytes: bound.bytes(),
            report: None,
        };
        this.scale_inducing();
        Ok(this)
    }

    fn scale_inducing(&mut self) {
        for (i, row) in self.inducing.chunks_exact(self.dims).enumerate() {
            for d in 0..self.dims {
                self.z[d * self.stride + i] = ((row[d] - self.centre[d]) * self.inverse_scales[d]).clamp(-FAR, FAR);
            }
        }
    }

    /// Predicts the latent function at one input.
    ///
    /// ```text
    /// f̄*    = k_u*ᵀ L⁻ᵀ β
    /// V[f*] = k** − |L⁻¹ k_u*|² + |L_B⁻¹ L⁻¹ k_u*|²
    /// ```
    ///
    /// # Errors
    ///
    /// As [`Gp::predict`](crate::Gp::predict).
    ///
    /// # Cost
    ///
    /// `M² + O(MD)` multiply-adds, on the stack up to 1,000 inducing inputs.
    pub fn predict(&self, x: &[f64]) -> Result<Prediction> {
        match self.stride + self.dims {
            0..=160 => self.moments(x, &mut [0.0; 160]),
            161..=1056 => self.moments(x, &mut [0.0; 1056]),
            length => self.moments(x, &mut vec![0.0; length]),
        }
    }

    /// [`predict`](Self::predict) in the caller's scratch memory.
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict).
    pub fn predict_with(&self, x: &[f64], scratch: &mut Scratch) -> Result<Prediction> {
        self.moments(x, scratch.take(self.stride + self.dims))
    }

    /// Joint mean and latent covariance at the rows of `points`.
    ///
    /// # Errors
    ///
    /// As [`Gp::predict_joint`](crate::Gp::predict_joint).
    pub fn predict_joint(&self, points: Points<'_>) -> Result<JointPrediction> {
        check_len("columns of points", self.dims, points.dims())?;
        let (count, stride) = (points.len(), self.stride);
        let (mut mean, mut covariance) = (vec![0.0; count], vec![0.0; count * count]);
        let mut whitened = vec![0.0; 2 * count * stride];
        let mut buffer = vec![0.0; stride + self.dims];
        for (i, (x, rows)) in points.rows().zip(whitened.chunks_exact_mut(2 * stride)).enumerate() {
            let at = self.moments(x, &mut buffer).map_err(|error| at_row(error, i))?;
            (mean[i], covariance[i * count + i]) = (at.mean, at.latent_variance);
            for (factor, row) in self.factors.iter().zip(rows.chunks_exact_mut(stride)) {
                factor.product(&buffer[..stride], row);
            }
        }
        for i in 0..count {
            for j in 0..i {
                let (a, b) = (points.row(i), points.row(j));
                let squared: f64 = (0..self.dims).map(|d| ((a[d] - b[d]) * self.inverse_scales[d]).powi(2)).sum();
                let row = |i: usize, which: usize| &whitened[(2 * i + which) * stride..][..stride];
                let value = self.kernel.covariance(squared, self.hyperparameters.signal_variance)
                    - dot(row(i, 0), row(j, 0))
                    + dot(row(i, 1), row(j, 1));
                (covariance[i * count + j], covariance[j * count + i]) = (value, value);
            }
        }
        Ok(JointPrediction { mean, covariance })
    }

    /// Predicts each training point from the others, without refitting anything. In a model with noise λ,
    ///
    /// ```text
    /// y − μ₋ = (y − μ) / (1 − h/λ),   σ²₋ = λ + (k − q) + h / (1 − h/λ)
    /// ```
    ///
    /// where h is the posterior variance of what the inducing inputs tell of the point, q its prior variance; with
    /// the points themselves as inducing inputs these are the equations of the exact process.
    ///
    /// # Arguments
    ///
    /// - `points`, `y` – what it was conditioned on.
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict).
    pub fn leave_one_out(&self, points: Points<'_>, y: &[f64]) -> Result<LeaveOneOut> {
        let Hyperparameters { signal_variance, noise_variance, .. } = self.hyperparameters;
        let (mut residuals, mut variances) = (Vec::with_capacity(y.len()), Vec::with_capacity(y.len()));
        let mut buffer = vec![0.0; self.stride + self.dims];
        for (x, y) in points.rows().zip(y) {
            let (mean, explained, returned) = self.parts(x, &mut buffer)?;
            let unexplained = (signal_variance - explained).max(0.0);
            let (noise, beside) = match self.method {
                SparseMethod::Vfe => (noise_variance, unexplained),
                SparseMethod::Fitc => (noise_variance + unexplained, 0.0),
            };
            let left = (1.0 - returned / noise).max(f64::EPSILON);
            residuals.push((y - mean - self.offset) / left);
            variances.push(noise + beside + returned / left);
        }
        Ok(LeaveOneOut { residuals, variances })
    }

    /// The same model with a report of how its parameters were found.
    pub(crate) fn with_report(self, report: Option<FitReport>) -> Self {
        Self { report, ..self }
    }

    /// Predicts at each row of `points`.
    ///
    /// # Errors
    ///
    /// As [`Gp::predict_batch`](crate::Gp::predict_batch).
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
        let buffer = scratch.take(self.stride + self.dims);
        for (i, x) in points.rows().enumerate() {
            let at = self.moments(x, buffer).map_err(|error| at_row(error, i))?;
            (mean[i], latent_variance[i]) = (at.mean, at.latent_variance);
        }
        Ok(())
    }

    /// Draws the latent function or an observation at one input.
    ///
    /// # Errors
    ///
    /// As [`predict`](Self::predict).
    pub fn sample<R: Rng + ?Sized>(&self, x: &[f64], draw: Draw, rng: &mut R) -> Result<f64> {
        let at = self.predict(x)?;
        let noise = match draw {
            Draw::Latent => 0.0,
            Draw::Observation => self.hyperparameters.noise_variance,
        };
        let normal: f64 = StandardNormal.sample(rng);
        Ok(at.mean + (at.latent_variance + noise).sqrt() * normal)
    }

    fn moments(&self, x: &[f64], buffer: &mut [f64]) -> Result<Prediction> {
        let (mean, explained, returned) = self.parts(x, buffer)?;
        let variance = self.hyperparameters.signal_variance - explained + returned;
        // As in exact regression: rounding becomes zero, anything worse is refused.
        if !(variance >= -VARIANCE_ROUND_OFF * self.hyperparameters.signal_variance) || variance.is_infinite() {
            return Err(GpError::Variance { row: 0, variance });
        }
        Ok(Prediction { mean: mean + self.offset, latent_variance: variance.max(0.0) })
    }

    /// Mean without the offset, and what the inducing inputs take from the variance and give back to it.
    fn parts(&self, x: &[f64], buffer: &mut [f64]) -> Result<(f64, f64, f64)> {
        check_len("length of x", self.dims, x.len())?;
        check_finite("x", x, self.dims)?;
        let (k, z) = buffer.split_at_mut(self.stride);
        for d in 0..self.dims {
            z[d] = ((x[d] - self.centre[d]) * self.inverse_scales[d]).clamp(-FAR, FAR);
        }
        let z = &z[..self.dims];
        Ok(with_profile!(self.kernel, profile => {
            self.arch.dispatch(Moments { profile, gp: self, z, k })
        }))
    }

    /// Covariance function.
    #[must_use]
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Approximation.
    #[must_use]
    pub fn method(&self) -> SparseMethod {
        self.method
    }

    /// Hyperparameters in the user's units.
    #[must_use]
    pub fn hyperparameters(&self) -> &Hyperparameters {
        &self.hyperparameters
    }

    /// Inducing inputs in the user's units, row-major, shape `(M, D)`.
    #[must_use]
    pub fn inducing(&self) -> &[f64] {
        &self.inducing
    }

    /// Lower bound of the log marginal likelihood (VFE) or the log marginal likelihood of the
    /// approximate model (FITC), in nats.
    #[must_use]
    pub fn bound(&self) -> f64 {
        self.bound
    }

    /// Number of training points `N`.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points
    }

    /// Always false: a model has at least one point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points == 0
    }

    /// Number of input dimensions `D`.
    #[must_use]
    pub fn dims(&self) -> usize {
        self.dims
    }

    /// Bytes that the fit worked in, `O(N M)`; freed since.
    #[must_use]
    pub fn fit_bytes(&self) -> usize {
        self.bytes
    }

    /// How the parameters were found; `None` if they were given.
    #[must_use]
    pub fn report(&self) -> Option<&FitReport> {
        self.report.as_ref()
    }
}

/// Largest negative latent variance, relative to the prior variance, that is put down to rounding.
const VARIANCE_ROUND_OFF: f64 = 1e-7;

/// Requires room for two matrices of `N × M` and six of `M × M`.
fn check_memory(points: usize, inducing: usize) -> Result<()> {
    let (n, m) = (points as f64, inducing as f64);
    room_for(points, 2.0 * n * m + 6.0 * m * m)
}

/// Row-major inputs, centred and in spreads.
fn in_frame(x: &[f64], frame: &Frame) -> Vec<f64> {
    let dims = frame.centre.len();
    x.iter().enumerate().map(|(i, x)| (x - frame.centre[i % dims]) / frame.spread_or_one(i % dims)).collect()
}

/// Mean, and the two parts of the variance, at a scaled input.
struct Moments<'a, P> {
    profile: P,
    gp: &'a SparseGp,
    z: &'a [f64],
    k: &'a mut [f64],
}

impl<P: Profile> WithSimd for Moments<'_, P> {
    type Output = (f64, f64, f64);
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { profile, gp, z, k } = self;
        let signal_variance = gp.hyperparameters.signal_variance;
        let (stride, points, weights) = (gp.stride, &gp.z[..], &gp.alpha[..]);
        let mean = CrossCovariance { profile, signal_variance, stride, points, weights, z, k }.with_simd(simd);
        let [prior, posterior] = &gp.factors;
        let explained = NormSquared { factor: prior, k }.with_simd(simd);
        let returned = NormSquared { factor: posterior, k }.with_simd(simd);
        (mean, explained, returned)
    }
}
