//! The inverse Cholesky factor `M = L⁻¹`, stored for one thing: `M k` as fast as memory allows.
//!
//! ```text
//! panel p: rows 8p … 8p+7, columns 0 … min(8(p+1), N) − 1, column by column
//! ```
//!
//! Half the memory of a square, every access a whole vector, and no solve (a chain of `N`
//! dependent divisions) in a prediction. Rows past `N` are zero.

use pulp::{Simd, WithSimd};

use crate::aligned::Aligned;
use crate::vector::{PANEL, padded};

/// `L⁻¹` of an `n × n` covariance in panels of 8 rows.
#[derive(Clone, Debug)]
pub(crate) struct InverseFactor {
    n: usize,
    data: Aligned,
}

/// Where panel `p` starts: the panels before it have 8, 16, … 8p columns.
const fn offset(p: usize) -> usize {
    PANEL * PANEL * p * (p + 1) / 2
}

impl InverseFactor {
    /// The factor of no points.
    pub(crate) fn empty() -> Self {
        Self { n: 0, data: Aligned::zeros(0) }
    }

    /// Packs the lower triangle of a column-major matrix.
    pub(crate) fn from_column_major(inverse: &[f64], n: usize, stride: usize) -> Self {
        let mut packed = Self { n, data: Aligned::zeros(Self::entries(n)) };
        for p in 0..n.div_ceil(PANEL) {
            let rows = PANEL.min(n - p * PANEL);
            for j in 0..packed.columns(p) {
                for r in 0..rows {
                    let i = p * PANEL + r;
                    if i >= j {
                        packed.data[offset(p) + j * PANEL + r] = inverse[j * stride + i];
                    }
                }
            }
        }
        packed
    }

    /// Entries of the packed form, padding included.
    fn entries(n: usize) -> usize {
        match n.div_ceil(PANEL) {
            0 => 0,
            panels => offset(panels - 1) + PANEL * n,
        }
    }

    fn columns(&self, p: usize) -> usize {
        (PANEL * (p + 1)).min(self.n)
    }

    fn index(i: usize, j: usize) -> usize {
        offset(i / PANEL) + j * PANEL + i % PANEL
    }

    /// Entry `(i, j)` with `j ≤ i`.
    pub(crate) fn at(&self, i: usize, j: usize) -> f64 {
        self.data[Self::index(i, j)]
    }

    /// `Σ log Mᵢᵢ = −½ log|K|`.
    pub(crate) fn log_det(&self) -> f64 {
        (0..self.n).map(|i| self.at(i, i).ln()).sum()
    }

    /// `out = M v`, both padded.
    pub(crate) fn product(&self, v: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for p in 0..self.n.div_ceil(PANEL) {
            let out = &mut out[p * PANEL..(p + 1) * PANEL];
            for j in 0..self.columns(p) {
                let column = &self.data[offset(p) + j * PANEL..][..PANEL];
                for (out, m) in out.iter_mut().zip(column) {
                    *out += m * v[j];
                }
            }
        }
    }

    /// `out = Mᵀ v`, both padded.
    pub(crate) fn transposed_product(&self, v: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for p in 0..self.n.div_ceil(PANEL) {
            let v = &v[p * PANEL..(p + 1) * PANEL];
            for j in 0..self.columns(p) {
                let column = &self.data[offset(p) + j * PANEL..][..PANEL];
                out[j] += column.iter().zip(v).map(|(m, v)| m * v).sum::<f64>();
            }
        }
    }

    /// Diagonal of `K⁻¹ = Mᵀ M`, shape `(N,)`.
    pub(crate) fn inverse_diagonal(&self) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.n];
        for p in 0..self.n.div_ceil(PANEL) {
            for (j, out) in diagonal.iter_mut().enumerate().take(self.columns(p)) {
                let column = &self.data[offset(p) + j * PANEL..][..PANEL];
                *out += column.iter().map(|m| m * m).sum::<f64>();
            }
        }
        diagonal
    }

    /// Appends the row `(row, pivot)`, with `row` of length `N`.
    pub(crate) fn push_row(&mut self, row: &[f64], pivot: f64) {
        let i = self.n;
        self.n += 1;
        // A new panel brings all its columns, an old one only the new one.
        self.data = Aligned::zeros_with(Self::entries(self.n), &self.data);
        for (j, value) in row.iter().enumerate() {
            self.data[Self::index(i, j)] = *value;
        }
        self.data[Self::index(i, i)] = pivot;
    }

    /// The factor of the covariance without point `index`.
    ///
    /// Rotations of neighbouring rows (`Qᵀ M`, which leaves `Mᵀ M` alone) empty column `index` but
    /// for the last row; that row and that column then go.
    pub(crate) fn without(&self, index: usize) -> Self {
        let n = self.n;
        let mut rows: Vec<Vec<f64>> =
            (index..n).map(|i| (0..n).map(|j| if j <= i { self.at(i, j) } else { 0.0 }).collect()).collect();
        for r in 0..rows.len() - 1 {
            let (upper, lower) = rows.split_at_mut(r + 1);
            let (upper, lower) = (&mut upper[r], &mut lower[0]);
            let (a, b) = (upper[index], lower[index]);
            let length = a.hypot(b);
            let (cos, sin) = (b / length, a / length);
            for (u, l) in upper.iter_mut().zip(lower.iter_mut()).take(index + r + 2) {
                (*u, *l) = (cos * *u - sin * *l, sin * *u + cos * *l);
            }
            // The factor's diagonal is positive by convention.
            if upper[index + r + 1] < 0.0 {
                upper.iter_mut().for_each(|u| *u = -*u);
            }
        }
        let mut smaller = Self { n: n - 1, data: Aligned::zeros(Self::entries(n - 1)) };
        for i in 0..n - 1 {
            for j in 0..=i {
                let source = if j < index { j } else { j + 1 };
                let value = if i < index { self.at(i, source) } else { rows[i - index][source] };
                smaller.data[Self::index(i, j)] = value;
            }
        }
        smaller
    }

    /// The panels from top to bottom, each column by column, 8 entries a column.
    #[inline(always)]
    pub(crate) fn panels(&self) -> impl Iterator<Item = &[f64]> {
        let mut rest = &self.data[..];
        (0..padded(self.n) / PANEL).map(move |p| {
            let (panel, below) = rest.split_at(self.columns(p) * PANEL);
            rest = below;
            panel
        })
    }

    /// The packed entries, for files.
    pub(crate) fn entries_slice(&self) -> &[f64] {
        &self.data
    }

    /// The factor from its packed entries; `None` if their number is not that of `n` rows.
    pub(crate) fn from_entries(n: usize, data: &[f64]) -> Option<Self> {
        (data.len() == Self::entries(n)).then(|| Self { n, data: Aligned::from_slice(data) })
    }
}

