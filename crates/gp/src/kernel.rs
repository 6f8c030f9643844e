//! Stationary kernels with one length scale per input (ARD).
//!
//! With `r² = Σ_d (x_d − x'_d)² / ℓ_d²`, each kernel is `σ_f² κ(r)`, and everything else the crate
//! needs of it follows from `κ` and one more function,
//!
//! ```text
//! h(r) = −2 dκ/d(r²),
//! ∂κ/∂ log ℓ_d = h(r) (x_d − x'_d)² / ℓ_d²,
//! ∂κ/∂x_d      = −h(r) (x_d − x'_d) / ℓ_d².
//! ```
//!
//! `h` is finite at `r = 0` for all three, which is why it and not `dκ/dr` is the primitive.
//!
//! References: \[RW06\] C. E. Rasmussen and C. K. I. Williams, *Gaussian Processes for Machine
//! Learning*, MIT Press, 2006; \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation
//! of an approximated Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009.

use pulp::Simd;
use serde::{Deserialize, Serialize};

use crate::mean::FAR;
use crate::vector::exp;

/// A stationary covariance function with one length scale per input dimension.
///
/// # Example
///
/// ```
/// use stridemap_gp::Kernel;
///
/// // One length scale away: e^(−1/2) of the signal variance 4.
/// let k = Kernel::SquaredExponential.covariance(1.0, 4.0);
/// assert!((k - 4.0 * f64::exp(-0.5)).abs() < 1e-15);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Kernel {
    /// `κ = exp(−r²/2)` \[RW06, eq. (4.9)\], the kernel of \[MA09, eq. (10)\] with
    /// `v₀ = σ_f²`, `v₁ = σₙ²`, `v_k = 1/ℓ_k²`.
    #[default]
    SquaredExponential,
    /// `κ = (1 + √3 r) exp(−√3 r)` \[RW06, eq. (4.17)\]: once differentiable samples.
    Matern32,
    /// `κ = (1 + √5 r + 5r²/3) exp(−√5 r)` \[RW06, eq. (4.17)\]: twice differentiable samples.
    Matern52,
}

impl Kernel {
    /// Covariance `σ_f² κ(r)` at squared scaled distance `squared_distance = r²`, without noise.
    #[must_use]
    pub fn covariance(self, squared_distance: f64, signal_variance: f64) -> f64 {
        let q = squared_distance.clamp(0.0, FAR * FAR);
        let kappa = match self {
            Self::SquaredExponential => (-0.5 * q).exp(),
            Self::Matern32 => {
                let s = (3.0 * q).sqrt();
                (1.0 + s) * (-s).exp()
            }
            Self::Matern52 => {
                let s = (5.0 * q).sqrt();
                (1.0 + s + s * s / 3.0) * (-s).exp()
            }
        };
        signal_variance * kappa
    }

    /// Slope `σ_f² h(r) = −2 σ_f² dκ/d(r²)` at squared scaled distance `squared_distance = r²`.
    #[must_use]
    pub fn slope(self, squared_distance: f64, signal_variance: f64) -> f64 {
        let q = squared_distance.clamp(0.0, FAR * FAR);
        let h = match self {
            Self::SquaredExponential => (-0.5 * q).exp(),
            Self::Matern32 => 3.0 * (-(3.0 * q).sqrt()).exp(),
            Self::Matern52 => {
                let s = (5.0 * q).sqrt();
                5.0 / 3.0 * (1.0 + s) * (-s).exp()
            }
        };
        signal_variance * h
    }
}

/// The same formulas over a vector of squared distances; one type a kernel, so that the choice is
/// made once, outside the loops.
pub(crate) trait Profile: Copy {
    /// `(κ, h)` at `q = r²`.
    fn value_and_slope<S: Simd>(self, simd: S, q: S::f64s) -> (S::f64s, S::f64s);

    /// `κ` alone.
    #[inline(always)]
    fn value<S: Simd>(self, simd: S, q: S::f64s) -> S::f64s {
        self.value_and_slope(simd, q).0
    }
}

#[derive(Clone, Copy)]
pub(crate) struct SquaredExponential;
#[derive(Clone, Copy)]
pub(crate) struct Matern32;
#[derive(Clone, Copy)]
pub(crate) struct Matern52;

