//! The posterior of a linear stochastic stride map with sensor noise, by Gibbs sampling.
//!
//! ```text
//! x(k+1) = A x(k) + B u(k) + b + w,  w ~ N(0, Q)        y(k) = x(k) + v,  v ~ N(0, diag R)
//! ```
//!
//! in components of unit variance. One sweep: the states by forward filtering and backward sampling (Carter & Kohn
//! 1994; left out if the sensor is exact); (A, B, b) from its normal conditional with `A_ij ~ N(0, τ²/d)` and τ flat on
//! a grid; Q inverse Wishart with half-t scales (Huang & Wand 2013); R known, or half-Cauchy. New (A, B, b) and Q are
//! accepted by Metropolis with the weight
//!
//! ```text
//! N(x(0); μ, G) (|G| / |Q|)^(κ/2) / |det(I - A)|,   ρ(A) < 1,   G = A G A' + Q,   μ = (I - A)⁻¹ b
//! ```
//!
//! which undoes the bias of least squares (Kendall 1954, Nicholls & Pope 1988): `1/|det(I - A)|` makes the prior flat in
//! the mean state, κ is 1 with a known sensor and 1/d with an unknown one. Where the robot is kicked, or the record begins
//! off its steady state, x(0) is free and κ = 0.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::filter::Filter;
use crate::linear::{MOST, Model, Moments, Sensor, Series, backward_n, cholesky_n, forward_n};
use crate::small::{
    Mat, Vector, apply, cholesky, eigenvalues, fixed_point, gamma, identity, inverse, inverse_wishart, log_det,
    log_normal, modes, normal, stationary,
};

/// Prior variance of b and B, and of a free x(0), in units of the components' variance.
const WIDE: f64 = 25.0;
const START: f64 = 4.0;
/// The scale of the half-Cauchy prior of a sensor's standard deviation, in that of its component.
const SENSOR_SCALE: f64 = 0.5;
/// The grid of τ: 30 values from 0.05 to 1.5.
const TAUS: usize = 30;
const TAU_STEP: f64 = 0.05;

/// How the sampler runs.
pub(crate) struct Settings {
    /// Whether each stretch begins in the steady state.
    pub steady: bool,
    /// The exponent κ.
    pub kappa: f64,
    pub burn: usize,
    pub keep: usize,
    pub thin: usize,
}

/// What the sampler drew.
pub(crate) struct Draws<const D: usize> {
    /// Largest modulus, largest and smallest real part.
    pub modes: Vec<[f64; 3]>,
    /// Eigenvalues of some of them, real and imaginary parts.
    pub eigenvalues: Vec<[f64; 2]>,
    /// The mean of all draws.
    pub mean: Model<D>,
}

/// What the weight of step 4 needs of a model; kept while the model is.
#[derive(Clone)]
struct Steady<const D: usize> {
    covariance: Mat<D>,
    mean: Vector<D>,
    log_weight: f64,
}

struct Chain<'a, const D: usize> {
    series: &'a Series<D>,
    sensor: &'a Sensor<D>,
    settings: &'a Settings,
    rng: ChaCha8Rng,
    p: usize,
    model: Model<D>,
    steady: Steady<D>,
    states: Vec<Vec<Vector<D>>>,
    moments: Moments<D>,
    tau: f64,
    scale_q: Vector<D>,
    scale_r: Vector<D>,
    log_taus: [f64; TAUS],
    scratch: Vec<f64>,
    filter: Filter<D>,
}

impl<'a, const D: usize> Chain<'a, D> {
    fn new(series: &'a Series<D>, sensor: &'a Sensor<D>, settings: &'a Settings, rng: ChaCha8Rng) -> Self {
        let p = series.regressors();
        let moments = Moments::of(series, &series.bouts);
        let (mut c, squares) = moments.least_squares(p);
        let dof = moments.n.saturating_sub(p).max(1) as f64;
        let mut q = squares;
        for (i, row) in q.iter_mut().enumerate() {
            row.iter_mut().for_each(|e| *e /= dof);
            row[i] += 1e-3;
        }
        let r = match sensor {
            Sensor::Exact => [0.0; D],
            Sensor::Noisy { known, .. } => known.map(|r| r.unwrap_or(0.1)),
        };
        let mut model = Model { c, q, r };
        for _ in 0..100 {
            if stationary(&model.a(), &q).is_some() {
                break;
            }
            c.iter_mut().take(D).flatten().for_each(|e| *e *= 0.95);
            model.c = c;
        }
        let mut chain = Self {
            series,
            sensor,
            settings,
            rng,
            p,
            model,
            steady: Steady { covariance: identity(1.0), mean: [0.0; D], log_weight: f64::NEG_INFINITY },
            states: series.bouts.clone(),
            moments,
            tau: 0.5,
            scale_q: [1.0; D],
            scale_r: [1.0; D],
            log_taus: std::array::from_fn(|i| (TAU_STEP * (i + 1) as f64).ln()),
            scratch: Vec::new(),
            filter: Filter::default(),
        };
        if let Some(steady) = chain.weigh(&chain.model) {
            chain.steady = steady;
        }
        chain
    }

