//! Products and distances of one point with all, many at a time.

use pulp::{Arch, Simd, WithSimd};

use crate::vector::exp;

/// Products of all pairs of points in one group.
pub struct Gram {
    pub along: Vec<f64>,
    pub far: Vec<f64>,
}

/// Squared distances and products between one point and all, group by group.
pub struct Seen<'a> {
    pub columns: &'a [f64],
    pub stride: usize,
    pub z: &'a [f64],
    pub along: &'a mut [f64],
    pub far: &'a mut [f64],
}

impl WithSimd for Seen<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (along, _) = S::as_mut_simd_f64s(self.along);
        let (far, _) = S::as_mut_simd_f64s(self.far);
        let zero = simd.splat_f64s(0.0);
        along.fill(zero);
        far.fill(zero);
        for (row, z) in self.columns.chunks_exact(self.stride).zip(self.z) {
            let (row, _) = S::as_simd_f64s(row);
            let z = simd.splat_f64s(*z);
            for ((along, far), x) in along.iter_mut().zip(far.iter_mut()).zip(row) {
                let d = simd.sub_f64s(*x, z);
                *along = simd.mul_add_e_f64s(*x, z, *along);
                *far = simd.mul_add_e_f64s(d, d, *far);
            }
        }
    }
}

/// `s² exp(−far₀ w₀ − far₁ w₁)` for all points.
pub struct Bent<'a> {
    pub far: [&'a [f64]; 2],
    pub weights: [f64; 2],
    pub variance: f64,
    pub out: &'a mut [f64],
}

impl WithSimd for Bent<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (out, _) = S::as_mut_simd_f64s(self.out);
        let (first, _) = S::as_simd_f64s(self.far[0]);
        let (second, _) = S::as_simd_f64s(self.far[1]);
        let [w0, w1] = self.weights.map(|w| simd.splat_f64s(-w));
        let variance = simd.splat_f64s(self.variance);
        for ((out, a), b) in out.iter_mut().zip(first).zip(second) {
            let argument = simd.mul_add_e_f64s(*a, w0, simd.mul_f64s(*b, w1));
            *out = simd.mul_f64s(variance, exp(simd, argument));
        }
    }
}

/// `a · b`, for slices of the same padded length.
pub struct Dot<'a>(pub &'a [f64], pub &'a [f64]);

impl WithSimd for Dot<'_> {
    type Output = f64;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (a, _) = S::as_simd_f64s(self.0);
        let (b, _) = S::as_simd_f64s(self.1);
        let mut sums = [simd.splat_f64s(0.0); 2];
        for (i, (a, b)) in a.iter().zip(b).enumerate() {
            sums[i % 2] = simd.mul_add_e_f64s(*a, *b, sums[i % 2]);
        }
        simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]))
    }
}

impl Gram {
    pub fn of(columns: &[f64], stride: usize, n: usize, arch: Arch) -> Self {
        let (mut along, mut far) = (vec![0.0; n * stride], vec![0.0; n * stride]);
        let dims = columns.len() / stride;
        for j in 0..n {
            let z: Vec<f64> = (0..dims).map(|d| columns[d * stride + j]).collect();
            let (along, far) = (&mut along[j * stride..(j + 1) * stride], &mut far[j * stride..(j + 1) * stride]);
            arch.dispatch(Seen { columns, stride, z: &z, along, far });
        }
        Self { along, far }
    }
}
