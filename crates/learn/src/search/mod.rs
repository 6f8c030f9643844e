//! A search in the process over constant actions.

mod cma_es;
mod config;
mod cross_entropy;
mod judged;

pub use cma_es::CmaEs;
pub use config::SearchConfig;
pub use cross_entropy::{CrossEntropy, CrossEntropyConfig};
use judged::{Episodes, Score};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_process::{Action, StrideProcess};

use crate::error::LearnError;
use crate::learner::{LearnOutcome, Learner, TrialReport, TrialSummary};
use crate::saved::{ConstantPolicy, KeptPolicy, SavedPolicy, check_same_components};

/// Finds the constant action of greatest mean reward within a box, by CMA-ES \[Hansen16\]. Nothing but
/// strides is asked of the process, so that it may be a learned map, an exact one, or a robot.
///
/// A generation is a trial. The search starts from the initial policy's constants (a constant or a
/// linear policy), otherwise from the middle of the box, and never answers with constants that fared
/// worse than those on the same random numbers.
#[derive(Clone, Debug)]
pub struct SearchLearner {
    /// The parameters.
    pub config: SearchConfig,
}

impl Learner for SearchLearner {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let config = &self.config;
        let spec = process.spec().clone();
        config.validate(spec.action.len())?;
        let start: Vec<f64> = match initial {
            None => config.lower.iter().zip(&config.upper).map(|(l, u)| 0.5 * (l + u)).collect(),
            Some(policy) => {
                check_same_components(policy.spec(), &spec)?;
                match policy {
                    SavedPolicy::Constant(p) => p.action().to_vec(),
                    SavedPolicy::Linear(p) => p.action().to_vec(),
                    _ => {
                        return Err(LearnError::InitialPolicy { expected: "constant or linear", found: policy.kind() });
                    }
                }
            }
        };
        let start = self.clipped(&start);
        let std: Vec<f64> = config.action_unit.iter().map(|u| 0.5 * u).collect();
        let mut search = CmaEs::new(&start, &std, None)?;
        let mut trials: Vec<TrialSummary> = Vec::with_capacity(config.generations);
        let mut strides = 0;
        for generation in 0..config.generations {
            let common = ChaCha8Rng::from_rng(rng);
            let points = search.ask(rng);
            let mut score = Score::default();
            let mut values = Vec::with_capacity(points.len());
            for point in &points {
                let inside = self.clipped(point);
                let mut one = self.score(process, &inside, &mut common.clone(), generation + 1)?;
                one.strides_made += one.aborted;
                strides += one.strides_made;
                // Outside the box the value falls with the distance, in units of the action.
                let outside: f64 = point
                    .iter()
                    .zip(&inside)
                    .zip(&config.action_unit)
                    .map(|((p, q), unit)| ((p - q) / unit).powi(2))
                    .sum();
                values.push(one.value() - outside);
                score.add(&one);
            }
            search.tell(&points, &values)?;
            let summary = score.summary(generation + 1);
            let policy = ConstantPolicy::new(spec.clone(), &self.clipped(search.mean()))?;
            observer(&TrialReport { summary: &summary, policy: &policy });
            trials.push(summary);
        }

        let found = self.clipped(search.mean());
        let judge = ChaCha8Rng::from_rng(rng);
        let mut values = [0.0; 2];
        for (value, constants) in values.iter_mut().zip([&start, &found]) {
            let score = self.score(process, constants, &mut judge.clone(), config.generations)?;
            strides += score.strides_made + score.aborted;
            *value = score.value();
        }
        let best = if values[1] >= values[0] { found } else { start };
        let policy = ConstantPolicy::new(spec, &best)?.to_saved();
        Ok(LearnOutcome { policy, trials, strides })
    }
}

impl SearchLearner {
    fn clipped(&self, point: &[f64]) -> Vec<f64> {
        let bounds = self.config.lower.iter().zip(&self.config.upper);
        point.iter().zip(bounds).map(|(p, (l, u))| p.clamp(*l, *u)).collect()
    }

    /// Runs the episodes of one candidate.
    fn score(
        &self,
        process: &mut dyn StrideProcess,
        constants: &[f64],
        rng: &mut ChaCha8Rng,
        trial: usize,
    ) -> Result<Score, LearnError> {
        let (constants, c) = (Action::from_slice(constants), &self.config);
        let episodes = Episodes {
            episodes: c.episodes,
            strides: c.strides_per_episode,
            unscored: c.unscored_strides,
            discount: None,
        };
        episodes.score(process, &|_| constants.clone(), rng, trial)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::Policy;
    use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters};

    /// Two states, two actions; the first action is fed back.
    fn map() -> LinearGaussianMap {
        LinearGaussianMap::new(LinearGaussianParameters {
            a: vec![vec![-0.9, 0.1], vec![0.0, 0.5]],
            b: vec![vec![0.4, 0.1], vec![0.1, 0.8]],
            offset: vec![0.3, -0.2],
            noise_std: vec![0.05, 0.05],
            target: vec![1.0, -1.0],
            state_cost: vec![1.0, 1.0],
            action_cost: vec![0.0, 0.0],
            initial_mean: vec![0.0, 0.0],
            initial_std: vec![0.3, 0.3],
            action_bounds: vec![[-20.0, 20.0], [-20.0, 20.0]],
            fall_beyond: None,
        })
        .unwrap()
    }

    fn config() -> SearchConfig {
        SearchConfig {
            action_unit: vec![1.0, 1.0],
            lower: vec![-10.0, -10.0],
            upper: vec![10.0, 10.0],
            generations: 40,
            episodes: 4,
            strides_per_episode: 60,
            unscored_strides: 20,
        }
    }

    /// In rest at the target (1, −1): x₁: 0.4 u₁ + 0.1 u₂ = 1.9 + 0.1 − 0.3, x₂: 0.1 u₁ + 0.8 u₂ =
    /// −0.5 + 0.2.
    #[test]
    fn the_constants_are_the_known_ones_and_stay_in_their_box() {
        let det = 0.4 * 0.8 - 0.1 * 0.1;
        let exact = [(1.7 * 0.8 + 0.3 * 0.1) / det, (-0.3 * 0.4 - 0.1 * 1.7) / det];
        let found = |config: SearchConfig, seed| {
            let (mut rng, mut observed) = (ChaCha8Rng::seed_from_u64(seed), 0);
            let upper = config.upper.clone();
            let generations = config.generations;
            let outcome = SearchLearner { config }.improve(&mut map(), None, &mut rng, &mut |report| {
                observed += 1;
                assert!(report.policy.mean(&[0.0, 0.0].into())[0] <= upper[0]);
            });
            assert_eq!(observed, generations);
            outcome.unwrap().policy.mean(&[0.0, 0.0].into())
        };
        for seed in 1..=5 {
            let constants = found(config(), seed);
            assert!((0..2).all(|j| (constants[j] - exact[j]).abs() < 0.1), "{constants:?}");
        }
        let corner = found(SearchConfig { upper: vec![2.0, 10.0], ..config() }, 1);
        assert!((corner[0] - 2.0).abs() < 0.05, "{corner:?}");
    }
}
