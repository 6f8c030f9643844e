//! The example of parts of one's own, as its user runs it.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test, and a program that prints")]

#[path = "../../../examples/own-parts/src/main.rs"]
#[allow(dead_code, reason = "its main is not run here")]
mod own_parts;

/// Its gait, learner, reward and state component are used, and the policy is better than the nominal gait.
#[test]
fn parts_of_ones_own_are_used_by_name() {
    let task = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/own-parts/own.toml");
    let summary = own_parts::learn(task).unwrap();
    assert_eq!((summary.improved, summary.strides.training), (Some(true), 60));
    // |ψ − 2 deg| of the nominal gait is about 1 deg, and its weight 0.1.
    let reward = |m: Option<stridemap_record::Measured>| m.unwrap().performance.mean_reward;
    assert!((reward(summary.nominal) + 0.1).abs() < 0.03);
    assert!(reward(summary.final_policy) > -0.02);
}
