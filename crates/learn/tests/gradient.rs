//! The policy's score against finite differences, and the estimated gradient against the exact one.

#![allow(clippy::unwrap_used)]

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_learn::{ActorCriticConfig, ActorCriticRun, GaussianPolicy, KeptPolicy, Policy, SavedPolicy};
use stridemap_process::{
    Action, ActionDimension, ProcessError, ProcessSpec, Situation, StateDimension, Stride, StrideEnd, StrideProcess,
};
use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters};

fn spec(states: usize, actions: usize, bound: f64) -> ProcessSpec {
    ProcessSpec {
        state: (0..states).map(|i| StateDimension { name: format!("x{i}") }).collect(),
        action: (0..actions).map(|j| ActionDimension { name: format!("u{j}"), lower: -bound, upper: bound }).collect(),
        goal: Vec::new(),
    }
}

/// Two states, two actions of different units, three bases.
fn vector_policy() -> GaussianPolicy {
    let mut policy = GaussianPolicy::new(spec(2, 2, 9.0), &[0.5, 3.0], &[2.0, 0.5], 0.8).unwrap();
    for (centre, weights) in [
        ([0.0, 0.0], [0.3, -0.2, 0.1, -1.0, 0.7]),
        ([0.6, 1.0], [-0.5, 0.9, 0.8, 0.3, -0.4]),
        ([-0.5, 4.0], [1.2, 0.1, -0.7, 1.5, 0.2]),
    ] {
        policy.network_mut().allocate(&centre);
        let base = policy.network().len() - 1;
        policy.network_mut().weights_mut(base).copy_from_slice(&weights);
    }
    policy
}

#[test]
fn the_score_agrees_with_finite_differences() {
    let policy = vector_policy();
    let h = 1e-5;
    for (x, u) in [([0.1, 0.5], [1.0, 0.3]), ([-0.4, 3.0], [-2.0, -0.6]), ([2.0, 9.0], [0.0, 0.9])] {
        let x = Situation::from(x);
        let gradient = policy.log_density_gradient(&x, &u);
        for base in 0..3 {
            for column in 0..4 {
                let at = |shift: f64| {
                    let mut moved = policy.clone();
                    moved.network_mut().weights_mut(base)[column] += shift;
                    moved.log_density(&x, &u)
                };
                let numerical = (at(h) - at(-h)) / (2.0 * h);
                let exact = if column < 2 { gradient.mean[base][column] } else { gradient.std_logit[base][column - 2] };
                // Rounding of ln π / h, and the third derivative times h².
                let tolerance = 1e-8 * (1.0 + exact.abs());
                assert!((numerical - exact).abs() < tolerance, "{numerical} is not {exact}");
            }
        }
    }
}

/// Samples have the mean and standard deviation that the policy states, and its density.
#[test]
fn samples_are_drawn_from_the_stated_density() {
    let policy = vector_policy();
    let x = Situation::from([0.2, 1.0]);
    let (mean, std) = (policy.mean(&x), policy.std(&x));
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let n = 100_000;
    let draws: Vec<Action> = (0..n).map(|_| policy.sample(&x, &mut rng)).collect();
    for j in 0..2 {
        let z: Vec<f64> = draws.iter().map(|u| (u[j] - mean[j]) / std[j]).collect();
        let average = z.iter().sum::<f64>() / f64::from(n);
        let square = z.iter().map(|z| z * z).sum::<f64>() / f64::from(n);
        assert!(average.abs() < 4.0 / f64::from(n).sqrt());
        assert!((square - 1.0).abs() < 4.0 * (2.0 / f64::from(n)).sqrt());
    }
    let log_density: f64 = (0..2)
        .map(|j| {
            let z = (draws[0][j] - mean[j]) / std[j];
            -0.5 * z * z - std[j].ln() - 0.5 * (2.0 * std::f64::consts::PI).ln()
        })
        .sum();
    assert!((policy.log_density(&x, &draws[0]) - log_density).abs() < 1e-12);
}

