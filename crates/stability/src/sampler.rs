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

use crate::small::{
    Mat, Vector, apply, backward, cholesky, fixed_point, forward, gamma, identity, inverse, inverse_wishart, log_det,
    log_normal, modes, normal, stationary, times, times_transposed,
};

/// Most actions that a record may have.
pub(crate) const MOST_ACTIONS: usize = 6;
/// Most regressors of a component: states, actions, one.
pub(crate) const MOST: usize = 12;
/// Prior variance of b and B, and of a free x(0), in units of the components' variance.
const WIDE: f64 = 25.0;
const START: f64 = 4.0;
/// The scale of the half-Cauchy prior of a sensor's standard deviation, in that of its component.
const SENSOR_SCALE: f64 = 0.5;
/// The grid of τ: 30 values from 0.05 to 1.5.
const TAUS: usize = 30;
const TAU_STEP: f64 = 0.05;

/// A record in components of zero mean and unit variance.
pub(crate) struct Series<const D: usize> {
    /// States of unbroken stretches.
    pub bouts: Vec<Vec<Vector<D>>>,
    /// The action after each state; as long as the states.
    pub actions: Vec<Vec<Vector<MOST_ACTIONS>>>,
    /// How many of the actions are there.
    pub m: usize,
}

impl<const D: usize> Series<D> {
    pub(crate) fn regressors(&self) -> usize {
        D + self.m + 1
    }

    pub(crate) fn regressor(&self, x: &Vector<D>, u: &Vector<MOST_ACTIONS>) -> [f64; MOST] {
        let mut v = [0.0; MOST];
        v[..D].copy_from_slice(x);
        v[D..D + self.m].copy_from_slice(&u[..self.m]);
        v[D + self.m] = 1.0;
        v
    }
}

/// What is known of the sensor.
pub(crate) enum Sensor<const D: usize> {
    /// It has no noise.
    Exact,
    /// Its variance, per component, where that is known; and two looks at each section.
    Noisy { known: [Option<f64>; D], looks: Option<Looks<D>> },
}

/// Differences of two looks at the same section, whose variance is four times that of their mean's noise.
pub(crate) struct Looks<const D: usize> {
    pub squares: Vector<D>,
    pub count: f64,
}

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

/// A model of the map.
#[derive(Clone)]
pub(crate) struct Model<const D: usize> {
    /// Coefficients, a row per regressor: A', B', b.
    pub c: [[f64; D]; MOST],
    pub q: Mat<D>,
    pub r: Vector<D>,
}

impl<const D: usize> Model<D> {
    pub(crate) fn a(&self) -> Mat<D> {
        let mut a = [[0.0; D]; D];
        for i in 0..D {
            for j in 0..D {
                a[i][j] = self.c[j][i];
            }
        }
        a
    }

    /// `A x + B u + b`.
    pub(crate) fn mean(&self, v: &[f64; MOST], p: usize) -> Vector<D> {
        let mut out = [0.0; D];
        for i in 0..p {
            for j in 0..D {
                out[j] += self.c[i][j] * v[i];
            }
        }
        out
    }
}

/// What the sampler drew.
pub(crate) struct Draws<const D: usize> {
    /// Largest modulus, largest and smallest real part.
    pub modes: Vec<[f64; 3]>,
    /// Variance of the sensor's noise.
    pub noise: Vec<Vector<D>>,
    /// The mean of all draws.
    pub mean: Model<D>,
}

/// Sums over pairs of successive states.
pub(crate) struct Moments<const D: usize> {
    xx: [[f64; MOST]; MOST],
    xy: [[f64; D]; MOST],
    yy: Mat<D>,
    pub n: usize,
}

impl<const D: usize> Moments<D> {
    pub(crate) fn of(series: &Series<D>, states: &[Vec<Vector<D>>]) -> Self {
        let mut m = Self { xx: [[0.0; MOST]; MOST], xy: [[0.0; D]; MOST], yy: [[0.0; D]; D], n: 0 };
        let p = series.regressors();
        for (x, u) in states.iter().zip(&series.actions) {
            for (k, pair) in x.windows(2).enumerate() {
                let v = series.regressor(&pair[0], &u[k]);
                for i in 0..p {
                    for j in 0..=i {
                        m.xx[i][j] += v[i] * v[j];
                    }
                    for c in 0..D {
                        m.xy[i][c] += v[i] * pair[1][c];
                    }
                }
                for i in 0..D {
                    for j in 0..D {
                        m.yy[i][j] += pair[1][i] * pair[1][j];
                    }
                }
                m.n += 1;
            }
        }
        for i in 0..p {
            for j in 0..i {
                m.xx[j][i] = m.xx[i][j];
            }
        }
        m
    }

    /// Sums of squares and products of the residuals of coefficients.
    fn residuals(&self, c: &[[f64; D]; MOST], p: usize) -> Mat<D> {
        let mut s = self.yy;
        for i in 0..D {
            for j in 0..D {
                for r in 0..p {
                    let fitted: f64 = (0..p).map(|k| self.xx[r][k] * c[k][j]).sum();
                    s[i][j] += c[r][i] * (fitted - self.xy[r][j]) - self.xy[r][i] * c[r][j];
                }
            }
        }
        s
    }

