//! Regression of one component of the next state on the state, whose curvature and tails decide when a gait falls.
//!
//! ```text
//! y = β'φ(z) + e,   e ~ s · t_ν        φ: 1, z, z_i z_j, z_i z_j z_k, and for each component a squared exponential process
//! ```
//!
//! in standardised units: linear terms of prior standard deviation 2, quadratic 0.15, cubic 0.03; the process by the
//! first eigenfunctions of the Laplacian (Solin & Särkkä 2020), so that a sweep costs N p² and not N³; ν on a grid
//! with prior 1/ν; hyperparameters by Metropolis with β integrated out.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use statrs::function::gamma::ln_gamma;

use crate::small::{gamma, normal};

/// Degrees of freedom of the noise.
const DOFS: [f64; 10] = [2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 60.0, 200.0];
/// Prior of log length scale, log size of the process and log noise: mean and standard deviation.
const LENGTH: (f64, f64) = (2.5, 0.6);
const SIZE: (f64, f64) = (0.3, 1.0);
const NOISE: (f64, f64) = (0.4, 1.5);
const LINEAR: f64 = 2.0;
const QUADRATIC: f64 = 0.15;
const CUBIC: f64 = 0.03;

/// What of a state goes into the regression.
#[derive(Clone, Debug)]
pub(crate) struct Features {
    /// Components of the state.
    d: usize,
    /// Further inputs that enter by a straight line.
    more: usize,
    /// Half of the width on which the process lives, in standard deviations.
    half: f64,
    /// Eigenfunctions per component.
    waves: usize,
}

impl Features {
    /// For states of `d` components within `half` standard deviations of their mean, and `more` further inputs.
    pub(crate) fn new(d: usize, more: usize, half: f64) -> Self {
        Self { d, more, half, waves: if d == 1 { 14 } else { 8 } }
    }

    /// Terms before the waves, with their prior variances.
    fn fixed(&self) -> Vec<f64> {
        let d = self.d;
        let (squares, cubes) = (d * (d + 1) / 2, d * (d + 1) * (d + 2) / 6);
        let mut variances = vec![LINEAR * LINEAR; 1 + d + self.more];
        variances.extend(std::iter::repeat_n(QUADRATIC * QUADRATIC, squares));
        variances.extend(std::iter::repeat_n(CUBIC * CUBIC, cubes));
        variances
    }

    /// φ of a state and further inputs, both standardised.
    pub(crate) fn write(&self, z: &[f64], more: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.push(1.0);
        out.extend_from_slice(z);
        out.extend_from_slice(more);
        for i in 0..self.d {
            for j in 0..=i {
                out.push(z[i] * z[j]);
            }
        }
        for i in 0..self.d {
            for j in 0..=i {
                for k in 0..=j {
                    out.push(z[i] * z[j] * z[k]);
                }
            }
        }
        let size = self.half.sqrt().recip();
        for &z in z {
            // sin(m θ) for m = 1, 2, ... by the addition theorem; nothing beyond the ends.
            let (sin, cos) = if z.abs() < self.half {
                (std::f64::consts::PI * (z + self.half) / (2.0 * self.half)).sin_cos()
            } else {
                (0.0, 1.0)
            };
            let (mut before, mut now) = (0.0, sin);
            for _ in 0..self.waves {
                out.push(now * size);
                (before, now) = (now, 2.0 * cos * now - before);
            }
        }
    }

    /// Prior variances of all terms: the spectral density of the process at each wave's frequency.
    fn variances(&self, fixed: &[f64], h: &[f64]) -> Vec<f64> {
        let mut all = fixed.to_vec();
        let size = (2.0 * h[self.d]).exp() / self.d as f64;
        for log_length in &h[..self.d] {
            let length = log_length.exp();
            for m in 1..=self.waves {
                let w = std::f64::consts::PI * m as f64 / (2.0 * self.half) * length;
                let density = size * std::f64::consts::TAU.sqrt() * length * (-0.5 * w * w).exp();
                all.push(density.max(1e-12));
            }
        }
        all
    }
}

