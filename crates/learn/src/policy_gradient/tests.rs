//! Both estimates against the exact gradient of a linear map.

use nalgebra::{DMatrix, DVector};
use rand_chacha::rand_core::SeedableRng;
use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters};

use super::*;

const GAMMA: f64 = 0.8;
const MEAN: f64 = 0.4;
const LOGIT: f64 = 0.3;
const STD_SCALE: f64 = 0.8;

fn map() -> LinearGaussianMap {
    LinearGaussianMap::new(LinearGaussianParameters {
        a: vec![vec![0.7]],
        b: vec![vec![0.5]],
        offset: vec![0.2],
        noise_std: vec![0.1],
        target: vec![1.0],
        state_cost: vec![1.0],
        action_cost: vec![0.1],
        initial_mean: vec![0.5],
        initial_std: vec![0.3],
        action_bounds: vec![[-50.0, 50.0]],
        fall_beyond: None,
    })
    .unwrap()
}

fn network() -> ActorCriticConfig {
    ActorCriticConfig { discount: GAMMA, std_scale: STD_SCALE, ..ActorCriticConfig::paper(&[0.4], &[1.0]) }
}

/// The slopes of the exact value from the start distribution by mean and logit of a policy that does not look at the
/// state.
fn exact() -> [f64; 2] {
    let value = |mean: f64, logit: f64| {
        let std = STD_SCALE / (1.0 + (-logit).exp());
        let (gain, mean, std) = (DMatrix::zeros(1, 1), DVector::from_element(1, mean), DVector::from_element(1, std));
        let v = map().evaluate(&gain, &mean, &std, GAMMA).unwrap();
        v.value(&[0.5]) - v.quadratic[(0, 0)] * 0.3 * 0.3
    };
    let h = 1e-4;
    [
        (value(MEAN + h, LOGIT) - value(MEAN - h, LOGIT)) / (2.0 * h),
        (value(MEAN, LOGIT + h) - value(MEAN, LOGIT - h)) / (2.0 * h),
    ]
}

/// A policy that answers alike at all states, whatever its bases.
fn policy(centres: &[f64]) -> GaussianPolicy {
    let mut policy = GaussianPolicy::new(map().spec().clone(), &[0.4], &[1.0], STD_SCALE).unwrap();
    for centre in centres {
        policy.network_mut().allocate(&[*centre]);
        let last = policy.network().len() - 1;
        policy.network_mut().weights_mut(last)[..2].copy_from_slice(&[MEAN, LOGIT]);
    }
    policy
}

fn batch(policy: &mut GaussianPolicy, strides: usize, episode_strides: usize, seed: u64) -> Batch {
    let config = PolicyGradientConfig {
        strides_per_trial: strides,
        episode_strides,
        max_bases: policy.network().len(),
        ..PolicyGradientConfig::default()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    batch::collect(&network(), &config, policy, &mut map(), 1, &mut rng).unwrap()
}

/// One base: the posterior of both slopes holds the exact ones within four of its standard deviations, and is tight
/// enough to tell the sign of the mean's.
#[test]
fn the_bayesian_posterior_holds_the_exact_gradient() {
    let exact = exact();
    for seed in 1..=3 {
        let batch = batch(&mut policy(&[0.5]), 40 * 300, 40, seed);
        let posterior = bayesian::posterior(&batch, GAMMA).unwrap();
        for (k, exact) in exact.iter().enumerate() {
            let (found, std) = (posterior.gradient[k], posterior.covariance[(k, k)].sqrt());
            assert!((found - exact).abs() < 4.0 * std, "seed {seed}, {k}: {found} ± {std}, exact {exact}");
        }
        assert!(posterior.gradient[0].abs() > 2.0 * posterior.covariance[(0, 0)].sqrt());
    }
}

/// The natural gradient times the Fisher information is the gradient \[PS08, eq. (20)\]: over batches of strides,
/// weighted by the discount since the start, it scatters about the exact one.
#[test]
fn the_natural_gradient_is_the_exact_one() {
    let exact = exact();
    let centres: Vec<f64> = (0..7).map(|i| -0.4 + 0.4 * f64::from(i)).collect();
    let mut found = [Vec::new(), Vec::new()];
    for seed in 1..=16 {
        let batch = batch(&mut policy(&centres), 6_000, 30, seed);
        let estimate = natural::estimate(&batch, GAMMA, 0.9).unwrap();
        // ∇J = Σₖ γᵏ E[φ φᵀ] g; of both common parameters, so summed over bases.
        let mut gradient = [0.0; 2];
        for path in batch.episodes() {
            let mut weight = 1.0;
            for stride in path {
                let mut score = vec![0.0; batch.parameters()];
                batch.add_gradient(stride, &mut score);
                let along: f64 = score.iter().zip(&estimate.natural).map(|(s, g)| s * g).sum();
                for (k, gradient) in gradient.iter_mut().enumerate() {
                    *gradient += weight * along * score.iter().skip(k).step_by(2).sum::<f64>() / 200.0;
                }
                weight *= GAMMA;
            }
        }
        (0..2).for_each(|k| found[k].push(gradient[k]));
    }
    for k in 0..2 {
        let n = found[k].len() as f64;
        let mean = found[k].iter().sum::<f64>() / n;
        let error = (found[k].iter().map(|g| (g - mean).powi(2)).sum::<f64>() / n / (n - 1.0)).sqrt();
        assert!((mean - exact[k]).abs() < 4.0 * error, "{k}: {mean} ± {error}, exact {}", exact[k]);
    }
}
