//! Several outputs of one kernel that is a straight line plus a smooth rest, over two groups of inputs.
//!
//! ```text
//! k(z, z') = 1 + a² x·x' + b² u·u' + s² exp(−½ |x − x'|²/ℓ_x² − ½ |u − u'|²/ℓ_u²)
//! ```
//!
//! with `z = (x, u)`, and noise of standard deviation `σ` on every target. Where there are few points the answer is a
//! plane with slopes that are shrunk, and the bend comes with the data. Six parameters an output, found as the mode of
//! the evidence times log-normal priors \[RW06, eq. (5.8)\]. Inputs and targets are the caller's to bring to order one.

use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::aligned::Aligned;
use crate::dense::{DenseScratch, cholesky, inverse_from_factor, triangular_inverse};
use crate::error::{GpError, Result, check_len};
use crate::optimize::{Limits, Objective, minimize};
use crate::panels::{InverseFactor, NormSquared};
use crate::points::Points;
use crate::vector::{exp, padded};

/// Parameters of an output: `a`, `b`, `s`, `ℓ_x`, `ℓ_u`, `σ`.
const PARAMETERS: usize = 6;
/// `0.5 log 2π`.
const HALF_LOG_2_PI: f64 = 0.918_938_533_204_672_7;
/// Added to the diagonal, for repeated inputs.
const JITTER: f64 = 1e-8;

/// What the kernel is made of, and what is believed of its parameters before the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupedOptions {
    /// Inputs of the first group; the others are of the second.
    pub first: usize,
    /// Whether there is a smooth rest beside the plane.
    pub bends: bool,
    /// Medians of the log-normal priors of `a`, `b`, `s`, `ℓ_x`, `ℓ_u`, `σ`.
    pub medians: [f64; PARAMETERS],
    /// Standard deviation of their logarithms.
    pub log_std: f64,
}

/// Independent Gaussian processes over the same inputs, one an output.
#[derive(Clone, Debug)]
pub struct Grouped {
    options: GroupedOptions,
    dims: usize,
    n: usize,
    /// Inputs, one padded row a dimension.
    columns: Aligned,
    stride: usize,
    outputs: Vec<Output>,
    arch: Arch,
    saved: SavedGrouped,
}

/// One output, conditioned on its targets.
#[derive(Clone, Debug)]
struct Output {
    theta: [f64; PARAMETERS],
    /// `K⁻¹ y`, padded.
    alpha: Aligned,
    factor: InverseFactor,
    /// `Σ α` and, per input, the slope of the plane.
    plane: Vec<f64>,
}

/// What brings a [`Grouped`] back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedGrouped {
    options: GroupedOptions,
    dims: usize,
    inputs: Vec<f64>,
    targets: Vec<Vec<f64>>,
    parameters: Vec<[f64; PARAMETERS]>,
}

/// Memory for predictions, and what is known of the points seen from one query.
#[derive(Clone, Debug, Default)]
pub struct GroupedScratch {
    /// Squared distances in either group, `x·x'` and `u·u'`, padded.
    far: [Vec<f64>; 2],
    along: [Vec<f64>; 2],
    bent: Vec<f64>,
    k: Vec<f64>,
}

/// Products of all pairs of points in one group.
struct Gram {
    along: Vec<f64>,
    far: Vec<f64>,
}

/// Squared distances and products between one point and all, group by group.
struct Seen<'a> {
    columns: &'a [f64],
    stride: usize,
    z: &'a [f64],
    along: &'a mut [f64],
    far: &'a mut [f64],
}

impl WithSimd for Seen<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (along, _) = S::as_mut_simd_f64s(self.along);
        let (far, _) = S::as_mut_simd_f64s(self.far);
        let zero = simd.splat_f64s(0.0);
        along.fill(zero);
        far.fill(zero);
        for (row, z) in self.columns.chunks_exact(self.stride).zip(self.z) {
            let (row, _) = S::as_simd_f64s(row);
            let z = simd.splat_f64s(*z);
            for ((along, far), x) in along.iter_mut().zip(far.iter_mut()).zip(row) {
                let d = simd.sub_f64s(*x, z);
                *along = simd.mul_add_e_f64s(*x, z, *along);
                *far = simd.mul_add_e_f64s(d, d, *far);
            }
        }
    }
}

