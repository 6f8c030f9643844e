//! One contract for every learner, on exact maps with known answers.

#![allow(clippy::panic, clippy::unwrap_used)]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_learn::{
    ActorCritic, ActorCriticConfig, BayesianPolicyGradient, ConstantPolicy, CrossEntropy, CrossEntropyConfig,
    KeptPolicy, LearnError, LearnOutcome, Learner, LinearPolicy, NaturalActorCritic, Output, Policy,
    PolicyGradientConfig, SavedPolicy, SearchConfig, SearchLearner,
};
use stridemap_process::{Next, ProcessError, ProcessSpec, Situation, Stride, StrideEnd, StrideProcess, walk};
use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters, RimlessWheel, RimlessWheelParameters};

/// Every learner of the crate, configured for one state and one action.
fn learners() -> Vec<(&'static str, Box<dyn Learner>)> {
    let short = ActorCriticConfig { trials: 10, ..stepping() };
    let search = SearchConfig {
        action_unit: vec![0.5],
        lower: vec![0.0],
        upper: vec![1.0],
        generations: 5,
        episodes: 4,
        strides_per_episode: 30,
        unscored_strides: 0,
    };
    let gradient =
        PolicyGradientConfig { trials: 6, strides_per_trial: 60, max_bases: 4, ..PolicyGradientConfig::default() };
    let few = CrossEntropyConfig { generations: 3, population: 6, ..CrossEntropyConfig::default() };
    let (state_unit, action_unit) = (vec![0.5], vec![0.5]);
    vec![
        ("cem", Box::new(CrossEntropy { config: few, discount: 0.95, state_unit, action_unit })),
        ("natural actor-critic", Box::new(NaturalActorCritic { network: short.clone(), config: gradient })),
        ("Bayesian policy gradient", Box::new(BayesianPolicyGradient { network: short.clone(), config: gradient })),
        ("actor-critic", Box::new(ActorCritic { config: short })),
        ("search", Box::new(SearchLearner { config: search })),
    ]
}

fn stepping() -> ActorCriticConfig {
    ActorCriticConfig::stepping()
}

fn processes() -> Vec<(&'static str, Box<dyn StrideProcess>)> {
    let map = LinearGaussianParameters::stepping();
    let falling = LinearGaussianParameters { fall_beyond: Some(1.0), ..map.clone() };
    let rough = RimlessWheelParameters { slope_std_rad: 0.03, ..Default::default() };
    vec![
        ("linear", Box::new(LinearGaussianMap::new(map).unwrap())),
        ("linear with falls", Box::new(LinearGaussianMap::new(falling).unwrap())),
        ("rimless wheel", Box::new(RimlessWheel::new(rough).unwrap())),
    ]
}

fn improve(learner: &mut dyn Learner, process: &mut dyn StrideProcess, seed: u64) -> Result<LearnOutcome, LearnError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    learner.improve(process, None, &mut rng, &mut |_| ())
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_does_not() {
    for (process_name, mut process) in processes() {
        for (name, mut learner) in learners() {
            let mut bytes = |seed| {
                let outcome = improve(learner.as_mut(), process.as_mut(), seed).unwrap();
                serde_json::to_vec(&outcome).unwrap()
            };
            assert_eq!(bytes(1), bytes(1), "{name} on {process_name}");
            assert_ne!(bytes(1), bytes(2), "{name} on {process_name}");
        }
    }
}

#[test]
fn every_trial_is_observed_and_the_outcome_can_be_kept() {
    for (process_name, mut process) in processes() {
        for (name, mut learner) in learners() {
            let mut seen = Vec::new();
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let outcome = learner
                .improve(process.as_mut(), None, &mut rng, &mut |report| {
                    seen.push((*report.summary, report.policy.to_saved()));
                })
                .unwrap();
            let curve: Vec<_> = seen.iter().map(|s| s.0).collect();
            assert_eq!(curve, outcome.trials, "{name} on {process_name}");
            assert!(curve.iter().enumerate().all(|(i, t)| t.trial == i + 1));
            let file = serde_json::to_string(&outcome.policy).unwrap();
            let back: stridemap_learn::SavedPolicy = serde_json::from_str(&file).unwrap();
            for x in [-1.0, 0.4, 1.3, 8.0] {
                let bounds = &process.spec().action[0];
                let u = outcome.policy.mean(&[x].into())[0];
                assert!(u >= bounds.lower && u <= bounds.upper);
                assert_eq!(u.to_bits(), back.mean(&[x].into())[0].to_bits());
            }
            back.check_fits(process.spec()).unwrap();
        }
    }
}

/// What a broken world answers.
struct Broken {
    spec: ProcessSpec,
    state: f64,
    reward: f64,
    end: StrideEnd,
    length: usize,
}

