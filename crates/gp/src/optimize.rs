//! Minimisation in a box by a projected quasi-Newton method (BFGS on the inverse Hessian).
//!
//! Each step goes along `−H_ff g_f`, where `f` are the parameters that are not held at a bound,
//! is projected onto the box, and is shortened until it satisfies the Armijo condition, or
//! lengthened while the slope stays steep. The gradient is asked for only at accepted points.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer, 2006,
//! secs. 3.5, 6.1, 16.7 (\[NW06\]).

use serde::{Deserialize, Serialize};

/// Sufficient decrease, as a share of the linear prediction [NW06, eq. (3.4)].
const ARMIJO: f64 = 1e-4;
/// A step is lengthened while the slope along it keeps more than this share [NW06, eq. (3.5)].
const CURVATURE: f64 = 0.9;
/// Largest change of a log parameter in one step: a factor of about 20.
const LONGEST_STEP: f64 = 3.0;
/// Largest change of a log parameter in the first step, taken without knowing the curvature.
const FIRST_STEP: f64 = 1.0;
/// Trial steps in one line search.
const TRIALS: usize = 20;
/// Distance from a bound, in logarithms, that counts as being at it.
const AT_BOUND: f64 = 1e-10;

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Stop {
    /// A further step would gain less than the tolerance.
    Converged,
    /// No step along the search direction gains anything: rounding has the last word.
    NoProgress,
    /// The evaluations allowed were used up.
    EvaluationLimit,
    /// The covariance at the start is not positive definite.
    BadStart,
}

/// A function to minimise; `None` where it has no value.
pub(crate) trait Objective {
    fn value(&mut self, theta: &[f64]) -> Option<f64>;
    /// Gradient at the point of the last `value`.
    fn gradient(&mut self, gradient: &mut [f64]);
}

/// Limits of a search.
pub(crate) struct Limits<'a> {
    pub(crate) lower: &'a [f64],
    pub(crate) upper: &'a [f64],
    pub(crate) max_evaluations: usize,
    /// Expected gain below which the search has converged.
    pub(crate) tolerance: f64,
}

/// Where a search ended.
pub(crate) struct Outcome {
    pub(crate) theta: Vec<f64>,
    pub(crate) value: f64,
    pub(crate) evaluations: usize,
    pub(crate) stop: Stop,
}

/// A point and what is known there.
struct Point {
    theta: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

impl Point {
    fn outcome(self, evaluations: usize, stop: Stop) -> Outcome {
        Outcome { theta: self.theta, value: self.value, evaluations, stop }
    }
}

/// A search along lines.
struct Search<'a, O> {
    objective: &'a mut O,
    limits: &'a Limits<'a>,
    evaluations: usize,
}

impl<O: Objective> Search<'_, O> {
    fn project(&self, theta: &mut [f64]) {
        for (p, t) in theta.iter_mut().enumerate() {
            *t = t.clamp(self.limits.lower[p], self.limits.upper[p]);
        }
    }

    /// Which parameters are not held at a bound.
    fn free(&self, at: &Point) -> Vec<bool> {
        let (lower, upper) = (self.limits.lower, self.limits.upper);
        let free = |p: usize| {
            let low = at.theta[p] <= lower[p] + AT_BOUND && at.gradient[p] > 0.0;
            let high = at.theta[p] >= upper[p] - AT_BOUND && at.gradient[p] < 0.0;
            !(low || high) && upper[p] > lower[p]
        };
        (0..at.theta.len()).map(free).collect()
    }

    fn is_over(&self) -> bool {
        self.evaluations >= self.limits.max_evaluations
    }

    /// The best point along a direction that satisfies the Armijo condition, from a first `step` on.
    fn line(&mut self, from: &Point, direction: &[f64], slope: f64, mut step: f64) -> Option<Point> {
        let longest = largest(direction.iter());
        // `good` is the best point that satisfies Armijo, `bad` the shortest step that does not.
        let mut good: Option<Point> = None;
        let mut bad = f64::INFINITY;
        for _ in 0..TRIALS {
            if self.is_over() {
                break;
            }
            let mut trial: Vec<f64> = from.theta.iter().zip(direction).map(|(t, d)| t + step * d).collect();
            self.project(&mut trial);
            let moved: f64 = (0..trial.len()).map(|p| from.gradient[p] * (trial[p] - from.theta[p])).sum();
            self.evaluations += 1;
            let found = self.objective.value(&trial).filter(|found| found.is_finite());
            match found {
                Some(value)
                    if value <= from.value + ARMIJO * moved
                        && good.as_ref().is_none_or(|before| value < before.value) =>
                {
                    let mut gradient = vec![0.0; trial.len()];
                    self.objective.gradient(&mut gradient);
                    let along = dot(&gradient, direction);
                    good = Some(Point { theta: trial, value, gradient });
                    let longer = if bad.is_finite() { 0.5 * (step + bad) } else { 2.5 * step };
                    let steep = along < CURVATURE * slope;
                    if !steep || longest * longer > 2.0 * LONGEST_STEP || bad < 1.5 * step {
                        break;
                    }
                    step = longer;
                }
                // The longer step was no better. Its predecessor stands, but the objective must hold that point's
                // intermediate results no more: nothing reads them.
                _ if good.is_some() => break,
                _ => {
                    bad = step;
                    // Minimum of the parabola through value, slope and the failed trial.
                    let shorter = found.map_or(0.25, |found| {
                        let curvature = found - from.value - slope * step;
                        if curvature > 0.0 { -0.5 * slope * step / curvature } else { 0.25 }
                    });
                    step *= shorter.clamp(0.1, 0.5);
                }
            }
        }
        good
    }
}

