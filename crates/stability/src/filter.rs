//! The Kalman filter and smoother of a record, without the data.

use crate::small::{Mat, Vector, backward, cholesky, forward, times, times_transposed};

/// The filter's gains, which do not depend on the data: they settle within a few strides and are then used again.
#[derive(Default)]
pub(crate) struct Filter<const D: usize> {
    /// Gains of the components' scalar updates.
    pub gains: Vec<Mat<D>>,
    pub filtered: Vec<Mat<D>>,
    /// Smoother gain and factor of the covariance of x(k) given x(k+1).
    pub smooth: Vec<(Mat<D>, Mat<D>)>,
    pub means: Vec<Vector<D>>,
}

impl<const D: usize> Filter<D> {
    /// Gains for a stretch of `n` states.
    pub(crate) fn prepare(&mut self, n: usize, start: &Mat<D>, a: &Mat<D>, q: &Mat<D>, r: &Vector<D>) {
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