impl StrideProcess for Broken {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn reset(&mut self, _rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        Ok([0.0].into())
    }

    fn stride(&mut self, action: &[f64], _rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        Ok(Stride {
            next: Situation {
                last_action: action.iter().copied().collect(),
                ..Situation::of_state(&vec![self.state; self.length])
            },
            reward: self.reward,
            end: self.end,
        })
    }
}

#[test]
fn nonsense_from_the_process_is_an_error_and_no_panic() {
    let spec = processes().remove(0).1.spec().clone();
    for (state, reward, end, length) in [
        (f64::NAN, 0.0, StrideEnd::Crossing, 1),
        (0.0, f64::NAN, StrideEnd::Crossing, 1),
        (0.0, f64::NEG_INFINITY, StrideEnd::Fell, 1),
        (0.0, 0.0, StrideEnd::Crossing, 3),
        (0.0, 0.0, StrideEnd::Aborted, 1),
    ] {
        for (name, mut learner) in learners() {
            let mut process = Broken { spec: spec.clone(), state, reward, end, length };
            let result = improve(learner.as_mut(), &mut process, 1);
            assert!(result.is_err(), "{name}: {state} {reward} {end:?} {length}");
        }
    }
}

#[test]
fn a_policy_for_other_components_is_refused() {
    let mut wheel = RimlessWheel::new(RimlessWheelParameters::default()).unwrap();
    let other = ConstantPolicy::new(processes()[0].1.spec().clone(), &[0.0]).unwrap().to_saved();
    for (name, mut learner) in learners() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let result = learner.improve(&mut wheel, Some(&other), &mut rng, &mut |_| ());
        assert!(result.is_err(), "{name}");
    }
}

/// Mean and standard error.
fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

fn regulation() -> LinearGaussianMap {
    LinearGaussianMap::new(LinearGaussianParameters {
        a: vec![vec![0.9]],
        b: vec![vec![0.5]],
        offset: vec![0.2],
        noise_std: vec![0.1],
        target: vec![0.0],
        state_cost: vec![0.1],
        action_cost: vec![0.01],
        initial_mean: vec![0.0],
        initial_std: vec![1.0],
        action_bounds: vec![[-10.0, 10.0]],
        fall_beyond: None,
    })
    .unwrap()
}

/// Discounted reward of the mean action, the same noise for every policy.
fn discounted_reward(policy: &dyn Policy, discount: f64) -> f64 {
    let mut map = regulation();
    let mut rng = ChaCha8Rng::seed_from_u64(99);
    let episodes = 400;
    let mut sum = 0.0;
    for _ in 0..episodes {
        let mut weight = 1.0;
        walk(
            &mut map,
            100,
            &mut rng,
            |at| policy.mean(at),
            |_, made| {
                sum += weight * made.stride.reward;
                weight *= discount;
                Next::Go
            },
        )
        .unwrap();
    }
    sum / f64::from(episodes)
}

#[test]
fn the_actor_critic_finds_the_linear_quadratic_regulator() {
    let config = ActorCriticConfig {
        trials: 1000,
        restart_every: Some(8),
        basis_widths: vec![0.7],
        outputs: vec![Output { unit: 1.0, mean_weight_limit: Some(4.0) }],
        actor_step: 0.1,
        trace_decay: 0.95,
        ..stepping()
    };
    let gamma = config.discount;
    let best = regulation().optimal(gamma).unwrap();
    let optimum =
        LinearPolicy::new(regulation().spec().clone(), best.offset.as_slice(), &[vec![best.gain[0]]], &[0.0]).unwrap();
    let nothing = ConstantPolicy::new(regulation().spec().clone(), &[0.0]).unwrap();
    let (best_reward, idle_reward) = (discounted_reward(&optimum, gamma), discounted_reward(&nothing, gamma));
    let (mut gains, mut offsets, mut regrets) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 1..=10 {
        let mut learner = ActorCritic { config: config.clone() };
        let policy = improve(&mut learner, &mut regulation(), seed).unwrap().policy;
        // Slope of the policy over [−1, 1], where the states are.
        let grid: Vec<f64> = (-10..=10).map(|i| 0.1 * f64::from(i)).collect();
        let square: f64 = grid.iter().map(|x| x * x).sum();
        gains.push(grid.iter().map(|x| x * policy.mean(&[*x].into())[0]).sum::<f64>() / square);
        offsets.push(policy.mean(&[0.0].into())[0]);
        let reward = discounted_reward(&policy, gamma);
        regrets.push((best_reward - reward) / (best_reward - idle_reward));
    }
    // Measured over the ten seeds: gain −1.45 ± 0.02 (exact −1.359), offset −0.376 ± 0.005 (exact
    // −0.382), and 0.20 % of what can be gained is missed, 0.26 % in the worst seed. The bands allow
    // for the network, which cannot represent a line exactly, beside four standard errors.
    let (gain, gain_error) = mean_and_error(&gains);
    assert!((gain - best.gain[0]).abs() < 0.15 + 4.0 * gain_error, "{gain} ± {gain_error}");
    let (offset, offset_error) = mean_and_error(&offsets);
    assert!((offset - best.offset[0]).abs() < 0.01 + 4.0 * offset_error, "{offset}");
    assert!(regrets.iter().all(|r| *r < 0.01), "{regrets:?}");
}

