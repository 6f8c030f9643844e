//! `sweep` in shards and `sweep merge`, by the command.
#![allow(clippy::unwrap_used, reason = "a test of its own")]

use std::path::Path;
use std::process::{Command, Output};

const STUDY: &str = "name = \"small\"\ntask = \"stepping\"\nseeds = { first = 1, count = 1 }\n[set]\n\
    algorithm.iterations = 1\ncollect.strides = [8]\nrecord.strides = 4\nrecord.iteration_strides = 3\n\
    record.pose_seconds = 0.0\n[grid]\nrobot.friction = [0.8, 1.0]\n";

fn stridemap(dir: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_stridemap")).current_dir(dir).args(words).output().unwrap()
}

#[test]
fn shards_are_made_apart_and_merged() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("study.toml"), STUDY).unwrap();
    let shard = |i: &str| stridemap(dir, &["sweep", "study.toml", "--shard", i, "--out", "out"]);
    assert!(shard("1/2").status.success());
    // Half of it: a table, and who is missing.
    let half = stridemap(dir, &["sweep", "merge", "out"]);
    assert_eq!(half.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&half.stderr).contains("1 runs are not made yet, run 0"));
    assert!(shard("2/2").status.success());
    let whole = stridemap(dir, &["sweep", "merge", "out", "--json"]);
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let merged: serde_json::Value = serde_json::from_slice(&whole.stdout).unwrap();
    assert_eq!((merged["made"].as_u64(), merged["rows"].as_array().unwrap().len()), (Some(2), 2));
    assert_eq!(std::fs::read_to_string(dir.join("out/results.csv")).unwrap().lines().count(), 3);
    assert!(dir.join("out/figures/robot-friction-mean_reward.svg").exists());

    std::fs::write(dir.join("study.toml"), STUDY.replace("friction", "frictoin")).unwrap();
    let wrong = shard("1/1");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("did you mean"));
}