    /// The weight of step 4 at the states at hand; `None` where the model is not stable.
    fn weigh(&self, model: &Model<D>) -> Option<Steady<D>> {
        let a = model.a();
        let covariance = stationary(&a, &model.q)?;
        let (log_det_i, mean) = fixed_point(&a, &model.c[self.p - 1]);
        let mut steady = Steady { covariance, mean, log_weight: -log_det_i };
        if self.settings.kappa > 0.0 {
            steady.log_weight += 0.5 * self.settings.kappa * (log_det(&covariance) - log_det(&model.q));
        }
        steady.log_weight += self.starts(&steady);
        steady.log_weight.is_finite().then_some(steady)
    }

    /// What the first states of the stretches say of the steady state.
    fn starts(&self, steady: &Steady<D>) -> f64 {
        if !self.settings.steady {
            return 0.0;
        }
        let factor = cholesky(&steady.covariance);
        self.states.iter().filter_map(|x| x.first()).map(|x| log_normal(x, &steady.mean, &factor)).sum()
    }

    /// Step 1.
    fn draw_states(&mut self) {
        let a = self.model.a();
        let (start_mean, start) = match self.settings.steady {
            true => (self.steady.mean, self.steady.covariance),
            false => ([0.0; D], identity(START)),
        };
        let longest = self.series.bouts.iter().map(Vec::len).max().unwrap_or(0);
        self.filter.prepare(longest, &start, &a, &self.model.q, &self.model.r);
        let last = self.filter.gains.len() - 1;
        for (bout, (y, u)) in self.series.bouts.iter().zip(&self.series.actions).enumerate() {
            self.filter.means.clear();
            let mut mean = start_mean;
            for (k, y) in y.iter().enumerate() {
                if k > 0 {
                    mean = self.model.mean(&self.series.regressor(&mean, &u[k - 1]), self.p);
                }
                let gains = &self.filter.gains[k.min(last)];
                for i in 0..D {
                    let e = y[i] - mean[i];
                    for c in 0..D {
                        mean[c] += gains[i][c] * e;
                    }
                }
                self.filter.means.push(mean);
            }
            let states = &mut self.states[bout];
            for k in (0..states.len()).rev() {
                let mut mean = self.filter.means[k];
                let z: Vector<D> = std::array::from_fn(|_| normal(&mut self.rng));
                let noise = if k + 1 == states.len() {
                    apply(&cholesky(&self.filter.filtered[k.min(last)]), &z)
                } else {
                    let (j, factor) = &self.filter.smooth[k.min(last)];
                    let ahead = self.model.mean(&self.series.regressor(&mean, &u[k]), self.p);
                    let e: Vector<D> = std::array::from_fn(|i| states[k + 1][i] - ahead[i]);
                    let shift = apply(j, &e);
                    for i in 0..D {
                        mean[i] += shift[i];
                    }
                    apply(factor, &z)
                };
                for i in 0..D {
                    states[k][i] = mean[i] + noise[i];
                }
            }
        }
        self.moments = Moments::of(self.series, &self.states);
        // The weight of the model at hand depends on the states by their first ones.
        if let Some(steady) = self.weigh(&self.model) {
            self.steady = steady;
        }
    }

    fn accept(&mut self, model: Model<D>) {
        if let Some(steady) = self.weigh(&model)
            && self.rng.random::<f64>().ln() < steady.log_weight - self.steady.log_weight
        {
            (self.model, self.steady) = (model, steady);
        }
    }

    /// Step 2: (A, B, b) given the states.
    fn draw_coefficients(&mut self) {
        let (p, n) = (self.p, self.p * D);
        let qi = inverse(&self.model.q);
        let shrink = D as f64 / (self.tau * self.tau);
        let mut h = std::mem::take(&mut self.scratch);
        h.clear();
        h.resize(n * n + n, 0.0);
        let (precision, target) = h.split_at_mut(n * n);
        for i in 0..p {
            for a in 0..D {
                target[i * D + a] = (0..D).map(|c| self.moments.xy[i][c] * qi[c][a]).sum();
                for j in 0..=i {
                    for c in 0..D {
                        precision[(i * D + a) * n + j * D + c] = self.moments.xx[i][j] * qi[a][c];
                    }
                }
                precision[(i * D + a) * n + i * D + a] += if i < D { shrink } else { 1.0 / WIDE };
            }
        }
        cholesky_n(precision, n);
        forward_n(precision, target, n);
        target.iter_mut().for_each(|e| *e += normal(&mut self.rng));
        backward_n(precision, target, n);
        let mut model = self.model.clone();
        for i in 0..p {
            for a in 0..D {
                model.c[i][a] = target[i * D + a];
            }
        }
        self.scratch = h;
        self.accept(model);
    }

