//! Hyperparameters and inducing inputs that maximise the sparse evidence.

use rand::Rng;
use rand::seq::index;

use super::bound::Bound;
use super::{SparseGp, SparseOptions, check_memory, in_frame};
use crate::error::{GpError, Result};
use crate::gp::check_data;
use crate::hyper::Hyperparameters;
use crate::mean::{Frame, Mean};
use crate::optimize::{FitReport, StartReport};
use crate::optimize::{Limits, Objective, Stop, minimize};
use crate::options::Resolved;
use crate::points::Points;

/// Inducing inputs stay this many spreads around the centre of the data.
const REACH: f64 = 100.0;

impl SparseGp {
    /// Finds hyperparameters and inducing inputs, and conditions on the data.
    ///
    /// # Arguments
    ///
    /// - `points` – inputs, shape `(N, D)`; `y` – targets, shape `(N,)`.
    /// - `rng` – draws the first inducing inputs from the training inputs.
    ///
    /// # Errors
    ///
    /// As [`SparseGp::condition`] and [`Gp::fit`](crate::Gp::fit); [`GpError::Shape`] if more
    /// inducing inputs are asked for than there are points; [`GpError::Unsupported`] for a mean
    /// other than zero.
    ///
    /// # Cost
    ///
    /// `O(N M²)` time an evaluation, two `N × M` matrices.
    ///
    /// # Example
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use stridemap_gp::{Points, SparseGp, SparseOptions};
    ///
    /// let x: Vec<f64> = (0..500).map(|i| 0.01 * f64::from(i)).collect();
    /// let y: Vec<f64> = x.iter().map(|x| x.sin()).collect();
    /// let options = SparseOptions { inducing: 10, ..SparseOptions::default() };
    /// let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// let gp = SparseGp::fit(Points::new(&x, 1)?, &y, &options, &mut rng)?;
    /// assert!((gp.predict(&[2.0])?.mean - 2.0_f64.sin()).abs() < 1e-3);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn fit<R: Rng + ?Sized>(points: Points<'_>, y: &[f64], options: &SparseOptions, rng: &mut R) -> Result<Self> {
        check_data(points, y)?;
        let (n, dims, m) = (points.len(), points.dims(), options.inducing);
        if m == 0 {
            return Err(GpError::Empty { what: "inducing" });
        }
        if m > n {
            let what = "inducing (at most the points)";
            return Err(GpError::Shape { what, expected: n, found: m });
        }
        if options.fit.mean != Mean::Zero {
            let (model, feature) = ("a sparse Gaussian process", "mean other than zero");
            return Err(GpError::Unsupported { model, feature });
        }
        check_memory(n, m)?;
        let frame = Frame::of(points.values(), dims);
        let resolved = options.fit.resolve(&frame, y)?;
        let targets: Vec<f64> = y.iter().map(|y| y - resolved.offset).collect();
        let x = in_frame(points.values(), &frame);
        let mut chosen = index::sample(rng, n, m).into_vec();
        chosen.sort_unstable();
        let inducing: Vec<f64> = chosen.iter().flat_map(|&i| x[i * dims..(i + 1) * dims].to_vec()).collect();

        let mut search = Search {
            bound: Bound::new(options.fit.kernel, options.method, x, dims, targets, m),
            resolved: &resolved,
            frame: &frame,
            fixed: (!options.optimize_inducing).then(|| inducing.clone()),
            last: Vec::new(),
        };
        let mut start = resolved.start.clone();
        let (mut lower, mut upper) = (resolved.lower.clone(), resolved.upper.clone());
        if options.optimize_inducing {
            start.extend(&inducing);
            lower.resize(start.len(), -REACH);
            upper.resize(start.len(), REACH);
        }
        let limits = Limits {
            lower: &lower,
            upper: &upper,
            max_evaluations: options.fit.max_evaluations,
            tolerance: options.fit.tolerance_nats,
        };
        let outcome = minimize(&mut search, &start, &limits);
        if outcome.stop == Stop::BadStart {
            return Err(GpError::NoStartSucceeded { starts: 1, points: n });
        }
        let (theta, moved) = outcome.theta.split_at(2 + dims);
        let moved = if options.optimize_inducing { moved } else { &inducing };
        let user: Vec<f64> =
            moved.iter().enumerate().map(|(i, u)| u * frame.spread_or_one(i % dims) + frame.centre[i % dims]).collect();
        let h = Hyperparameters::from_log(theta);
        let mut gp = Self::from_bound(&mut search.bound, h, user, resolved.offset, &frame)?;
        gp.report = Some(FitReport {
            starts: vec![StartReport {
                log_marginal_likelihood: Some(gp.bound),
                evaluations: outcome.evaluations,
                stop: outcome.stop,
            }],
            best: 0,
            lower: resolved.lower.iter().map(|t| t.exp()).collect(),
            upper: resolved.upper.iter().map(|t| t.exp()).collect(),
        });
        Ok(gp)
    }
}

/// `−F − log p(θ)` as a function of log parameters and inducing inputs.
struct Search<'a> {
    bound: Bound,
    resolved: &'a Resolved,
    frame: &'a Frame,
    /// The inducing inputs, if they do not move.
    fixed: Option<Vec<f64>>,
    last: Vec<f64>,
}

impl Objective for Search<'_> {
    fn value(&mut self, theta: &[f64]) -> Option<f64> {
        let dims = self.frame.centre.len();
        let h = Hyperparameters::from_log(&theta[..2 + dims]);
        let scales: Vec<f64> = (0..dims).map(|d| h.length_scales[d] / self.frame.spread_or_one(d)).collect();
        self.last.clear();
        self.last.extend_from_slice(&theta[..2 + dims]);
        let inducing = self.fixed.as_deref().unwrap_or(&theta[2 + dims..]);
        let value = self.bound.value(&h, &scales, inducing)?;
        Some(-value - self.resolved.log_prior(theta).0)
    }

    fn gradient(&mut self, gradient: &mut [f64]) {
        let dims = self.frame.centre.len();
        if let Some(fixed) = &self.fixed {
            let mut whole = vec![0.0; 2 + dims + fixed.len()];
            self.bound.gradient(&mut whole);
            gradient.copy_from_slice(&whole[..2 + dims]);
        } else {
            self.bound.gradient(gradient);
        }
        let (_, slopes) = self.resolved.log_prior(&self.last);
        for gradient in gradient.iter_mut() {
            *gradient = -*gradient;
        }
        for (gradient, slope) in gradient.iter_mut().zip(slopes) {
            *gradient -= slope;
        }
    }
}
