//! The mean function: nothing, a constant, or a plane, with its coefficients integrated out.

use serde::{Deserialize, Serialize};

/// The prior mean of the process.
///
/// The coefficients `β` of a constant or linear mean have a vague (improper, flat) prior and are
/// integrated out \[RW06, sec. 2.7\]. So their estimate is that of generalised least squares, the
/// predictive variance includes their uncertainty, and the log marginal likelihood is that of
/// \[RW06, eq. (2.45)\], which is not comparable with one of another mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Mean {
    /// `m(x) = 0`, as in \[MA09, eq. (9)\].
    #[default]
    Zero,
    /// `m(x) = β₀`.
    Constant,
    /// `m(x) = β₀ + Σ_d β_d x_d`.
    Linear,
}

impl Mean {
    /// Number of coefficients for `dims` inputs: 0, 1 or `1 + D`.
    #[must_use]
    pub fn coefficients(self, dims: usize) -> usize {
        match self {
            Self::Zero => 0,
            Self::Constant => 1,
            Self::Linear => 1 + dims,
        }
    }
}

/// So many length scales away there is nothing but the prior, and squares are still finite.
pub(crate) const FAR: f64 = 1e150;

/// Numbers that differ by less than this share of their size differ by rounding: `0.1 + 0.2` and `0.3`.
const ROUNDING: f64 = 1e-12;

/// Mean and standard deviation of some numbers; no deviation if they are equal to rounding.
fn centre_and_spread<'v, I: Iterator<Item = &'v f64>>(values: &dyn Fn() -> I) -> (f64, f64) {
    let first = values().next().copied().unwrap_or(0.0);
    let count = values().count() as f64;
    // About the first entry: equal numbers have exactly no spread.
    let mean = first + values().map(|v| (v - first) / count).sum::<f64>();
    let scale = values().fold(0.0_f64, |m, v| m.max((v - mean).abs()));
    let size = values().fold(0.0_f64, |m, v| m.max(v.abs()));
    if scale <= ROUNDING * size {
        return (mean, 0.0);
    }
    let squares: f64 = values().map(|v| ((v - mean) / scale).powi(2)).sum();
    (mean, scale * (squares / count).sqrt())
}

/// Standard deviation of some numbers; exactly zero if they are equal to rounding, within 10⁻¹² of their size.
///
/// # Example
///
/// ```
/// use stridemap_gp::spread;
///
/// assert_eq!(spread(&[1.0, 3.0]), 1.0);
/// assert_eq!(spread(&[0.3, 0.1 + 0.2, 0.3]), 0.0);
/// ```
#[must_use]
pub fn spread(values: &[f64]) -> f64 {
    centre_and_spread(&|| values.iter()).1
}

/// Centre and spread of each input column: the frame in which distances and the linear mean are
/// computed, so that neither a far origin nor unlike units cost digits.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Frame {
    /// Mean of each column.
    pub(crate) centre: Vec<f64>,
    /// Standard deviation of each column, zero for one that is constant to rounding.
    pub(crate) spread: Vec<f64>,
}

impl Frame {
    /// Frame of row-major `x` with `dims` columns.
    pub(crate) fn of(x: &[f64], dims: usize) -> Self {
        let mut centre = vec![0.0; dims];
        let mut spread = vec![0.0; dims];
        for d in 0..dims {
            (centre[d], spread[d]) = centre_and_spread(&|| x.iter().skip(d).step_by(dims));
        }
        Self { centre, spread }
    }

    /// Basis of the linear mean at `x`: 1, then each input centred and in units of its spread.
    pub(crate) fn basis(&self, mean: Mean, x: &[f64], out: &mut [f64]) {
        if mean == Mean::Zero {
            return;
        }
        out[0] = 1.0;
        if mean == Mean::Linear {
            for d in 0..x.len() {
                // The rounding of a constant column is no slope.
                out[1 + d] = if self.spread[d] > 0.0 { (x[d] - self.centre[d]) / self.spread[d] } else { 0.0 };
            }
        }
    }

    /// Input `d` in length scales, given their inverse. Beyond what can be squared all points are equally far.
    pub(crate) fn scaled(&self, d: usize, x: f64, inverse_scale: f64) -> f64 {
        ((x - self.centre[d]) * inverse_scale).clamp(-FAR, FAR)
    }

    pub(crate) fn spread_or_one(&self, d: usize) -> f64 {
        if self.spread[d] > 0.0 { self.spread[d] } else { 1.0 }
    }

    /// `log |det T|` of the change of basis to that in the user's units, `h_user = T h`.
    pub(crate) fn log_det_to_user(&self, mean: Mean) -> f64 {
        match mean {
            Mean::Zero | Mean::Constant => 0.0,
            Mean::Linear => (0..self.spread.len()).map(|d| self.spread_or_one(d).ln()).sum(),
        }
    }

    /// Coefficients in the user's units from those in this frame.
    pub(crate) fn to_user(&self, mean: Mean, beta: &[f64]) -> Vec<f64> {
        let mut user = beta.to_vec();
        if mean == Mean::Linear {
            for d in 0..self.spread.len() {
                user[1 + d] = beta[1 + d] / self.spread_or_one(d);
                user[0] -= user[1 + d] * self.centre[d];
            }
        }
        user
    }
}
