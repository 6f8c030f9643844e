//! A search in the process over constant actions, with linear-quadratic feedback about them.

mod cma_es;
mod config;

pub use cma_es::CmaEs;
pub use config::{FeedbackConfig, SearchConfig, StateBound};

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_returnmap::{Action, State, Stride, StrideEnd, StrideProcess, linear_quadratic_feedback};

use crate::error::LearnError;
use crate::learner::{LearnOutcome, Learner, TrialReport, TrialSummary};
use crate::policy::KeptPolicy;
use crate::saved::{ConstantPolicy, LinearPolicy, SavedPolicy, check_same_components};

/// Finds the constant action of greatest
///
/// ```text
/// mean of r − k · sd of r − penalty · P(unsafe)
/// ```
///
/// within a box, by CMA-ES \[Hansen16\]; then, if asked for, adds feedback `u = u₀ + K (x − x̄)` on
/// some components: least squares of x′ on (x, u) over strides with a little dither about the
/// constants gives A and B, and the Riccati equation K. Nothing but strides is asked of the process,
/// so that it may be a learned map (where the sd of the reward contains what the map does not know),
/// an exact one, or a robot.
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
        config.validate(spec.state.len(), spec.action.len())?;
        let start: Vec<f64> = match initial {
            None => config.lower.iter().zip(&config.upper).map(|(l, u)| 0.5 * (l + u)).collect(),
            Some(policy) => {
                check_same_components(policy.spec(), &spec)?;
                match policy {
                    SavedPolicy::Constant(p) => p.action().to_vec(),
                    SavedPolicy::Linear(p) => p.action().to_vec(),
                    SavedPolicy::GaussianNetwork(_) => {
                        return Err(LearnError::InitialPolicy { expected: "constant or linear", found: policy.kind() });
                    }
                }
            }
        };
        let start = self.clipped(&start);
        let std: Vec<f64> = config.action_unit.iter().map(|u| 0.5 * u).collect();
        let mut search = CmaEs::new(&start, &std, config.population)?;
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
                values.push(one.value(config) - outside);
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
            *value = score.value(config);
        }
        let best = if values[1] >= values[0] { found } else { start };
        let policy = match &config.feedback {
            None => ConstantPolicy::new(spec, &best)?.to_saved(),
            Some(feedback) => {
                let (policy, made) = self.with_feedback(process, &best, feedback, rng)?;
                strides += made;
                policy.to_saved()
            }
        };
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
        let mut score = Score::default();
        for _ in 0..self.config.episodes {
            let mut running = false;
            for k in 0..self.config.strides_per_episode {
                if !running {
                    check_state(&process.reset(rng)?, process, trial, k)?;
                }
                let stride = process.stride(constants, rng)?;
                running = stride.end == StrideEnd::Crossing;
                if stride.end == StrideEnd::Aborted {
                    score.aborted += 1;
                    continue;
                }
                check_stride(&stride, process, trial, k)?;
                let low = self.config.unsafe_below.is_some_and(|b| stride.next_state[b.component] < b.value);
                let scored = k >= self.config.unscored_strides;
                score.count(&stride, low || stride.end.is_terminal(), scored);
            }
        }
        if score.scored == 0 {
            return Err(LearnError::AllAborted { trial });
        }
        Ok(score)
    }

    /// The constants with feedback, and the strides that it took to find it.
    fn with_feedback(
        &self,
        process: &mut dyn StrideProcess,
        constants: &[f64],
        feedback: &FeedbackConfig,
        rng: &mut ChaCha8Rng,
    ) -> Result<(LinearPolicy, usize), LearnError> {
        let spec = process.spec().clone();
        let (n, chosen) = (spec.state.len(), feedback.components.len());
        let trial = self.config.generations;
        let mut rows: Vec<f64> = Vec::new();
        let mut nexts: Vec<f64> = Vec::new();
        let mut mean = vec![0.0; n];
        let mut here: Option<State> = None;
        for k in 0..feedback.linearization_strides {
            let x = match here.take() {
                Some(x) => x,
                None => process.reset(rng)?,
            };
            check_state(&x, process, trial, k)?;
            let mut action: Action = constants.iter().copied().collect();
            for &c in &feedback.components {
                let z: f64 = StandardNormal.sample(rng);
                action[c] += feedback.dither * self.config.action_unit[c] * z;
            }
            let stride = process.stride(&action, rng)?;
            if stride.end != StrideEnd::Crossing {
                continue;
            }
            check_stride(&stride, process, trial, k)?;
            rows.push(1.0);
            rows.extend_from_slice(&x);
            // What the action becomes after rate limits is the process's doing: the feedback chooses
            // what is asked for, within the bounds.
            rows.extend(
                feedback.components.iter().map(|&c| action[c].clamp(spec.action[c].lower, spec.action[c].upper)),
            );
            nexts.extend_from_slice(&stride.next_state);
            for (m, v) in mean.iter_mut().zip(&x) {
                *m += v;
            }
            let restart = (k + 1) % self.config.strides_per_episode == 0;
            here = (!restart).then_some(stride.next_state);
        }
        let count = nexts.len() / n;
        let needed = n + chosen + 2;
        if count < needed {
            return Err(LearnError::TooFewStrides { found: count, needed });
        }
        for m in &mut mean {
            *m /= count as f64;
        }
        let z = DMatrix::from_row_slice(count, 1 + n + chosen, &rows);
        let y = DMatrix::from_row_slice(count, n, &nexts);
        // A ridge of a part in 10⁹ keeps a state that never varies from being singular.
        let mut normal = z.transpose() * &z;
        for i in 0..normal.nrows() {
            normal[(i, i)] += 1e-9 * normal[(i, i)].max(f64::MIN_POSITIVE);
        }
        let solution = normal
            .cholesky()
            .ok_or_else(|| LearnError::parameter("feedback.dither", feedback.dither, "larger"))?
            .solve(&(z.transpose() * y));
        let a = solution.rows(1, n).transpose();
        let b = solution.rows(1 + n, chosen).transpose();
        let diagonal = |v: &[f64]| DMatrix::from_diagonal(&DVector::from_column_slice(v));
        let best = linear_quadratic_feedback(
            &a,
            &b,
            &diagonal(&feedback.state_cost),
            &diagonal(&feedback.action_cost),
            feedback.discount,
        )?;
        let mut gain = vec![vec![0.0; n]; spec.action.len()];
        let mut limit = vec![f64::MAX; spec.action.len()];
        for (i, &c) in feedback.components.iter().enumerate() {
            gain[c] = best.gain.row(i).iter().copied().collect();
            limit[c] = feedback.limit[i];
        }
        let policy = LinearPolicy::new(spec, constants, &gain, &mean)?.limited(&limit)?;
        Ok((policy, feedback.linearization_strides))
    }
}

