//! Walking, made small: the loop with caution keeps its books, its bounds and its seeds.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_lab::{Algorithm, LearnerKind, NoRecorder, Task, analyse, builtin};
use stridemap_map::{Kick, decay_after_kick};
use stridemap_process::StrideEnd;
use stridemap_record::{StrideRole, Summary, Verdict};

fn small(name: &str) -> Task {
    let mut task = builtin::load(name, &[]).unwrap().task;
    task.collect.strides = vec![40, 0];
    task.algorithm.iterations = 2;
    task.algorithm.strides_at_most = Some(90);
    task.record.walk_s = Some(5.0);
    task.record.pose_seconds = 0.0;
    task.collect.warm_up_strides = 4;
    if let Some(search) = &mut task.learner.search {
        search.generations = 4;
    }
    task.learner.actor_critic.trials = 3;
    if let Some(caution) = &mut task.caution {
        caution.proof.trial_strides = 20;
        caution.proof.proof_strides = 25;
    }
    task.validate().unwrap();
    task
}

fn learned(task: &Task, seed: u64) -> (Summary, usize) {
    let mut algorithm = Algorithm::new(task, seed).unwrap();
    algorithm.learn(&mut NoRecorder).unwrap();
    let progress = &algorithm.progress;
    for t in &progress.transitions {
        assert_eq!(t.role, StrideRole::Training);
        // Bounds and rates hold on the robot, whoever chose the action.
        for ((u, last), a) in t.action.iter().zip(&t.last_action).zip(&task.action) {
            assert!(*u >= a.bounds[0] - 1e-9 && *u <= a.bounds[1] + 1e-9);
            assert!((u - last).abs() <= a.rate_per_stride.unwrap() + 1e-9);
        }
    }
    let falls = progress.transitions.iter().filter(|t| t.end == StrideEnd::Fell).count();
    (progress.summary(task, seed), falls)
}

/// Every learner stays within the budget, counts every fall and proves what it calls proven.
#[test]
fn every_learner_keeps_the_books() {
    for kind in LearnerKind::CONTROLS.into_iter().chain([LearnerKind::SEARCH]) {
        let mut task = small("walking");
        task.learner.kind = kind;
        let (summary, falls) = learned(&task, 3);
        let made: usize = summary.iterations.iter().map(|i| i.strides).sum();
        assert_eq!(made, summary.strides.training, "{kind:?}");
        assert!(made <= 90, "{kind:?}: {made}");
        let counted: usize = summary.iterations.iter().map(|i| i.falls).sum();
        assert_eq!(counted, falls, "{kind:?}");
        for iteration in &summary.iterations {
            let proof = iteration.proof.as_ref().unwrap();
            if proof.verdict == Verdict::Proven {
                assert_eq!(proof.strides, 25, "{kind:?}");
            }
            assert!(iteration.speed_m_s.is_some());
        }
        let measured = summary.final_policy.unwrap();
        assert!(measured.upright_s.unwrap() <= 5.0);
    }
}

/// The small humanoid under the same loop: its learner and the control that steers `ψ_roll`. Its
/// odometry agrees with the simulator's way, and iterations' policies walk the first part only.
#[test]
fn the_small_humanoid_keeps_the_books() {
    for kind in [LearnerKind::ACTOR_CRITIC, LearnerKind::INTEGRAL] {
        let loaded = builtin::load("small-walking", &[]).unwrap();
        let mut task = loaded.on(None, 3).unwrap().task;
        task.learner.kind = kind;
        task.collect.strides = vec![30, 0];
        task.learner.actor_critic.trials = 20;
        task.algorithm.strides_at_most = Some(62); // 32 of them are the proof
        task.algorithm.iterations = 1;
        task.record.walk_s = Some(12.0);
        task.record.speed_s = Some(8.0);
        task.record.pose_seconds = 0.0;
        task.validate().unwrap();
        let (summary, falls) = learned(&task, 3);
        assert_eq!(falls, 0, "{kind:?}");
        assert_eq!(summary.iterations[0].upright_s, Some(8.0), "{kind:?}");
        let walk = summary.final_policy.unwrap().performance.walk.unwrap();
        assert!((walk.upright_s - 12.0).abs() < 1e-12, "{kind:?}");
        let truth = walk.true_speed_m_s.unwrap();
        assert!(truth > 0.01 && (walk.speed_m_s - truth).abs() < 0.003, "{walk:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_policy() {
    let task = small("walking-single");
    let without_seconds = |(mut summary, _): (Summary, usize)| {
        summary.seconds.total = 0.0;
        summary.seconds.by_work = Default::default();
        summary
    };
    let first = without_seconds(learned(&task, 5));
    assert_eq!(first, without_seconds(learned(&task, 5)));
}

/// With A_walk alone the robot alternates: at 6 to 9 deg a kick decays by -0.7 to -0.95 a stride, slowest
/// nearest to the cliff, and at 11.5 deg a constant action falls.
#[test]
fn a_walk_near_its_cliff_flips() {
    let mut task = builtin::load("walking-single", &[]).unwrap().task;
    for action in &mut task.action {
        (action.gain, action.rate_per_stride) = (1.0, None);
    }
    let mut robot = task.plant().unwrap();
    let watched = 2;
    let mut flip = |deg: f64| {
        let kick = Kick { action: &[deg], neutral: &[0.0], component: 0, size: 1.0, watched };
        decay_after_kick(&mut robot, &kick, &ChaCha8Rng::seed_from_u64(1)).unwrap()
    };
    let flips = [6.0, 8.0, 9.0].map(|deg| flip(deg).unwrap());
    for m in flips {
        assert!((-0.95..-0.7).contains(&m), "{flips:?}");
    }
    assert!(flips[2] < flips[0], "{flips:?}");
    assert_eq!(flip(11.5), None);
}

/// With A_walk alone 90 strides tell the map the flip where the robot walked; every stride that reached
/// the section is predicted once, without and with the last action.
#[test]
fn an_analysis_sets_the_map_beside_the_robot() {
    let task = small("walking-single");
    let mut algorithm = Algorithm::new(&task, 22).unwrap();
    algorithm.learn(&mut NoRecorder).unwrap();
    let progress = &algorithm.progress;
    let found = analyse(&task, progress, 22).unwrap();
    let reached = progress.transitions.iter();
    let reached = reached.filter(|t| t.end == StrideEnd::Crossing).count();
    let rows = &found.pitch_rate_residual_deg_s;
    assert_eq!(
        rows.iter().map(|r| (r.last_action, r.strides)).collect::<Vec<_>>(),
        [(false, reached), (true, reached)]
    );
    let flip = &found.flips[0];
    let (map, robot) = (flip.map.unwrap(), flip.robot.unwrap());
    assert!((map - robot).abs() < 0.2, "{map} {robot}");
}

/// What the components of the state say, a task file cannot say otherwise.
#[test]
fn an_invariant_in_a_task_file_is_refused() {
    let error = builtin::load("walking", &["map.invariant=[1]".into()]).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("map.invariant") && text.contains("heading_deg"), "{text}");
}