/// Minimises `objective` from `start`, which is projected onto the box.
pub(crate) fn minimize<O: Objective>(objective: &mut O, start: &[f64], limits: &Limits) -> Outcome {
    let size = start.len();
    let mut search = Search { objective, limits, evaluations: 1 };
    let mut at = Point { theta: start.to_vec(), value: f64::INFINITY, gradient: vec![0.0; size] };
    search.project(&mut at.theta);
    let Some(value) = search.objective.value(&at.theta) else {
        return at.outcome(1, Stop::BadStart);
    };
    at.value = value;
    search.objective.gradient(&mut at.gradient);
    let mut hessian = InverseHessian::new(size);
    let mut direction = vec![0.0; size];
    loop {
        let free = search.free(&at);
        hessian.direction(&at.gradient, &free, &mut direction);
        let mut slope = dot(&at.gradient, &direction);
        if !(slope < 0.0) {
            let fresh = hessian.is_fresh();
            hessian.reset();
            hessian.direction(&at.gradient, &free, &mut direction);
            slope = dot(&at.gradient, &direction);
            if fresh || !(slope < 0.0) {
                return at.outcome(search.evaluations, Stop::Converged);
            }
        }
        let longest = largest(direction.iter());
        let (gain, step) = if hessian.is_fresh() {
            // Nothing is known of the curvature yet: judge by the gradient.
            let steepest = largest(at.gradient.iter().zip(&free).filter(|(_, free)| **free).map(|(g, _)| g));
            (steepest * FIRST_STEP, FIRST_STEP / longest)
        } else {
            (-0.5 * slope, (LONGEST_STEP / longest).min(1.0))
        };
        if gain < limits.tolerance {
            return at.outcome(search.evaluations, Stop::Converged);
        }
        match search.line(&at, &direction, slope, step) {
            Some(next) => {
                hessian.update(&at.theta, &next.theta, &at.gradient, &next.gradient);
                at = next;
                if search.is_over() {
                    return at.outcome(search.evaluations, Stop::EvaluationLimit);
                }
            }
            None if search.is_over() => return at.outcome(search.evaluations, Stop::EvaluationLimit),
            None if !hessian.is_fresh() => hessian.reset(),
            None => return at.outcome(search.evaluations, Stop::NoProgress),
        }
    }
}

/// The largest magnitude.
fn largest<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    values.fold(0.0_f64, |most, v| most.max(v.abs()))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// BFGS approximation of the inverse Hessian [NW06, eq. (6.17)], row-major and dense.
struct InverseHessian {
    size: usize,
    h: Vec<f64>,
    fresh: bool,
}

impl InverseHessian {
    fn new(size: usize) -> Self {
        let mut this = Self { size, h: vec![0.0; size * size], fresh: true };
        this.reset();
        this
    }

    /// Whether no curvature has been seen since the last reset.
    fn is_fresh(&self) -> bool {
        self.fresh
    }

    fn reset(&mut self) {
        self.h.fill(0.0);
        for p in 0..self.size {
            self.h[p * self.size + p] = 1.0;
        }
        self.fresh = true;
    }

