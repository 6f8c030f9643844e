//! Does the record look like the model? Five checks that can say no.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::linear::{MOST, MOST_ACTIONS, Model, Moments, Series, backward_n};
use crate::small::{Mat, cholesky, inverse_wishart, modes, normal, times_transposed};

/// Lags of the portmanteau tests: of states, and of prediction errors, where long memory is what a linear map leaves.
const LAGS: usize = 4;
const ERROR_LAGS: usize = 10;

/// Rows of a series by stretch, of any width.
type Rows = Vec<Vec<Vec<f64>>>;

fn chi_squared_above(x: f64, dof: f64) -> f64 {
    ChiSquared::new(dof).map_or(1.0, |d| d.sf(x.max(0.0)))
}

/// The p-value of Hosking's (1980) portmanteau statistic at `lags` from 1 on: whether `later` is correlated with
/// `earlier`, strides before; `fitted` parameters are taken off its degrees of freedom.
///
/// ```text
/// n² Σ tr(C_l C_zz⁻¹ C_l' C_yy⁻¹) / (n - l),   C_l = mean y(k) z(k-l)'
/// ```
fn portmanteau(later: &Rows, earlier: &Rows, lags: usize, fitted: usize) -> f64 {
    let n: usize = later.iter().map(Vec::len).sum();
    let (Some(dy), Some(dz)) = (wide(later), wide(earlier)) else { return 1.0 };
    let covariance = |rows: &Rows, d: usize| {
        let sum = rows.iter().flatten().fold(DMatrix::zeros(d, d), |sum, y| {
            let y = DVector::from_column_slice(y);
            sum + &y * y.transpose()
        });
        (sum / n as f64 + DMatrix::identity(d, d) * 1e-12).try_inverse()
    };
    let (Some(yy), Some(zz)) = (covariance(later, dy), covariance(earlier, dz)) else { return 1.0 };
    let mut statistic = 0.0;
    for lag in 1..=lags {
        let mut c = DMatrix::zeros(dy, dz);
        let mut pairs = 0;
        for (y, z) in later.iter().zip(earlier) {
            for (y, z) in y.iter().skip(lag).zip(z) {
                c += DVector::from_column_slice(y) * DVector::from_column_slice(z).transpose();
                pairs += 1;
            }
        }
        c /= n as f64;
        statistic += (&c * &zz * c.transpose() * &yy).trace() * (n * n) as f64 / pairs.max(1) as f64;
    }
    chi_squared_above(statistic, (lags * dy * dz).saturating_sub(fitted).max(1) as f64)
}

fn wide(rows: &Rows) -> Option<usize> {
    rows.iter().flatten().next().map(Vec::len)
}

/// Whether strides remember one another, or an action: the p-value of there being nothing to see. Without memory seen,
/// a gait that forgets at once and a sensor that is all noise are the same.
pub(crate) fn excited<const D: usize>(series: &Series<D>) -> f64 {
    let states: Rows = series.bouts.iter().map(|b| b.iter().map(|x| x.to_vec()).collect()).collect();
    let both = series.bouts.iter().zip(&series.actions).map(|(x, u)| {
        let row = |(x, u): (&[f64; D], &[f64; MOST_ACTIONS])| [x, &u[..series.m]].concat();
        x.iter().zip(u).map(row).collect()
    });
    portmanteau(&states, &both.collect(), LAGS, 0)
}

/// Whether differences of two looks are white in time: slow noise that both looks share does not show in them.
pub(crate) fn independent_looks<const D: usize>(differences: &[Vec<[f64; D]>]) -> f64 {
    let rows: Rows = differences.iter().map(|b| b.iter().map(|x| x.to_vec()).collect()).collect();
    portmanteau(&rows, &rows, LAGS, 0)
}

