//! A linear stride map with sensor noise, a record of it, and least squares.

use crate::small::{Mat, Vector};

/// Most actions that a record may have.
pub(crate) const MOST_ACTIONS: usize = 6;
/// Most regressors of a component: states, actions, one.
pub(crate) const MOST: usize = 12;
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

/// Sums over pairs of successive states.
pub(crate) struct Moments<const D: usize> {
    pub xx: [[f64; MOST]; MOST],
    pub xy: [[f64; D]; MOST],
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
    pub(crate) fn residuals(&self, c: &[[f64; D]; MOST], p: usize) -> Mat<D> {
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
pub(crate) fn cholesky_n(h: &mut [f64], n: usize) {
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

pub(crate) fn forward_n(l: &[f64], b: &mut [f64], n: usize) {
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
