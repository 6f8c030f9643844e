//! Log marginal likelihood and its gradient in log parameters.
//!
//! With `K = K_f + σₙ² I`, mean basis `H` (`N × m`), `A = Hᵀ K⁻¹ H` and
//! `P = K⁻¹ − K⁻¹ H A⁻¹ Hᵀ K⁻¹`,
//!
//! ```text
//! log p(y) = −½ yᵀ P y − ½ log|K| − ½ log|A| − ½ (N − m) log 2π     [RW06, eqs. (2.30), (2.45)]
//! ∂ log p / ∂θ = ½ tr[((P y)(P y)ᵀ − P) ∂K/∂θ]                        [RW06, eq. (5.9)]
//! ```
//!
//! The parameters are `θ = (log σ_f², log σₙ², log ℓ₁ … log ℓ_D)`. As `tr(P K) = N − m`, the
//! derivatives by the first two need no pass over the matrix.

use pulp::{Arch, Simd, WithSimd};

use crate::aligned::Aligned;
use crate::dense::{
    BackwardSolve, DenseScratch, ForwardSolve, cholesky, inverse_from_factor, small_cholesky, small_forward,
};
use crate::kernel::{Kernel, Profile, with_profile};
use crate::mean::{Frame, Mean};
use crate::vector::{PANEL, padded};

/// `log 2π`.
pub(crate) const LOG_2_PI: f64 = 1.837_877_066_409_345_3;

/// Why an evaluation has no value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NoValue {
    /// `K` is not positive definite; the pivot of this row failed.
    Covariance(usize),
    /// `A` is singular: the mean's coefficients are not determined.
    Mean,
}

/// The data of a regression and the memory to evaluate its evidence again and again.
pub(crate) struct Evidence {
    pub(crate) arch: Arch,
    kernel: Kernel,
    n: usize,
    dims: usize,
    /// Column stride of all matrices and length of all vectors: `n` padded to whole panels.
    stride: usize,
    /// Number of mean coefficients `m`.
    coefficients: usize,
    log_det_basis: f64,
    /// Centred inputs, one padded row a dimension.
    x: Aligned,
    /// Targets, padded.
    y: Aligned,
    /// Mean basis, one padded row a coefficient.
    basis: Aligned,
    /// Inputs in length scales, one padded row a dimension.
    z: Aligned,
    /// Slopes `h` below the diagonal, zero elsewhere.
    slopes: Aligned,
    /// `K`, then its factor `L`.
    pub(crate) factor: Aligned,
    inverse: Aligned,
    /// `L⁻¹ H`, then `K⁻¹ H L_A⁻ᵀ`.
    trend: Aligned,
    small: Vec<f64>,
    /// `P y`.
    alpha: Aligned,
    signal_variance: f64,
    noise_variance: f64,
    quadratic: f64,
    scratch: DenseScratch,
    /// Evaluations of the value and of the gradient so far.
    pub(crate) counts: (usize, usize),
}

impl Evidence {
    /// Evidence of `y` at row-major inputs `x` in `frame`.
    pub(crate) fn new(x: &[f64], dims: usize, y: &[f64], kernel: Kernel, mean: Mean, frame: &Frame) -> Self {
        let n = y.len();
        let stride = padded(n);
        let coefficients = mean.coefficients(dims);
        let mut soa = Aligned::zeros(dims * stride);
        let mut basis = Aligned::zeros(coefficients * stride);
        let mut row_basis = vec![0.0; coefficients];
        for (i, row) in x.chunks_exact(dims).enumerate() {
            for d in 0..dims {
                soa[d * stride + i] = row[d] - frame.centre[d];
            }
            frame.basis(mean, row, &mut row_basis);
            for (b, value) in row_basis.iter().enumerate() {
                basis[b * stride + i] = *value;
            }
        }
        let targets = Aligned::zeros_with(stride, y);
        Self {
            arch: Arch::new(),
            kernel,
            n,
            dims,
            stride,
            coefficients,
            log_det_basis: frame.log_det_to_user(mean),
            z: soa.clone(),
            x: soa,
            y: targets,
            trend: basis.clone(),
            basis,
            slopes: Aligned::zeros(stride * stride),
            factor: Aligned::zeros(stride * stride),
            inverse: Aligned::zeros(stride * stride),
            small: vec![0.0; coefficients * coefficients],
            alpha: Aligned::zeros(stride),
            signal_variance: 0.0,
            noise_variance: 0.0,
            quadratic: 0.0,
            scratch: DenseScratch::new(n),
            counts: (0, 0),
        }
    }