/// A draw from the posterior of a regression.
#[derive(Clone, Debug)]
pub(crate) struct Draw {
    pub beta: Vec<f64>,
    /// Scale of the noise.
    pub scale: f64,
    /// Its degrees of freedom.
    pub dof: f64,
}

/// Weighted sums of squares and products.
struct Sums {
    precision: Vec<f64>,
    target: Vec<f64>,
    squares: f64,
}

struct Regression<'a> {
    features: &'a Features,
    fixed: Vec<f64>,
    rows: &'a [Vec<f64>],
    y: &'a [f64],
    p: usize,
    /// Log lengths, log size, log noise.
    h: Vec<f64>,
    weights: Vec<f64>,
    dof: f64,
}

impl Regression<'_> {
    fn sums(&self) -> Sums {
        let p = self.p;
        let mut sums = Sums { precision: vec![0.0; p * p], target: vec![0.0; p], squares: 0.0 };
        for ((row, y), w) in self.rows.iter().zip(self.y).zip(&self.weights) {
            let inverse = 1.0 / w;
            for (i, a) in row.iter().enumerate() {
                let a = a * inverse;
                for (s, b) in sums.precision[i * p..=i * p + i].iter_mut().zip(row) {
                    *s += a * b;
                }
                sums.target[i] += a * y;
            }
            sums.squares += y * y * inverse;
        }
        sums
    }

    /// The log posterior of hyperparameters with β integrated out, and the factor and target by which β is drawn.
    fn posterior(&self, sums: &Sums, h: &[f64]) -> (f64, Vec<f64>, Vec<f64>) {
        let (p, d) = (self.p, self.features.d);
        let variances = self.features.variances(&self.fixed, h);
        let precision = (-2.0 * h[d + 1]).exp();
        let mut l: Vec<f64> = sums.precision.iter().map(|s| s * precision).collect();
        let mut log = 0.0;
        for (i, v) in variances.iter().enumerate() {
            l[i * p + i] += 1.0 / v;
            log -= 0.5 * v.ln();
        }
        let mut z: Vec<f64> = sums.target.iter().map(|t| t * precision).collect();
        for i in 0..p {
            for j in 0..=i {
                let (head, tail) = l.split_at_mut(i * p);
                let dot: f64 = if i == j {
                    tail[..j].iter().map(|x| x * x).sum()
                } else {
                    tail[..j].iter().zip(&head[j * p..j * p + j]).map(|(a, b)| a * b).sum()
                };
                let t = tail[j] - dot;
                tail[j] = if i == j { t.max(1e-12).sqrt() } else { t / head[j * p + j] };
            }
            let done: f64 = l[i * p..i * p + i].iter().zip(&z).map(|(a, b)| a * b).sum();
            z[i] = (z[i] - done) / l[i * p + i];
            log += 0.5 * z[i] * z[i] - l[i * p + i].ln();
        }
        log -= self.y.len() as f64 * h[d + 1] + 0.5 * sums.squares * precision;
        let prior = |x: f64, (mean, std): (f64, f64)| -0.5 * ((x - mean.ln()) / std).powi(2);
        log += h[..d].iter().map(|x| prior(*x, LENGTH)).sum::<f64>() + prior(h[d], SIZE) + prior(h[d + 1], NOISE);
        (log, l, z)
    }

    fn sweep(&mut self, rng: &mut ChaCha8Rng) -> Draw {
        const TRIES: usize = 4;
        let d = self.features.d;
        let sums = self.sums();
        let mut now = self.posterior(&sums, &self.h);
        for attempt in 0..TRIES {
            let shrink = if attempt % 2 == 0 { 1.0 } else { 0.4 };
            let step = |i: usize| {
                if i < d {
                    0.5
                } else if i == d {
                    0.6
                } else {
                    0.12
                }
            };
            let h: Vec<f64> = self.h.iter().enumerate().map(|(i, x)| x + shrink * step(i) * normal(rng)).collect();
            let next = self.posterior(&sums, &h);
            if rng.random::<f64>().ln() < next.0 - now.0 {
                (self.h, now) = (h, next);
            }
        }
        let (_, l, mut beta) = now;
        beta.iter_mut().for_each(|b| *b += normal(rng));
        crate::linear::backward_n(&l, &mut beta, self.p);
        let scale = self.h[d + 1].exp();
        for ((row, y), w) in self.rows.iter().zip(self.y).zip(&mut self.weights) {
            let e = (y - dot(row, &beta)) / scale;
            *w = 0.5 * (self.dof + e * e) / gamma(0.5 * (self.dof + 1.0), rng);
        }
        self.draw_dof(rng);
        Draw { beta, scale, dof: self.dof }
    }

    fn draw_dof(&mut self, rng: &mut ChaCha8Rng) {
        let (mut logs, mut inverses) = (0.0, 0.0);
        for w in &self.weights {
            logs += w.ln();
            inverses += 1.0 / w;
        }
        let n = self.weights.len() as f64;
        let of = |v: f64| {
            let h = 0.5 * v;
            n * (h * h.ln() - ln_gamma(h)) - (h + 1.0) * logs - h * inverses - v.ln()
        };
        let most = DOFS.iter().map(|v| of(*v)).fold(f64::NEG_INFINITY, f64::max);
        let weights = DOFS.map(|v| (of(v) - most).exp());
        let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
        let found = weights.iter().position(|w| {
            left -= w;
            left < 0.0
        });
        self.dof = DOFS[found.unwrap_or(DOFS.len() - 1)];
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `draws` draws of a regression of `y` on rows of features, both standardised.
pub(crate) fn regress(
    features: &Features,
    rows: &[Vec<f64>],
    y: &[f64],
    draws: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<Draw> {
    const BURN: usize = 100;
    const THIN: usize = 3;
    let mut h = vec![LENGTH.0.ln(); features.d];
    h.extend([SIZE.0.ln(), 0.5_f64.ln()]);
    let fixed = features.fixed();
    let p = fixed.len() + features.d * features.waves;
    let weights = vec![1.0; y.len()];
    let mut chain = Regression { features, fixed, rows, y, p, h, weights, dof: 30.0 };
    for _ in 0..BURN {
        chain.sweep(rng);
    }
    let thinned = |chain: &mut Regression<'_>, rng: &mut ChaCha8Rng| {
        for _ in 1..THIN {
            chain.sweep(rng);
        }
        chain.sweep(rng)
    };
    (0..draws).map(|_| thinned(&mut chain, rng)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn a_curve_with_outliers_is_found_and_its_tails_are_heavy() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let features = Features::new(1, 0, 6.0);
        let (mut rows, mut y) = (Vec::new(), Vec::new());
        for k in 0..200 {
            let z = -2.0 + 0.02 * f64::from(k);
            let mut row = Vec::new();
            features.write(&[z], &[], &mut row);
            rows.push(row);
            let outlier = if k % 20 == 7 { 3.0 } else { 0.0 };
            y.push(0.7 * z - 0.25 * z * z + 0.2 * normal(&mut rng) + outlier);
        }
        let draws = regress(&features, &rows, &y, 60, &mut rng);
        let mut row = Vec::new();
        features.write(&[1.0], &[], &mut row);
        let mean = draws.iter().map(|d| dot(&row, &d.beta)).sum::<f64>() / 60.0;
        assert!((mean - 0.45).abs() < 0.1, "{mean}");
        assert!(draws.iter().filter(|d| d.dof < 6.0).count() > 40);
        assert!(draws.iter().all(|d| d.scale < 0.5));
    }
}
