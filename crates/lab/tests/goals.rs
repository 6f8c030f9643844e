//! A task with goals on the biped, small: learned, measured, cut and resumed to the same bytes, replayed.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use stridemap_lab::{Algorithm, LearnerKind, NoRecorder, builtin, run_learner};
use stridemap_record::Columns;

fn small() -> builtin::LoadedTask {
    let sets = [
        "collect.strides=[30, 10]",
        "algorithm.strides_at_most=40",
        "record.strides=15",
        "record.iteration_strides=10",
        "record.sweep=false",
        "record.pose_seconds=0",
        "learner.goals.candidates=3",
        "learner.goals.pairs=4",
    ];
    builtin::load("walking-goals", &sets.map(String::from)).unwrap()
}

#[test]
fn goals_are_followed_measured_and_kept_and_equal_seeds_are_equal() {
    let task = small().task;
    let run = || {
        let mut algorithm = Algorithm::new(&task, 1).unwrap().however_often_it_falls();
        algorithm.learn(&mut NoRecorder).unwrap();
        algorithm.progress
    };
    let (a, b) = (run(), run());
    assert_eq!(a.transitions, b.transitions);
    let summary = a.summary(&task, 1);
    assert_eq!(summary.iterations.iter().map(|i| i.strides_so_far).collect::<Vec<_>>(), [30, 40]);
    let nominal = summary.nominal.unwrap().performance.random_goals.unwrap();
    assert!(nominal.rms_vx_m_s.unwrap() > 0.05 && nominal.rms_vy_m_s.is_none() && nominal.strides == 15);
    assert!(summary.iterations.iter().all(|i| i.random_goals.is_some_and(|g| g.cost.is_finite())));
    assert!(summary.final_policy.unwrap().performance.random_goals.is_some());
    // Goals are held as long as the task says, and are columns of the table.
    let held = a.transitions.windows(2).filter(|w| w[0].episode == w[1].episode && w[0].goal != w[1].goal);
    let new: Vec<usize> = held.map(|w| w[1].k).collect();
    assert!(!new.is_empty() && new.iter().all(|k| k % task.goal[0].hold == 0), "{new:?}");
    let columns = Columns::new(&task.process_spec().unwrap());
    assert!(columns.header().contains(",goal_forward_speed_m_s,goal_heading_deg,"));
}

#[test]
fn every_learner_of_goals_comes_to_an_end() {
    let task = small().task;
    for kind in LearnerKind::GOALS {
        let summary = run_learner(&task, kind, 2).unwrap();
        assert!(summary.iterations.last().unwrap().random_goals.is_some(), "{}", kind.name());
    }
    let error = builtin::load("stepping", &["learner.kind=planning".into()]).unwrap_err();
    assert!(error.is_request() && error.to_string().contains("learner.kind"), "{error}");
}