/// `s² exp(−far₀ w₀ − far₁ w₁)` for all points.
struct Bent<'a> {
    far: [&'a [f64]; 2],
    weights: [f64; 2],
    variance: f64,
    out: &'a mut [f64],
}

impl WithSimd for Bent<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (out, _) = S::as_mut_simd_f64s(self.out);
        let (first, _) = S::as_simd_f64s(self.far[0]);
        let (second, _) = S::as_simd_f64s(self.far[1]);
        let [w0, w1] = self.weights.map(|w| simd.splat_f64s(-w));
        let variance = simd.splat_f64s(self.variance);
        for ((out, a), b) in out.iter_mut().zip(first).zip(second) {
            let argument = simd.mul_add_e_f64s(*a, w0, simd.mul_f64s(*b, w1));
            *out = simd.mul_f64s(variance, exp(simd, argument));
        }
    }
}

/// `a · b`, for slices of the same padded length.
struct Dot<'a>(&'a [f64], &'a [f64]);

impl WithSimd for Dot<'_> {
    type Output = f64;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (a, _) = S::as_simd_f64s(self.0);
        let (b, _) = S::as_simd_f64s(self.1);
        let mut sums = [simd.splat_f64s(0.0); 2];
        for (i, (a, b)) in a.iter().zip(b).enumerate() {
            sums[i % 2] = simd.mul_add_e_f64s(*a, *b, sums[i % 2]);
        }
        simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]))
    }
}

impl Gram {
    fn of(columns: &[f64], stride: usize, n: usize, arch: Arch) -> Self {
        let (mut along, mut far) = (vec![0.0; n * stride], vec![0.0; n * stride]);
        let dims = columns.len() / stride;
        for j in 0..n {
            let z: Vec<f64> = (0..dims).map(|d| columns[d * stride + j]).collect();
            let (along, far) = (&mut along[j * stride..(j + 1) * stride], &mut far[j * stride..(j + 1) * stride]);
            arch.dispatch(Seen { columns, stride, z: &z, along, far });
        }
        Self { along, far }
    }
}

/// Minus the log of evidence times prior, as a function of the log parameters.
struct Posterior<'a> {
    options: &'a GroupedOptions,
    grams: &'a [Gram; 2],
    y: &'a [f64],
    n: usize,
    stride: usize,
    arch: Arch,
    dense: DenseScratch,
    bent: Vec<f64>,
    factor: Vec<f64>,
    inverse: Vec<f64>,
    alpha: Vec<f64>,
    theta: [f64; PARAMETERS],
}

impl Posterior<'_> {
    /// Fills `bent` and `factor` with the smooth part and with `K`, whole columns.
    fn covariance(&mut self) {
        let [a, b, s, lx, lu, noise] = self.theta;
        let (n, stride) = (self.n, self.stride);
        let weights = [0.5 / (lx * lx), 0.5 / (lu * lu)];
        for j in 0..n {
            let column = j * stride..(j + 1) * stride;
            let bent = &mut self.bent[column.clone()];
            if self.options.bends {
                let far = [&self.grams[0].far[column.clone()], &self.grams[1].far[column.clone()]];
                self.arch.dispatch(Bent { far, weights, variance: s * s, out: bent });
            }
            let along = [&self.grams[0].along[column.clone()], &self.grams[1].along[column.clone()]];
            for (i, k) in self.factor[column].iter_mut().enumerate() {
                *k = 1.0 + a * a * along[0][i] + b * b * along[1][i] + bent[i];
            }
            self.factor[j * stride + j] += noise * noise + JITTER;
        }
    }
}

