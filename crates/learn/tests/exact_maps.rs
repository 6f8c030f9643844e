//! Every learner in a map on exact maps with known answers: the linear-quadratic regulator, and a cliff walk whose
//! best policy is computed on a grid.

#![allow(clippy::unwrap_used)]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_learn::{
    ActorCriticConfig, BayesianPolicyGradient, ConstantPolicy, CrossEntropy, CrossEntropyConfig, GpDp, GpDpConfig,
    Learner, LinearPolicy, NaturalActorCritic, Output, Pathwise, PathwiseConfig, Policy, PolicyGradientConfig,
};
use stridemap_process::{Next, StrideProcess, walk};
use stridemap_testbed::{CliffWalk, CliffWalkParameters, LinearGaussianMap, LinearGaussianParameters};

fn learners(network: &ActorCriticConfig) -> Vec<(&'static str, Box<dyn Learner>)> {
    let (network, gradient) = (network.clone(), PolicyGradientConfig::default());
    let (state_unit, action_unit) = (network.basis_widths.clone(), network.units());
    let discount = network.discount;
    vec![
        ("natural-actor-critic", Box::new(NaturalActorCritic { network: network.clone(), config: gradient })),
        ("bayes-policy-gradient", Box::new(BayesianPolicyGradient { network: network.clone(), config: gradient })),
        ("pathwise", Box::new(Pathwise { network: network.clone(), config: PathwiseConfig::default() })),
        ("gp-dp", Box::new(GpDp { network, config: GpDpConfig::default() })),
        ("cem", Box::new(CrossEntropy { config: CrossEntropyConfig::default(), discount, state_unit, action_unit })),
    ]
}

/// Mean reward of the mean action over episodes, the same noise for every policy.
fn reward(map: &mut LinearGaussianMap, policy: &dyn Policy) -> f64 {
    let (mut rng, mut sum) = (ChaCha8Rng::seed_from_u64(99), 0.0);
    for _ in 0..1000 {
        let act = |at: &_| policy.mean(at);
        walk(map, 8, &mut rng, act, |_, made| {
            sum += made.stride.reward / 8000.0;
            Next::Go
        })
        .unwrap();
    }
    sum
}

/// The map of stepping, with what an action costs: of what can be gained over a constant (that of rest at the target)
/// each learner misses little.
#[test]
fn each_learner_comes_near_the_linear_quadratic_regulator() {
    let parameters = LinearGaussianParameters {
        a: vec![vec![0.9]],
        b: vec![vec![0.5]],
        offset: vec![0.2],
        noise_std: vec![0.1],
        target: vec![0.0],
        state_cost: vec![0.1],
        action_cost: vec![0.01],
        initial_mean: vec![0.0],
        initial_std: vec![1.0],
        action_bounds: vec![[-4.0, 4.0]],
        fall_beyond: None,
    };
    let mut map = LinearGaussianMap::new(parameters).unwrap();
    let network = ActorCriticConfig {
        basis_widths: vec![0.7],
        outputs: vec![Output { unit: 1.0, mean_weight_limit: Some(4.0) }],
        ..ActorCriticConfig::stepping()
    };
    let best = map.optimal(network.discount).unwrap();
    let spec = map.spec().clone();
    let optimum = LinearPolicy::new(spec.clone(), best.offset.as_slice(), &[vec![best.gain[0]]], &[0.0]).unwrap();
    let idle = ConstantPolicy::new(spec, &[0.0]).unwrap();
    let (optimum, idle) = (reward(&mut map, &optimum), reward(&mut map, &idle));
    for (name, mut learner) in learners(&network) {
        let seed = 11;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let policy = learner.improve(&mut map, None, &mut rng, &mut |_| ()).unwrap().policy;
        let missed = (optimum - reward(&mut map, &policy)) / (optimum - idle);
        assert!(missed < 0.03, "{name}, seed {seed}: misses {missed} of what can be gained");
    }
}

/// The cliff walk: the value from rest of each learner's policy, exact on the grid, is near the best one, and nearer
/// than that of the best constant.
#[test]
fn each_learner_walks_near_the_cliff_and_not_over_it() {
    let mut map = CliffWalk::new(CliffWalkParameters::default());
    let network = ActorCriticConfig {
        discount: 0.9,
        basis_widths: vec![0.15],
        outputs: vec![Output { unit: 0.3, mean_weight_limit: None }],
        ..ActorCriticConfig::stepping()
    };
    let best = map.best_from_rest(network.discount);
    let constants = (0..=40).map(|i| f64::from(i) / 40.0);
    let constant = constants.map(|u| map.value_from_rest(&|_| u, network.discount)).fold(0.0, f64::max);
    for (name, mut learner) in learners(&network) {
        let seed = 11;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let policy = learner.improve(&mut map, None, &mut rng, &mut |_| ()).unwrap().policy;
        let value = map.value_from_rest(&|x| policy.mean(&[x].into())[0], network.discount);
        assert!(value > 0.92 * best, "{name}, seed {seed}: {value}, best {best}, best constant {constant}");
    }
}