/// One-step prediction errors of a model by the Kalman filter; an exact sensor is the case R = 0.
pub(crate) fn innovations<const D: usize>(series: &Series<D>, model: &Model<D>) -> Vec<Vec<[f64; D]>> {
    let p = series.regressors();
    let a = model.a();
    let mut all = Vec::new();
    for (y, u) in series.bouts.iter().zip(&series.actions) {
        let mut errors = Vec::new();
        let (mut mean, mut cov) = ([0.0; D], crate::small::identity::<D>(4.0));
        for (k, y) in y.iter().enumerate() {
            if k > 0 {
                mean = model.mean(&series.regressor(&mean, &u[k - 1]), p);
                cov = times_transposed(&crate::small::times(&a, &cov), &a);
                for i in 0..D {
                    for j in 0..D {
                        cov[i][j] += model.q[i][j];
                    }
                }
                errors.push(std::array::from_fn(|i| y[i] - mean[i]));
            }
            for i in 0..D {
                let row = cov[i];
                let scale = 1.0 / (row[i] + model.r[i]).max(1e-12);
                let e = y[i] - mean[i];
                for c in 0..D {
                    mean[c] += row[c] * scale * e;
                    for j in 0..D {
                        cov[c][j] -= row[c] * scale * row[j];
                    }
                }
            }
        }
        all.push(errors);
    }
    all
}

/// What prediction errors look like: p-values of their being white, of their sizes being so — bursts, as of a walker
/// who pauses — and of their having the tails of a normal distribution.
pub(crate) struct Whiteness {
    pub signed: f64,
    pub sizes: f64,
    pub tails: f64,
}

impl Whiteness {
    pub(crate) fn of<const D: usize>(errors: &[Vec<[f64; D]>], noise_was_fitted: bool) -> Self {
        let rows: Rows = errors.iter().map(|b| b.iter().map(|x| x.to_vec()).collect()).collect();
        let signed = portmanteau(&rows, &rows, ERROR_LAGS, D * D + if noise_was_fitted { D } else { 0 });
        let n = errors.iter().map(Vec::len).sum::<usize>().max(1) as f64;
        let mean = |f: &dyn Fn(f64) -> f64, i: usize| errors.iter().flatten().map(|e| f(e[i])).sum::<f64>() / n;
        let usual: [f64; D] = std::array::from_fn(|i| mean(&f64::abs, i));
        let size = |e: &[f64; D]| e.iter().zip(&usual).map(|(e, m)| e.abs() - m).collect();
        let sizes: Rows = errors.iter().map(|b| b.iter().map(size).collect()).collect();
        // Excess kurtosis has variance 24 / n.
        let heavy = (0..D).map(|i| {
            let excess = mean(&|e| e.powi(4), i) / mean(&|e| e * e, i).powi(2).max(1e-300) - 3.0;
            if excess > 0.0 { chi_squared_above(n * excess * excess / 24.0, 1.0) } else { 1.0 }
        });
        let tails = (D as f64 * heavy.fold(1.0, f64::min)).min(1.0);
        Self { signed, sizes: portmanteau(&sizes, &sizes, LAGS, 0), tails }
    }

    /// The p-value of all being well, by Bonferroni. Tails count where the sensor's noise was estimated: an outlier is
    /// then taken for noise or for memory, as it comes; otherwise they do no harm to a linear map.
    pub(crate) fn p(&self, noise_was_fitted: bool) -> f64 {
        let least = self.signed.min(self.sizes);
        if noise_was_fitted { (3.0 * least.min(self.tails)).min(1.0) } else { (2.0 * least).min(1.0) }
    }
}

/// Whether the mean is the same in both halves of the record: the p-value of its being so, by the score test of a
/// step in b between the halves.
pub(crate) fn steady_mean<const D: usize>(series: &Series<D>, errors: &[Vec<[f64; D]>]) -> f64 {
    let n: usize = errors.iter().map(Vec::len).sum();
    let p = series.regressors();
    let mut rows = Vec::with_capacity(n * p);
    for (x, u) in series.bouts.iter().zip(&series.actions) {
        for k in 0..x.len().saturating_sub(1) {
            rows.extend_from_slice(&series.regressor(&x[k], &u[k])[..p]);
        }
    }
    let x = DMatrix::from_row_slice(n, p, &rows);
    let step = DVector::from_fn(n, |k, _| if 2 * k < n { -1.0 } else { 1.0 });
    let normal_equations = x.transpose() * &x + DMatrix::identity(p, p) * 1e-9;
    let Some(fit) = normal_equations.lu().solve(&(x.transpose() * &step)) else { return 1.0 };
    let own = step - &x * fit;
    let (mut score, mut cov) = (DVector::zeros(D), DMatrix::zeros(D, D));
    for (e, h) in errors.iter().flatten().zip(own.iter()) {
        let e = DVector::from_column_slice(e);
        score += &e * *h;
        cov += &e * e.transpose();
    }
    let cov = cov * (own.norm_squared() / n.saturating_sub(p).max(1) as f64) + DMatrix::identity(D, D) * 1e-12;
    let Some(solved) = cov.lu().solve(&score) else { return 1.0 };
    chi_squared_above(score.dot(&solved), D as f64)
}

