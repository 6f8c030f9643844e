//! Vector arithmetic chosen at run time by what the processor has (AVX-512, AVX2 with FMA, or
//! scalar), through `pulp`: no `unsafe` here, one binary everywhere.

use pulp::{Simd, bytemuck};

/// Rows of a panel, and the multiple to which point counts are padded: a whole number of vectors
/// on every processor. Panels of 16 read a fifth more memory at N = 100, which is what bounds a
/// single prediction.
pub(crate) const PANEL: usize = 8;

/// `n` rounded up to a whole number of panels.
pub(crate) const fn padded(n: usize) -> usize {
    n.div_ceil(PANEL) * PANEL
}

/// `log₂ e`.
const LOG2_E: f64 = std::f64::consts::LOG2_E;
/// `ln 2` to 42 bits, so that a multiple by a small integer is exact.
const LN_2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fefa_3800);
/// `ln 2 − LN_2_HIGH`.
const LN_2_LOW: f64 = f64::from_bits(0x3d2e_f357_93c7_6730);
/// Adding `1.5·2⁵²` leaves the nearest integer in the low bits of a double.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Below this `exp` is returned as zero: `2⁻¹⁰²²` is the smallest normal number.
const LEAST_ARGUMENT: f64 = -708.0;

/// `eˣ` for `x ≤ 0`, to about one unit in the last place; zero below −708.
///
/// `x = n ln 2 + r` with `|r| ≤ ½ ln 2`; a Taylor polynomial of degree 12 in `r`, times `2ⁿ` put
/// together from bits.
#[inline(always)]
pub(crate) fn exp<S: Simd>(simd: S, x: S::f64s) -> S::f64s {
    let splat = |value: f64| simd.splat_f64s(value);
    let clamped = simd.max_f64s(x, splat(LEAST_ARGUMENT));
    let shifted = simd.mul_add_e_f64s(clamped, splat(LOG2_E), splat(ROUND));
    let n = simd.sub_f64s(shifted, splat(ROUND));
    let r = simd.mul_add_e_f64s(n, splat(-LN_2_HIGH), clamped);
    let r = simd.mul_add_e_f64s(n, splat(-LN_2_LOW), r);

    // Σ rᵏ/k!, by pairs (Estrin), which shortens the chain of dependent operations.
    let pair = |low: f64, high: f64| simd.mul_add_e_f64s(r, splat(high), splat(low));
    let r2 = simd.mul_f64s(r, r);
    let r4 = simd.mul_f64s(r2, r2);
    let r8 = simd.mul_f64s(r4, r4);
    let a = simd.mul_add_e_f64s(pair(1.0 / 2.0, 1.0 / 6.0), r2, pair(1.0, 1.0));
    let b = simd.mul_add_e_f64s(pair(1.0 / 720.0, 1.0 / 5040.0), r2, pair(1.0 / 24.0, 1.0 / 120.0));
    let c = simd.mul_add_e_f64s(pair(1.0 / 3_628_800.0, 1.0 / 39_916_800.0), r2, pair(1.0 / 40_320.0, 1.0 / 362_880.0));
    let c = simd.mul_add_e_f64s(r4, splat(1.0 / 479_001_600.0), c);
    let low = simd.mul_add_e_f64s(b, r4, a);
    let polynomial = simd.mul_add_e_f64s(c, r8, low);

    let mut scale = shifted;
    for bits in bytemuck::cast_slice_mut::<S::f64s, u64>(std::slice::from_mut(&mut scale)) {
        *bits = bits.wrapping_add(1023) << 52;
    }
    let value = simd.mul_f64s(polynomial, scale);
    let underflow = simd.less_than_f64s(x, splat(LEAST_ARGUMENT));
    simd.select_f64s(underflow, splat(0.0), value)
}

/// Every instruction set that this processor has, for tests.
#[cfg(test)]
pub(crate) fn every_arch() -> Vec<pulp::Arch> {
    let mut every = vec![pulp::Arch::Scalar, pulp::Arch::new()];
    #[cfg(target_arch = "x86_64")]
    every.extend(pulp::x86::V3::try_new().map(pulp::Arch::V3));
    every
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative error allowed: three units in the last place.
    const EXP_TOLERANCE: f64 = 6.7e-16;

    struct Exp<'a>(&'a mut [f64]);
    impl pulp::WithSimd for Exp<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let (body, _) = S::as_mut_simd_f64s(self.0);
            for x in body {
                *x = exp(simd, *x);
            }
        }
    }

    #[test]
    fn exp_is_within_three_units_in_the_last_place() {
        let arguments: Vec<f64> = (0..160_000).map(|i| -0.004_424_9 * f64::from(i)).collect();
        let mut values = arguments.clone();
        pulp::Arch::new().dispatch(Exp(&mut values));
        let mut scalar = arguments.clone();
        Simd::vectorize(pulp::Scalar, Exp(&mut scalar));
        for ((&x, &vector), &scalar) in arguments.iter().zip(&values).zip(&scalar) {
            let expected = x.exp();
            assert!((vector - expected).abs() <= EXP_TOLERANCE * expected, "exp({x}) = {vector}");
            assert!((scalar - expected).abs() <= EXP_TOLERANCE * expected, "exp({x}) = {scalar}");
        }
    }

    #[test]
    fn exp_underflows_to_zero_and_is_one_at_zero() {
        let mut values = [0.0; PANEL];
        values[1] = -709.0;
        values[2] = -1e300;
        values[3] = f64::NEG_INFINITY;
        pulp::Arch::new().dispatch(Exp(&mut values));
        assert_eq!(values[..4].iter().map(|v| v.to_bits()).collect::<Vec<_>>(), [1.0_f64.to_bits(), 0, 0, 0]);
    }
}
