//! The cross-entropy method over linear policies.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_process::{ProcessSpec, StrideProcess};

use super::judged::{Episodes, Score};
use crate::error::{LearnError, Place, check_length, check_number};
use crate::learner::{LearnOutcome, Learner, TrialReport, TrialSummary};
use crate::policy::Policy;
use crate::saved::{KeptPolicy, LinearPolicy, SavedPolicy, check_same_components};

/// Parameters of [`CrossEntropy`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CrossEntropyConfig {
    /// Generations; at least 1.
    pub generations: usize,
    /// Candidates of a generation; at least 4.
    pub population: usize,
    /// Share of them from which the next generation is drawn, above 0, at most 1.
    pub elite_fraction: f64,
    /// Episodes by which a candidate is judged; at least 1. All candidates of a generation see the same random numbers.
    pub episodes: usize,
    /// Strides of an episode; at least 1.
    pub strides_per_episode: usize,
    /// First standard deviation of the constants, in units of the action, and of the gains, in units of the action for
    /// a width of the state; positive.
    pub first_std: f64,
    /// Noise added to the standard deviations in the first generation, as a share of `first_std`, falling to none in
    /// the last \[SL06\]; from 0 to 1.
    pub extra_noise: f64,
    /// Standard deviation with which the policy found explores when it is sampled, in units of the action; not
    /// negative.
    pub exploration: f64,
}

impl Default for CrossEntropyConfig {
    fn default() -> Self {
        Self {
            generations: 40,
            population: 40,
            elite_fraction: 0.2,
            episodes: 8,
            strides_per_episode: 12,
            first_std: 1.0,
            extra_noise: 0.2,
            exploration: 0.25,
        }
    }
}

impl CrossEntropyConfig {
    /// Checks every field against its domain.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] naming the field.
    pub fn validate(&self) -> Result<(), LearnError> {
        for (field, value, least) in [
            ("generations", self.generations, 1),
            ("population", self.population, 4),
            ("episodes", self.episodes, 1),
            ("strides_per_episode", self.strides_per_episode, 1),
        ] {
            if value < least {
                let domain = if least == 1 { "at least 1" } else { "at least 4" };
                return Err(LearnError::parameter(field, value, domain));
            }
        }
        let share = self.elite_fraction;
        check_number("elite_fraction", share, share > 0.0 && share <= 1.0, "above 0, at most 1")?;
        check_number("first_std", self.first_std, self.first_std > 0.0, "positive and finite")?;
        let noise = self.extra_noise;
        check_number("extra_noise", noise, (0.0..=1.0).contains(&noise), "from 0 to 1")?;
        check_number("exploration", self.exploration, self.exploration >= 0.0, "finite and not negative")
    }
}

/// Finds a linear policy `u = clip(u₀ + K (x − x₀))` of greatest discounted reward, to the end of an episode or a fall, by the cross-entropy method \[dB05\]: a
/// normal distribution over u₀ and K, from the best share of a generation to the next. Nothing but strides is asked of
/// the process, so that it may be a learned map, an exact one, or a robot. `x₀` is the mean of some starts.
///
/// # References
///
/// \[dB05\], \[SL06\]: see the [crate](crate) documentation.
#[derive(Clone, Debug)]
pub struct CrossEntropy {
    /// The parameters.
    pub config: CrossEntropyConfig,
    /// γ, from 0 to 1.
    pub discount: f64,
    /// Per component of the state, what counts as a small difference, in its unit; positive.
    pub state_unit: Vec<f64>,
    /// Per component of the action, what counts as a small change, in its unit; positive.
    pub action_unit: Vec<f64>,
}

