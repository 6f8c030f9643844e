//! Columns of `K_uf`, and the sums over them that gradients need, by vectors.

use pulp::{Simd, WithSimd};

use crate::aligned::Aligned;
use crate::kernel::Profile;

/// Sums over all points of `Q = ∂F/∂K_uf ∘ h` that the gradients need.
pub(super) struct CrossSums {
    /// `Σᵢ Q_mi`.
    pub(super) zeroth: Aligned,
    /// `Σᵢ Q_mi xᵢ_d`, one padded row a dimension.
    pub(super) first: Aligned,
    /// `Σ_mi Q_mi xᵢ_d²`.
    pub(super) second: Vec<f64>,
}

impl CrossSums {
    pub(super) fn new(stride: usize, dims: usize) -> Self {
        Self { zeroth: Aligned::zeros(stride), first: Aligned::zeros(dims * stride), second: vec![0.0; dims] }
    }
}

/// Fills columns of `K_uf` and their slopes; rows from `m` on are zero.
pub(super) struct Cross<'a, P> {
    pub(super) profile: P,
    pub(super) signal_variance: f64,
    pub(super) z: &'a [f64],
    pub(super) m: usize,
    pub(super) stride: usize,
    pub(super) x: &'a [f64],
    pub(super) scales: &'a [f64],
    pub(super) covariance: &'a mut [f64],
    pub(super) slopes: &'a mut [f64],
}

impl<P: Profile> WithSimd for Cross<'_, P> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { profile, signal_variance, z, m, stride, x, scales, covariance, slopes } = self;
        let scale = simd.splat_f64s(signal_variance);
        let columns = covariance.chunks_exact_mut(stride).zip(slopes.chunks_exact_mut(stride));
        for (x, (covariance, slopes)) in x.chunks_exact(scales.len()).zip(columns) {
            {
                let (k, _) = S::as_mut_simd_f64s(covariance);
                let (h, _) = S::as_mut_simd_f64s(slopes);
                for (v, (k, h)) in k.iter_mut().zip(h).enumerate() {
                    let mut q = simd.splat_f64s(0.0);
                    for ((row, x), scale) in z.chunks_exact(stride).zip(x).zip(scales) {
                        let (row, _) = S::as_simd_f64s(row);
                        let difference = simd.sub_f64s(row[v], simd.splat_f64s(x / scale));
                        q = simd.mul_add_e_f64s(difference, difference, q);
                    }
                    let (value, slope) = profile.value_and_slope(simd, q);
                    *k = simd.mul_f64s(value, scale);
                    *h = simd.mul_f64s(slope, scale);
                }
            }
            covariance[m..].fill(0.0);
            slopes[m..].fill(0.0);
        }
    }
}

/// Adds columns of points to [`CrossSums`].
pub(super) struct CrossGradient<'a> {
    pub(super) stride: usize,
    pub(super) dims: usize,
    /// `∂F/∂K_uf` without its outer product `weights residualsᵀ`.
    pub(super) by_cross: &'a [f64],
    pub(super) slopes: &'a [f64],
    pub(super) weights: &'a [f64],
    pub(super) residuals: &'a [f64],
    pub(super) x: &'a [f64],
    pub(super) scales: &'a [f64],
    pub(super) sums: &'a mut CrossSums,
}

impl WithSimd for CrossGradient<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { stride, dims, by_cross, slopes, weights, residuals, x, scales, sums } = self;
        let (weights, _) = S::as_simd_f64s(weights);
        let columns = by_cross.chunks_exact(stride).zip(slopes.chunks_exact(stride));
        for ((x, residual), (by_cross, slopes)) in x.chunks_exact(dims).zip(residuals).zip(columns) {
            let (g, _) = S::as_simd_f64s(by_cross);
            let (h, _) = S::as_simd_f64s(slopes);
            let (zeroth, _) = S::as_mut_simd_f64s(&mut sums.zeroth);
            let residual = simd.splat_f64s(*residual);
            let mut total = simd.splat_f64s(0.0);
            for v in 0..g.len() {
                let q = simd.mul_f64s(simd.mul_add_e_f64s(weights[v], residual, g[v]), h[v]);
                zeroth[v] = simd.add_f64s(zeroth[v], q);
                total = simd.add_f64s(total, q);
                for d in 0..dims {
                    let (first, _) = S::as_mut_simd_f64s(&mut sums.first[d * stride..(d + 1) * stride]);
                    first[v] = simd.mul_add_e_f64s(q, simd.splat_f64s(x[d] / scales[d]), first[v]);
                }
            }
            let total = simd.reduce_sum_f64s(total);
            for d in 0..dims {
                sums.second[d] += total * (x[d] / scales[d]).powi(2);
            }
        }
    }
}