impl Objective for Posterior<'_> {
    fn value(&mut self, theta: &[f64]) -> Option<f64> {
        let (n, stride) = (self.n, self.stride);
        for (t, log) in self.theta.iter_mut().zip(theta) {
            *t = log.exp();
        }
        self.covariance();
        cholesky(&mut self.factor, n, stride, &mut self.dense).ok()?;
        inverse_from_factor(&self.factor, &mut self.inverse, n, stride, &mut self.dense);
        crate::dense::mirror(&mut self.inverse, n, stride);
        let mut quadratic = 0.0;
        for j in 0..n {
            let column = &self.inverse[j * stride..j * stride + n];
            self.alpha[j] = column.iter().zip(self.y).map(|(a, b)| a * b).sum();
            quadratic += self.alpha[j] * self.y[j];
        }
        let log_det: f64 = (0..n).map(|i| self.factor[i * stride + i].ln()).sum();
        let prior: f64 = theta
            .iter()
            .zip(self.options.medians)
            .map(|(log, median)| 0.5 * ((log - median.ln()) / self.options.log_std).powi(2))
            .sum();
        Some(0.5 * quadratic + log_det + n as f64 * HALF_LOG_2_PI + prior)
    }

    fn gradient(&mut self, gradient: &mut [f64]) {
        let [a, b, s, lx, lu, noise] = self.theta;
        let (n, stride) = (self.n, self.stride);
        // ½ tr[(K⁻¹ − α αᵀ) ∂K/∂θ], with the sums over pairs of what each ∂K/∂θ is made of.
        let (mut along, mut bent, mut far, mut trace) = ([0.0; 2], 0.0, [0.0; 2], 0.0);
        for j in 0..n {
            let at = j * stride;
            for i in 0..n {
                let w = self.inverse[at + i] - self.alpha[i] * self.alpha[j];
                let e = self.bent[at + i];
                along[0] += w * self.grams[0].along[at + i];
                along[1] += w * self.grams[1].along[at + i];
                bent += w * e;
                far[0] += w * e * self.grams[0].far[at + i];
                far[1] += w * e * self.grams[1].far[at + i];
            }
            trace += self.inverse[at + j] - self.alpha[j] * self.alpha[j];
        }
        let slopes = [
            a * a * along[0],
            b * b * along[1],
            if s > 0.0 { bent } else { 0.0 },
            0.5 * far[0] / (lx * lx),
            0.5 * far[1] / (lu * lu),
            noise * noise * trace,
        ];
        for ((g, slope), (t, median)) in
            gradient.iter_mut().zip(slopes).zip(self.theta.iter().zip(self.options.medians))
        {
            *g = slope + (t / median).ln() / self.options.log_std.powi(2);
        }
    }
}

