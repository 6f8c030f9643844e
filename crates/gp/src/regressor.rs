//! One interface over exact and sparse Gaussian processes.

use std::fmt::Debug;
use std::ops::Deref;

use rand::Rng;
use rand::seq::index;
use serde::{Deserialize, Deserializer, Serialize, de};

use crate::card::Card;
use crate::error::{GpError, Result};
use crate::gp::Gp;
use crate::hyper::Hyperparameters;
use crate::mean::{Frame, Mean};
use crate::options::FitOptions;
use crate::points::Points;
use crate::predict::{Prediction, Scratch};
use crate::sample::JointPrediction;
use crate::scores::LeaveOneOut;
use crate::sparse::{SparseGp, SparseOptions};

/// What a map of strides asks of a Gaussian process.
pub trait Regressor: Debug + Send + Sync {
    /// Number of input dimensions `D`.
    fn dims(&self) -> usize;

    /// Hyperparameters in the user's units.
    fn hyperparameters(&self) -> &Hyperparameters;

    /// Log marginal likelihood, or its lower bound, in nats.
    fn log_marginal_likelihood(&self) -> f64;

    /// Predicts the latent function at one input, in the caller's scratch memory.
    ///
    /// # Errors
    ///
    /// As [`Gp::predict`].
    fn predict_with(&self, x: &[f64], scratch: &mut Scratch) -> Result<Prediction>;

    /// Joint mean and latent covariance at the rows of `points`.
    ///
    /// # Errors
    ///
    /// As [`Gp::predict_joint`].
    fn predict_joint(&self, points: Points<'_>) -> Result<JointPrediction>;

    /// Training targets, shape `(N,)`; empty in a sparse model that was read from a file, which holds no data.
    fn targets(&self) -> &[f64];

    /// What each training point would have been predicted to be from the others.
    ///
    /// # Errors
    ///
    /// As [`Gp::leave_one_out`]; [`GpError::Unsupported`] where the targets are not held.
    fn leave_one_out(&self) -> Result<LeaveOneOut>;

    /// What this model is, how well it predicts, and what to be wary of.
    fn card(&self) -> Card;

    /// [`predict_with`](Self::predict_with) memory of its own.
    ///
    /// # Errors
    ///
    /// As [`Gp::predict`].
    fn predict(&self, x: &[f64]) -> Result<Prediction> {
        self.predict_with(x, &mut Scratch::new())
    }
}

impl Regressor for Gp {
    fn dims(&self) -> usize {
        self.dims()
    }
    fn hyperparameters(&self) -> &Hyperparameters {
        self.hyperparameters()
    }
    fn log_marginal_likelihood(&self) -> f64 {
        self.log_marginal_likelihood()
    }
    fn predict_with(&self, x: &[f64], scratch: &mut Scratch) -> Result<Prediction> {
        self.predict_with(x, scratch)
    }
    fn predict_joint(&self, points: Points<'_>) -> Result<JointPrediction> {
        self.predict_joint(points)
    }
    fn targets(&self) -> &[f64] {
        self.targets()
    }
    fn leave_one_out(&self) -> Result<LeaveOneOut> {
        self.leave_one_out()
    }
    fn card(&self) -> Card {
        self.card()
    }
}

/// Inducing inputs of a [`SparseFit`], where there are as many points.
const INDUCING: usize = 100;
/// Points among which hyperparameters and inducing inputs are searched.
const SEARCHED: usize = 2000;

/// A sparse Gaussian process about a mean that was fitted by least squares before it.
///
/// Hyperparameters and inducing inputs are those of 2,000 points drawn at random, and the model is then conditioned
/// on all. With that many points the mean's own uncertainty is small, and left out.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SparseFit {
    /// Coefficients of the mean, in the user's units: none, `β₀`, or `β₀` and a slope an input.
    plane: Vec<f64>,
    gp: SparseGp,
    card: Card,
    #[serde(skip)]
    targets: Vec<f64>,
    #[serde(skip)]
    leave_one_out: Option<LeaveOneOut>,
}

impl SparseFit {
    /// Fits mean, hyperparameters and inducing inputs, and conditions on the data.
    ///
    /// # Errors
    ///
    /// As [`SparseGp::fit`]; [`GpError::MeanNotIdentifiable`] if the data do not determine the mean.
    ///
    /// # Cost
    ///
    /// That of [`SparseGp::fit`] for 2,000 points, and `O(N M²)`.
    pub fn fit<R: Rng + ?Sized>(points: Points<'_>, y: &[f64], options: &FitOptions, rng: &mut R) -> Result<Self> {
        crate::gp::check_data(points, y)?;
        let (n, dims) = (points.len(), points.dims());
        let plane = plane(points, y, options.mean)?;
        let rest: Vec<f64> = points.rows().zip(y).map(|(x, y)| y - at_plane(&plane, x)).collect();
        let sparse = SparseOptions {
            fit: FitOptions { mean: Mean::Zero, starts: 1, tolerance_nats: 1e-3, ..options.clone() },
            inducing: INDUCING.min(n),
            ..SparseOptions::default()
        };
        let mut gp = if n <= SEARCHED {
            SparseGp::fit(points, &rest, &sparse, rng)?
        } else {
            let mut chosen = index::sample(rng, n, SEARCHED).into_vec();
            chosen.sort_unstable();
            let x: Vec<f64> = chosen.iter().flat_map(|&i| points.row(i).to_vec()).collect();
            let y: Vec<f64> = chosen.iter().map(|&i| rest[i]).collect();
            SparseGp::fit(Points::new(&x, dims)?, &y, &sparse, rng)?
        };
        if n > SEARCHED {
            let (h, report) = (gp.hyperparameters().clone(), gp.report().cloned());
            let inducing = gp.inducing().to_vec();
            let inducing = Points::new(&inducing, dims)?;
            gp = SparseGp::condition(points, &rest, sparse.fit.kernel, sparse.method, h, inducing)?.with_report(report);
        }
        let leave_one_out = gp.leave_one_out(points, &rest)?;
        let card = gp.card(options.mean, &plane, y, &leave_one_out);
        Ok(Self { plane, gp, card, targets: y.to_vec(), leave_one_out: Some(leave_one_out) })
    }
}