impl Learner for CrossEntropy {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let (config, spec) = (self.config, process.spec().clone());
        config.validate()?;
        let g = self.discount;
        check_number("discount", g, (0.0..=1.0).contains(&g), "from 0 to 1")?;
        check_length("state_unit", self.state_unit.len(), spec.state.len())?;
        check_length("action_unit", self.action_unit.len(), spec.action.len())?;
        let (x0, mut mean) = self.start(process, initial, rng)?;
        let mut std = vec![config.first_std; mean.len()];
        let episodes = Episodes {
            episodes: config.episodes,
            strides: config.strides_per_episode,
            unscored: 0,
            discount: Some(self.discount),
        };
        let elite = ((config.elite_fraction * config.population as f64).round() as usize).max(2);
        let mut trials: Vec<TrialSummary> = Vec::with_capacity(config.generations);
        let mut strides = 0;
        for generation in 0..config.generations {
            let common = ChaCha8Rng::from_rng(rng);
            let mut score = Score::default();
            let mut judged = Vec::with_capacity(config.population);
            for _ in 0..config.population {
                let draw = |(m, s): (&f64, &f64)| {
                    let z: f64 = StandardNormal.sample(rng);
                    m + s * z
                };
                let point: Vec<f64> = mean.iter().zip(&std).map(draw).collect();
                let policy = self.policy(&spec, &point, &x0)?;
                let mut one = episodes.score(process, &|at| policy.mean(at), &mut common.clone(), generation + 1)?;
                one.strides_made += one.aborted;
                strides += one.strides_made;
                score.add(&one);
                judged.push((one.value(), point));
            }
            judged.sort_by(|a, b| b.0.total_cmp(&a.0));
            judged.truncate(elite);
            let left = 1.0 - (generation + 1) as f64 / config.generations as f64;
            let noise = config.extra_noise * config.first_std * left;
            for (k, (mean, std)) in mean.iter_mut().zip(&mut std).enumerate() {
                let values = judged.iter().map(|(_, point)| point[k]);
                *mean = values.clone().sum::<f64>() / judged.len() as f64;
                let variance = values.map(|v| (v - *mean).powi(2)).sum::<f64>() / judged.len() as f64;
                *std = (variance + noise * noise).sqrt();
            }
            let summary = score.summary(generation + 1);
            let policy = self.policy(&spec, &mean, &x0)?;
            observer(&TrialReport { summary: &summary, policy: &policy });
            trials.push(summary);
        }
        let explores: Vec<f64> = self.action_unit.iter().map(|u| config.exploration * u).collect();
        let policy = self.policy(&spec, &mean, &x0)?.exploring(&explores)?;
        Ok(LearnOutcome { policy: policy.to_saved(), trials, strides })
    }
}

impl CrossEntropy {
    /// x₀ and the first mean of the search: the initial policy, or the last actions before some starts.
    fn start(
        &self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
    ) -> Result<(Vec<f64>, Vec<f64>), LearnError> {
        const STARTS: usize = 32;
        let (n, m) = (process.spec().state.len(), process.spec().action.len());
        let (mut x0, mut neutral) = (vec![0.0; n], vec![0.0; m]);
        for _ in 0..STARTS {
            let at = process.reset(rng)?;
            Place { trial: 1, stride: 1 }.check_state(&at.state, process.spec())?;
            for (sum, x) in x0.iter_mut().zip(&at.state).chain(neutral.iter_mut().zip(&at.last_action)) {
                *sum += x / STARTS as f64;
            }
        }
        let mut gain = vec![vec![0.0; n]; m];
        match initial {
            None => {}
            Some(policy) => {
                check_same_components(policy.spec(), process.spec())?;
                match policy {
                    SavedPolicy::Constant(p) => neutral = p.action().to_vec(),
                    SavedPolicy::Linear(p) => {
                        (neutral, gain, x0) = (p.action().to_vec(), p.gain().to_vec(), p.state().to_vec());
                    }
                    other => {
                        return Err(LearnError::InitialPolicy { expected: "constant or linear", found: other.kind() });
                    }
                }
            }
        }
        let constants = neutral.iter().zip(&self.action_unit).map(|(u, unit)| u / unit);
        let gains = gain
            .iter()
            .zip(&self.action_unit)
            .flat_map(|(row, unit)| row.iter().zip(&self.state_unit).map(move |(k, state_unit)| k * state_unit / unit));
        Ok((x0, constants.chain(gains).collect()))
    }

    /// The policy of a point: constants, then the rows of the gain, in units.
    fn policy(&self, spec: &ProcessSpec, point: &[f64], x0: &[f64]) -> Result<LinearPolicy, LearnError> {
        let (n, m) = (self.state_unit.len(), self.action_unit.len());
        let within = |j: usize, u: f64| u.clamp(spec.action[j].lower, spec.action[j].upper);
        let constants: Vec<f64> = (0..m).map(|j| within(j, point[j] * self.action_unit[j])).collect();
        let row = |j: usize| (0..n).map(|k| point[m + j * n + k] * self.action_unit[j] / self.state_unit[k]).collect();
        let gain: Vec<Vec<f64>> = (0..m).map(row).collect();
        LinearPolicy::new(spec.clone(), &constants, &gain, x0)
    }
}