    /// Step 3: Q given the states and coefficients.
    fn draw_process_noise(&mut self) {
        let mut s = self.moments.residuals(&self.model.c, self.p);
        for i in 0..D {
            s[i][i] += 4.0 / self.scale_q[i];
        }
        let q = inverse_wishart(&s, (D + 1 + self.moments.n) as f64, &mut self.rng);
        self.accept(Model { q, ..self.model.clone() });
        let qi = inverse(&self.model.q);
        for i in 0..D {
            self.scale_q[i] = (2.0 * qi[i][i] + 1.0) / gamma(0.5 * (2.0 + D as f64), &mut self.rng);
        }
    }

    /// Step 3: R given the states.
    fn draw_sensor_noise(&mut self) {
        let Sensor::Noisy { known, looks } = self.sensor else { return };
        for i in (0..D).filter(|i| known[*i].is_none()) {
            let both = self.series.bouts.iter().flatten().zip(self.states.iter().flatten());
            let mut squares: f64 = both.map(|(y, x)| (y[i] - x[i]).powi(2)).sum();
            let mut count = self.series.bouts.iter().map(Vec::len).sum::<usize>() as f64;
            if let Some(looks) = looks {
                squares += 0.25 * looks.squares[i];
                count += looks.count;
            }
            let rate = 1.0 / self.scale_r[i] + 0.5 * squares;
            self.model.r[i] = (rate / gamma(0.5 + 0.5 * count, &mut self.rng)).max(1e-6);
            let rate = 1.0 / self.model.r[i] + 1.0 / (SENSOR_SCALE * SENSOR_SCALE);
            self.scale_r[i] = rate / gamma(1.0, &mut self.rng);
        }
    }

    /// τ given A, on its grid.
    fn draw_shrinkage(&mut self) {
        let squares: f64 = self.model.c.iter().take(D).flatten().map(|e| e * e).sum();
        let d = D as f64;
        let mut weights = [0.0; TAUS];
        let mut most = f64::NEG_INFINITY;
        for ((i, w), log_tau) in weights.iter_mut().enumerate().zip(&self.log_taus) {
            let tau = TAU_STEP * (i + 1) as f64;
            *w = -d * d * log_tau - 0.5 * d * squares / (tau * tau);
            most = most.max(*w);
        }
        weights.iter_mut().for_each(|w| *w = (*w - most).exp());
        let mut left = self.rng.random::<f64>() * weights.iter().sum::<f64>();
        let found = weights.iter().position(|w| {
            left -= w;
            left < 0.0
        });
        self.tau = TAU_STEP * (found.unwrap_or(TAUS - 1) + 1) as f64;
    }

    fn sweep(&mut self) {
        if matches!(self.sensor, Sensor::Noisy { .. }) {
            self.draw_states();
        }
        self.draw_coefficients();
        self.draw_process_noise();
        self.draw_sensor_noise();
        self.draw_shrinkage();
    }
}

/// Draws from the posterior.
pub(crate) fn sample<const D: usize>(
    series: &Series<D>,
    sensor: &Sensor<D>,
    settings: &Settings,
    rng: ChaCha8Rng,
) -> Draws<D> {
    let mut chain = Chain::new(series, sensor, settings, rng);
    let mean = Model { c: [[0.0; D]; MOST], q: [[0.0; D]; D], r: [0.0; D] };
    let mut draws = Draws { modes: Vec::with_capacity(settings.keep), eigenvalues: Vec::new(), mean };
    for _ in 0..settings.burn {
        chain.sweep();
    }
    let share = 1.0 / settings.keep as f64;
    const SHOWN: usize = 200;
    for number in 0..settings.keep {
        for _ in 0..settings.thin {
            chain.sweep();
        }
        let model = &chain.model;
        draws.modes.push(modes(&model.a()));
        if number % settings.keep.div_ceil(SHOWN) == 0 {
            draws.eigenvalues.extend(eigenvalues(&model.a()));
        }
        for i in 0..D {
            draws.mean.r[i] += share * model.r[i];
            for j in 0..D {
                draws.mean.q[i][j] += share * model.q[i][j];
            }
        }
        for (mean, row) in draws.mean.c.iter_mut().zip(&model.c) {
            for (m, c) in mean.iter_mut().zip(row) {
                *m += share * c;
            }
        }
    }
    draws
}
