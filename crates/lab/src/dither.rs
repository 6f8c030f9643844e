//! Exploration about goals: what a policy asks for, the robot's constants about where they are explored, and noise that is
//! remembered from stride to stride.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_process::Action;

/// Factor on the noise after a fall.
const AFTER_FALL: f64 = 0.8;

/// How strides are explored about a policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Dither {
    /// Standard deviation per component.
    pub std: Vec<f64>,
    /// Per component the range of its centre and its neutral value, where it is not the policy's.
    pub centre: Vec<Option<([f64; 2], f64)>>,
    /// Strides for which a centre is kept.
    pub hold: usize,
    /// Share of its noise that a stride keeps from the one before.
    pub memory: f64,
    /// Strides over which it is faded in.
    pub fade_in: usize,
}

/// Noise that goes on.
#[derive(Clone, Debug)]
pub(crate) struct Dithering {
    noise: Vec<f64>,
    centres: Vec<f64>,
    k: usize,
    scale: f64,
}

impl Default for Dithering {
    fn default() -> Self {
        Self { noise: Vec::new(), centres: Vec::new(), k: 0, scale: 1.0 }
    }
}

impl Dithering {
    /// The action with noise about it.
    pub(crate) fn about(&mut self, action: &[f64], dither: &Dither, rng: &mut ChaCha8Rng) -> Action {
        self.noise.resize(action.len(), 0.0);
        if self.k.is_multiple_of(dither.hold.max(1)) {
            let drawn = |centre: &Option<([f64; 2], f64)>| {
                centre.map_or(0.0, |([low, high], _)| low + (high - low) * rng.random::<f64>())
            };
            self.centres = dither.centre.iter().map(drawn).collect();
        }
        self.k += 1;
        let faded = if dither.fade_in > 0 { (self.k as f64 / dither.fade_in as f64).min(1.0) } else { 1.0 };
        let keeps = (1.0 - dither.memory * dither.memory).max(0.0).sqrt();
        let of = |j: usize| {
            let z: f64 = StandardNormal.sample(rng);
            self.noise[j] = dither.memory * self.noise[j] + keeps * dither.std[j] * z;
            let base = match dither.centre[j] {
                Some((_, neutral)) => neutral + faded * (self.centres[j] - neutral),
                None => action[j],
            };
            base + faded * self.scale * self.noise[j]
        };
        (0..action.len()).map(of).collect()
    }

    /// The robot fell.
    pub(crate) fn fell(&mut self) {
        self.scale *= AFTER_FALL;
        self.noise.fill(0.0);
    }
}
