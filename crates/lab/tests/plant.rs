//! The robot as a stride process: physics, contract, outcomes.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_lab::{Plant, Push, builtin};
use stridemap_process::{ProcessError, Stride, StrideEnd, StrideProcess};
use stridemap_record::FallCriterion;

fn plant(sets: &[&str]) -> Plant {
    let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
    builtin::load("stepping", &sets).unwrap().task.plant().unwrap()
}

fn strides(plant: &mut Plant, actions: &[f64], seed: u64) -> Vec<Stride> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    plant.reset(&mut rng).unwrap();
    let mut made = Vec::new();
    for action in actions {
        let stride = plant.stride(&[*action], &mut rng).unwrap();
        let goes_on = stride.end == StrideEnd::Crossing;
        made.push(stride);
        if !goes_on {
            break;
        }
    }
    made
}

/// The nominal gait found in an independent prototype: 0.577 s a stride, psi_roll 3.01 deg, reward
/// -0.102 = -0.1 (2 - 3.01)^2, within what a change of the physics step changes.
#[test]
fn nominal_stepping_is_the_one_that_was_found_by_experiment() {
    let mut plant = plant(&[]);
    let made = strides(&mut plant, &[0.0; 30], 1);
    assert!(made.iter().all(|s| s.end == StrideEnd::Crossing));
    for stride in &made[10..] {
        let psi_deg = stride.next.state[0];
        assert!((psi_deg - 3.01).abs() < 0.03, "{psi_deg}");
        assert!((stride.reward + 0.1 * (2.0 - psi_deg).powi(2)).abs() < 1e-12);
    }
    assert!((plant.last_measures().duration_s - 0.577).abs() < 0.003);
}

/// More pitch amplitude brings the mass further out over the stance foot: about -0.2 deg per deg.
#[test]
fn the_action_moves_the_section_with_the_sign_and_size_that_was_found() {
    let settled = |action: f64| strides(&mut plant(&[]), &[action; 25], 1)[24].next.state[0];
    let gain = (settled(1.0) - settled(-1.0)) / 2.0;
    assert!((-0.6..-0.15).contains(&gain), "{gain}");
}

#[test]
fn the_same_seed_gives_the_same_strides_to_the_bit_and_a_disturbed_start_another() {
    let actions = [0.3, -0.2, 0.5, 0.0, 1.0];
    let first = strides(&mut plant(&[]), &actions, 7);
    let mut again = plant(&[]);
    strides(&mut again, &[1.0; 4], 3); // what was done before a reset does not matter
    assert_eq!(strides(&mut again, &actions, 7), first);
    let noisy = &["robot.start_joint_noise_deg=0.2"];
    let (a, b) = (strides(&mut plant(noisy), &actions, 7), strides(&mut plant(noisy), &actions, 8));
    assert_ne!(a, b);
    assert_eq!(strides(&mut plant(noisy), &actions, 7), a);
}

#[test]
fn bad_actions_are_refused_and_bounds_are_kept() {
    let mut plant = plant(&[]);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    assert!(matches!(plant.stride(&[0.0], &mut rng), Err(ProcessError::NotReset)));
    plant.reset(&mut rng).unwrap();
    assert!(matches!(plant.stride(&[f64::NAN], &mut rng), Err(ProcessError::ActionNotFinite { component: 0, .. })));
    assert!(matches!(plant.stride(&[0.0, 0.0], &mut rng), Err(ProcessError::ActionLength { .. })));
    let stride = plant.stride(&[99.0], &mut rng).unwrap();
    assert!((stride.action()[0] - 5.0).abs() < 1e-15);
}

/// 400 N for 0.4 s on 95 kg: 1.7 m/s to the side, far more than the next step can catch.
#[test]
fn a_fall_is_an_outcome_with_its_reward_and_the_robot_starts_afresh() {
    let mut plant = plant(&[]);
    strides(&mut plant, &[0.0; 3], 1);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    plant.push_in_next_stride(Push::sideways(400.0, 0.4));
    let mut last = plant.stride(&[0.0], &mut rng).unwrap();
    for _ in 0..3 {
        if last.end == StrideEnd::Crossing {
            last = plant.stride(&[0.0], &mut rng).unwrap();
        }
    }
    assert!(last.end.is_terminal(), "{last:?}");
    assert!((last.reward + 1.0).abs() < 1e-15);
    let cause = plant.last_fall().unwrap();
    assert_eq!(cause.criterion.end(), last.end);
    assert_eq!(plant.falls().len(), 1);
    assert_eq!(plant.falls()[0].1, cause);
    match cause.criterion {
        FallCriterion::PsiRoll | FallCriterion::Height => assert!(cause.value < cause.threshold),
        FallCriterion::Tilt | FallCriterion::NoSection => assert!(cause.value > cause.threshold),
    }
    let counters = plant.counters();
    assert_eq!(counters.falls + counters.stalls, 1);
    assert!(matches!(plant.stride(&[0.0], &mut rng), Err(ProcessError::NotReset)));
    let afresh = strides(&mut plant, &[0.0; 12], 1);
    assert!((afresh[11].next.state[0] - 3.01).abs() < 0.03);
}

/// A push to the outside brings the mass out over the foot; the impulse is what counts, so that its
/// mirror image does the opposite.
#[test]
fn pushes_move_the_section_and_left_and_right_differ() {
    let after_push = |left_n: f64| {
        let mut plant = plant(&[]);
        strides(&mut plant, &[0.0; 12], 1);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        plant.push_in_next_stride(Push::sideways(left_n, 0.2));
        plant.stride(&[0.0], &mut rng).unwrap().next.state[0]
    };
    let (left, none, right) = (after_push(30.0), after_push(0.0), after_push(-30.0));
    assert!((left - none) * (right - none) < 0.0, "{left} {none} {right}");
    assert!((left - none).abs() > 0.3 && (right - none).abs() > 0.3);
}

#[test]
fn a_robot_that_cannot_walk_is_an_error_that_says_what_to_do() {
    let mut plant = plant(&["gait.coupling_rad_s=0"]);
    let error = plant.reset(&mut ChaCha8Rng::seed_from_u64(1)).unwrap_err().to_string();
    assert!(error.contains("tilt") && error.contains("stridemap tune"), "{error}");
}
