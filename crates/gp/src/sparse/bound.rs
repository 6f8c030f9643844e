//! Evidence of a sparse approximation, and its gradient by hyperparameters and inducing inputs.
//!
//! With inducing inputs `Z` (`M × D`), `L Lᵀ = K_uu`, `A = L⁻¹ K_uf`, `B = I + A W Aᵀ`, `b = A W y`
//! and `W = diag(1/Λᵢ)`,
//!
//! ```text
//! F = −½ N log 2π − ½ Σ log Λᵢ − ½ log|B| − ½ yᵀ W y + ½ bᵀ B⁻¹ b − ½ Σ tᵢ / σₙ²   (VFE only: last term)
//! VFE:  Λᵢ = σₙ²              [T09, eq. (9)], a lower bound of the log marginal likelihood
//! FITC: Λᵢ = σₙ² + tᵢ         [SG06, eq. (8)], the likelihood of another model
//! tᵢ = σ_f² − |aᵢ|²
//! ```
//!
//! With `β = B⁻¹ b`, `r = y − Aᵀ β`, `λᵢ = ∂F/∂Λᵢ = ½ (aᵢᵀ B⁻¹ aᵢ + rᵢ² − Λᵢ) / Λᵢ²`,
//!
//! ```text
//! ∂F/∂A    = −B⁻¹ A W + β (W r)ᵀ + A E,   Eᵢ = 1/σₙ² (VFE) or −2 λᵢ (FITC)
//! Γ        = (∂F/∂A) Aᵀ = −(I − B⁻¹) + β βᵀ + A E Aᵀ, symmetric
//! ∂F/∂K_uf = L⁻ᵀ ∂F/∂A,   ∂F/∂K_uu = −½ L⁻ᵀ Γ L⁻¹
//! ```
//!
//! `K_uu` has 10⁻⁶ σ_f² on its diagonal: the inducing variables are values of the function blurred
//! by that much, for which the bound holds as well.
//!
//! \[T09\] M. K. Titsias, *Variational learning of inducing variables in sparse Gaussian processes*,
//! AISTATS 2009. \[SG06\] E. Snelson and Z. Ghahramani, *Sparse Gaussian processes using
//! pseudo-inputs*, NIPS 18, 2006.

use pulp::Arch;

use super::SparseMethod;
use super::cross::{Cross, CrossGradient, CrossSums};
use crate::aligned::Aligned;
use crate::dense::{
    BackwardSolve, DenseScratch, ForwardSolve, add_outer, add_product_transposed, cholesky, inverse_from_factor,
    mirror, product, solve_lower, triangular_inverse,
};
use crate::evidence::{Fill, LOG_2_PI};
use crate::gp::dot;
use crate::hyper::Hyperparameters;
use crate::kernel::{Kernel, with_profile};
use crate::vector::padded;

/// Blur of the inducing variables, in signal variances.
const JITTER: f64 = 1e-6;
/// Points handled together: 512 columns of 100 inducing variables fit in a second-level cache.
const CHUNK: usize = 512;

/// Data of a sparse regression and the memory to evaluate its evidence again and again.
pub(crate) struct Bound {
    arch: Arch,
    kernel: Kernel,
    method: SparseMethod,
    n: usize,
    m: usize,
    dims: usize,
    /// `m` padded.
    stride: usize,
    /// Inputs in the frame (centred, in spreads), row-major.
    x: Vec<f64>,
    y: Vec<f64>,
    /// Inducing inputs in length scales, one padded row a dimension.
    z: Aligned,
    /// Slopes of `K_uf`, a column a point.
    slopes: Aligned,
    /// `A`, a column a point.
    a: Aligned,
    /// Slopes of `K_uu`.
    slopes_uu: Aligned,
    /// `L`.
    pub(crate) factor: Aligned,
    /// `A W Aᵀ`, lower triangle.
    outer: Aligned,
    /// `L_B`.
    pub(crate) factor_b: Aligned,
    /// `β`.
    pub(crate) beta: Aligned,
    /// `Λ`.
    lambda: Vec<f64>,
    trace: f64,
    scales: Vec<f64>,
    signal_variance: f64,
    noise_variance: f64,
    work: [Aligned; 4],
    scratch: DenseScratch,
}