impl Profile for SquaredExponential {
    #[inline(always)]
    fn value_and_slope<S: Simd>(self, simd: S, q: S::f64s) -> (S::f64s, S::f64s) {
        let kappa = exp(simd, simd.mul_f64s(q, simd.splat_f64s(-0.5)));
        (kappa, kappa)
    }
}

impl Profile for Matern32 {
    #[inline(always)]
    fn value_and_slope<S: Simd>(self, simd: S, q: S::f64s) -> (S::f64s, S::f64s) {
        let s = simd.sqrt_f64s(simd.mul_f64s(q, simd.splat_f64s(3.0)));
        let e = exp(simd, simd.neg_f64s(s));
        let kappa = simd.mul_add_e_f64s(s, e, e);
        (kappa, simd.mul_f64s(e, simd.splat_f64s(3.0)))
    }
}

impl Profile for Matern52 {
    #[inline(always)]
    fn value_and_slope<S: Simd>(self, simd: S, q: S::f64s) -> (S::f64s, S::f64s) {
        let s = simd.sqrt_f64s(simd.mul_f64s(q, simd.splat_f64s(5.0)));
        let e = exp(simd, simd.neg_f64s(s));
        let linear = simd.mul_add_e_f64s(s, e, e);
        let third = simd.mul_f64s(simd.mul_f64s(s, s), simd.splat_f64s(1.0 / 3.0));
        (simd.mul_add_e_f64s(third, e, linear), simd.mul_f64s(linear, simd.splat_f64s(5.0 / 3.0)))
    }
}

/// Runs `$body` with `$profile` bound to the type of the kernel `$kernel`.
macro_rules! with_profile {
    ($kernel:expr, $profile:ident => $body:expr) => {
        match $kernel {
            $crate::kernel::Kernel::SquaredExponential => {
                let $profile = $crate::kernel::SquaredExponential;
                $body
            }
            $crate::kernel::Kernel::Matern32 => {
                let $profile = $crate::kernel::Matern32;
                $body
            }
            $crate::kernel::Kernel::Matern52 => {
                let $profile = $crate::kernel::Matern52;
                $body
            }
        }
    };
}
pub(crate) use with_profile;

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Kernel; 3] = [Kernel::SquaredExponential, Kernel::Matern32, Kernel::Matern52];

    #[test]
    fn slope_is_minus_twice_the_derivative_by_squared_distance() {
        for kernel in ALL {
            for q in [0.01, 0.3, 1.0, 7.0] {
                let step = 1e-5 * q;
                let difference = kernel.covariance(q + step, 2.0) - kernel.covariance(q - step, 2.0);
                let expected = -difference / step;
                let slope = kernel.slope(q, 2.0);
                assert!((slope - expected).abs() < 1e-8 * slope, "{kernel:?} at {q}");
            }
        }
    }

    struct Both<'a, P>(P, &'a [f64], &'a mut [f64], &'a mut [f64]);
    impl<P: Profile> pulp::WithSimd for Both<'_, P> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let (q, _) = S::as_simd_f64s(self.1);
            let (k, _) = S::as_mut_simd_f64s(self.2);
            let (h, _) = S::as_mut_simd_f64s(self.3);
            for ((&q, k), h) in q.iter().zip(k).zip(h) {
                (*k, *h) = self.0.value_and_slope(simd, q);
            }
        }
    }

    #[test]
    fn vector_and_scalar_formulas_agree() {
        let q: Vec<f64> = (0..64).map(|i| 0.37 * f64::from(i)).collect();
        for kernel in ALL {
            let (mut k, mut h) = (vec![0.0; 64], vec![0.0; 64]);
            with_profile!(kernel, profile => {
                pulp::Arch::new().dispatch(Both(profile, &q, &mut k, &mut h));
            });
            for i in 0..64 {
                let (value, slope) = (kernel.covariance(q[i], 1.0), kernel.slope(q[i], 1.0));
                assert!((k[i] - value).abs() <= 4e-15 * value, "{kernel:?} value at {}", q[i]);
                assert!((h[i] - slope).abs() <= 4e-15 * slope, "{kernel:?} slope at {}", q[i]);
            }
        }
    }
}
