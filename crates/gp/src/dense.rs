//! Dense symmetric arithmetic on column-major buffers: the only file that speaks to `faer`.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};
use pulp::Simd;

use crate::vector::PANEL;

/// One thread always: results must not depend on how many there are.
const PAR: Par = Par::Seq;

/// Scratch memory for factorising and inverting matrices of one size.
pub(crate) struct DenseScratch {
    memory: MemBuffer,
}

impl DenseScratch {
    /// Scratch for `n × n` matrices.
    pub(crate) fn new(n: usize) -> Self {
        let factor = llt::factor::cholesky_in_place_scratch::<f64>(n, PAR, Default::default());
        let inverse = llt::inverse::inverse_scratch::<f64>(n, PAR);
        Self { memory: MemBuffer::new(factor.or(inverse)) }
    }
}

/// Replaces the lower triangle of `a` (`n × n`, column stride `stride`) by its Cholesky factor.
///
/// `Err(row)` if the pivot of that row is not positive.
pub(crate) fn cholesky(a: &mut [f64], n: usize, stride: usize, scratch: &mut DenseScratch) -> Result<(), usize> {
    let matrix = MatMut::from_column_major_slice_with_stride_mut(a, n, n, stride);
    let stack = MemStack::new(&mut scratch.memory);
    llt::factor::cholesky_in_place(matrix, Default::default(), PAR, stack, Default::default()).map(|_| ()).map_err(
        |error| match error {
            llt::factor::LltError::NonPositivePivot { index } => index,
        },
    )?;
    // The factorisation compares pivots with zero, which a NaN survives.
    match (0..n).find(|&i| !(a[i * stride + i] > 0.0 && a[i * stride + i].is_finite())) {
        None => Ok(()),
        Some(row) => Err(row),
    }
}

/// Lower triangle of `(L Lᵀ)⁻¹` from the factor `L`.
pub(crate) fn inverse_from_factor(
    factor: &[f64],
    inverse: &mut [f64],
    n: usize,
    stride: usize,
    scratch: &mut DenseScratch,
) {
    let factor = MatRef::from_column_major_slice_with_stride(factor, n, n, stride);
    let inverse = MatMut::from_column_major_slice_with_stride_mut(inverse, n, n, stride);
    llt::inverse::inverse(inverse, factor, PAR, MemStack::new(&mut scratch.memory));
}

/// Lower triangle of `L⁻¹`.
pub(crate) fn triangular_inverse(factor: &[f64], inverse: &mut [f64], n: usize, stride: usize) {
    let factor = MatRef::from_column_major_slice_with_stride(factor, n, n, stride);
    let inverse = MatMut::from_column_major_slice_with_stride_mut(inverse, n, n, stride);
    faer::linalg::triangular_inverse::invert_lower_triangular(inverse, factor, PAR);
}

/// `B ← L⁻¹ B` for `columns` columns of `B`.
pub(crate) fn solve_lower(factor: &[f64], b: &mut [f64], n: usize, stride: usize, columns: usize) {
    let factor = MatRef::from_column_major_slice_with_stride(factor, n, n, stride);
    let b = MatMut::from_column_major_slice_with_stride_mut(b, n, columns, stride);
    faer::linalg::triangular_solve::solve_lower_triangular_in_place(factor, b, PAR);
}

/// `C ← C + A Aᵀ`, lower triangle, for `n × columns` `A`.
pub(crate) fn add_outer(c: &mut [f64], a: &[f64], n: usize, stride: usize, columns: usize) {
    let a = MatRef::from_column_major_slice_with_stride(a, n, columns, stride);
    let c = MatMut::from_column_major_slice_with_stride_mut(c, n, n, stride);
    let whole = BlockStructure::Rectangular;
    let lower = BlockStructure::TriangularLower;
    triangular::matmul(c, lower, Accum::Add, a, whole, a.transpose(), whole, 1.0, PAR);
}

/// `C ← C + A Bᵀ` for `n × columns` `A` and `B`.
pub(crate) fn add_product_transposed(c: &mut [f64], a: &[f64], b: &[f64], n: usize, stride: usize, columns: usize) {
    let a = MatRef::from_column_major_slice_with_stride(a, n, columns, stride);
    let b = MatRef::from_column_major_slice_with_stride(b, n, columns, stride);
    let c = MatMut::from_column_major_slice_with_stride_mut(c, n, n, stride);
    faer::linalg::matmul::matmul(c, Accum::Add, a, b.transpose(), 1.0, PAR);
}

