//! Several outputs of one kernel that is a straight line plus a smooth rest, over two groups of inputs.
//!
//! ```text
//! k(z, z') = 1 + a² x·x' + b² u·u' + s² exp(−½ |x − x'|²/ℓ_x² − ½ |u − u'|²/ℓ_u²)
//! ```
//!
//! with `z = (x, u)`, and noise of standard deviation `σ` on every target. Where there are few points the answer is a
//! plane with slopes that are shrunk, and the bend comes with the data. Six parameters an output, found as the mode of
//! the evidence times log-normal priors \[RW06, eq. (5.8)\]. Inputs and targets are the caller's to bring to order one.

mod products;

use pulp::Arch;
use serde::{Deserialize, Serialize};

use crate::aligned::Aligned;
use crate::dense::{DenseScratch, cholesky, inverse_from_factor, triangular_inverse};
use crate::error::{GpError, Result, check_len};
use crate::optimize::{Limits, Objective, minimize};
use crate::panels::{InverseFactor, NormSquared};
use crate::points::Points;
use crate::vector::padded;
use products::{Bent, Dot, Gram, Seen};

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
mod tests;