/// The value of a mean with these coefficients.
fn at_plane(plane: &[f64], x: &[f64]) -> f64 {
    plane.iter().zip(std::iter::once(&1.0).chain(x)).map(|(b, x)| b * x).sum()
}

/// Least squares of a mean.
fn plane(points: Points<'_>, y: &[f64], mean: Mean) -> Result<Vec<f64>> {
    let (dims, m) = (points.dims(), mean.coefficients(points.dims()));
    let frame = Frame::of(points.values(), dims);
    let (mut gram, mut right, mut row) = (vec![0.0; m * m], vec![0.0; m], vec![0.0; m]);
    for (x, y) in points.rows().zip(y) {
        frame.basis(mean, x, &mut row);
        for a in 0..m {
            right[a] += row[a] * y;
            for b in 0..m {
                gram[a * m + b] += row[a] * row[b];
            }
        }
    }
    // A column that never changes has no slope.
    for a in 0..m {
        if gram[a * m + a] <= 0.0 {
            gram[a * m + a] = 1.0;
        }
    }
    let undetermined = GpError::MeanNotIdentifiable { points: points.len(), coefficients: m };
    crate::dense::small_cholesky(&mut gram, m).ok_or(undetermined)?;
    crate::dense::small_forward(&gram, m, &mut right);
    crate::dense::small_backward(&gram, m, &mut right);
    Ok(frame.to_user(mean, &right))
}

impl Regressor for SparseFit {
    fn dims(&self) -> usize {
        self.gp.dims()
    }
    fn hyperparameters(&self) -> &Hyperparameters {
        self.gp.hyperparameters()
    }
    fn log_marginal_likelihood(&self) -> f64 {
        self.gp.bound()
    }
    fn predict_with(&self, x: &[f64], scratch: &mut Scratch) -> Result<Prediction> {
        let at = self.gp.predict_with(x, scratch)?;
        Ok(Prediction { mean: at.mean + at_plane(&self.plane, x), ..at })
    }
    fn predict_joint(&self, points: Points<'_>) -> Result<JointPrediction> {
        let mut joint = self.gp.predict_joint(points)?;
        for (mean, x) in joint.mean.iter_mut().zip(points.rows()) {
            *mean += at_plane(&self.plane, x);
        }
        Ok(joint)
    }
    fn targets(&self) -> &[f64] {
        &self.targets
    }
    fn leave_one_out(&self) -> Result<LeaveOneOut> {
        let (model, feature) = ("a sparse Gaussian process that was read from a file", "leaving one out");
        self.leave_one_out.clone().ok_or(GpError::Unsupported { model, feature })
    }
    fn card(&self) -> Card {
        self.card.clone()
    }
}

/// Which Gaussian process is fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegressorKind {
    /// Exact: up to some thousand points.
    #[default]
    Exact,
    /// Sparse: 100 inducing inputs stand for any number of points.
    Sparse,
}

/// A fitted [`Regressor`] that goes into a file and comes back.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Fitted {
    /// An exact one.
    Exact(Box<Gp>),
    /// A sparse one.
    Sparse(Box<SparseFit>),
}

impl Fitted {
    /// Fits a Gaussian process of a kind.
    ///
    /// # Errors
    ///
    /// As [`Gp::fit`] and [`SparseFit::fit`].
    pub fn fit<R: Rng + ?Sized>(
        kind: RegressorKind,
        points: Points<'_>,
        y: &[f64],
        options: &FitOptions,
        rng: &mut R,
    ) -> Result<Self> {
        Ok(match kind {
            RegressorKind::Exact => Self::Exact(Box::new(Gp::fit(points, y, options, rng)?)),
            RegressorKind::Sparse => Self::Sparse(Box::new(SparseFit::fit(points, y, options, rng)?)),
        })
    }
}

impl Deref for Fitted {
    type Target = dyn Regressor;

    #[inline]
    fn deref(&self) -> &Self::Target {
        match self {
            Self::Exact(gp) => gp.as_ref(),
            Self::Sparse(gp) => gp.as_ref(),
        }
    }
}

impl<'de> Deserialize<'de> for Fitted {
    /// By what only a sparse one has, so that a fault in either is told as its own reader tells it.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let value = serde_json::Value::deserialize(deserializer)?;
        if value.get("plane").is_some() {
            return SparseFit::deserialize(value).map(|gp| Self::Sparse(Box::new(gp))).map_err(de::Error::custom);
        }
        Gp::deserialize(value).map(|gp| Self::Exact(Box::new(gp))).map_err(de::Error::custom)
    }
}
