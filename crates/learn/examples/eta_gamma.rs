//! Does the paper's eq. (20), derived for η = γ, need η = γ? The actor-critic over a grid of trace decay η and discount γ on
//! two exact maps, of stepping and of a walk beside a cliff, 20 seeds each; prints the table of docs/questions.md.
//!
//! `cargo run -p stridemap-learn --example eta_gamma`

#![allow(clippy::print_stdout, reason = "an example prints")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_learn::{ActorCritic, ActorCriticConfig, LearnError, Learner, Output, Policy};
use stridemap_process::{Next, StrideProcess, walk};
use stridemap_testbed::{CliffWalk, CliffWalkParameters, LinearGaussianMap, LinearGaussianParameters};

const SEEDS: u64 = 20;
const FIRST_SEED: u64 = 5001;

/// Mean reward of the mean action over 6 strides from each of 300 starts, the same for every policy.
fn stepping(policy: &dyn Policy) -> Result<f64, Box<dyn std::error::Error>> {
    let mut map = LinearGaussianMap::new(LinearGaussianParameters::stepping())?;
    let (mut rng, mut sum) = (ChaCha8Rng::seed_from_u64(99), 0.0);
    for _ in 0..300 {
        walk(
            &mut map,
            6,
            &mut rng,
            |at| policy.mean(at),
            |_, made| {
                sum += made.stride.reward / 1800.0;
                Next::Go
            },
        )?;
    }
    Ok(sum)
}

/// Mean, and half of its 95 % interval (t with 19 degrees of freedom).
fn interval(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, 2.093 * (variance / n).sqrt())
}

type Failure = Box<dyn std::error::Error>;

/// The policies of all seeds with these decays, judged; `None` for one that diverged.
fn over_seeds(
    config: &ActorCriticConfig,
    process: &dyn Fn() -> Result<Box<dyn StrideProcess>, Failure>,
    judge: &dyn Fn(&dyn Policy) -> Result<f64, Failure>,
) -> Result<(Vec<f64>, usize), Failure> {
    let (mut values, mut diverged) = (Vec::new(), 0);
    for seed in FIRST_SEED..FIRST_SEED + SEEDS {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut learner = ActorCritic { config: config.clone() };
        match learner.improve(process()?.as_mut(), None, &mut rng, &mut |_| ()) {
            Ok(outcome) => values.push(judge(&outcome.policy)?),
            Err(LearnError::Diverged { .. }) => diverged += 1,
            Err(error) => return Err(error.into()),
        }
    }
    Ok((values, diverged))
}

fn main() -> Result<(), Failure> {
    const ETAS: [f64; 5] = [0.0, 0.3, 0.6, 0.9, 0.95];
    const GAMMAS: [f64; 4] = [0.3, 0.6, 0.9, 0.95];
    println!("map       gamma   eta   mean [95 %], diverged (eta = gamma is marked =)");
    for gamma in GAMMAS {
        for eta in ETAS {
            let same = if (eta - gamma).abs() < 1e-9 { "=" } else { " " };
            let step = ActorCriticConfig {
                discount: gamma,
                trace_decay: eta,
                mean_weights_within_bounds: true,
                ..ActorCriticConfig::stepping()
            };
            let map = || -> Result<Box<dyn StrideProcess>, Failure> {
                Ok(Box::new(LinearGaussianMap::new(LinearGaussianParameters::stepping())?))
            };
            let (values, diverged) = over_seeds(&step, &map, &stepping)?;
            let (mean, half) = interval(&values);
            println!("stepping  {gamma:5}  {eta:4} {same} {mean:+.5} +- {half:.5}, {diverged}");
            let cliff = ActorCriticConfig {
                basis_widths: vec![0.15],
                outputs: vec![Output { unit: 0.3, mean_weight_limit: None }],
                ..step
            };
            let map = || -> Result<Box<dyn StrideProcess>, Failure> {
                Ok(Box::new(CliffWalk::new(CliffWalkParameters::default())))
            };
            // Judged alike whatever it learned with: the value from rest at 0.9, of the best one.
            let exact = CliffWalk::new(CliffWalkParameters::default());
            let best = exact.best_from_rest(0.9);
            let judge = |policy: &dyn Policy| -> Result<f64, Failure> {
                Ok(exact.value_from_rest(&|x| policy.mean(&[x].into())[0], 0.9) / best)
            };
            let (values, diverged) = over_seeds(&cliff, &map, &judge)?;
            let (mean, half) = interval(&values);
            println!("cliff     {gamma:5}  {eta:4} {same} {mean:+.5} +- {half:.5}, {diverged}");
        }
    }
    Ok(())
}