impl Grouped {
    /// Fits one Gaussian process an output.
    ///
    /// # Arguments
    ///
    /// - `points` – inputs, shape `(N, D)`, of order one; the first `options.first` of a row are the first group.
    /// - `outputs` – slices of `N` targets, of order one.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::Empty`], [`GpError::NotPositiveDefinite`].
    ///
    /// # Cost
    ///
    /// About 40 evaluations of `O(N³)` an output: a millisecond each for 120 points.
    ///
    /// # Example
    ///
    /// A plane with a bend along the second group, from 30 points.
    ///
    /// ```
    /// use stridemap_gp::{Grouped, GroupedOptions, GroupedScratch, Points};
    ///
    /// let rows: Vec<[f64; 2]> = (0..30).map(|i| [(i as f64).sin(), (i as f64 * 1.7).cos()]).collect();
    /// let y: Vec<f64> = rows.iter().map(|[x, u]| 0.5 * x + 0.8 * u + 0.3 * u * u).collect();
    /// let inputs: Vec<f64> = rows.iter().flatten().copied().collect();
    /// let options =
    ///     GroupedOptions { first: 1, bends: true, medians: [0.6, 0.6, 0.5, 3.6, 2.0, 0.4], log_std: 1.0 };
    /// let map = Grouped::fit(Points::new(&inputs, 2)?, &[&y], options)?;
    ///
    /// let mut scratch = GroupedScratch::default();
    /// map.look(&[0.2, -0.4], &mut scratch);
    /// let (mean, variance) = map.predict(0, &mut scratch, &[0.2, -0.4]);
    /// assert!((mean - (0.1 - 0.32 + 0.048)).abs() < 0.03 && variance < 0.01);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn fit(points: Points<'_>, outputs: &[&[f64]], options: GroupedOptions) -> Result<Self> {
        let (n, dims) = (points.len(), points.dims());
        if outputs.is_empty() || n == 0 {
            return Err(GpError::Empty { what: "outputs" });
        }
        for y in outputs {
            check_len("length of y", n, y.len())?;
        }
        let (columns, stride) = columns_of(points.values(), dims);
        let arch = Arch::new();
        let split = options.first * stride;
        let grams = [Gram::of(&columns[..split], stride, n, arch), Gram::of(&columns[split..], stride, n, arch)];
        let mut parameters = Vec::with_capacity(outputs.len());
        for y in outputs {
            parameters.push(search(&options, &grams, y, n, stride, arch)?);
        }
        let inputs = points.values().to_vec();
        let targets = outputs.iter().map(|y| y.to_vec()).collect();
        Self::try_from(SavedGrouped { options, dims, inputs, targets, parameters })
    }

    /// Number of points.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.n
    }

    /// Whether there is no point; there is always one.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Number of outputs.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// `a`, `b`, `s`, `ℓ_x`, `ℓ_u`, `σ` of an output.
    #[must_use]
    pub fn parameters(&self, output: usize) -> &[f64; PARAMETERS] {
        &self.outputs[output].theta
    }

    /// What goes into a file.
    #[must_use]
    pub const fn saved(&self) -> &SavedGrouped {
        &self.saved
    }

    /// Looks at the points from a query: both groups.
    pub fn look(&self, z: &[f64], scratch: &mut GroupedScratch) {
        self.look_at(0, z, scratch);
        self.look_at(1, z, scratch);
    }

    /// The same along one group, 0 or 1, where the other of the query has not changed since.
    pub fn look_at(&self, group: usize, z: &[f64], scratch: &mut GroupedScratch) {
        let split = self.options.first;
        let (columns, z) = match group {
            0 => (&self.columns[..split * self.stride], &z[..split]),
            _ => (&self.columns[split * self.stride..self.dims * self.stride], &z[split..]),
        };
        let (along, far) = (&mut scratch.along[group], &mut scratch.far[group]);
        along.resize(self.stride, 0.0);
        far.resize(self.stride, 0.0);
        self.arch.dispatch(Seen { columns, stride: self.stride, z, along, far });
    }

    fn bend(&self, output: &Output, scratch: &mut GroupedScratch) {
        let [_, _, s, lx, lu, _] = output.theta;
        scratch.bent.resize(self.stride, 0.0);
        let far = [&scratch.far[0][..], &scratch.far[1][..]];
        let weights = [0.5 / (lx * lx), 0.5 / (lu * lu)];
        self.arch.dispatch(Bent { far, weights, variance: s * s, out: &mut scratch.bent });
    }

    /// The mean of an output at the query that was looked from.
    #[must_use]
    pub fn mean(&self, output: usize, scratch: &mut GroupedScratch, z: &[f64]) -> f64 {
        let output = &self.outputs[output];
        let plane = output.plane[0] + output.plane[1..].iter().zip(z).map(|(b, z)| b * z).sum::<f64>();
        if !self.options.bends {
            return plane;
        }
        self.bend(output, scratch);
        plane + self.arch.dispatch(Dot(&scratch.bent, &output.alpha))
    }

    /// Mean and latent variance of an output at the query that was looked from.
    #[must_use]
    pub fn predict(&self, output: usize, scratch: &mut GroupedScratch, z: &[f64]) -> (f64, f64) {
        let mean = self.mean(output, scratch, z);
        let output = &self.outputs[output];
        let [a, b, s, ..] = output.theta;
        let split = self.options.first;
        scratch.k.resize(self.stride, 0.0);
        let along = scratch.along[0].iter().zip(&scratch.along[1]);
        for (k, (x, u)) in scratch.k.iter_mut().zip(along) {
            *k = 1.0 + a * a * x + b * b * u;
        }
        if self.options.bends {
            scratch.k.iter_mut().zip(&scratch.bent).for_each(|(k, bent)| *k += bent);
        }
        scratch.k[self.n..].fill(0.0);
        let square = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
        let smooth = if self.options.bends { s * s } else { 0.0 };
        let prior = 1.0 + a * a * square(&z[..split]) + b * b * square(&z[split..]) + smooth;
        let known = self.arch.dispatch(NormSquared { factor: &output.factor, k: &scratch.k });
        (mean, (prior - known).max(0.0))
    }
}

