//! The learned map as a cautious learner should see it.
//!
//! ```text
//! r = r(mean of x') − k · sd(r) − penalty · P(ψ'_roll < bound) − penalty · max(0, |Δψ̇_pitch| − free)
//! ```
//!
//! where sd is that of the latent function, what the map does not know. The state goes on as the task's
//! map draws it (`draw = "mean"`: without noise, so that a search sees a smooth function).

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};
use stridemap_map::{LearnedMap, MapPrediction, StateReward};
use stridemap_process::{Foreseen, Foresight, ProcessError, ProcessSpec, Situation, Stride, StrideEnd, StrideProcess};

/// How much a stride in the map costs for what is not known or not safe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PessimismConfig {
    /// k: predictive standard deviations taken from the reward.
    pub std_weight: f64,
    /// What a certain violation of the bound on `ψ_roll` costs, in reward.
    pub unsafe_penalty: f64,
    /// The bound, this far below the mean `ψ_roll` in place, deg; left out: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psi_roll_below_in_place_deg: Option<f64>,
    /// Cost of a change of the pitch rate from stride to stride, per deg/s beyond the free ones.
    pub flip_penalty: f64,
    /// Changes of the pitch rate that are free, deg/s.
    pub flip_free_deg_s: f64,
}

/// A learned map that charges for what it does not know, for a low `ψ_roll` and for alternation.
pub struct CautiousMap {
    map: LearnedMap,
    config: PessimismConfig,
    spec: ProcessSpec,
    psi_roll: Option<(usize, f64)>,
    pitch_rate: Option<usize>,
    normal: Normal,
}

impl CautiousMap {
    /// A cautious view of a map.
    ///
    /// # Arguments
    ///
    /// - `spec` – the map's components, with the bounds that a learner is to see: those of a trust region.
    /// - `psi_roll` – the component of the state that is `ψ_roll`, and the bound below which it is unsafe.
    /// - `pitch_rate` – the component of the state that is `ψ̇_pitch`.
    #[must_use]
    pub fn new(
        map: LearnedMap,
        config: PessimismConfig,
        spec: ProcessSpec,
        psi_roll: Option<(usize, f64)>,
        pitch_rate: Option<usize>,
    ) -> Self {
        Self { map, config, spec, psi_roll, pitch_rate, normal: Normal::standard() }
    }

    /// What it charges, apart from the map that is asked.
    fn charges(&self) -> Charges {
        let noise = |c: usize| self.map.outputs()[c].hyperparameters().noise_variance;
        Charges {
            config: self.config,
            of_state: self.map.world().reward.clone(),
            psi_roll: self.psi_roll.map(|(c, bound)| (c, bound, noise(c))),
            pitch_rate: self.pitch_rate,
            normal: self.normal,
        }
    }
}

/// What a prediction costs.
struct Charges {
    config: PessimismConfig,
    of_state: Option<StateReward>,
    /// The component, its bound, and the variance of its noise.
    psi_roll: Option<(usize, f64, f64)>,
    pitch_rate: Option<usize>,
    normal: Normal,
}

impl Charges {
    /// The reward of a stride that does not fall, less what is charged.
    fn reward(&self, at: &Situation, predicted: &MapPrediction) -> f64 {
        let config = self.config;
        let mut reward = Self::doubtful_reward(config.std_weight, self.of_state.as_ref(), predicted);
        if let Some((c, bound, noise)) = self.psi_roll {
            let sd = (predicted.latent_variances[c] + noise).sqrt().max(f64::MIN_POSITIVE);
            reward -= config.unsafe_penalty * self.normal.cdf((bound - predicted.means[c]) / sd);
        }
        if let Some(c) = self.pitch_rate {
            let change = (predicted.means[c] - at.state[c]).abs();
            reward -= config.flip_penalty * (change - config.flip_free_deg_s).max(0.0);
        }
        reward
    }

    /// Mean reward less k standard deviations, without the penalties.
    fn doubtful_reward(k: f64, of_state: Option<&StateReward>, predicted: &MapPrediction) -> f64 {
        let Some(of_state) = of_state else {
            let (mean, variance) = predicted.reward.unwrap_or_default();
            return mean - k * variance.sqrt();
        };
        // The sd of a function of the state: central differences over one sd of each
        // component, which are independent given the inputs.
        let means = &predicted.means;
        let mut moved = means.to_vec();
        let mut variance = 0.0;
        if k > 0.0 {
            for i in 0..means.len() {
                let sd = predicted.latent_variances[i].sqrt();
                moved[i] = means[i] + sd;
                let above = of_state(&moved);
                moved[i] = means[i] - sd;
                variance += (0.5 * (above - of_state(&moved))).powi(2);
                moved[i] = means[i];
            }
        }
        of_state(means) - k * variance.sqrt()
    }
}

impl StrideProcess for CautiousMap {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        self.map.reset(rng)
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let mut stride = self.map.imagine(action, rng)?;
        if stride.end != StrideEnd::Crossing {
            return Ok(stride);
        }
        let charges = self.charges();
        let (at, predicted) = self.map.imagined()?;
        stride.reward = charges.reward(at, predicted);
        Ok(stride)
    }

    fn foresight(&self) -> Option<&dyn Foresight> {
        Some(self)
    }
}

impl Foresight for CautiousMap {
    fn foresee(&self, at: &Situation, action: &[f64]) -> Result<Foreseen, ProcessError> {
        let charges = self.charges();
        self.map.foresee_by(at, action, &|predicted| charges.reward(at, predicted))
    }

    fn remembers(&self) -> bool {
        self.map.remembers()
    }
}