/// `C ← A B` (or `C + A B`) for `n × n` `A` and `n × columns` `B`.
pub(crate) fn product(c: &mut [f64], a: &[f64], b: &[f64], n: usize, stride: usize, columns: usize, add: bool) {
    let a = MatRef::from_column_major_slice_with_stride(a, n, n, stride);
    let b = MatRef::from_column_major_slice_with_stride(b, n, columns, stride);
    let c = MatMut::from_column_major_slice_with_stride_mut(c, n, columns, stride);
    let accumulate = if add { Accum::Add } else { Accum::Replace };
    faer::linalg::matmul::matmul(c, accumulate, a, b, 1.0, PAR);
}

/// Mirrors the lower triangle into the upper one.
pub(crate) fn mirror(a: &mut [f64], n: usize, stride: usize) {
    for j in 0..n {
        for i in j + 1..n {
            a[i * stride + j] = a[j * stride + i];
        }
    }
}

/// `b ← L⁻¹ b`, with rows beyond `n` of `factor` and `b` zero up to a whole panel.
pub(crate) struct ForwardSolve<'a> {
    pub(crate) factor: &'a [f64],
    pub(crate) n: usize,
    pub(crate) stride: usize,
    pub(crate) b: &'a mut [f64],
}

impl pulp::WithSimd for ForwardSolve<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for c in 0..self.n {
            let column = &self.factor[c * self.stride..(c + 1) * self.stride];
            let solved = self.b[c] / column[c];
            // Whole panels from the one that holds `c`; its entries up to `c` are put back.
            let from = c / PANEL * PANEL;
            let mut kept = [0.0; PANEL];
            let count = c - from;
            kept[..count].copy_from_slice(&self.b[from..c]);
            let (l, _) = S::as_simd_f64s(&column[from..]);
            let (b, _) = S::as_mut_simd_f64s(&mut self.b[from..]);
            let minus = simd.splat_f64s(-solved);
            for (b, &l) in b.iter_mut().zip(l) {
                *b = simd.mul_add_e_f64s(l, minus, *b);
            }
            self.b[from..c].copy_from_slice(&kept[..count]);
            self.b[c] = solved;
        }
    }
}

/// `b ← L⁻ᵀ b`, with rows beyond `n` of `factor` and `b` zero up to a whole panel.
pub(crate) struct BackwardSolve<'a> {
    pub(crate) factor: &'a [f64],
    pub(crate) n: usize,
    pub(crate) stride: usize,
    pub(crate) b: &'a mut [f64],
}

impl pulp::WithSimd for BackwardSolve<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for c in (0..self.n).rev() {
            let column = &self.factor[c * self.stride..(c + 1) * self.stride];
            // The rest of the panel that holds `c` one by one, whole panels after it.
            let next = (c / PANEL + 1) * PANEL;
            let mut sum = 0.0;
            for i in c + 1..next.min(self.n) {
                sum += column[i] * self.b[i];
            }
            let (l, _) = S::as_simd_f64s(&column[next..]);
            let (b, _) = S::as_simd_f64s(&self.b[next..]);
            let mut lanes = simd.splat_f64s(0.0);
            for (&l, &b) in l.iter().zip(b) {
                lanes = simd.mul_add_e_f64s(l, b, lanes);
            }
            self.b[c] = (self.b[c] - sum - simd.reduce_sum_f64s(lanes)) / column[c];
        }
    }
}

/// Lower Cholesky factor of a small row-major `m × m` matrix in place; `None` if not positive
/// definite.
pub(crate) fn small_cholesky(a: &mut [f64], m: usize) -> Option<()> {
    for j in 0..m {
        for i in j..m {
            let dot: f64 = (0..j).map(|k| a[i * m + k] * a[j * m + k]).sum();
            let rest = a[i * m + j] - dot;
            if i == j {
                // A pivot lost to rounding counts as zero.
                let least = 1e-13 * a[j * m + j].abs();
                if !(rest > least && rest.is_finite()) {
                    return None;
                }
                a[j * m + j] = rest.sqrt();
            } else {
                a[i * m + j] = rest / a[j * m + j];
            }
        }
        for k in j + 1..m {
            a[j * m + k] = 0.0;
        }
    }
    Some(())
}

/// `b ← L⁻¹ b` for the small row-major factor of [`small_cholesky`].
pub(crate) fn small_forward(l: &[f64], m: usize, b: &mut [f64]) {
    for i in 0..m {
        let dot: f64 = (0..i).map(|k| l[i * m + k] * b[k]).sum();
        b[i] = (b[i] - dot) / l[i * m + i];
    }
}

/// `b ← L⁻ᵀ b` for the small row-major factor of [`small_cholesky`].
pub(crate) fn small_backward(l: &[f64], m: usize, b: &mut [f64]) {
    for i in (0..m).rev() {
        let dot: f64 = (i + 1..m).map(|k| l[k * m + i] * b[k]).sum();
        b[i] = (b[i] - dot) / l[i * m + i];
    }
}