/// The probability of a multiplier above one in the posterior of a flat prior (Kadane-type conjugate draws): the only
/// place where a gait may be unstable.
pub(crate) fn growing<const D: usize>(series: &Series<D>, rng: &mut ChaCha8Rng) -> f64 {
    const DRAWS: usize = 400;
    let p = series.regressors();
    let moments = Moments::of(series, &series.bouts);
    let (c, squares): ([[f64; D]; MOST], Mat<D>) = moments.least_squares(p);
    let factor = moments.factor(p);
    let dof = moments.n.saturating_sub(p).max(D) as f64;
    let mut above = 0;
    for _ in 0..DRAWS {
        let l = cholesky(&inverse_wishart(&squares, dof, rng));
        let mut columns = [[0.0; MOST]; D];
        for column in &mut columns {
            column[..p].iter_mut().for_each(|z| *z = normal(rng));
            backward_n(&factor, &mut column[..p], p);
        }
        let mut a = [[0.0; D]; D];
        for i in 0..D {
            for j in 0..D {
                a[i][j] = c[j][i] + (0..=i).map(|k| l[i][k] * columns[k][j]).sum::<f64>();
            }
        }
        above += usize::from(modes(&a)[0] > 1.0);
    }
    above as f64 / DRAWS as f64
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;
    use rand::SeedableRng;

    fn walk(a: f64, shift: f64, n: usize, seed: u64) -> Series<1> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut x = 0.0;
        let mut bout = Vec::new();
        for k in 0..n {
            x = a * x + normal(&mut rng);
            bout.push([x + if k > n / 2 { shift } else { 0.0 }]);
        }
        let mean = bout.iter().map(|x| x[0]).sum::<f64>() / n as f64;
        bout.iter_mut().for_each(|x| x[0] -= mean);
        Series { actions: vec![vec![[0.0; 6]; n]], bouts: vec![bout], m: 0 }
    }

    fn share(test: impl Fn(&Series<1>) -> f64, a: f64, shift: f64) -> f64 {
        let fails = (0..200).filter(|seed| test(&walk(a, shift, 100, *seed)) < 0.05).count();
        fails as f64 / 200.0
    }

    fn least_squares(series: &Series<1>) -> Model<1> {
        let m = Moments::of(series, &series.bouts);
        let (c, s) = m.least_squares(series.regressors());
        Model { c, q: [[s[0][0] / m.n as f64]], r: [0.0] }
    }

    #[test]
    fn checks_fire_one_time_in_twenty_without_cause_and_often_with_it() {
        let white = |s: &Series<1>| Whiteness::of(&innovations(s, &least_squares(s)), false).p(false);
        let steady = |s: &Series<1>| steady_mean(s, &innovations(s, &least_squares(s)));
        assert!((0.01..=0.10).contains(&share(white, 0.6, 0.0)), "{}", share(white, 0.6, 0.0));
        assert!((0.01..=0.10).contains(&share(steady, 0.6, 0.0)), "{}", share(steady, 0.6, 0.0));
        assert!(share(steady, 0.3, 3.0) > 0.6, "{}", share(steady, 0.3, 3.0));
        assert!((0.01..=0.10).contains(&share(excited, 0.0, 0.0)));
        assert!(share(excited, 0.8, 0.0) > 0.95);
    }

    #[test]
    fn growth_is_seen_where_there_is_growth() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        assert!(growing(&walk(1.05, 0.0, 60, 1), &mut rng) > 0.5);
        assert!(growing(&walk(0.5, 0.0, 60, 1), &mut rng) < 0.01);
    }
}