/// Inputs with one padded row a dimension.
fn columns_of(inputs: &[f64], dims: usize) -> (Aligned, usize) {
    let n = inputs.len() / dims;
    let stride = padded(n);
    let mut columns = Aligned::zeros(dims * stride);
    for (i, row) in inputs.chunks_exact(dims).enumerate() {
        for (d, x) in row.iter().enumerate() {
            columns[d * stride + i] = *x;
        }
    }
    (columns, stride)
}

/// The mode of evidence times prior.
fn search(
    options: &GroupedOptions,
    grams: &[Gram; 2],
    y: &[f64],
    n: usize,
    stride: usize,
    arch: Arch,
) -> Result<[f64; PARAMETERS]> {
    /// Most and least of a parameter, in logarithms about its median.
    const RANGE: f64 = 5.0;
    let square = || vec![0.0; n * stride];
    let mut posterior = Posterior {
        options,
        grams,
        y,
        n,
        stride,
        arch,
        dense: DenseScratch::new(n),
        bent: square(),
        factor: square(),
        inverse: square(),
        alpha: vec![0.0; n],
        theta: [1.0; PARAMETERS],
    };
    let start = options.medians.map(f64::ln);
    let lower: Vec<f64> = start.iter().map(|t| t - RANGE).collect();
    let upper: Vec<f64> = start.iter().map(|t| t + RANGE).collect();
    let limits = Limits { lower: &lower, upper: &upper, max_evaluations: 80, tolerance: 1e-3 };
    let found = minimize(&mut posterior, &start, &limits);
    if !found.value.is_finite() {
        return Err(GpError::NoStartSucceeded { starts: 1, points: n });
    }
    let mut theta = [0.0; PARAMETERS];
    theta.iter_mut().zip(&found.theta).for_each(|(t, log)| *t = log.exp());
    Ok(theta)
}

impl TryFrom<SavedGrouped> for Grouped {
    type Error = GpError;