    /// Log marginal likelihood at the given hyperparameters.
    pub(crate) fn value(
        &mut self,
        length_scales: &[f64],
        signal_variance: f64,
        noise_variance: f64,
    ) -> Result<f64, NoValue> {
        let (n, stride, m) = (self.n, self.stride, self.coefficients);
        self.counts.0 += 1;
        self.signal_variance = signal_variance;
        self.noise_variance = noise_variance;
        for d in 0..self.dims {
            let inverse = 1.0 / length_scales[d];
            let row = d * stride..(d + 1) * stride;
            for (z, x) in self.z[row.clone()].iter_mut().zip(&self.x[row]) {
                *z = x * inverse;
            }
        }
        with_profile!(self.kernel, profile => self.arch.dispatch(Fill {
            profile,
            z: &self.z,
            n,
            stride,
            signal_variance,
            noise_variance,
            covariance: &mut self.factor,
            slopes: &mut self.slopes,
        }));
        cholesky(&mut self.factor, n, stride, &mut self.scratch).map_err(NoValue::Covariance)?;

        self.alpha.copy_from_slice(&self.y);
        self.forward_alpha();
        let mut quadratic: f64 = self.alpha[..n].iter().map(|v| v * v).sum();
        let half_log_det: f64 = (0..n).map(|i| self.factor[i * stride + i].ln()).sum();
        let mut log_det_a = 0.0;
        if m > 0 {
            let reduced = self.fold_in_trend()?;
            quadratic -= reduced;
            log_det_a = 2.0 * (0..m).map(|b| self.small[b * m + b].ln()).sum::<f64>() + 2.0 * self.log_det_basis;
        }
        self.quadratic = quadratic;
        Ok(-0.5 * quadratic - half_log_det - 0.5 * log_det_a - 0.5 * (n as f64 - m as f64) * LOG_2_PI)
    }

    fn forward_alpha(&mut self) {
        self.arch.dispatch(ForwardSolve { factor: &self.factor, n: self.n, stride: self.stride, b: &mut self.alpha });
    }

    /// Turns `trend` into `L⁻¹ H L_A⁻ᵀ`, `small` into `L_A`, takes the trend out of
    /// `alpha = L⁻¹ y`, and returns by how much that lowers `yᵀ K⁻¹ y`.
    fn fold_in_trend(&mut self) -> Result<f64, NoValue> {
        let (n, stride, m) = (self.n, self.stride, self.coefficients);
        self.trend.copy_from_slice(&self.basis);
        for column in self.trend.chunks_exact_mut(stride) {
            self.arch.dispatch(ForwardSolve { factor: &self.factor, n, stride, b: column });
        }
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        for a in 0..m {
            for b in 0..=a {
                let value = dot(&self.trend[a * stride..(a + 1) * stride], &self.trend[b * stride..(b + 1) * stride]);
                self.small[a * m + b] = value;
                self.small[b * m + a] = value;
            }
        }
        if n < m {
            return Err(NoValue::Mean);
        }
        small_cholesky(&mut self.small, m).ok_or(NoValue::Mean)?;
        let mut row = vec![0.0; m];
        for i in 0..n {
            for b in 0..m {
                row[b] = self.trend[b * stride + i];
            }
            small_forward(&self.small, m, &mut row);
            for b in 0..m {
                self.trend[b * stride + i] = row[b];
            }
        }
        let mut reduced = 0.0;
        for b in 0..m {
            let column = &self.trend[b * stride..(b + 1) * stride];
            let along = dot(column, &self.alpha);
            reduced += along * along;
            for (alpha, value) in self.alpha.iter_mut().zip(column) {
                *alpha -= along * value;
            }
        }
        Ok(reduced)
    }