impl Bound {
    /// Evidence of `y` at row-major inputs `x` in the frame, with `m` inducing inputs.
    pub(crate) fn new(kernel: Kernel, method: SparseMethod, x: Vec<f64>, dims: usize, y: Vec<f64>, m: usize) -> Self {
        let (n, stride) = (y.len(), padded(m));
        let square = || Aligned::zeros(stride * stride.max(CHUNK.min(n)));
        Self {
            arch: Arch::new(),
            kernel,
            method,
            n,
            m,
            dims,
            stride,
            x,
            y,
            z: Aligned::zeros(dims * stride),
            slopes: Aligned::zeros(stride * n),
            a: Aligned::zeros(stride * n),
            slopes_uu: Aligned::zeros(stride * stride),
            factor: Aligned::zeros(stride * stride),
            outer: Aligned::zeros(stride * stride),
            factor_b: Aligned::zeros(stride * stride),
            beta: Aligned::zeros(stride),
            lambda: vec![0.0; n],
            trace: 0.0,
            scales: vec![1.0; dims],
            signal_variance: 1.0,
            noise_variance: 1.0,
            work: [square(), square(), square(), square()],
            scratch: DenseScratch::new(m),
        }
    }

    /// Number of points `N`.
    pub(crate) fn points(&self) -> usize {
        self.n
    }

    pub(crate) fn kernel(&self) -> Kernel {
        self.kernel
    }

    pub(crate) fn method(&self) -> SparseMethod {
        self.method
    }

    /// Bytes held, most of them the two `M × N` matrices.
    pub(crate) fn bytes(&self) -> usize {
        let work: usize = self.work.iter().map(|w| w.len()).sum();
        let square = self.slopes_uu.len() + self.factor.len() + self.factor_b.len();
        let vectors = self.x.len() + self.y.len() + self.lambda.len();
        size_of::<f64>() * (self.slopes.len() + self.a.len() + work + square + vectors)
    }

