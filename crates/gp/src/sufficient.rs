//! How many points, or inducing inputs, are enough: the rule of [MA09, sec. 8.1].
//!
//! "We determined the number of sampled data […] so that the prediction error of the state at the
//! next Poincaré section becomes smaller than a given threshold."

use rand::Rng;

use crate::error::{GpError, Result, check_len, check_positive};
use crate::gp::Gp;
use crate::options::FitOptions;
use crate::points::Points;
use crate::predict::Scratch;
use crate::sparse::{SparseGp, SparseOptions};

/// Whether a threshold was met, and where.
#[derive(Clone, Debug)]
pub enum Sufficient<M> {
    /// The first size whose error is below the threshold.
    Met {
        /// Number of points or inducing inputs.
        size: usize,
        /// Root mean square error of its predictions, in the unit of `y`.
        rmse: f64,
        /// The model of that size.
        model: M,
    },
    /// No size tried was enough.
    NotMet {
        /// The errors found, in order of the sizes tried.
        rmse: Vec<f64>,
    },
}

/// The least number of leading points whose model predicts the rest of the data to `threshold`.
///
/// For each entry of `sizes` in turn a model is fitted to the first so many points, and judged by
/// the root mean square error of its predictions at all points after the largest size.
///
/// # Arguments
///
/// - `points`, `y` – data in the order in which they were collected, shapes `(N, D)` and `(N,)`.
/// - `sizes` – numbers of points to try, growing, the last below `N`.
/// - `threshold` – in the unit of `y`; positive.
///
/// # Errors
///
/// As [`Gp::fit`]; [`GpError::Empty`] without sizes; [`GpError::Shape`] if they do not grow or
/// leave nothing to predict.
///
/// # Example
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use stridemap_gp::{FitOptions, Points, Sufficient, sufficient_points};
///
/// let x: Vec<f64> = (0..60).map(|i| (1.7 * f64::from(i)).sin()).collect();
/// let y: Vec<f64> = x.iter().map(|x| (3.0 * x).sin()).collect();
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// let (points, options) = (Points::new(&x, 1)?, FitOptions::default());
/// let found = sufficient_points(points, &y, &[2, 5, 10, 20, 40], 0.01, &options, &mut rng)?;
/// assert!(matches!(found, Sufficient::Met { size: 5..=20, .. }));
/// # Ok::<(), stridemap_gp::GpError>(())
/// ```
pub fn sufficient_points<R: Rng + ?Sized>(
    points: Points<'_>,
    y: &[f64],
    sizes: &[usize],
    threshold: f64,
    options: &FitOptions,
    rng: &mut R,
) -> Result<Sufficient<Gp>> {
    check_len("length of y", points.len(), y.len())?;
    let largest = check_sizes(sizes, points.len().saturating_sub(1))?;
    let (dims, held_out) = (points.dims(), &y[largest..]);
    let queries = Points::new(&points.values()[largest * dims..], dims)?;
    search(sizes, threshold, |size| {
        let leading = Points::new(&points.values()[..size * dims], dims)?;
        let gp = Gp::fit(leading, &y[..size], options, rng)?;
        let (mut mean, mut variance) = (vec![0.0; held_out.len()], vec![0.0; held_out.len()]);
        gp.predict_batch(queries, &mut mean, &mut variance, &mut Scratch::new())?;
        Ok((rmse(&mean, held_out), gp))
    })
}

/// The least number of inducing inputs with which a sparse model of `points` predicts `held_out` to
/// `threshold`.
///
/// # Arguments
///
/// - `points`, `y` – training data, shapes `(N, D)` and `(N,)`.
/// - `held_out` – inputs and targets to predict, shapes `(Q, D)` and `(Q,)`.
/// - `sizes` – numbers of inducing inputs to try, growing, at most `N`; they replace
///   `options.inducing`.
/// - `threshold` – in the unit of `y`; positive.
///
/// # Errors
///
/// As [`SparseGp::fit`], and as [`sufficient_points`].
pub fn sufficient_inducing<R: Rng + ?Sized>(
    points: Points<'_>,
    y: &[f64],
    held_out: (Points<'_>, &[f64]),
    sizes: &[usize],
    threshold: f64,
    options: &SparseOptions,
    rng: &mut R,
) -> Result<Sufficient<SparseGp>> {
    let (queries, targets) = held_out;
    check_len("length of held-out y", queries.len(), targets.len())?;
    if targets.is_empty() {
        return Err(GpError::Empty { what: "held-out points" });
    }
    check_sizes(sizes, points.len())?;
    search(sizes, threshold, |size| {
        let options = SparseOptions { inducing: size, ..options.clone() };
        let gp = SparseGp::fit(points, y, &options, rng)?;
        let (mut mean, mut variance) = (vec![0.0; targets.len()], vec![0.0; targets.len()]);
        gp.predict_batch(queries, &mut mean, &mut variance, &mut Scratch::new())?;
        Ok((rmse(&mean, targets), gp))
    })
}

/// Requires sizes that grow and end at most at `limit`; the largest.
fn check_sizes(sizes: &[usize], limit: usize) -> Result<usize> {
    let Some(&largest) = sizes.last() else {
        return Err(GpError::Empty { what: "sizes" });
    };
    for pair in sizes.windows(2) {
        if pair[0] >= pair[1] {
            let what = "sizes (growing)";
            return Err(GpError::Shape { what, expected: pair[0] + 1, found: pair[1] });
        }
    }
    if sizes[0] == 0 || largest > limit {
        return Err(GpError::Shape { what: "largest size", expected: limit, found: largest });
    }
    Ok(largest)
}

fn search<M>(sizes: &[usize], threshold: f64, mut fit: impl FnMut(usize) -> Result<(f64, M)>) -> Result<Sufficient<M>> {
    check_positive("threshold", threshold)?;
    let mut errors = Vec::new();
    for &size in sizes {
        let (rmse, model) = fit(size)?;
        if rmse <= threshold {
            return Ok(Sufficient::Met { size, rmse, model });
        }
        errors.push(rmse);
    }
    Ok(Sufficient::NotMet { rmse: errors })
}

fn rmse(mean: &[f64], targets: &[f64]) -> f64 {
    let squares: f64 = mean.iter().zip(targets).map(|(m, y)| (m - y).powi(2)).sum();
    (squares / targets.len() as f64).sqrt()
}