    /// Gradient of the last [`value`](Self::value) by `(log σ_f², log σₙ², log ℓ…)`; spoils the
    /// intermediate results, so one call a value.
    pub(crate) fn gradient(&mut self, gradient: &mut [f64]) {
        let (n, stride, m) = (self.n, self.stride, self.coefficients);
        self.counts.1 += 1;
        self.arch.dispatch(BackwardSolve { factor: &self.factor, n, stride, b: &mut self.alpha });
        for column in self.trend.chunks_exact_mut(stride) {
            self.arch.dispatch(BackwardSolve { factor: &self.factor, n, stride, b: column });
        }
        inverse_from_factor(&self.factor, &mut self.inverse, n, stride, &mut self.scratch);

        let squares = |v: &[f64]| -> f64 { v.iter().map(|v| v * v).sum() };
        let trace_p: f64 = (0..n).map(|i| self.inverse[i * stride + i]).sum::<f64>() - squares(&self.trend);
        let fit = squares(&self.alpha);
        let noise = self.noise_variance;
        gradient[0] = 0.5 * (self.quadratic - noise * fit - (n as f64 - m as f64) + noise * trace_p);
        gradient[1] = 0.5 * noise * (fit - trace_p);
        self.arch.dispatch(LengthScaleGradient {
            z: &self.z,
            n,
            dims: self.dims,
            stride,
            slopes: &self.slopes,
            inverse: &self.inverse,
            alpha: &self.alpha,
            trend: &self.trend,
            out: &mut gradient[2..],
        });
    }
}

/// Fills the lower triangle of `K` and the slopes below its diagonal.
pub(crate) struct Fill<'a, P> {
    pub(crate) profile: P,
    pub(crate) z: &'a [f64],
    pub(crate) n: usize,
    pub(crate) stride: usize,
    pub(crate) signal_variance: f64,
    pub(crate) noise_variance: f64,
    pub(crate) covariance: &'a mut [f64],
    pub(crate) slopes: &'a mut [f64],
}

impl<P: Profile> WithSimd for Fill<'_, P> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { profile, z, n, stride, signal_variance, noise_variance, covariance, slopes } = self;
        let scale = simd.splat_f64s(signal_variance);
        for c in 0..n {
            let from = c / PANEL * PANEL;
            let column = c * stride + from..(c + 1) * stride;
            let (k, _) = S::as_mut_simd_f64s(&mut covariance[column.clone()]);
            let (h, _) = S::as_mut_simd_f64s(&mut slopes[column]);
            for q in k.iter_mut() {
                *q = simd.splat_f64s(0.0);
            }
            for row in z.chunks_exact(stride) {
                let at = simd.splat_f64s(row[c]);
                let (points, _) = S::as_simd_f64s(&row[from..]);
                for (q, &point) in k.iter_mut().zip(points) {
                    let difference = simd.sub_f64s(point, at);
                    *q = simd.mul_add_e_f64s(difference, difference, *q);
                }
            }
            for (k, h) in k.iter_mut().zip(h) {
                let (value, slope) = profile.value_and_slope(simd, *k);
                *k = simd.mul_f64s(value, scale);
                *h = simd.mul_f64s(slope, scale);
            }
            // Zero outside the part that counts, so that whole panels can be summed.
            slopes[c * stride + from..=c * stride + c].fill(0.0);
            slopes[c * stride + n..(c + 1) * stride].fill(0.0);
            covariance[c * stride + n..(c + 1) * stride].fill(0.0);
            covariance[c * stride + c] = signal_variance + noise_variance;
        }
    }
}

/// `½ tr[((P y)(P y)ᵀ − P) ∂K/∂log ℓ_d]` for each `d`: the sum over the lower triangle of
/// `(αᵢ αⱼ − Pᵢⱼ) hᵢⱼ (zᵢ_d − zⱼ_d)²`.
struct LengthScaleGradient<'a> {
    z: &'a [f64],
    n: usize,
    dims: usize,
    stride: usize,
    slopes: &'a [f64],
    inverse: &'a [f64],
    alpha: &'a [f64],
    trend: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for LengthScaleGradient<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // As many dimensions in one pass as there are registers to spare.
        let mut first = 0;
        while first < self.dims {
            let rest = self.dims - first;
            match rest {
                1 => self.pass::<S, 1>(simd, first),
                2 => self.pass::<S, 2>(simd, first),
                3 => self.pass::<S, 3>(simd, first),
                _ => self.pass::<S, 4>(simd, first),
            }
            first += rest.min(4);
        }
    }
}