    /// `direction = −H_ff g_f`, zero where not free.
    fn direction(&self, gradient: &[f64], free: &[bool], direction: &mut [f64]) {
        for p in 0..self.size {
            direction[p] = 0.0;
            if free[p] {
                let row = &self.h[p * self.size..(p + 1) * self.size];
                let masked = row.iter().zip(gradient).zip(free);
                direction[p] = -masked.map(|((h, g), free)| if *free { h * g } else { 0.0 }).sum::<f64>();
            }
        }
    }

    /// Takes in one step from `theta` to `next`; a step along which the gradient does not grow
    /// says nothing of a minimum and is left out.
    fn update(&mut self, theta: &[f64], next: &[f64], gradient: &[f64], next_gradient: &[f64]) {
        let size = self.size;
        let s: Vec<f64> = next.iter().zip(theta).map(|(a, b)| a - b).collect();
        let y: Vec<f64> = next_gradient.iter().zip(gradient).map(|(a, b)| a - b).collect();
        let (sy, yy, ss) = (dot(&s, &y), dot(&y, &y), dot(&s, &s));
        if !(sy > 1e-10 * (ss * yy).sqrt() && sy > 0.0) {
            return;
        }
        if self.fresh {
            // [NW06, eq. (6.20)]
            for p in 0..size {
                self.h[p * size + p] = sy / yy;
            }
            self.fresh = false;
        }
        let hy: Vec<f64> = (0..size).map(|p| dot(&self.h[p * size..(p + 1) * size], &y)).collect();
        let factor = (1.0 + dot(&y, &hy) / sy) / sy;
        for p in 0..size {
            let row = &mut self.h[p * size..(p + 1) * size];
            for q in 0..size {
                row[q] += factor * s[p] * s[q] - (s[p] * hy[q] + hy[p] * s[q]) / sy;
            }
        }
    }
}

/// One search for the hyperparameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartReport {
    /// Log marginal likelihood at the end, in nats; `None` if the start had none.
    pub log_marginal_likelihood: Option<f64>,
    /// Evaluations of the evidence.
    pub evaluations: usize,
    /// Why the search ended.
    pub stop: Stop,
}

/// How the hyperparameters of a model were found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Every search, in order.
    pub starts: Vec<StartReport>,
    /// Index of the search whose result was kept.
    pub best: usize,
    /// Bounds of `(σ_f², σₙ², ℓ…)` in the user's units.
    pub lower: Vec<f64>,
    /// Upper bounds, likewise.
    pub upper: Vec<f64>,
}

impl FitReport {
    /// The search whose result was kept.
    #[must_use]
    pub fn best_start(&self) -> &StartReport {
        &self.starts[self.best]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Rosenbrock([f64; 2]);
    impl Objective for Rosenbrock {
        fn value(&mut self, t: &[f64]) -> Option<f64> {
            self.0 = [t[0], t[1]];
            // No value left of −1.5.
            (t[0] > -1.5).then(|| (1.0 - t[0]).powi(2) + 100.0 * (t[1] - t[0] * t[0]).powi(2))
        }
        fn gradient(&mut self, g: &mut [f64]) {
            let [a, b] = self.0;
            g[0] = -2.0 * (1.0 - a) - 400.0 * a * (b - a * a);
            g[1] = 200.0 * (b - a * a);
        }
    }

    fn run(lower: [f64; 2], upper: [f64; 2]) -> Outcome {
        let limits = Limits { lower: &lower, upper: &upper, max_evaluations: 300, tolerance: 1e-14 };
        minimize(&mut Rosenbrock([0.0; 2]), &[-1.2, 1.0], &limits)
    }

    #[test]
    fn the_valley_of_rosenbrock_is_walked_to_its_end() {
        let outcome = run([-5.0; 2], [5.0; 2]);
        assert_eq!(outcome.stop, Stop::Converged);
        assert!((outcome.theta[0] - 1.0).abs() < 1e-5, "{:?}", outcome.theta);
    }

    #[test]
    fn a_minimum_on_the_boundary_is_found() {
        // With a ≤ 0.5 the minimum is at (0.5, 0.25).
        let outcome = run([-5.0; 2], [0.5, 5.0]);
        assert!((outcome.theta[0] - 0.5).abs() < 1e-12 && (outcome.theta[1] - 0.25).abs() < 1e-6);
    }

    #[test]
    fn a_start_without_value_is_told() {
        let limits = Limits { lower: &[-5.0; 2], upper: &[5.0; 2], max_evaluations: 10, tolerance: 1e-9 };
        let outcome = minimize(&mut Rosenbrock([0.0; 2]), &[-2.0, 1.0], &limits);
        assert_eq!(outcome.stop, Stop::BadStart);
    }
}