#[test]
fn a_file_brings_back_every_bit() {
    let policy = vector_policy();
    let text = serde_json::to_string(&policy.to_saved()).unwrap();
    assert!(text.starts_with(r#"{"kind":"gaussian_network","format":1"#), "{text}");
    let back: SavedPolicy = serde_json::from_str(&text).unwrap();
    assert_eq!(serde_json::to_string(&back).unwrap(), text);
    for i in 0..200 {
        let x = Situation::from([0.013 * f64::from(i) - 1.0, 0.07 * f64::from(i)]);
        for (a, b) in policy.mean(&x).iter().zip(back.mean(&x)) {
            assert_eq!(a.to_bits(), b.to_bits());
        }
    }
    for (wrong, what) in [
        (text.replace(r#""format":1"#, r#""format":2"#), "format 2"),
        (text.replace("std_scale", "std_skale"), "std_skale"),
        (text.replace(r#""std_scale":0.8"#, r#""std_scale":-0.8"#), "std_scale"),
    ] {
        let error = serde_json::from_str::<SavedPolicy>(&wrong).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
}

/// A linear map from one start, whose second stride ends the episode with its reward.
struct TwoStrides {
    map: LinearGaussianMap,
    strides: usize,
    last: usize,
}

impl StrideProcess for TwoStrides {
    fn spec(&self) -> &ProcessSpec {
        self.map.spec()
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        self.strides = 0;
        self.map.reset(rng)
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        self.strides += 1;
        let mut stride = self.map.stride(action, rng)?;
        if self.strides == self.last {
            stride.end = StrideEnd::Fell;
        }
        Ok(stride)
    }
}

const A: f64 = 0.8;
const B: f64 = 0.5;
const OFFSET: f64 = 0.3;
const NOISE: f64 = 0.2;
const START: f64 = 1.5;
const MEAN: f64 = 0.4;
const LOGIT: f64 = 0.3;
const STD_SCALE: f64 = 0.7;
const DISCOUNT: f64 = 0.9;

fn scalar(bound: f64, last: usize) -> TwoStrides {
    let parameters = LinearGaussianParameters {
        a: vec![vec![A]],
        b: vec![vec![B]],
        offset: vec![OFFSET],
        noise_std: vec![NOISE],
        target: vec![0.0],
        state_cost: vec![1.0],
        action_cost: vec![0.1],
        initial_mean: vec![START],
        initial_std: vec![0.0],
        action_bounds: vec![[-bound, bound]],
        fall_beyond: None,
    };
    TwoStrides { map: LinearGaussianMap::new(parameters).unwrap(), strides: 0, last }
}

/// Estimates Σ δ(k) e(k) from single episodes, by what the learner adds to its weights with a step so
/// small that the policy stays. One base for all states: two parameters, mean and logit. Returns
/// means and standard errors.
fn estimates(process: &mut TwoStrides, value: f64, episodes: usize) -> [(f64, f64); 2] {
    const STEP: f64 = 1e-11;
    let config = ActorCriticConfig {
        discount: DISCOUNT,
        trace_decay: DISCOUNT, // η = γ: the condition of eq. (20)
        critic_step: 0.0,
        actor_step: STEP,
        std_scale: STD_SCALE,
        trials: episodes,
        strides_per_trial: process.last,
        ..ActorCriticConfig::paper(&[1e6], &[1.0])
    };
    let mut policy = GaussianPolicy::new(process.spec().clone(), &[1e6], &[1.0], STD_SCALE).unwrap();
    policy.network_mut().allocate(&[0.0]);
    policy.network_mut().weights_mut(0).copy_from_slice(&[MEAN, LOGIT, value]);
    let mut run = ActorCriticRun::new(&config, &process.spec().clone(), Some(&policy.to_saved())).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(17);
    let mut sums = [(0.0, 0.0); 2];
    let mut before = [MEAN, LOGIT];
    for _ in 0..episodes {
        run.run_trial(process, &mut rng).unwrap();
        let after = run.policy().network().weights(0);
        for ((sum, before), after) in sums.iter_mut().zip(&mut before).zip(after) {
            let estimate = (after - *before) / STEP;
            sum.0 += estimate;
            sum.1 += estimate * estimate;
            *before = *after;
        }
    }
    let n = episodes as f64;
    sums.map(|(sum, square)| {
        let mean = sum / n;
        (mean, ((square / n - mean * mean) / n).sqrt())
    })
}

/// E r(1) and E r(2) where the first action is drawn with (mean, logit) and the second with others.
fn expected_rewards(first: [f64; 2], second: [f64; 2]) -> [f64; 2] {
    let std = |logit: f64| STD_SCALE / (1.0 + (-logit).exp());
    let mut x = (START, 0.0); // mean and variance
    [first, second].map(|[mean, logit]| {
        let variance = std(logit).powi(2);
        x = (A * x.0 + B * mean + OFFSET, A * A * x.1 + B * B * variance + NOISE * NOISE);
        -(x.0 * x.0 + x.1) - 0.1 * (mean * mean + variance)
    })
}

/// Eq. (20): the mean of Σ δ e over episodes is Σₖ ∂/∂w E{V(k)}, where w acts at stride k only; and
/// whatever V̂ is, as long as episodes end (a baseline does not shift it).
#[test]
fn the_estimated_gradient_is_the_exact_one_whatever_the_baseline() {
    let h = 1e-4;
    let derivative = |f: &dyn Fn([f64; 2]) -> f64, i: usize| {
        let at = |shift: f64| {
            let mut w = [MEAN, LOGIT];
            w[i] += shift;
            f(w)
        };
        (at(h) - at(-h)) / (2.0 * h)
    };
    let here = [MEAN, LOGIT];
    for value in [0.0, -4.0] {
        let found = estimates(&mut scalar(1e3, 2), value, 2_000_000);
        for (i, (mean, std_error)) in found.into_iter().enumerate() {
            let first = derivative(
                &|w| {
                    let [r1, r2] = expected_rewards(w, here);
                    r1 + DISCOUNT * r2
                },
                i,
            );
            let second = derivative(&|w| expected_rewards(here, w)[1], i);
            let exact = first + second;
            assert!(std_error < 0.05 * exact.abs(), "{std_error} of {exact}");
            assert!((mean - exact).abs() < 4.0 * std_error, "{mean} ± {std_error} is not {exact}");
        }
    }
}

/// One stride with clipping that bites: what the learner does (the score of the sampled output) is
/// the gradient of the clipped reward; the score of the clipped action would not be.
#[test]
fn clipped_actions_do_not_bias_the_gradient() {
    let bound = 0.5;
    let std = STD_SCALE / (1.0 + (-LOGIT).exp());
    // E r as a function of mean and standard deviation, by quadrature over the sampled output.
    let integrate = |mean: f64, std: f64, f: &dyn Fn(f64) -> f64| {
        let (n, reach) = (40_000, 9.0);
        let step = 2.0 * reach / f64::from(n);
        (0..=n)
            .map(|i| {
                let z = -reach + f64::from(i) * step;
                let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
                step * density * f(mean + std * z)
            })
            .sum::<f64>()
    };
    let reward = |output: f64| {
        let u = output.clamp(-bound, bound);
        let x = A * START + B * u + OFFSET;
        -(x * x + NOISE * NOISE) - 0.1 * u * u
    };
    let h = 1e-4;
    let by_mean = (integrate(MEAN + h, std, &reward) - integrate(MEAN - h, std, &reward)) / (2.0 * h);
    let by_std = (integrate(MEAN, std + h, &reward) - integrate(MEAN, std - h, &reward)) / (2.0 * h);
    let by_logit = by_std * std * (1.0 - std / STD_SCALE);
    let found = estimates(&mut scalar(bound, 1), -2.0, 200_000);
    for ((mean, std_error), exact) in found.into_iter().zip([by_mean, by_logit]) {
        assert!((mean - exact).abs() < 4.0 * std_error, "{mean} ± {std_error} is not {exact}");
    }
    // The other choice: score at the clipped action.
    let of_clipped = integrate(MEAN, std, &|o| (reward(o) + 2.0) * (o.clamp(-bound, bound) - MEAN) / (std * std));
    assert!((of_clipped - by_mean).abs() > 20.0 * found[0].1, "{of_clipped} against {by_mean}");
    // Its expected score is not zero, so that even a baseline would move the policy.
    let score = integrate(MEAN, std, &|o| (o.clamp(-bound, bound) - MEAN) / (std * std));
    assert!(score < -0.1, "{score}");
}

/// The exact value of the linear map, used as a check on `expected_rewards` itself.
#[test]
fn expected_rewards_agree_with_the_maps_own_value() {
    let process = scalar(1e3, 1);
    let std = STD_SCALE / (1.0 + (-LOGIT).exp());
    let value = process
        .map
        .evaluate(&DMatrix::zeros(1, 1), &DVector::from_element(1, MEAN), &DVector::from_element(1, std), 0.0)
        .unwrap();
    let [first, _] = expected_rewards([MEAN, LOGIT], [MEAN, LOGIT]);
    assert!((value.value(&[START]) - first).abs() < 1e-12);
}