    /// Conditions on the data with given parameters.
    fn try_from(saved: SavedGrouped) -> Result<Self> {
        let SavedGrouped { options, dims, inputs, targets, parameters } = &saved;
        let dims = *dims;
        let points = Points::new(inputs, dims)?;
        let n = points.len();
        check_len("parameters", targets.len(), parameters.len())?;
        if options.first > dims || n == 0 {
            return Err(GpError::Shape { what: "inputs of the first group", expected: dims, found: options.first });
        }
        let (columns, stride) = columns_of(inputs, dims);
        let arch = Arch::new();
        let split = options.first * stride;
        let grams =
            [Gram::of(&columns[..split], stride, n, arch), Gram::of(&columns[split..dims * stride], stride, n, arch)];
        let square = || vec![0.0; n * stride];
        let mut outputs = Vec::with_capacity(targets.len());
        for (y, theta) in targets.iter().zip(parameters) {
            check_len("length of y", n, y.len())?;
            let mut posterior = Posterior {
                options,
                grams: &grams,
                y,
                n,
                stride,
                arch,
                dense: DenseScratch::new(n),
                bent: square(),
                factor: square(),
                inverse: square(),
                alpha: vec![0.0; n],
                theta: *theta,
            };
            let log: Vec<f64> = theta.iter().map(|t| t.ln()).collect();
            let undefined =
                GpError::NotPositiveDefinite { points: n, row: 0, signal_variance: theta[2], noise_variance: theta[5] };
            posterior.value(&log).filter(|v| v.is_finite()).ok_or(undefined)?;
            let mut inverse = square();
            triangular_inverse(&posterior.factor, &mut inverse, n, stride);
            let mut alpha = Aligned::zeros(stride);
            alpha[..n].copy_from_slice(&posterior.alpha);
            let of_input = |d: usize| -> f64 {
                let row = &columns[d * stride..d * stride + n];
                let slope = if d < options.first { theta[0] } else { theta[1] };
                slope * slope * row.iter().zip(&alpha[..n]).map(|(x, a)| x * a).sum::<f64>()
            };
            let mut plane = vec![alpha[..n].iter().sum::<f64>()];
            plane.extend((0..dims).map(of_input));
            let factor = InverseFactor::from_column_major(&inverse, n, stride);
            outputs.push(Output { theta: *theta, alpha, factor, plane });
        }
        Ok(Self { options: options.clone(), dims, n, columns, stride, outputs, arch, saved })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(n: usize) -> Vec<f64> {
        (0..3 * n).map(|i| ((i * i) as f64 * 0.37).sin() * 1.3).collect()
    }

    fn options(bends: bool) -> GroupedOptions {
        GroupedOptions { first: 2, bends, medians: [0.6, 0.6, 0.5, 3.6, 2.0, 0.4], log_std: 1.0 }
    }

    /// The gradient is that of the value, by central differences.
    #[test]
    fn the_gradient_is_the_slope_of_the_value() {
        let n = 17;
        let inputs = rows(n);
        let (columns, stride) = columns_of(&inputs, 3);
        let arch = Arch::new();
        let grams = [
            Gram::of(&columns[..2 * stride], stride, n, arch),
            Gram::of(&columns[2 * stride..3 * stride], stride, n, arch),
        ];
        let y: Vec<f64> = inputs.chunks(3).map(|r| r[0] - 0.5 * r[2] + (2.0 * r[2]).sin()).collect();
        let options = options(true);
        let square = || vec![0.0; n * stride];
        let mut posterior = Posterior {
            options: &options,
            grams: &grams,
            y: &y,
            n,
            stride,
            arch,
            dense: DenseScratch::new(n),
            bent: square(),
            factor: square(),
            inverse: square(),
            alpha: vec![0.0; n],
            theta: [1.0; PARAMETERS],
        };
        let at = [-0.3, 0.2, -0.4, 0.5, 0.1, -1.0];
        posterior.value(&at).unwrap();
        let mut gradient = [0.0; PARAMETERS];
        posterior.gradient(&mut gradient);
        for p in 0..PARAMETERS {
            let mut value = |step: f64| {
                let mut moved = at;
                moved[p] += step;
                posterior.value(&moved).unwrap()
            };
            let slope = (value(1e-5) - value(-1e-5)) / 2e-5;
            assert!((slope - gradient[p]).abs() < 1e-5 * (1.0 + slope.abs()), "{p}: {slope} {}", gradient[p]);
        }
    }

    /// Against the textbook, in dense algebra of nalgebra's kind by hand: K⁻¹ by the definition of mean and variance at
    /// a training point with tiny noise; a file brings the same numbers back.
    #[test]
    fn predictions_interpolate_are_plain_without_bend_and_come_back_from_a_file() {
        let inputs = rows(25);
        let points = Points::new(&inputs, 3).unwrap();
        let plane: Vec<f64> = inputs.chunks(3).map(|r| 0.2 + 0.7 * r[0] - 0.4 * r[1] + 0.9 * r[2]).collect();
        let bent: Vec<f64> = inputs.chunks(3).map(|r| 0.5 * r[0] * r[2]).collect();
        let mut scratch = GroupedScratch::default();
        for (bends, y) in [(false, &plane), (true, &plane), (true, &bent)] {
            let map = Grouped::fit(points, &[y], options(bends)).unwrap();
            for (row, y) in inputs.chunks(3).zip(y) {
                map.look(row, &mut scratch);
                let (mean, variance) = map.predict(0, &mut scratch, row);
                assert!((mean - y).abs() < 0.05, "{mean} {y}");
                assert!((0.0..0.05).contains(&variance));
            }
            let text = serde_json::to_string(map.saved()).unwrap();
            let back = Grouped::try_from(serde_json::from_str::<SavedGrouped>(&text).unwrap()).unwrap();
            let z = [0.3, -0.2, 0.1];
            back.look(&z, &mut scratch);
            let again = back.predict(0, &mut scratch, &z);
            map.look(&z, &mut scratch);
            assert_eq!(again, map.predict(0, &mut scratch, &z));
        }
    }
}
