//! What is checked by hand: targets, traces, restarts, averages, bad answers.

use rand_chacha::rand_core::SeedableRng;
use stridemap_process::{ActionDimension, ProcessError, StateDimension, Stride};

use super::*;
use crate::policy::Policy;

/// Plays back (next state, reward, end); keeps the actions that it was given.
struct Script {
    spec: ProcessSpec,
    strides: Vec<(f64, f64, StrideEnd)>,
    played: usize,
    resets: usize,
    actions: Vec<f64>,
}

fn script(strides: &[(f64, f64, StrideEnd)]) -> Script {
    let spec = ProcessSpec {
        state: vec![StateDimension { name: "x".into() }],
        action: vec![ActionDimension { name: "u".into(), lower: -100.0, upper: 100.0 }],
        goal: Vec::new(),
    };
    Script { spec, strides: strides.to_vec(), played: 0, resets: 0, actions: Vec::new() }
}

impl StrideProcess for Script {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn reset(&mut self, _rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        self.resets += 1;
        Ok([0.0].into())
    }

    fn stride(&mut self, action: &[f64], _rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let (x, reward, end) = self.strides[self.played];
        self.played += 1;
        self.actions.push(action[0]);
        let next = Situation { last_action: Action::from_slice(action), ..[x].into() };
        Ok(Stride { next, reward, end })
    }
}

/// One base for everything, so that V̂ is one number, here 2, and the mean is one number, 0.
fn value_two(spec: &ProcessSpec) -> SavedPolicy {
    let mut policy = GaussianPolicy::new(spec.clone(), &[1e6], &[2.0], 0.5).unwrap();
    policy.network_mut().allocate(&[0.0]);
    policy.network_mut().weights_mut(0)[2] = 2.0;
    policy.to_saved()
}

fn config(strides_per_trial: usize) -> ActorCriticConfig {
    ActorCriticConfig {
        trials: 1,
        strides_per_trial,
        discount: 0.9,
        critic_step: 0.5,
        ..ActorCriticConfig::paper(&[1e6], &[2.0])
    }
}

fn run(config: &ActorCriticConfig, process: &mut Script) -> Result<(GaussianPolicy, TrialSummary), LearnError> {
    let initial = value_two(&process.spec);
    let mut run = ActorCriticRun::new(config, &process.spec, Some(&initial))?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut summary = None;
    for _ in 0..config.trials {
        summary = Some(run.run_trial(process, &mut rng)?);
    }
    Ok((run.policy().clone(), summary.unwrap()))
}

fn close(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} is not {b}");
}

/// With V̂ = 2, r = −1, γ = 0.9, α = 1/2.
#[test]
fn terminated_and_truncated_strides_have_different_targets() {
    let cases = [
        // End, δ, V̂ after: −1 − 2 without bootstrap, −1 + 0.9 · 2 − 2 with.
        (StrideEnd::Fell, -3.0, 0.5),
        (StrideEnd::NoCrossing, -3.0, 0.5),
        (StrideEnd::Crossing, -1.2, 1.4),
    ];
    for (end, td_error, value) in cases {
        // The last stride of a trial is truncated if it crossed.
        let (policy, summary) = run(&config(1), &mut script(&[(0.0, -1.0, end)])).unwrap();
        close(summary.mean_td_error, td_error);
        close(policy.value(&[0.0].into()), value);
        assert_eq!(summary.falls, usize::from(end == StrideEnd::Fell));
        assert_eq!(summary.stalls, usize::from(end == StrideEnd::NoCrossing));
    }
}

#[test]
fn a_fall_and_a_cut_reset_the_process_and_nothing_else_does() {
    let crossing = (0.0, 0.0, StrideEnd::Crossing);
    let mut process = script(&[crossing, (0.0, -1.0, StrideEnd::Fell), crossing, crossing]);
    run(&config(4), &mut process).unwrap();
    assert_eq!(process.resets, 2);
    let mut process = script(&[crossing; 6]);
    run(&ActorCriticConfig { restart_every: Some(2), ..config(6) }, &mut process).unwrap();
    assert_eq!(process.resets, 3);
}

#[test]
fn nothing_is_learned_from_an_aborted_stride() {
    let aborted = (f64::NAN, f64::NAN, StrideEnd::Aborted);
    let mut process = script(&[aborted, (0.0, -1.0, StrideEnd::Fell)]);
    let (policy, summary) = run(&config(2), &mut process).unwrap();
    close(policy.value(&[0.0].into()), 0.5);
    assert_eq!((summary.strides, summary.aborted, process.resets), (1, 1, 2));
    let error = run(&config(2), &mut script(&[aborted, aborted])).unwrap_err();
    assert!(matches!(error, LearnError::AllAborted { trial: 1 }));
}