    /// `F`; `scales` are length scales in the frame, `inducing` row-major in the frame.
    /// `None` if a matrix is not positive definite.
    pub(crate) fn value(&mut self, h: &Hyperparameters, scales: &[f64], inducing: &[f64]) -> Option<f64> {
        let (n, m, stride) = (self.n, self.m, self.stride);
        self.scales.copy_from_slice(scales);
        (self.signal_variance, self.noise_variance) = (h.signal_variance, h.noise_variance);
        let noise = h.noise_variance;
        for (i, row) in inducing.chunks_exact(self.dims).enumerate() {
            for d in 0..self.dims {
                self.z[d * stride + i] = row[d] / scales[d];
            }
        }
        with_profile!(self.kernel, profile => self.arch.dispatch(Fill {
            profile,
            z: &self.z,
            n: m,
            stride,
            signal_variance: h.signal_variance,
            noise_variance: JITTER * h.signal_variance,
            covariance: &mut self.factor,
            slopes: &mut self.slopes_uu,
        }));
        cholesky(&mut self.factor, m, stride, &mut self.scratch).ok()?;

        let b = &mut self.factor_b;
        b.fill(0.0);
        self.beta.fill(0.0);
        self.trace = 0.0;
        let (mut log_lambda, mut fit) = (0.0, 0.0);
        for first in (0..n).step_by(CHUNK) {
            let last = (first + CHUNK).min(n);
            let range = first * stride..last * stride;
            let a = &mut self.a[range.clone()];
            with_profile!(self.kernel, profile => self.arch.dispatch(Cross {
                profile,
                signal_variance: h.signal_variance,
                z: &self.z,
                m,
                stride,
                x: &self.x[first * self.dims..last * self.dims],
                scales,
                covariance: a,
                slopes: &mut self.slopes[range],
            }));
            solve_lower(&self.factor, a, m, stride, last - first);
            let weighted = &mut self.work[0][..(last - first) * stride];
            for (i, (a, weighted)) in a.chunks_exact(stride).zip(weighted.chunks_exact_mut(stride)).enumerate() {
                let y = self.y[first + i];
                let rest = h.signal_variance - dot(a, a);
                self.trace += rest;
                let lambda = match self.method {
                    SparseMethod::Vfe => noise,
                    SparseMethod::Fitc => noise + rest.max(0.0),
                };
                self.lambda[first + i] = lambda;
                log_lambda += lambda.ln();
                fit += y * y / lambda;
                let (root, target) = (1.0 / lambda.sqrt(), y / lambda);
                for ((weighted, beta), a) in weighted.iter_mut().zip(self.beta.iter_mut()).zip(a) {
                    *weighted = root * a;
                    *beta += target * a;
                }
            }
            add_outer(b, weighted, m, stride, last - first);
        }
        self.outer.copy_from_slice(b);
        for i in 0..m {
            b[i * stride + i] += 1.0;
        }
        cholesky(b, m, stride, &mut self.scratch).ok()?;
        let half_log_det: f64 = (0..m).map(|i| b[i * stride + i].ln()).sum();
        self.arch.dispatch(ForwardSolve { factor: b, n: m, stride, b: &mut self.beta });
        let explained = dot(&self.beta, &self.beta);
        self.arch.dispatch(BackwardSolve { factor: b, n: m, stride, b: &mut self.beta });
        let penalty = match self.method {
            SparseMethod::Vfe => 0.5 * self.trace / noise,
            SparseMethod::Fitc => 0.0,
        };
        let value =
            -0.5 * n as f64 * LOG_2_PI - 0.5 * log_lambda - half_log_det - 0.5 * fit + 0.5 * explained - penalty;
        value.is_finite().then_some(value)
    }

    /// Gradient of the last [`value`](Self::value) by `(log σ_f², log σₙ², log ℓ…)` and by the
    /// inducing inputs, row-major in the frame.
    pub(crate) fn gradient(&mut self, gradient: &mut [f64]) {
        let (m, stride, dims, noise) = (self.m, self.stride, self.dims, self.noise_variance);
        let vfe = self.method == SparseMethod::Vfe;
        let [_, inverse_b, left, _] = &mut self.work;

        // B⁻¹ and L⁻¹
        inverse_from_factor(&self.factor_b, inverse_b, m, stride, &mut self.scratch);
        mirror(inverse_b, m, stride);
        let mut inverse = Aligned::zeros(stride * stride);
        triangular_inverse(&self.factor, &mut inverse, m, stride);
        let transposed = transpose(&inverse, m, stride);

        // Γ without A E Aᵀ; `left` = L⁻ᵀ(E-part − B⁻¹)
        let mut adjoint = Aligned::zeros(stride * stride);
        let mut middle = Aligned::zeros(stride * stride);
        for j in 0..m {
            for i in 0..m {
                let at = j * stride + i;
                let identity = if i == j { 1.0 } else { 0.0 };
                adjoint[at] = inverse_b[at] - identity + self.beta[i] * self.beta[j];
                middle[at] = if vfe { identity - inverse_b[at] } else { -inverse_b[at] };
            }
        }
        product(left, &transposed, &middle, m, stride, m, false);
        let (sums, by_lambda, energy) = self.over_points(&transposed);
        for (adjoint, energy) in adjoint.iter_mut().zip(energy.iter()) {
            *adjoint += energy;
        }
        let trace_adjoint: f64 = (0..m).map(|i| adjoint[i * stride + i]).sum();

        // ∂F/∂K_uu = −½ L⁻ᵀ Γ L⁻¹
        let [_, _, left, by_uu] = &mut self.work;
        product(left, &transposed, &adjoint, m, stride, m, false);
        product(by_uu, left, &inverse, m, stride, m, false);

        let (direct, by_noise) = if vfe {
            (-0.5 * self.n as f64 / noise, by_lambda + 0.5 * self.trace / (noise * noise))
        } else {
            (by_lambda, by_lambda)
        };
        gradient[0] = 0.5 * trace_adjoint + self.signal_variance * direct;
        gradient[1] = noise * by_noise;
        gradient[2..].fill(0.0);
        let (by_scales, by_inducing) = gradient[2..].split_at_mut(dims);
        for d in 0..dims {
            by_scales[d] = self.by_dimension(d, &sums, by_inducing);
        }
    }