/// Two states, two actions of different units: the same learner, no change but the numbers. Of what
/// can be gained the worst of 20 seeds missed 2.8 %. With unscaled gradients a step of 0.1 left 28 %
/// in one seed of 5; a step of 0.03 at most 3.1 % in 20.
#[test]
fn the_actor_critic_regulates_with_a_vector_of_actions() {
    let map = || {
        LinearGaussianMap::new(LinearGaussianParameters {
            a: vec![vec![0.9, 0.2], vec![-0.1, 0.8]],
            b: vec![vec![0.5, 0.0], vec![0.1, 5.0]],
            offset: vec![0.2, -0.1],
            noise_std: vec![0.05, 0.05],
            target: vec![0.0, 0.0],
            state_cost: vec![0.1, 0.1],
            action_cost: vec![0.01, 1.0],
            initial_mean: vec![0.0, 0.0],
            initial_std: vec![0.7, 0.7],
            action_bounds: vec![[-4.0, 4.0], [-0.4, 0.4]],
            fall_beyond: None,
        })
        .unwrap()
    };
    let config = ActorCriticConfig {
        trials: 2000,
        restart_every: Some(8),
        basis_widths: vec![0.9, 0.9],
        outputs: [(1.0, 4.0), (0.1, 0.4)].map(|(unit, limit)| Output { unit, mean_weight_limit: Some(limit) }).to_vec(),
        actor_step: 1.0,
        scale_gradient_by_variance: true,
        trace_decay: 0.95,
        max_bases: 60,
        ..stepping()
    };
    // Mean reward of the mean action, with the same starts and noise for every policy.
    let reward = |policy: &dyn Policy| {
        let (mut map, mut rng) = (map(), ChaCha8Rng::seed_from_u64(99));
        let mut sum = 0.0;
        for _ in 0..1000 {
            walk(
                &mut map,
                8,
                &mut rng,
                |at| policy.mean(at),
                |_, made| {
                    sum += made.stride.reward / 8000.0;
                    Next::Go
                },
            )
            .unwrap();
        }
        sum
    };
    let (spec, best) = (map().spec().clone(), map().optimal(config.discount).unwrap());
    let rows: Vec<Vec<f64>> = (0..2).map(|j| best.gain.row(j).iter().copied().collect()).collect();
    let optimum = LinearPolicy::new(spec.clone(), best.offset.as_slice(), &rows, &[0.0; 2]).unwrap();
    let idle = reward(&ConstantPolicy::new(spec, &[0.0, 0.0]).unwrap());
    let optimum = reward(&optimum);
    let missed: Vec<f64> = (1..=10)
        .map(|seed| {
            let mut learner = ActorCritic { config: config.clone() };
            let policy = improve(&mut learner, &mut map(), seed).unwrap().policy;
            (optimum - reward(&policy)) / (optimum - idle)
        })
        .collect();
    assert!(missed.iter().all(|m| *m < 0.05), "{missed:?}");
}

/// Recipe A with the two changes that make every seed succeed on the linear map of stepping: of 1000
/// seeds the worst has a reward of −0.0029 and the median −0.00023 (as it stands: 28 of 1000 below
/// −0.005, the worst −0.48, the median −0.00043).
#[test]
fn no_seed_is_stuck_where_all_actions_are_clipped() {
    let config = ActorCriticConfig { mean_weights_within_bounds: true, trace_decay: 0.9, ..stepping() };
    for seed in 0..100 {
        let parameters = LinearGaussianParameters::stepping();
        let mut map = LinearGaussianMap::new(parameters).unwrap();
        let mut learner = ActorCritic { config: config.clone() };
        let policy = improve(&mut learner, &mut map, seed).unwrap().policy;
        let SavedPolicy::GaussianNetwork(network) = &policy else { panic!("not a network") };
        for base in 0..network.network().len() {
            let mean = network.network().weights(base)[0] * 2.0;
            assert!((-1.5..=5.0).contains(&mean), "{mean}");
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut sum = 0.0;
        walk(
            &mut map,
            110,
            &mut rng,
            |at| policy.mean(at),
            |_, made| {
                sum += if made.k < 10 { 0.0 } else { made.stride.reward };
                Next::Go
            },
        )
        .unwrap();
        assert!(sum / 100.0 > -0.005, "seed {seed}: {}", sum / 100.0);
    }
}
