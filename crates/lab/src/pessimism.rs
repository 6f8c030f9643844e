//! The learned map as a cautious learner should see it.
//!
//! ```text
//! r = r(mean of x') − k · sd(r) − penalty · P(ψ'_roll < bound) − penalty · max(0, |Δψ̇_pitch| − free)
//! ```
//!
//! where sd is that of the latent function, what the map does not know. The state goes on as the task's
//! map draws it (`draw = "mean"`: without noise, so that a search sees a smooth function).

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};
use stridemap_map::{LearnedMap, MapDraw, MapFailure, MapStart, StateReward};
use stridemap_process::{ActionLaw, ActionLimits, ProcessError, ProcessSpec, State, Stride, StrideEnd, StrideProcess};

/// How much a stride in the map costs for what is not known or not safe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PessimismConfig {
    /// k: predictive standard deviations taken from the reward.
    pub std_weight: f64,
    /// What a certain violation of the bound on `ψ_roll` costs, in reward.
    pub unsafe_penalty: f64,
    /// The bound, this far below the mean `ψ_roll` in place, deg.
    pub psi_roll_below_in_place_deg: f64,
    /// Cost of a change of the pitch rate from stride to stride, per deg/s beyond the free ones.
    pub flip_penalty: f64,
    /// Changes of the pitch rate that are free, deg/s.
    pub flip_free_deg_s: f64,
}

/// What the bounds of a [`CautiousMap`] are, and where it finds what it charges for.
#[derive(Clone)]
pub struct CautiousWorld {
    /// Names, and the bounds of the trust region.
    pub spec: ProcessSpec,
    /// The action law, the same as on the robot.
    pub limits: Vec<ActionLimits>,
    /// When a next state is a fall.
    pub failure: MapFailure,
    /// The reward of a next state; `None`: the map's own Gaussian process predicts it.
    pub reward: Option<StateReward>,
    /// Component of the state that is `ψ_roll`, and the bound below which it is unsafe.
    pub psi_roll: Option<(usize, f64)>,
    /// Component of the state that is `ψ̇_pitch`.
    pub pitch_rate: Option<usize>,
}

/// A learned map that charges for what it does not know, for a low `ψ_roll` and for alternation.
pub struct CautiousMap<'a> {
    map: &'a LearnedMap,
    config: PessimismConfig,
    world: CautiousWorld,
    law: ActionLaw,
    state: Option<State>,
    normal: Normal,
}

impl<'a> CautiousMap<'a> {
    /// A cautious view of a map.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] for limits outside their domain.
    pub fn new(map: &'a LearnedMap, config: PessimismConfig, world: CautiousWorld) -> Result<Self, ProcessError> {
        Ok(Self {
            law: ActionLaw::new(world.limits.clone())?,
            map,
            config,
            world,
            state: None,
            normal: Normal::standard(),
        })
    }

    /// Mean reward less k standard deviations, without the penalties.
    fn doubtful_reward(&self, means: &[f64], variances: &[f64], of_gp: Option<(f64, f64)>) -> f64 {
        let k = self.config.std_weight;
        match (&self.world.reward, of_gp) {
            (Some(of_state), _) => {
                // The sd of a function of the state: central differences over one sd of each
                // component, which are independent given the inputs.
                let mut moved = means.to_vec();
                let mut variance = 0.0;
                if k > 0.0 {
                    for i in 0..means.len() {
                        let sd = variances[i].sqrt();
                        moved[i] = means[i] + sd;
                        let above = of_state(&moved);
                        moved[i] = means[i] - sd;
                        variance += (0.5 * (above - of_state(&moved))).powi(2);
                        moved[i] = means[i];
                    }
                }
                of_state(means) - k * variance.sqrt()
            }
            (None, Some((mean, variance))) => mean - k * variance.sqrt(),
            (None, None) => 0.0,
        }
    }
}

impl StrideProcess for CautiousMap<'_> {
    fn spec(&self) -> &ProcessSpec {
        &self.world.spec
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<State, ProcessError> {
        let config = self.map.config();
        self.law.reset();
        let state: State = match config.start {
            MapStart::Uniform => {
                config.start_range.iter().map(|[low, high]| low + (high - low) * rng.random::<f64>()).collect()
            }
            MapStart::Data => {
                let samples = self.map.samples();
                let sample = &samples[rng.random_range(0..samples.len())];
                self.law.reset_to(sample.last_action.clone());
                sample.state.clone()
            }
        };
        self.state = Some(state.clone());
        Ok(state)
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let Some(state) = self.state.take() else {
            return Err(ProcessError::NotReset);
        };
        let last_action = self.law.last().clone();
        let action = self.law.apply(action)?;
        let prediction = self.map.predict_all(&state, &action, &last_action)?;
        let (means, variances) = (&prediction.means, &prediction.latent_variances);
        let config = self.map.config();
        let mut next_state = State::new();
        for (i, gp) in self.map.outputs().iter().enumerate() {
            let noise = gp.hyperparameters().noise_variance;
            let variance = match config.draw {
                MapDraw::Full => variances[i] + noise,
                MapDraw::Latent => variances[i],
                MapDraw::Mean => 0.0,
            };
            let mut drawn = means[i];
            if variance > 0.0 {
                let z: f64 = StandardNormal.sample(rng);
                drawn += variance.sqrt() * z;
            }
            let [low, high] = config.state_range[i];
            next_state.push(drawn.clamp(low, high));
        }
        let failure = self.world.failure;
        let fell = failure.fell(&next_state);
        let mut reward = if fell { failure.reward } else { self.doubtful_reward(means, variances, prediction.reward) };
        if let (false, Some((c, bound))) = (fell, self.world.psi_roll) {
            let noise = self.map.outputs()[c].hyperparameters().noise_variance;
            let sd = (variances[c] + noise).sqrt().max(f64::MIN_POSITIVE);
            reward -= self.config.unsafe_penalty * self.normal.cdf((bound - means[c]) / sd);
        }
        if let (false, Some(c)) = (fell, self.world.pitch_rate) {
            let change = (means[c] - state[c]).abs();
            reward -= self.config.flip_penalty * (change - self.config.flip_free_deg_s).max(0.0);
        }
        let end = if fell {
            StrideEnd::Fell
        } else {
            self.state = Some(next_state.clone());
            StrideEnd::Crossing
        };
        Ok(Stride { action, next_state, reward, end })
    }
}