    /// What the points contribute, chunk by chunk: sums for `K_uf`, `Σ λᵢ`, and `A E Aᵀ`.
    fn over_points(&mut self, transposed: &Aligned) -> (CrossSums, f64, Aligned) {
        let (n, m, stride, dims) = (self.n, self.m, self.stride, self.dims);
        let noise = self.noise_variance;
        let vfe = self.method == SparseMethod::Vfe;
        let [work, inverse_b, left, right] = &mut self.work;
        let mut weights = self.beta.clone();
        self.arch.dispatch(BackwardSolve { factor: &self.factor, n: m, stride, b: &mut weights });
        let mut sums = CrossSums::new(stride, dims);
        let (mut by_lambda, mut energy) = (0.0, Aligned::zeros(stride * stride));
        let mut residuals = vec![0.0; CHUNK];
        for first in (0..n).step_by(CHUNK) {
            let last = (first + CHUNK).min(n);
            let columns = last - first;
            let range = first * stride..last * stride;
            let a = &self.a[range.clone()];
            // FITC needs aᵀ B⁻¹ a point by point; VFE only its sum, which B knows.
            if !vfe {
                product(work, inverse_b, a, m, stride, columns, false);
            }
            for i in 0..columns {
                let column = &a[i * stride..(i + 1) * stride];
                let lambda = self.lambda[first + i];
                let residual = self.y[first + i] - dot(column, &self.beta);
                residuals[i] = residual / lambda;
                let spread = if vfe { 0.0 } else { dot(column, &work[i * stride..(i + 1) * stride]) };
                let slope = 0.5 * (spread + residual * residual - lambda) / (lambda * lambda);
                by_lambda += slope;
                let scale = if vfe { 1.0 / noise } else { 1.0 / lambda };
                for (r, a) in right[i * stride..(i + 1) * stride].iter_mut().zip(column) {
                    *r = scale * a;
                }
                if !vfe {
                    // A E, kept for the second product.
                    for (w, a) in work[i * stride..(i + 1) * stride].iter_mut().zip(column) {
                        *w = -2.0 * slope * a;
                    }
                }
            }
            let mut by_cross = Aligned::zeros(stride * columns);
            product(&mut by_cross, left, right, m, stride, columns, false);
            if !vfe {
                product(&mut by_cross, transposed, work, m, stride, columns, true);
                add_product_transposed(&mut energy, work, a, m, stride, columns);
            }
            self.arch.dispatch(CrossGradient {
                stride,
                dims,
                by_cross: &by_cross,
                slopes: &self.slopes[range],
                weights: &weights,
                residuals: &residuals[..columns],
                x: &self.x[first * dims..last * dims],
                scales: &self.scales,
                sums: &mut sums,
            });
        }
        if vfe {
            // A E Aᵀ = A W Aᵀ, and Σ aᵀB⁻¹a = σₙ² tr(I − B⁻¹).
            energy.copy_from_slice(&self.outer);
            mirror(&mut energy, m, stride);
            for i in 0..m {
                by_lambda += 0.5 * (1.0 - inverse_b[i * stride + i]) / noise;
            }
        }
        (sums, by_lambda, energy)
    }

