//! Linear algebra of matrices whose size is known when the program is built: a gait has one to five states, and a
//! sampler that allocates spends its time there.

use nalgebra::DMatrix;
use rand::Rng;
use rand_distr::{Distribution, Gamma, StandardNormal};

/// A square matrix, by rows.
pub(crate) type Mat<const D: usize> = [[f64; D]; D];
/// A vector.
pub(crate) type Vector<const D: usize> = [f64; D];

/// The least pivot of a factor: what rounding makes of zero.
const LEAST_PIVOT: f64 = 1e-14;

pub(crate) fn identity<const D: usize>(scale: f64) -> Mat<D> {
    let mut m = [[0.0; D]; D];
    for (i, row) in m.iter_mut().enumerate() {
        row[i] = scale;
    }
    m
}

pub(crate) fn times<const D: usize>(a: &Mat<D>, b: &Mat<D>) -> Mat<D> {
    let mut out = [[0.0; D]; D];
    for i in 0..D {
        for k in 0..D {
            let t = a[i][k];
            for j in 0..D {
                out[i][j] += t * b[k][j];
            }
        }
    }
    out
}

/// `A B'`.
pub(crate) fn times_transposed<const D: usize>(a: &Mat<D>, b: &Mat<D>) -> Mat<D> {
    let mut out = [[0.0; D]; D];
    for i in 0..D {
        for j in 0..D {
            out[i][j] = (0..D).map(|k| a[i][k] * b[j][k]).sum();
        }
    }
    out
}

pub(crate) fn apply<const D: usize>(a: &Mat<D>, x: &Vector<D>) -> Vector<D> {
    let mut out = [0.0; D];
    for i in 0..D {
        out[i] = (0..D).map(|k| a[i][k] * x[k]).sum();
    }
    out
}

/// The lower Cholesky factor; pivots of zero are lifted to rounding.
pub(crate) fn cholesky<const D: usize>(a: &Mat<D>) -> Mat<D> {
    let mut l = [[0.0; D]; D];
    for i in 0..D {
        for j in 0..=i {
            let mut t = a[i][j];
            for k in 0..j {
                t -= l[i][k] * l[j][k];
            }
            l[i][j] = if i == j { t.max(LEAST_PIVOT).sqrt() } else { t / l[j][j] };
        }
    }
    l
}

/// Solves `L z = b`.
pub(crate) fn forward<const D: usize>(l: &Mat<D>, mut b: Vector<D>) -> Vector<D> {
    for i in 0..D {
        for k in 0..i {
            b[i] -= l[i][k] * b[k];
        }
        b[i] /= l[i][i];
    }
    b
}

/// Solves `L' z = b`.
pub(crate) fn backward<const D: usize>(l: &Mat<D>, mut b: Vector<D>) -> Vector<D> {
    for i in (0..D).rev() {
        for k in i + 1..D {
            b[i] -= l[k][i] * b[k];
        }
        b[i] /= l[i][i];
    }
    b
}

/// The inverse of a positive definite matrix.
pub(crate) fn inverse<const D: usize>(a: &Mat<D>) -> Mat<D> {
    let l = cholesky(a);
    let mut out = [[0.0; D]; D];
    for c in 0..D {
        let mut e = [0.0; D];
        e[c] = 1.0;
        let column = backward(&l, forward(&l, e));
        for i in 0..D {
            out[i][c] = column[i];
        }
    }
    out
}

/// `log |A|` of a positive definite matrix.
pub(crate) fn log_det<const D: usize>(a: &Mat<D>) -> f64 {
    let l = cholesky(a);
    (0..D).map(|i| 2.0 * l[i][i].ln()).sum()
}

/// `log N(x; mean, S)` up to a constant, of the factor of S.
pub(crate) fn log_normal<const D: usize>(x: &Vector<D>, mean: &Vector<D>, factor: &Mat<D>) -> f64 {
    let mut e = [0.0; D];
    for i in 0..D {
        e[i] = x[i] - mean[i];
    }
    let z = forward(factor, e);
    (0..D).map(|i| -0.5 * z[i] * z[i] - factor[i][i].ln()).sum()
}

/// Solves `S = A S A' + Q` by doubling; `None` where A is not stable.
pub(crate) fn stationary<const D: usize>(a: &Mat<D>, q: &Mat<D>) -> Option<Mat<D>> {
    const DOUBLINGS: usize = 16;
    if D == 1 {
        return (a[0][0].abs() < 1.0 - 1e-6).then(|| identity(q[0][0] / (1.0 - a[0][0] * a[0][0])));
    }
    let (mut s, mut m) = (*q, *a);
    for _ in 0..DOUBLINGS {
        let more = times_transposed(&times(&m, &s), &m);
        let (mut change, mut size) = (0.0_f64, 0.0_f64);
        for i in 0..D {
            for j in 0..D {
                s[i][j] += more[i][j];
            }
            change = change.max(more[i][i].abs());
            size = size.max(s[i][i].abs());
        }
        if size.is_nan() || size >= 1e12 {
            return None;
        }
        if change < 1e-10 * size {
            return Some(s);
        }
        m = times(&m, &m);
    }
    None
}