/// Eqs. (18) to (22) for two strides, by hand from the actions that the process saw.
#[test]
fn traces_carry_over_within_an_episode_only() {
    let strides = [(0.0, -1.0, StrideEnd::Crossing), (0.0, 0.7, StrideEnd::Crossing)];
    for (restart_every, carried) in [(None, 1.0), (Some(1), 0.0)] {
        let config = ActorCriticConfig { restart_every, ..config(2) };
        let mut process = script(&strides);
        let (policy, _) = run(&config, &mut process).unwrap();

        let (gamma, alpha, beta, eta) = (0.9, 0.5, 0.3, 0.3);
        let (mut value, mut mean, mut logit) = (2.0, 0.0, 0.0);
        let (mut e_mean, mut e_logit) = (0.0, 0.0);
        for ((_, reward, _), action) in strides.iter().zip(&process.actions) {
            let delta = reward + gamma * value - value;
            let fraction = 1.0 / (1.0 + f64::exp(-logit));
            let std = 0.5 * fraction;
            let distance = action / 2.0 - mean;
            e_mean = eta * carried * e_mean + distance / (std * std);
            e_logit = eta * carried * e_logit + (distance * distance / (std * std) - 1.0) * (1.0 - fraction);
            value += alpha * delta;
            mean += beta * delta * e_mean;
            logit += beta * delta * e_logit;
        }
        let weights = policy.network().weights(0);
        for (found, expected) in weights.iter().zip([mean, logit, value]) {
            assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
        }
    }
}

#[test]
fn weights_stay_within_their_bounds() {
    let mut config = config(200);
    config.outputs[0].mean_weight_limit = Some(0.3); // 0.15 outputs of 2
    config.std_logit_bounds = Some([-0.1, 0.2]);
    let strides: Vec<_> = (0..200).map(|k| (0.0, f64::from(k % 7) - 3.0, StrideEnd::Crossing)).collect();
    let (policy, _) = run(&config, &mut script(&strides)).unwrap();
    let weights = policy.network().weights(0);
    assert!(weights[0].abs() <= 0.15 && (-0.1..=0.2).contains(&weights[1]), "{weights:?}");
}

/// The averaged policy is the mean of the frozen ones where no base was added; a base added while
/// averaging leaves the averaged outputs at its centre alone.
#[test]
fn the_average_is_right_although_bases_are_added() {
    let far = |k: usize| if k >= 24 { 50.0 } else { 0.0 };
    let strides: Vec<_> = (0..40).map(|k| (far(k), (k % 5) as f64 - 2.0, StrideEnd::Crossing)).collect();
    let config = ActorCriticConfig {
        trials: 8,
        average_fraction: 0.5,
        basis_widths: vec![1.0],
        critic_step: 0.1,
        actor_step: 0.05,
        ..config(5)
    };
    let mut process = script(&strides);
    let spec = process.spec.clone();
    let mut run = ActorCriticRun::new(&config, &spec, None).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut frozen = Vec::new();
    for _ in 0..8 {
        run.run_trial(&mut process, &mut rng).unwrap();
        frozen.push(run.policy().clone());
    }
    assert_eq!((frozen[3].network().len(), frozen[7].network().len()), (1, 2));
    let averaged = run.finish().policy;
    // Far from the new base, at −50, only the first one counts.
    let expected: f64 = frozen[4..].iter().map(|p| p.mean(&[-50.0].into())[0]).sum::<f64>() / 4.0;
    close(averaged.mean(&[-50.0].into())[0], expected);
    // At 50 the new base counts. Trials 5 (before it was there) and later are all in the mean: as
    // functions, too, since a policy without the base goes on to 50 with the first one's output.
    let expected: f64 = frozen[4..].iter().map(|p| p.mean(&[50.0].into())[0]).sum::<f64>() / 4.0;
    close(averaged.mean(&[50.0].into())[0], expected);
}

#[test]
fn nonsense_is_an_error_and_no_panic() {
    let crossing = StrideEnd::Crossing;
    for (x, r) in [(f64::NAN, 0.0), (0.0, f64::NAN), (f64::INFINITY, 0.0)] {
        let error = run(&config(1), &mut script(&[(x, r, crossing)])).unwrap_err();
        assert!(matches!(error, LearnError::NotFinite { trial: 1, stride: 1, .. }), "{error}");
    }
    let error = run(&config(3), &mut script(&[(0.0, 1e308, crossing); 3])).unwrap_err();
    assert!(matches!(error, LearnError::Diverged { .. }), "{error}");

    let process = script(&[]);
    let constant = crate::ConstantPolicy::new(process.spec.clone(), &[0.0]).unwrap().to_saved();
    let error = ActorCriticRun::new(&config(1), &process.spec, Some(&constant)).unwrap_err();
    assert!(matches!(error, LearnError::InitialPolicy { found: "constant", .. }));
    let narrow = ActorCriticConfig { basis_widths: vec![1.0, 1.0], ..config(1) };
    let error = ActorCriticRun::new(&narrow, &process.spec, None).unwrap_err();
    assert!(matches!(error, LearnError::Length { field: "basis_widths", expected: 1, found: 2 }));
}
