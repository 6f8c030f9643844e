//! Maximum-likelihood (or maximum-a-posteriori) hyperparameters from several starts.

use rand::Rng;

use crate::error::{GpError, Result};
use crate::evidence::{Evidence, NoValue};
use crate::gp::{Gp, check_data};
use crate::hyper::Hyperparameters;
use crate::mean::Frame;
use crate::memory::check_memory;
use crate::optimize::{FitReport, Limits, Objective, Outcome, StartReport, Stop, minimize};
use crate::options::{FitOptions, Resolved};
use crate::points::Points;

/// Random starts of length scales and signal variance: up to this factor from the data's scale.
const START_FACTOR: f64 = 10.0;
/// Random starts of the noise variance, in variances of `y`.
const START_NOISE: (f64, f64) = (1e-4, 1.0);

impl Gp {
    /// Finds the hyperparameters that make the data most probable, and conditions on the data:
    /// type-II maximum likelihood, as in \[MA09, sec. 4\].
    ///
    /// # Arguments
    ///
    /// - `points` – inputs, shape `(N, D)`, `N ≥ 1`.
    /// - `y` – targets, shape `(N,)`.
    /// - `rng` – places the starts beyond the first; not touched when `options.starts` is 1.
    ///
    /// # Errors
    ///
    /// As [`Gp::condition`]; [`GpError::Parameter`], [`GpError::Range`] or [`GpError::Shape`] for
    /// impossible options; [`GpError::NoStartSucceeded`] if no start could be evaluated;
    /// [`GpError::Memory`] if this machine cannot hold the matrices.
    ///
    /// # Cost
    ///
    /// `O(N³)` time for each of about 20 evaluations a start; three matrices of `N²`.
    ///
    /// # Example
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use stridemap_gp::{FitOptions, Gp, Points};
    ///
    /// let x: Vec<f64> = (0..20).map(|i| 0.3 * f64::from(i)).collect();
    /// let y: Vec<f64> = x.iter().map(|x| x.sin()).collect();
    /// let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// let gp = Gp::fit(Points::new(&x, 1)?, &y, &FitOptions::default(), &mut rng)?;
    /// assert!((gp.predict(&[1.0])?.mean - 1.0_f64.sin()).abs() < 1e-3);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn fit<R: Rng + ?Sized>(points: Points<'_>, y: &[f64], options: &FitOptions, rng: &mut R) -> Result<Self> {
        check_data(points, y)?;
        check_memory(points.len(), 0)?;
        let frame = Frame::of(points.values(), points.dims());
        let resolved = options.resolve(&frame, y)?;
        let targets: Vec<f64> = y.iter().map(|y| y - resolved.offset).collect();
        let evidence = Evidence::new(points.values(), points.dims(), &targets, options.kernel, options.mean, &frame);
        let mut search = Search { evidence, resolved: &resolved, mean_failed: false, last: Vec::new() };
        let (best, report) = search.run(options, rng)?;
        let mean_failed = search.mean_failed;
        // Its matrices make room for the model's.
        drop(search);
        if mean_failed && best.is_none() {
            let coefficients = options.mean.coefficients(points.dims());
            return Err(GpError::MeanNotIdentifiable { points: y.len(), coefficients });
        }
        let Some(best) = best else {
            return Err(GpError::NoStartSucceeded { starts: options.starts, points: y.len() });
        };
        let mut gp = Self::conditioned(points, y, options.kernel, options.mean, best, resolved.offset, frame)?;
        gp.report = Some(report);
        Ok(gp)
    }
}

/// `−log p(y|θ) − log p(θ)` as a function of log parameters.
struct Search<'a> {
    evidence: Evidence,
    resolved: &'a Resolved,
    mean_failed: bool,
    last: Vec<f64>,
}

impl Search<'_> {
    /// Runs all starts; the best hyperparameters, if any start could be evaluated.
    fn run<R: Rng + ?Sized>(
        &mut self,
        options: &FitOptions,
        rng: &mut R,
    ) -> Result<(Option<Hyperparameters>, FitReport)> {
        let resolved = self.resolved;
        let limits = Limits {
            lower: &resolved.lower,
            upper: &resolved.upper,
            max_evaluations: options.max_evaluations,
            tolerance: options.tolerance_nats,
        };
        let mut best: Option<Outcome> = None;
        let mut report = FitReport {
            starts: Vec::with_capacity(options.starts),
            best: 0,
            lower: resolved.lower.iter().map(|t| t.exp()).collect(),
            upper: resolved.upper.iter().map(|t| t.exp()).collect(),
        };
        for index in 0..options.starts {
            let start = if index == 0 { resolved.start.clone() } else { self.random_start(rng) };
            let outcome = minimize(self, &start, &limits);
            let log_prior: f64 = self.resolved.log_prior(&outcome.theta).0;
            report.starts.push(StartReport {
                log_marginal_likelihood: (outcome.stop != Stop::BadStart).then_some(-outcome.value - log_prior),
                evaluations: outcome.evaluations,
                stop: outcome.stop,
            });
            if outcome.value < best.as_ref().map_or(f64::INFINITY, |best| best.value) {
                report.best = index;
                best = Some(outcome);
            }
        }
        Ok((best.map(|best| Hyperparameters::from_log(&best.theta)), report))
    }

    fn random_start<R: Rng + ?Sized>(&self, rng: &mut R) -> Vec<f64> {
        let resolved = self.resolved;
        let spread = START_FACTOR.ln();
        (0..resolved.start.len())
            .map(|p| {
                let (low, high) = if p == 1 { (START_NOISE.0.ln(), START_NOISE.1.ln()) } else { (-spread, spread) };
                let offset = low + (high - low) * rng.random::<f64>();
                (resolved.log_scale[p] + offset).clamp(resolved.lower[p], resolved.upper[p])
            })
            .collect()
    }
}

impl Objective for Search<'_> {
    fn value(&mut self, theta: &[f64]) -> Option<f64> {
        let parameters = Hyperparameters::from_log(theta);
        self.last.clear();
        self.last.extend_from_slice(theta);
        match self.evidence.value(&parameters.length_scales, parameters.signal_variance, parameters.noise_variance) {
            Ok(value) => Some(-value - self.resolved.log_prior(theta).0),
            Err(NoValue::Covariance(_)) => None,
            Err(NoValue::Mean) => {
                self.mean_failed = true;
                None
            }
        }
    }

    fn gradient(&mut self, gradient: &mut [f64]) {
        self.evidence.gradient(gradient);
        let (_, slopes) = self.resolved.log_prior(&self.last);
        for (gradient, slope) in gradient.iter_mut().zip(slopes) {
            *gradient = -*gradient - slope;
        }
    }
}
