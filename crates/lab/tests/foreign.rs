//! A robot that is not ours: other names and signs, torque motors, other mass and lengths. It is
//! checked, learned on, and better afterwards.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;

use stridemap_lab::{Algorithm, NoRecorder, builtin, check};

fn task_file() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tasks/foreign.toml")
}

#[test]
fn a_foreign_robot_passes_the_check_and_learning_improves_it() {
    let task = builtin::load_file(&task_file(), &[]).unwrap().task;
    let report = check(&task, 1).unwrap();
    assert!(report.ok, "{:?}", report.items);
    // The same law that drives the big biped: more pitch amplitude, mass further out.
    assert!(report.gains[0].gain < -0.2, "{:?}", report.gains);

    let mut algorithm = Algorithm::new(&task, 1).unwrap();
    algorithm.learn(&mut NoRecorder).unwrap();
    let (nominal, learned) = (algorithm.progress.nominal.unwrap(), algorithm.progress.final_performance.unwrap());
    assert!(nominal.mean_reward < -0.05, "{nominal:?}");
    assert!(learned.mean_reward > -0.005 && learned.falls == 0, "{learned:?}");
    assert!((learned.mean_psi_roll_deg.unwrap() - 2.0).abs() < 0.15, "{learned:?}");
}

#[test]
fn a_wrong_sign_in_the_joint_map_is_found_before_anything_moves() {
    let sets = [r#"robot.left.knee="L_kn""#.to_string()];
    let task = builtin::load_file(&task_file(), &sets).unwrap().task;
    let report = check(&task, 1).unwrap();
    assert!(!report.ok);
    assert!(report.items[0].found.contains("L_kn"), "{:?}", report.items);
}

#[test]
fn a_gait_that_does_not_carry_the_robot_fails_with_what_to_try_and_not_with_check() {
    let task = builtin::load("stepping", &["gait.coupling_rad_s=0".into()]);
    let report = check(&task.unwrap().task, 1).unwrap();
    let item = report.items.last().unwrap();
    assert!(!report.ok && !item.ok && item.what == "nominal gait", "{item:?}");
    // When, by which criterion, where to and why, and what to do.
    assert!(item.found.contains("to the right: it stood on the edge of a sole"), "{item:?}");
    assert!(item.found.contains("stridemap tune") && !item.found.contains("stridemap check"), "{item:?}");
}

#[test]
fn a_misspelt_joint_is_an_error_that_names_the_nearest() {
    let sets = [r#"robot.left.knee="L_knee""#.to_string()];
    let task = builtin::load_file(&task_file(), &sets).unwrap().task;
    let error = check(&task, 1).unwrap_err().to_string();
    assert!(error.contains("left.knee") && error.contains("L_kn"), "{error}");
}

#[test]
fn the_resolved_task_finds_its_model_from_anywhere() {
    let loaded = builtin::load_file(&task_file(), &[]).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("config.toml");
    std::fs::write(&path, &loaded.resolved).unwrap();
    assert!(builtin::load_file(&path, &[]).unwrap().task.plant().is_ok());
}