    /// Least squares: coefficients, and the sums of squares of their residuals.
    pub(crate) fn least_squares(&self, p: usize) -> ([[f64; D]; MOST], Mat<D>) {
        let l = self.factor(p);
        let mut c = [[0.0; D]; MOST];
        for j in 0..D {
            let mut b: Vec<f64> = (0..p).map(|i| self.xy[i][j]).collect();
            forward_n(&l, &mut b, p);
            backward_n(&l, &mut b, p);
            for i in 0..p {
                c[i][j] = b[i];
            }
        }
        (c, self.residuals(&c, p))
    }

    /// The factor of `X'X`.
    pub(crate) fn factor(&self, p: usize) -> Vec<f64> {
        let mut h = vec![0.0; p * p];
        for i in 0..p {
            for j in 0..=i {
                h[i * p + j] = self.xx[i][j] * if i == j { 1.0 + 1e-12 } else { 1.0 };
            }
        }
        cholesky_n(&mut h, p);
        h
    }
}

/// The Cholesky factor in place of the lower triangle.
fn cholesky_n(h: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let mut t = h[i * n + j];
            for k in 0..j {
                t -= h[i * n + k] * h[j * n + k];
            }
            h[i * n + j] = if i == j { t.max(1e-14).sqrt() } else { t / h[j * n + j] };
        }
    }
}

fn forward_n(l: &[f64], b: &mut [f64], n: usize) {
    for i in 0..n {
        let mut t = b[i];
        for k in 0..i {
            t -= l[i * n + k] * b[k];
        }
        b[i] = t / l[i * n + i];
    }
}

pub(crate) fn backward_n(l: &[f64], b: &mut [f64], n: usize) {
    for i in (0..n).rev() {
        let mut t = b[i];
        for k in i + 1..n {
            t -= l[k * n + i] * b[k];
        }
        b[i] = t / l[i * n + i];
    }
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

/// The filter's gains, which do not depend on the data: they settle within a few strides and are then used again.
#[derive(Default)]
struct Filter<const D: usize> {
    /// Gains of the components' scalar updates.
    gains: Vec<Mat<D>>,
    filtered: Vec<Mat<D>>,
    /// Smoother gain and factor of the covariance of x(k) given x(k+1).
    smooth: Vec<(Mat<D>, Mat<D>)>,
    means: Vec<Vector<D>>,
}

impl<const D: usize> Filter<D> {
    /// Gains for a stretch of `n` states.
    fn prepare(&mut self, n: usize, start: &Mat<D>, a: &Mat<D>, q: &Mat<D>, r: &Vector<D>) {
        const SETTLED: f64 = 1e-11;
        self.gains.clear();
        self.filtered.clear();
        self.smooth.clear();
        let mut predicted = *start;
        while self.gains.len() < n {
            let mut p = predicted;
            let mut gains = [[0.0; D]; D];
            for i in 0..D {
                let row = p[i];
                let scale = 1.0 / (row[i] + r[i]).max(1e-300);
                for c in 0..D {
                    gains[i][c] = row[c] * scale;
                    for (e, w) in p[c].iter_mut().zip(&row) {
                        *e -= row[c] * scale * w;
                    }
                }
            }
            let ap = times(a, &p);
            let mut next = times_transposed(&ap, a);
            for i in 0..D {
                for j in 0..D {
                    next[i][j] += q[i][j];
                }
            }
            // J = F A' S⁻¹ with S = A F A' + Q; F - J S J' is the covariance given the next state.
            let l = cholesky(&next);
            let (mut j, mut left) = ([[0.0; D]; D], p);
            let mut v = [[0.0; D]; D];
            for c in 0..D {
                let mut column = [0.0; D];
                for i in 0..D {
                    column[i] = ap[i][c];
                }
                v[c] = forward(&l, column);
                j[c] = backward(&l, v[c]);
            }
            for i in 0..D {
                for c in 0..D {
                    left[i][c] -= (0..D).map(|k| v[i][k] * v[c][k]).sum::<f64>();
                }
                left[i][i] += 1e-12;
            }
            self.gains.push(gains);
            self.filtered.push(p);
            self.smooth.push((j, cholesky(&left)));
            let apart = (0..D).flat_map(|i| (0..D).map(move |j| (i, j)));
            let apart = apart.fold(0.0_f64, |most, (i, j)| most.max((next[i][j] - predicted[i][j]).abs()));
            if self.gains.len() > 1 && apart < SETTLED {
                break;
            }
            predicted = next;
        }
    }
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
    let mut draws = Draws { modes: Vec::with_capacity(settings.keep), noise: Vec::new(), mean };
    for _ in 0..settings.burn {
        chain.sweep();
    }
    let share = 1.0 / settings.keep as f64;
    for _ in 0..settings.keep {
        for _ in 0..settings.thin {
            chain.sweep();
        }
        let model = &chain.model;
        draws.modes.push(modes(&model.a()));
        draws.noise.push(model.r);
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
