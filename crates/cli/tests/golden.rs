//! Every number stays: what the built-in tasks write, as SHA-256 by kind of file.
//!
//! `golden.txt` holds the hashes of short runs (seed 1), which `cargo test` makes again, and of whole runs
//! (seeds 1 to 3). A change that moves a number on purpose writes them anew, and its commit says which and why:
//!
//! ```sh
//! STRIDEMAP_GOLDEN=check cargo test --release --test golden   # short and whole runs, against golden.txt
//! STRIDEMAP_GOLDEN=write cargo test --release --test golden   # the same, to golden.txt
//! ```
//!
//! Bytes are the same on machines that round alike; the first line of the file says on which kind it was made, and
//! elsewhere the test says that it compares nothing.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test of its own")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use sha2::{Digest, Sha256};

const GOLDEN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden.txt");

/// Overrides that make a run short, by the kind of task.
fn short(task: &str) -> Vec<&'static str> {
    let walks = task.contains("walking");
    let cautious = walks && !task.ends_with("paper");
    let mut sets = vec!["record.strides=4", "record.iteration_strides=3", "record.pose_seconds=0.5"];
    if walks {
        sets.extend(["record.walk_s=4.0", "record.speed_s=4.0"]);
    }
    sets.push(match (cautious, task.starts_with("small")) {
        (true, _) => "algorithm.strides_at_most=75",
        (false, true) => "algorithm.iterations=2",
        (false, false) => "algorithm.iterations=1",
    });
    if cautious {
        sets.push("collect.strides=[40, 0]");
    }
    if task.ends_with("goals") {
        sets.push("record.sweep=false");
    }
    sets
}

fn hex(digest: Sha256) -> String {
    digest.finalize().iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// What this machine's arithmetic is made of: vector width, and a hash of the functions that libm rounds.
fn arithmetic() -> String {
    let mut digest = Sha256::new();
    for i in 1..2000 {
        let x = f64::from(i) * 0.0137;
        for y in [x.sin(), x.cos(), x.exp(), x.ln(), x.tanh(), x.powf(1.7), x.atan2(0.3), x.acos()] {
            digest.update(y.to_bits().to_le_bytes());
        }
    }
    #[cfg(target_arch = "x86_64")]
    let width = match (is_x86_feature_detected!("avx512f"), is_x86_feature_detected!("avx2")) {
        (true, _) => "avx512",
        (false, true) => "avx2",
        _ => "scalar",
    };
    #[cfg(not(target_arch = "x86_64"))]
    let width = std::env::consts::ARCH;
    format!("arithmetic {width} {}", &hex(digest)[..16])
}

/// The files of a directory in order, with their names.
fn directory(digest: &mut Sha256, dir: &Path) {
    let mut entries: Vec<_> = std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        digest.update(path.file_name().unwrap().as_encoded_bytes());
        digest.update(std::fs::read(&path).unwrap());
    }
}

/// Makes a run and hashes what it wrote, by kind.
fn run(task: &str, seed: u64, sets: &[&str]) -> BTreeMap<&'static str, String> {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run");
    let mut command = Command::new(env!("CARGO_BIN_EXE_stridemap"));
    command.current_dir(&dir).args(["learn", task, "--seed", &seed.to_string(), "--out"]).arg(&out);
    command.args(sets.iter().map(|set| format!("--set={set}")));
    let output = command.output().unwrap();
    assert!(out.join("summary.json").exists(), "{task}: {}", String::from_utf8_lossy(&output.stderr));
    let mut hashes = BTreeMap::new();
    for kind in ["transitions.csv", "record.csv", "learning.csv", "policy", "map", "summary.json"] {
        let (path, mut digest) = (out.join(kind), Sha256::new());
        if kind == "summary.json" {
            let mut summary: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            // Times differ, and the hashes are older than the version of the file.
            let keys = summary.as_object_mut().unwrap();
            keys.remove("seconds");
            keys.remove("format");
            digest.update(summary.to_string());
        } else if path.is_dir() {
            directory(&mut digest, &path);
        } else if let Ok(bytes) = std::fs::read(&path) {
            digest.update(bytes);
        }
        hashes.insert(kind, hex(digest));
    }
    hashes
}

#[test]
fn every_number_of_the_built_in_tasks_stays() {
    let asked = std::env::var("STRIDEMAP_GOLDEN").unwrap_or_default();
    let (write, whole) = (asked == "write", !asked.is_empty());
    let golden = std::fs::read_to_string(GOLDEN).unwrap_or_default();
    let elsewhere = golden.lines().next().is_some_and(|first| first != arithmetic());
    if !write && elsewhere {
        eprintln!("golden.txt was made where arithmetic rounds differently; nothing is compared here");
        return;
    }
    let mut found = arithmetic() + "\n";
    let mut add = |size: &str, task: &str, seed: u64, sets: &[&str]| {
        for (kind, hash) in run(task, seed, sets) {
            let _ = writeln!(found, "{size} {task} {seed} {kind} {hash}");
        }
    };
    // Networks of others are not here to walk by.
    let ours = |task: &str| stridemap_lab::builtin::load(task, &[]).unwrap().task.gait.kind != "onnx";
    for (task, _) in stridemap_lab::builtin::TASKS.into_iter().filter(|(task, _)| ours(task)) {
        add("short", task, 1, &short(task));
        for seed in (1..=3).filter(|_| whole) {
            add("whole", task, seed, &[]);
        }
    }
    if write {
        std::fs::write(GOLDEN, found).unwrap();
        return;
    }
    let moved: Vec<&str> = found.lines().filter(|line| !golden.lines().any(|kept| kept == *line)).collect();
    assert!(moved.is_empty(), "these are not in golden.txt (what moved, and why?):\n{}", moved.join("\n"));
}
