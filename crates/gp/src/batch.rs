//! Predictions eight at a time: the inverse factor is read once for eight queries, from registers.
//!
//! `k*` of eight queries is kept point by point, eight numbers a point, so that a tile of 8 rows
//! by eight queries of `L⁻¹ k*` is a sum of outer products.

use pulp::{Simd, WithSimd};

use crate::gp::Gp;
use crate::kernel::Profile;
use crate::vector::PANEL;

/// Queries in a group.
pub(crate) const GROUP: usize = 8;

/// `(k*ᵀα, |L⁻¹k*|²)` for a group of queries.
pub(crate) struct GroupMoments<'a, P> {
    pub(crate) profile: P,
    pub(crate) gp: &'a Gp,
    /// Scaled queries, eight numbers a dimension.
    pub(crate) z: &'a [f64],
    /// Room for `k*`, eight numbers a training point.
    pub(crate) k: &'a mut [f64],
}

impl<P: Profile> WithSimd for GroupMoments<'_, P> {
    type Output = ([f64; GROUP], [f64; GROUP]);
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> Self::Output {
        let mean = self.covariances(simd);
        let explained = match S::F64_LANES {
            8 => self.norms::<S, 1, 8>(simd),
            4 => self.norms::<S, 2, 4>(simd),
            2 => self.norms::<S, 4, 2>(simd),
            _ => self.norms::<S, 8, 1>(simd),
        };
        (mean, explained)
    }
}

impl<P: Profile> GroupMoments<'_, P> {
    /// Fills `k` and returns `k*ᵀα`.
    #[inline(always)]
    fn covariances<S: Simd>(&mut self, simd: S) -> [f64; GROUP] {
        let gp = self.gp;
        let scale = simd.splat_f64s(gp.hyperparameters.signal_variance);
        let mut mean = [0.0; GROUP];
        let (sums, _) = S::as_mut_simd_f64s(&mut mean);
        for (i, k) in self.k.chunks_exact_mut(GROUP).take(gp.y.len()).enumerate() {
            let (k, _) = S::as_mut_simd_f64s(k);
            let alpha = simd.splat_f64s(gp.alpha[i]);
            for (v, (k, sum)) in k.iter_mut().zip(sums.iter_mut()).enumerate() {
                let mut q = simd.splat_f64s(0.0);
                for (row, z) in gp.z.chunks_exact(gp.stride).zip(self.z.chunks_exact(GROUP)) {
                    let (z, _) = S::as_simd_f64s(z);
                    let difference = simd.sub_f64s(z[v], simd.splat_f64s(row[i]));
                    q = simd.mul_add_e_f64s(difference, difference, q);
                }
                *k = simd.mul_f64s(self.profile.value(simd, q), scale);
                *sum = simd.mul_add_e_f64s(*k, alpha, *sum);
            }
        }
        mean
    }

    /// `|L⁻¹k*|²`, in tiles of 8 rows (`VECTORS` vectors) by `QUERIES` queries.
    #[inline(always)]
    fn norms<S: Simd, const VECTORS: usize, const QUERIES: usize>(&self, simd: S) -> [f64; GROUP] {
        let zero = simd.splat_f64s(0.0);
        let mut norms = [0.0; GROUP];
        for panel in self.gp.factor.panels() {
            let (m, _) = S::as_simd_f64s(panel);
            for first in (0..GROUP).step_by(QUERIES) {
                let mut tile = [[zero; VECTORS]; QUERIES];
                for (m, k) in m.chunks_exact(VECTORS).zip(self.k.chunks_exact(GROUP)) {
                    let k = &k[first..first + QUERIES];
                    for q in 0..QUERIES {
                        let k = simd.splat_f64s(k[q]);
                        for v in 0..VECTORS {
                            tile[q][v] = simd.mul_add_e_f64s(m[v], k, tile[q][v]);
                        }
                    }
                }
                for q in 0..QUERIES {
                    let mut sum = zero;
                    for v in 0..VECTORS {
                        sum = simd.mul_add_e_f64s(tile[q][v], tile[q][v], sum);
                    }
                    norms[first + q] += simd.reduce_sum_f64s(sum);
                }
            }
        }
        norms
    }
}

const _: () = assert!(PANEL.is_multiple_of(GROUP));