    /// Gradient by one logarithmic length scale, and by that coordinate of the inducing inputs.
    fn by_dimension(&self, d: usize, sums: &CrossSums, by_inducing: &mut [f64]) -> f64 {
        let (m, stride, by_uu) = (self.m, self.stride, &self.work[3]);
        let z = &self.z[d * stride..(d + 1) * stride];
        let first_moment = &sums.first[d * stride..(d + 1) * stride];
        let mut total = sums.second[d];
        for i in 0..m {
            let (q, s) = (sums.zeroth[i], first_moment[i]);
            total += z[i] * (z[i] * q - 2.0 * s);
            let mut by_z = s - z[i] * q;
            for j in 0..m {
                let weight = -0.5 * by_uu[j * stride + i] * symmetric(&self.slopes_uu, i, j, stride);
                let difference = z[i] - z[j];
                total += weight * difference * difference;
                by_z -= 2.0 * weight * difference;
            }
            by_inducing[i * self.dims + d] = by_z / self.scales[d];
        }
        total
    }
}

/// Entry `(i, j)` of a symmetric matrix of which only the part below the diagonal is stored, and
/// zero on it.
fn symmetric(lower: &[f64], i: usize, j: usize, stride: usize) -> f64 {
    match i.cmp(&j) {
        std::cmp::Ordering::Greater => lower[j * stride + i],
        std::cmp::Ordering::Less => lower[i * stride + j],
        std::cmp::Ordering::Equal => 0.0,
    }
}

fn transpose(lower: &[f64], m: usize, stride: usize) -> Aligned {
    let mut upper = Aligned::zeros(stride * stride);
    for j in 0..m {
        for i in j..m {
            upper[i * stride + j] = lower[j * stride + i];
        }
    }
    upper
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences with a step of 1e-5: rounding of F, about 1e-12, over the step.
    const DIFFERENCE_TOLERANCE: f64 = 2e-6;

    #[test]
    fn gradient_agrees_with_central_differences() {
        let (n, m, dims) = (60, 7, 2);
        let x: Vec<f64> = (0..n * dims).map(|i| 1.5 * ((i * i * 5 + i) as f64).sin()).collect();
        let y: Vec<f64> = x.chunks_exact(dims).map(|x| (2.0 * x[0]).sin() + 0.3 * x[1]).collect();
        let inducing: Vec<f64> = (0..m * dims).map(|i| 1.4 * (i as f64 * 2.7).cos()).collect();
        for kernel in [Kernel::SquaredExponential, Kernel::Matern32, Kernel::Matern52] {
            for method in [SparseMethod::Vfe, SparseMethod::Fitc] {
                let mut bound = Bound::new(kernel, method, x.clone(), dims, y.clone(), m);
                let mut theta = vec![0.2, -2.0, -0.3, 0.1];
                theta.extend(&inducing);
                let mut value = |theta: &[f64]| {
                    let h = Hyperparameters::from_log(&theta[..2 + dims]);
                    let scales = h.length_scales.clone();
                    bound.value(&h, &scales, &theta[2 + dims..]).unwrap()
                };
                let mut expected = vec![0.0; theta.len()];
                for p in 0..theta.len() {
                    let mut moved = theta.clone();
                    moved[p] += 1e-5;
                    let above = value(&moved);
                    moved[p] -= 2e-5;
                    expected[p] = (above - value(&moved)) / 2e-5;
                }
                value(&theta);
                let mut gradient = vec![0.0; theta.len()];
                bound.gradient(&mut gradient);
                for (p, (found, expected)) in gradient.iter().zip(&expected).enumerate() {
                    assert!(
                        (found - expected).abs() < DIFFERENCE_TOLERANCE * (1.0 + expected.abs()),
                        "{kernel:?} {method:?} parameter {p}: {found} {expected}"
                    );
                }
            }
        }
    }
}