impl LengthScaleGradient<'_> {
    /// Dimensions `first .. first + WIDTH`.
    #[inline(always)]
    fn pass<S: Simd, const WIDTH: usize>(&mut self, simd: S, first: usize) {
        let stride = self.stride;
        let mut sums = [simd.splat_f64s(0.0); WIDTH];
        for c in 0..self.n {
            let from = c / PANEL * PANEL;
            let column = c * stride + from..(c + 1) * stride;
            let (h, _) = S::as_simd_f64s(&self.slopes[column.clone()]);
            let (inverse, _) = S::as_simd_f64s(&self.inverse[column]);
            let (alpha, _) = S::as_simd_f64s(&self.alpha[from..]);
            let alpha_c = simd.splat_f64s(self.alpha[c]);
            let mut at = [simd.splat_f64s(0.0); WIDTH];
            let mut rows = [h; WIDTH];
            for d in 0..WIDTH {
                let row = &self.z[(first + d) * stride..(first + d + 1) * stride];
                at[d] = simd.splat_f64s(row[c]);
                rows[d] = S::as_simd_f64s(&row[from..]).0;
            }
            for i in 0..h.len() {
                let mut weight = simd.sub_f64s(simd.mul_f64s(alpha[i], alpha_c), inverse[i]);
                for trend in self.trend.chunks_exact(stride) {
                    let (values, _) = S::as_simd_f64s(&trend[from..]);
                    weight = simd.mul_add_e_f64s(values[i], simd.splat_f64s(trend[c]), weight);
                }
                let weight = simd.mul_f64s(weight, h[i]);
                for d in 0..WIDTH {
                    let difference = simd.sub_f64s(rows[d][i], at[d]);
                    let weighted = simd.mul_f64s(difference, weight);
                    sums[d] = simd.mul_add_e_f64s(weighted, difference, sums[d]);
                }
            }
        }
        for (d, sum) in sums.into_iter().enumerate() {
            self.out[first + d] = simd.reduce_sum_f64s(sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences with a step of 1e-5 in log parameters: error of order 1e-10 times the
    /// third derivative, plus rounding of 1e-11.
    const DIFFERENCE_TOLERANCE: f64 = 2e-7;

    fn data(n: usize, dims: usize) -> (Vec<f64>, Vec<f64>) {
        let x: Vec<f64> = (0..n * dims).map(|i| ((i * i * 7 + 3 * i) as f64 * 0.61).sin()).collect();
        let y = x
            .chunks_exact(dims)
            .enumerate()
            .map(|(i, row)| row.iter().sum::<f64>().sin() + 0.1 * (i as f64 * 1.7).cos() + 0.4)
            .collect();
        (x, y)
    }

    #[test]
    fn gradient_agrees_with_central_differences() {
        for kernel in [Kernel::SquaredExponential, Kernel::Matern32, Kernel::Matern52] {
            for mean in [Mean::Zero, Mean::Constant, Mean::Linear] {
                for (n, dims) in [(9, 1), (17, 2), (33, 3), (40, 4), (48, 7)] {
                    let (x, y) = data(n, dims);
                    let frame = Frame::of(&x, dims);
                    let mut evidence = Evidence::new(&x, dims, &y, kernel, mean, &frame);
                    let mut theta: Vec<f64> = (0..dims + 2).map(|p| 0.1 * p as f64 - 0.2).collect();
                    theta[1] = -2.0;
                    let mut value = |theta: &[f64], gradient: Option<&mut [f64]>| {
                        let scales: Vec<f64> = theta[2..].iter().map(|t| t.exp()).collect();
                        let value = evidence.value(&scales, theta[0].exp(), theta[1].exp()).unwrap();
                        if let Some(gradient) = gradient {
                            evidence.gradient(gradient);
                        }
                        value
                    };
                    let mut gradient = vec![0.0; dims + 2];
                    value(&theta, Some(&mut gradient));
                    for p in 0..dims + 2 {
                        let step = 1e-5;
                        let mut moved = theta.clone();
                        moved[p] += step;
                        let above = value(&moved, None);
                        moved[p] -= 2.0 * step;
                        let below = value(&moved, None);
                        let expected = (above - below) / (2.0 * step);
                        assert!(
                            (gradient[p] - expected).abs() < DIFFERENCE_TOLERANCE * (1.0 + expected.abs()),
                            "{kernel:?} {mean:?} n {n} d {dims} p {p}: {} {expected}",
                            gradient[p]
                        );
                    }
                }
            }
        }
    }
}