/// `log |det (I - A)|` and `(I - A)⁻¹ b`, by elimination with pivots.
pub(crate) fn fixed_point<const D: usize>(a: &Mat<D>, b: &Vector<D>) -> (f64, Vector<D>) {
    let mut m = identity::<D>(1.0);
    let mut x = *b;
    for i in 0..D {
        for j in 0..D {
            m[i][j] -= a[i][j];
        }
    }
    let mut log_det = 0.0;
    for c in 0..D {
        let pivot = (c..D).max_by(|i, j| m[*i][c].abs().total_cmp(&m[*j][c].abs())).unwrap_or(c);
        m.swap(pivot, c);
        x.swap(pivot, c);
        log_det += (m[c][c].abs() + 1e-300).ln();
        for i in c + 1..D {
            let f = m[i][c] / m[c][c];
            for j in c..D {
                m[i][j] -= f * m[c][j];
            }
            x[i] -= f * x[c];
        }
    }
    for i in (0..D).rev() {
        for j in i + 1..D {
            x[i] -= m[i][j] * x[j];
        }
        x[i] /= m[i][i];
    }
    (log_det, x)
}

/// A draw of Gamma(shape, 1).
pub(crate) fn gamma(shape: f64, rng: &mut impl Rng) -> f64 {
    Gamma::new(shape, 1.0).map_or(shape, |g| g.sample(rng))
}

pub(crate) fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A draw of the inverse Wishart distribution with scale S and `dof` degrees of freedom, by Bartlett's factor.
pub(crate) fn inverse_wishart<const D: usize>(s: &Mat<D>, dof: f64, rng: &mut impl Rng) -> Mat<D> {
    let l = cholesky(s);
    let mut t = [[0.0; D]; D];
    for i in 0..D {
        t[i][i] = (2.0 * gamma(0.5 * (dof - i as f64), rng)).sqrt();
        for j in 0..i {
            t[i][j] = normal(rng);
        }
    }
    // Rows of L, through T: Q = (T⁻¹ L')' (T⁻¹ L').
    let mut m = [[0.0; D]; D];
    for c in 0..D {
        let mut row = [0.0; D];
        row[..=c].copy_from_slice(&l[c][..=c]);
        m[c] = forward(&t, row);
    }
    times_transposed(&m, &m)
}

/// Real and imaginary parts of the eigenvalues.
pub(crate) fn eigenvalues<const D: usize>(a: &Mat<D>) -> Vec<[f64; 2]> {
    let found = DMatrix::from_fn(D, D, |i, j| a[i][j]).complex_eigenvalues();
    found.iter().map(|z| [z.re, z.im]).collect()
}

/// Largest modulus, largest real part and smallest real part of the eigenvalues.
pub(crate) fn modes<const D: usize>(a: &Mat<D>) -> [f64; 3] {
    match D {
        1 => [a[0][0].abs(), a[0][0], a[0][0]],
        2 => {
            let (half_trace, det) = (0.5 * (a[0][0] + a[1][1]), a[0][0] * a[1][1] - a[0][1] * a[1][0]);
            let discriminant = half_trace * half_trace - det;
            if discriminant < 0.0 {
                return [det.max(0.0).sqrt(), half_trace, half_trace];
            }
            let root = discriminant.sqrt();
            [half_trace.abs() + root, half_trace + root, half_trace - root]
        }
        _ => eigenvalues(a).iter().fold([0.0, f64::NEG_INFINITY, f64::INFINITY], |[rho, slow, flip], [re, im]| {
            [rho.max(re.hypot(*im)), slow.max(*re), flip.min(*re)]
        }),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_stationary_covariance_solves_its_equation() {
        let a = [[0.6, 0.3, 0.1], [-0.25, 0.7, 0.0], [0.2, -0.1, -0.5]];
        let q = [[1.0, 0.3, 0.0], [0.3, 2.0, 0.1], [0.0, 0.1, 0.5]];
        let s = stationary(&a, &q).unwrap();
        let again = times_transposed(&times(&a, &s), &a);
        for i in 0..3 {
            for j in 0..3 {
                assert!((s[i][j] - again[i][j] - q[i][j]).abs() < 1e-9);
            }
        }
        assert!(stationary(&[[1.01, 0.0], [0.0, 0.2]], &identity(1.0)).is_none());
    }

    #[test]
    fn fixed_point_modes_and_determinant_of_a_known_map() {
        let a = [[0.5, 0.0, 0.0], [0.0, 0.0, -0.8], [0.0, 0.8, 0.0]];
        let (log_det, x) = fixed_point(&a, &[1.0, 1.64, 0.0]);
        assert!((log_det - (0.5_f64 * 1.64).ln()).abs() < 1e-12);
        assert!((x[0] - 2.0).abs() < 1e-12 && (x[1] - 1.0).abs() < 1e-12 && (x[2] - 0.8).abs() < 1e-12);
        let [rho, slow, flip] = modes(&a);
        assert!((rho - 0.8).abs() < 1e-12 && (slow - 0.5).abs() < 1e-12 && flip.abs() < 1e-12);
        assert!((modes(&[[0.2, 0.5], [0.5, 0.2]])[2] + 0.3).abs() < 1e-12);
    }

    #[test]
    fn the_mean_of_the_inverse_wishart_is_its_scale_over_dof_less_d_and_1() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let s = [[2.0, 0.6], [0.6, 1.0]];
        let (n, mut mean) = (40_000, [[0.0; 2]; 2]);
        for _ in 0..n {
            let q = inverse_wishart(&s, 12.0, &mut rng);
            for i in 0..2 {
                for j in 0..2 {
                    mean[i][j] += q[i][j] / f64::from(n);
                }
            }
        }
        // E = S / (12 - 3); the standard error of an entry is below 0.001.
        for i in 0..2 {
            for j in 0..2 {
                assert!((mean[i][j] - s[i][j] / 9.0).abs() < 0.004, "{mean:?}");
            }
        }
    }
}