fn check_state(state: &State, process: &dyn StrideProcess, trial: usize, k: usize) -> Result<(), LearnError> {
    let expected = process.spec().state.len();
    if state.len() != expected {
        return Err(LearnError::StateLength { expected, found: state.len() });
    }
    match state.iter().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(&value) => Err(LearnError::NotFinite { quantity: "state", value, trial, stride: k + 1 }),
    }
}

fn check_stride(stride: &Stride, process: &dyn StrideProcess, trial: usize, k: usize) -> Result<(), LearnError> {
    check_state(&stride.next_state, process, trial, k)?;
    if stride.reward.is_finite() {
        return Ok(());
    }
    let value = stride.reward;
    Err(LearnError::NotFinite { quantity: "reward", value, trial, stride: k + 1 })
}

/// How a candidate, or a generation, fared.
#[derive(Default)]
struct Score {
    scored: usize,
    reward: f64,
    reward_square: f64,
    not_safe: usize,
    strides_made: usize,
    all_rewards: f64,
    falls: usize,
    stalls: usize,
    aborted: usize,
}

impl Score {
    fn count(&mut self, stride: &Stride, not_safe: bool, scored: bool) {
        self.strides_made += 1;
        self.all_rewards += stride.reward;
        self.falls += usize::from(stride.end == StrideEnd::Fell);
        self.stalls += usize::from(stride.end == StrideEnd::NoCrossing);
        if scored || stride.end.is_terminal() {
            self.scored += 1;
            self.reward += stride.reward;
            self.reward_square += stride.reward * stride.reward;
            self.not_safe += usize::from(not_safe);
        }
    }

    fn add(&mut self, other: &Self) {
        self.strides_made += other.strides_made;
        self.all_rewards += other.all_rewards;
        self.falls += other.falls;
        self.stalls += other.stalls;
        self.aborted += other.aborted;
    }