/// `|M k|²` for `k` of padded length.
pub(crate) struct NormSquared<'a> {
    pub(crate) factor: &'a InverseFactor,
    pub(crate) k: &'a [f64],
}

impl WithSimd for NormSquared<'_> {
    type Output = f64;
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        match S::F64_LANES {
            8 => self.run::<S, 1, 8>(simd),
            4 => self.run::<S, 2, 4>(simd),
            2 => self.run::<S, 4, 2>(simd),
            _ => self.run::<S, 8, 1>(simd),
        }
    }
}

impl NormSquared<'_> {
    /// `VECTORS` vectors make a column of a panel; `CHAINS` columns are summed apart, so that
    /// additions need not wait for each other.
    #[inline(always)]
    fn run<S: Simd, const VECTORS: usize, const CHAINS: usize>(self, simd: S) -> f64 {
        let zero = simd.splat_f64s(0.0);
        let mut total = zero;
        for this in self.factor.panels() {
            let columns = this.len() / PANEL;
            let mut sums = [[zero; VECTORS]; CHAINS];
            let k = &self.k[..columns];
            let quads = k.chunks_exact(CHAINS);
            let tail = quads.remainder();
            let mut blocks = this.chunks_exact(CHAINS * PANEL);
            for (k, block) in quads.zip(&mut blocks) {
                let (m, _) = S::as_simd_f64s(block);
                let m = &m[..CHAINS * VECTORS];
                for c in 0..CHAINS {
                    let k = simd.splat_f64s(k[c]);
                    for v in 0..VECTORS {
                        sums[c][v] = simd.mul_add_e_f64s(m[c * VECTORS + v], k, sums[c][v]);
                    }
                }
            }
            for (k, block) in tail.iter().zip(blocks.remainder().chunks_exact(PANEL)) {
                let (m, _) = S::as_simd_f64s(block);
                let k = simd.splat_f64s(*k);
                for v in 0..VECTORS {
                    sums[0][v] = simd.mul_add_e_f64s(m[v], k, sums[0][v]);
                }
            }
            for v in 0..VECTORS {
                let mut sum = sums[0][v];
                for chain in &sums[1..] {
                    sum = simd.add_f64s(sum, chain[v]);
                }
                total = simd.mul_add_e_f64s(sum, sum, total);
            }
        }
        simd.reduce_sum_f64s(total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lower(n: usize) -> Vec<f64> {
        let stride = padded(n);
        let mut m = vec![0.0; stride * stride];
        for j in 0..n {
            for i in j..n {
                m[j * stride + i] = if i == j { 1.5 } else { ((i * 7 + j * 3) as f64).sin() * 0.1 };
            }
        }
        m
    }

    #[test]
    fn products_agree_with_the_definition_at_every_remainder() {
        for n in [1, 2, 15, 16, 17, 31, 32, 33, 50] {
            let (m, stride) = (lower(n), padded(n));
            let packed = InverseFactor::from_column_major(&m, n, stride);
            let mut k = vec![0.0; stride];
            (0..n).for_each(|i| k[i] = (i as f64).cos());
            let expected: Vec<f64> = (0..n).map(|i| (0..=i).map(|j| m[j * stride + i] * k[j]).sum()).collect();
            let mut product = vec![0.0; stride];
            packed.product(&k, &mut product);
            for i in 0..n {
                assert!((product[i] - expected[i]).abs() < 1e-13);
            }
            let norm: f64 = expected.iter().map(|v| v * v).sum();
            assert!((pulp::Arch::new().dispatch(NormSquared { factor: &packed, k: &k }) - norm).abs() < 1e-12 * norm);
            assert!(
                (Simd::vectorize(pulp::Scalar, NormSquared { factor: &packed, k: &k }) - norm).abs() < 1e-12 * norm
            );
            let mut back = vec![0.0; stride];
            packed.transposed_product(&product, &mut back);
            let quadratic: f64 = back.iter().zip(&k).map(|(a, b)| a * b).sum();
            assert!((quadratic - norm).abs() < 1e-12 * norm);
        }
    }

    #[test]
    fn rows_are_pushed_as_they_would_have_been_packed() {
        let (m, stride) = (lower(40), padded(40));
        let whole = InverseFactor::from_column_major(&m, 40, stride);
        let mut grown = InverseFactor::from_column_major(&m, 1, stride);
        for i in 1..40 {
            let row: Vec<f64> = (0..i).map(|j| whole.at(i, j)).collect();
            grown.push_row(&row, whole.at(i, i));
        }
        assert_eq!(grown.data[..], whole.data[..]);
    }
}
