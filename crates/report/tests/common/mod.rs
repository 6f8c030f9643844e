//! Synthetic data for the figures: made up, smooth, the same on every machine.
#![allow(dead_code, clippy::unwrap_used)] // not every test uses all; helpers stand outside of #[test]

pub mod figures;
pub mod run;

/// A small deterministic generator (Numerical Recipes' LCG), for fixtures only.
pub struct Lcg(pub u64);

impl Lcg {
    /// Uniform on [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Near enough to N(0, 1): twelve uniforms less six.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}