    fn value(&self, config: &SearchConfig) -> f64 {
        let n = self.scored as f64;
        let mean = self.reward / n;
        let variance = (self.reward_square / n - mean * mean).max(0.0);
        mean - config.std_weight * variance.sqrt() - config.unsafe_penalty * self.not_safe as f64 / n
    }

    fn summary(&self, trial: usize) -> TrialSummary {
        let strides = self.strides_made - self.aborted;
        TrialSummary {
            trial,
            strides,
            mean_reward: self.all_rewards / strides as f64,
            falls: self.falls,
            stalls: self.stalls,
            aborted: self.aborted,
            mean_td_error: 0.0,
            rms_td_error: 0.0,
            bases: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::Policy;
    use stridemap_returnmap::{LinearGaussianMap, LinearGaussianParameters};

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
            std_weight: 0.0,
            unscored_strides: 20,
            strides_per_episode: 60,
            feedback: Some(FeedbackConfig {
                components: vec![0],
                state_cost: vec![1.0, 1.0],
                action_cost: vec![0.2],
                limit: vec![0.5],
                discount: 0.95,
                dither: 0.5,
                linearization_strides: 4000,
            }),
            ..SearchConfig::within(&[1.0, 1.0], &[-10.0, -10.0], &[10.0, 10.0])
        }
    }

    /// In rest at the target (1, −1): x₁: 0.4 u₁ + 0.1 u₂ = 1.9 + 0.1 − 0.3, x₂: 0.1 u₁ + 0.8 u₂ =
    /// −0.5 + 0.2. And the feedback is the one of the true A and B.
    #[test]
    fn constants_and_feedback_are_the_known_ones() {
        let det = 0.4 * 0.8 - 0.1 * 0.1;
        let exact = [(1.7 * 0.8 + 0.3 * 0.1) / det, (-0.3 * 0.4 - 0.1 * 1.7) / det];
        let gain = linear_quadratic_feedback(
            &DMatrix::from_row_slice(2, 2, &[-0.9, 0.1, 0.0, 0.5]),
            &DMatrix::from_row_slice(2, 1, &[0.4, 0.1]),
            &DMatrix::identity(2, 2),
            &DMatrix::from_element(1, 1, 0.2),
            0.95,
        )
        .unwrap()
        .gain;
        for seed in 1..=5 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut learner = SearchLearner { config: config() };
            let outcome = learner.improve(&mut map(), None, &mut rng, &mut |_| ()).unwrap();
            let SavedPolicy::Linear(policy) = outcome.policy else { panic!("not linear") };
            for j in 0..2 {
                assert!((policy.action()[j] - exact[j]).abs() < 0.1, "{:?}", policy.action());
                assert!((policy.gain()[0][j] - gain[j]).abs() < 0.1, "{:?} {gain}", policy.gain());
                assert!(policy.gain()[1][j].abs() < 1e-15);
            }
            // The correction is limited to 0.5.
            let far = policy.mean(&[9.0, 9.0])[0] - policy.action()[0];
            assert!((far.abs() - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn the_search_stays_in_its_box_and_away_from_what_is_unsafe() {
        let boxed = SearchConfig { upper: vec![2.0, 10.0], feedback: None, ..config() };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut observed = 0;
        let outcome = SearchLearner { config: boxed.clone() }
            .improve(&mut map(), None, &mut rng, &mut |report| {
                observed += 1;
                assert!(report.policy.mean(&[0.0, 0.0])[0] <= 2.0);
            })
            .unwrap();
        assert_eq!(observed, boxed.generations);
        assert!((outcome.policy.mean(&[0.0, 0.0])[0] - 2.0).abs() < 0.05); // the corner
        // x₂ of the optimum is −1; below −0.8 is unsafe.
        let bound = StateBound { component: 1, value: -0.8 };
        let safe = SearchConfig { unsafe_below: Some(bound), unsafe_penalty: 10.0, feedback: None, ..config() };
        let mean_x = |config| {
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let mut learner = SearchLearner { config };
            let policy = learner.improve(&mut map(), None, &mut rng, &mut |_| ()).unwrap().policy;
            let u = policy.mean(&[0.0, 0.0]);
            (-0.2 + 0.1 * u[0] + 0.8 * u[1]) / 0.5 // x₂ at rest
        };
        let free = mean_x(SearchConfig { feedback: None, ..config() });
        let kept = mean_x(safe);
        assert!((free + 1.0).abs() < 0.05 && kept > -0.75, "{free} {kept}");
    }
}
