//! A run directory: the same seed gives the same bytes, and a killed run ends like an unbroken one.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stridemap_lab::builtin::{self, LoadedTask};
use stridemap_lab::run::{FinishedRun, NoWatcher, RunDirectory};
use stridemap_lab::{Algorithm, LabError, Progress, Recorder, RobotChoice, provenance_of};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_map::LearnedMap;
use stridemap_record::{FELL_IN_START, FallCriterion, Pace, Phase, Recording, Summary, Transition};

/// A short run: two iterations of six strides.
fn short() -> LoadedTask {
    let sets = [
        "collect.strides=[6]",
        "algorithm.iterations=2",
        "algorithm.evaluation_strides=4",
        "algorithm.evaluation_discard=1",
        "learner.actor_critic.trials=10",
        "record.strides=3",
        "record.iteration_strides=2",
        "record.discard=1",
        "record.pose_seconds=0.5",
    ];
    builtin::load("stepping", &sets.map(String::from)).unwrap()
}

/// Passes everything on, and fails once after a number of strides: the power cut.
struct Cut<'a> {
    inner: &'a mut RunDirectory,
    strides_left: usize,
}

impl Recorder for Cut<'_> {
    fn stride(&mut self, t: &Transition, what: Option<&str>) -> Result<(), LabError> {
        self.inner.stride(t, what)?;
        if self.strides_left == 0 {
            return Err(LabError::Interrupted { path: self.inner.path().into() });
        }
        self.strides_left -= 1;
        Ok(())
    }
    fn map(&mut self, iteration: usize, map: &LearnedMap) -> Result<(), LabError> {
        self.inner.map(iteration, map)
    }
    fn trial(&mut self, iteration: usize, trial: &TrialSummary) -> Result<(), LabError> {
        self.inner.trial(iteration, trial)
    }
    fn policy(&mut self, iteration: usize, policy: &SavedPolicy) -> Result<(), LabError> {
        self.inner.policy(iteration, policy)
    }
    fn poses(&mut self, what: &str, pace: Pace, recording: &Recording) -> Result<(), LabError> {
        self.inner.poses(what, pace, recording)
    }
    fn checkpoint(&mut self, phase: Phase, progress: &Progress) -> Result<(), LabError> {
        self.inner.checkpoint(phase, progress)
    }
}

fn never() -> Arc<AtomicBool> {
    Arc::new(AtomicBool::new(false))
}

fn create(path: &Path, loaded: &LoadedTask, seed: u64) -> Result<RunDirectory, LabError> {
    let record = provenance_of(&loaded.task, seed, None, "test".into()).unwrap();
    RunDirectory::create(path, &loaded.task, &record, never(), Box::new(NoWatcher))
}

fn learn(path: &Path, loaded: &LoadedTask, seed: u64) {
    let mut directory = create(path, loaded, seed).unwrap();
    let mut algorithm = Algorithm::new(&loaded.task, seed).unwrap();
    algorithm.learn(&mut directory).unwrap();
    directory.write_summary(&algorithm.progress).unwrap();
}

/// Everything that must not depend on when or in how many pieces a run was made: all files but the
/// times.
fn contents(path: &Path) -> Vec<(String, String)> {
    let mut files = Vec::new();
    let mut dirs = vec![path.to_path_buf()];
    while let Some(dir) = dirs.pop() {
        for entry in std::fs::read_dir(dir).unwrap() {
            let entry = entry.unwrap().path();
            if entry.is_dir() {
                dirs.push(entry);
                continue;
            }
            let name = entry.strip_prefix(path).unwrap().display().to_string();
            let text = std::fs::read_to_string(&entry).unwrap();
            match name.as_str() {
                "events.ndjson" | "provenance.json" | "checkpoint.json" | ".lock" => {}
                "summary.json" => {
                    let mut value: serde_json::Value = serde_json::from_str(&text).unwrap();
                    value.as_object_mut().unwrap().remove("seconds").unwrap();
                    files.push((name, value.to_string()));
                }
                _ => files.push((name, text)),
            }
        }
    }
    files.sort();
    files
}

/// Compares file by file, so that a failure names the file and does not print them all.
fn assert_same(a: &Path, b: &Path, when: &str) {
    let (a, b) = (contents(a), contents(b));
    let names = |files: &[(String, String)]| -> Vec<String> { files.iter().map(|(name, _)| name.clone()).collect() };
    assert_eq!(names(&a), names(&b), "{when}");
    for ((name, left), (_, right)) in a.iter().zip(&b) {
        let line = left.lines().zip(right.lines()).position(|(l, r)| l != r);
        assert!(left == right, "{when}: {name} differs, first in line {line:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let dir = tempfile::tempdir().unwrap();
    let loaded = short();
    let [a, b, c] = ["a", "b", "c"].map(|name| dir.path().join(name));
    learn(&a, &loaded, 3);
    learn(&b, &loaded, 3);
    learn(&c, &loaded, 4);
    let names: Vec<String> = contents(&a).into_iter().map(|(name, _)| name).collect();
    for wanted in ["transitions.csv", "record.csv", "map/2.json", "policy/final.json", "poses/final.json"] {
        assert!(names.iter().any(|n| n == wanted), "{wanted} is missing in {names:?}");
    }
    assert_same(&a, &b, "the same seed twice");
    assert!(contents(&a) != contents(&c));
}

#[test]
fn a_run_that_was_cut_anywhere_ends_like_an_unbroken_one() {
    let dir = tempfile::tempdir().unwrap();
    let loaded = short();
    let whole = dir.path().join("whole");
    learn(&whole, &loaded, 5);
    // In the nominal gait, the first batch, the first evaluation, the second batch, the final record.
    for strides in [1, 6, 12, 19, 30] {
        let path = dir.path().join(format!("cut-{strides}"));
        let mut directory = create(&path, &loaded, 5).unwrap();
        let mut algorithm = Algorithm::new(&loaded.task, 5).unwrap();
        let cut = algorithm.learn(&mut Cut { inner: &mut directory, strides_left: strides });
        assert!(matches!(cut, Err(LabError::Interrupted { .. })), "{strides}");
        drop(directory);

        let open = FinishedRun::open(&path, &[]).unwrap();
        let (mut directory, progress) = RunDirectory::resume(&open, never(), Box::new(NoWatcher)).unwrap();
        let mut algorithm = Algorithm::resume(&open.task, 5, progress).unwrap();
        algorithm.learn(&mut directory).unwrap();
        directory.write_summary(&algorithm.progress).unwrap();
        assert_same(&path, &whole, &format!("cut after {strides} strides"));
    }
}

/// Exploration that falls: a threshold just under where the nominal gait begins (2.68 deg). The budget ends the
/// run, every fall has its cause, nothing is dropped by trying again, and a raised budget goes on as if it had
/// been so from the start.
#[test]
fn a_spent_fall_budget_ends_the_run_and_a_raised_one_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let with_budget = |falls_at_most: usize| {
        let mut loaded = short();
        loaded.task.failure.psi_roll_below_deg = Some(2.6);
        loaded.task.collect.strides = vec![12];
        loaded.task.collect.explore.hold = 1;
        loaded.task.algorithm.falls_at_most = falls_at_most;
        loaded
    };
    let whole = dir.path().join("whole");
    learn(&whole, &with_budget(1000), 5);
    let (run, spent) = (dir.path().join("run"), with_budget(2));
    let mut directory = create(&run, &with_budget(1000), 5).unwrap();
    let mut algorithm = Algorithm::new(&spent.task, 5).unwrap();
    let error = algorithm.learn(&mut directory).unwrap_err();
    let LabError::FallBudget { at_most: 2, falls } = &error else {
        panic!("{error}");
    };
    assert_eq!(falls.len(), 3, "the first beyond the budget ends it");
    for fall in falls {
        assert_eq!(fall.fall.criterion, FallCriterion::PsiRoll);
        assert!(fall.fall.value < 2.6 && (fall.fall.threshold - 2.6).abs() < 1e-12);
    }
    assert!(!error.is_request());
    let said = error.to_string();
    assert!(
        said.contains("iteration 1, collect, stride") && said.contains("below 2.6 (failure.psi_roll_below_deg)"),
        "{said}"
    );
    let summary = directory.write_summary(&algorithm.progress).unwrap();
    assert_eq!(&summary.falls, falls);
    // The batch was broken off, and is counted all the same.
    let rows = std::fs::read_to_string(run.join("transitions.csv")).unwrap();
    let made = rows.lines().count() - 1;
    let first = &summary.iterations[0];
    let counted = (summary.strides.training, first.strides, first.falls);
    assert!(made > 2 && counted == (made, made, 3), "{counted:?} {made}");
    assert!(summary.final_policy.is_none() && summary.improved.is_none());
    drop(directory);

    let strides = || std::fs::read_to_string(run.join("transitions.csv")).unwrap();
    let made = strides();
    assert_eq!(made.matches(",fell,").count(), 3);
    let resume = |falls_at_most: usize| {
        let mut open = FinishedRun::open(&run, &[]).unwrap();
        open.task.algorithm.falls_at_most = falls_at_most;
        RunDirectory::resume(&open, never(), Box::new(NoWatcher))
    };
    let again = resume(2).err().unwrap().to_string();
    assert!(again.contains("falls_at_most allows 2"), "{again}");
    assert_eq!(strides(), made, "nothing is dropped");
    let raised = with_budget(1000).task;
    let (mut directory, progress) = resume(1000).unwrap();
    let mut algorithm = Algorithm::resume(&raised, 5, progress).unwrap();
    algorithm.learn(&mut directory).unwrap();
    directory.write_summary(&algorithm.progress).unwrap();
    assert_same(&run, &whole, "a raised budget");
}

#[test]
fn a_directory_that_holds_something_is_refused_and_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let loaded = short();
    let run = dir.path().join("run");
    learn(&run, &loaded, 1);
    let before = contents(&run);
    let edited = builtin::load("stepping", &["robot.mass_scale=1.3".into()]).unwrap();
    let error = create(&run, &edited, 1).err().unwrap();
    let text = error.to_string();
    assert!(error.is_request() && text.contains("--resume"), "{text}");
    assert!(text.contains("robot.mass_scale was 1.0, is 1.3 now"), "{text}");
    assert!(contents(&run) == before);

    let other = dir.path().join("other");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("thesis.tex"), "precious").unwrap();
    let error = create(&other, &loaded, 1).err().unwrap();
    assert!(error.to_string().contains("not empty"), "{error}");
    assert!(FinishedRun::open(&other, &[]).err().unwrap().to_string().contains("holds no run"));
}

/// One writer; the lock is the system's, so that it ends with its process.
#[test]
fn a_live_run_is_not_written_by_a_second() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    let first = create(&run, &short(), 1).unwrap();
    let open = FinishedRun::open(&run, &[]).unwrap();
    let pid = format!("process {}", std::process::id());
    let second = create(&run, &short(), 1).err().unwrap();
    let third = RunDirectory::resume(&open, never(), Box::new(NoWatcher)).err().unwrap();
    for error in [second, third] {
        assert!(error.is_request() && error.to_string().contains(&pid), "{error}");
    }
    drop(first);
    assert!(RunDirectory::resume(&open, never(), Box::new(NoWatcher)).is_ok());
}

/// Whatever a killed process left before the first stride, the same command starts; events stay.
#[test]
fn a_beginning_without_a_stride_is_begun_anew() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    std::fs::create_dir_all(run.join("map")).unwrap();
    std::fs::write(run.join("config.toml.tmp"), "exten").unwrap();
    std::fs::create_dir_all(dir.path().join(".run-2.new/policy")).unwrap();
    for path in [run.clone(), dir.path().join("run-2")] {
        let mut directory = create(&path, &short(), 1).unwrap();
        directory.event("asked", serde_json::json!({})).unwrap();
        drop(directory);
        let edited = builtin::load("walking", &[]).unwrap();
        drop(create(&path, &edited, 1).unwrap());
        assert_eq!(FinishedRun::open(&path, &[]).unwrap().task, edited.task);
        let events = std::fs::read_to_string(path.join("events.ndjson")).unwrap();
        assert!(events.contains("asked"), "{events}");
    }
    assert!(!dir.path().join(".run-2.new").exists());
}

/// Model, simulator, program, seed and task: what would mix two runs is refused by name, and nothing is written.
#[test]
fn a_run_does_not_go_on_by_other_means() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("e.xml");
    std::fs::write(&model, stridemap_mujoco::BIPED_XML).unwrap();
    let task = dir.path().join("e.toml");
    let sets = ["collect.strides=[4]", "record.strides=3", "record.discard=1", "record.pose_seconds=0"];
    std::fs::write(&task, "extends = \"stepping\"\nname = \"e\"\nrobot.model = \"e.xml\"\n").unwrap();
    let loaded = builtin::load(task.to_str().unwrap(), &sets.map(String::from)).unwrap();
    let run = dir.path().join("run");
    let mut directory = create(&run, &loaded, 5).unwrap();
    let mut algorithm = Algorithm::new(&loaded.task, 5).unwrap();
    algorithm.collect(&mut directory).unwrap();
    drop(directory);
    let refused = |expected: &str| {
        let open = FinishedRun::open(&run, &[]).unwrap();
        let error = RunDirectory::resume(&open, never(), Box::new(NoWatcher)).err().unwrap();
        assert!(error.is_request() && error.to_string().contains(expected), "{expected}: {error}");
    };
    let edit = |file: &str, from: &str, to: &str| {
        let path = run.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file}: {from}");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    };
    for (file, from, to, expected) in [
        ("config.toml", "mass_scale = 1.0", "mass_scale = 1.3", "robot.mass_scale was 1.0, is 1.3 now"),
        ("provenance.json", "\"seed\": 5", "\"seed\": 6", "the seed was 6, is 5 now"),
        ("provenance.json", "MuJoCo 3", "MuJoCo 2", "the simulator was MuJoCo 2"),
    ] {
        edit(file, from, to);
        refused(expected);
        edit(file, to, from);
    }
    let kp = stridemap_mujoco::BIPED_XML.replace("kp=\"3000\"", "kp=\"1500\"");
    std::fs::write(&model, kp).unwrap();
    refused("the robot's model");
    // Moved away without its model: the run has a copy, which is the same robot to the bit.
    std::fs::remove_file(&model).unwrap();
    let moved = dir.path().join("elsewhere");
    std::fs::rename(&run, &moved).unwrap();
    let open = FinishedRun::open(&moved, &[]).unwrap();
    assert!(open.differences().unwrap().is_empty());
    assert!(RunDirectory::resume(&open, never(), Box::new(NoWatcher)).is_ok());
    std::fs::write(moved.join("model.mjb"), "damaged").unwrap();
    let error = FinishedRun::open(&moved, &[]).err().unwrap().to_string();
    assert!(error.contains("model.mjb: is damaged"), "{error}");
}

#[test]
fn a_damaged_checkpoint_is_named_and_nothing_is_lost() {
    let dir = tempfile::tempdir().unwrap();
    let loaded = short();
    let run = dir.path().join("run");
    learn(&run, &loaded, 2);
    let transitions = std::fs::read_to_string(run.join("transitions.csv")).unwrap();
    std::fs::write(run.join("checkpoint.json"), "{\"format\": 1, ").unwrap();
    let error = FinishedRun::open(&run, &[]).err().unwrap().to_string();
    assert!(error.contains("checkpoint.json:1") && error.contains("damaged"), "{error}");
    assert_eq!(std::fs::read_to_string(run.join("transitions.csv")).unwrap(), transitions);
}

/// Time lapses of everything that a before and after is drawn from, each from the first stride on.
#[test]
fn a_run_has_time_lapses_of_exploration_and_of_every_policy() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    let loaded = short();
    learn(&run, &loaded, 6);
    let table = std::fs::read_to_string(run.join("record.csv")).unwrap();
    let mut lines = table.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let column = |name: &str| header.iter().position(|h| *h == name).unwrap();
    let rows: Vec<_> = lines.collect();
    for what in ["nominal", "exploration", "iteration-1", "iteration-2", "final"] {
        let path = run.join(format!("lapse/{what}.json"));
        let recording: Recording = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        assert!((recording.period_s - 0.5).abs() < 1e-12);
        let first_s = recording.frames[0].time_s;
        for (i, frame) in recording.frames.iter().enumerate() {
            // Ticks of 2 ms stand on the half seconds.
            assert!((frame.time_s - first_s - 0.5 * i as f64).abs() < 2e-3, "{what}");
        }
        // Half a second at most after the section where the first stride begins.
        if let Some(row) = rows.iter().find(|r| r[column("what")] == what) {
            let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
            let begin_s = number("time_s") - number("stride_duration_s");
            assert!((-1e-3..0.51).contains(&(first_s - begin_s)), "{what}: {first_s} after {begin_s}");
        }
    }
    assert!(run.join("poses/iteration-1.json").exists());
    assert!(!run.join("poses/iteration-2.json").exists());
}

/// Where learning cannot help, because the action can do next to nothing, the nominal gait is final, and said to be.
#[test]
fn where_nothing_beats_the_nominal_gait_it_is_the_final_policy() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    let mut loaded = short();
    loaded.task.action[0].bounds = [-1e-3, 1e-3];
    loaded.task.action[0].explore.center = [-1e-3, 1e-3];
    learn(&run, &loaded, 7);
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(run.join(name)).unwrap()).unwrap()
    };
    let summary = json("summary.json");
    assert_eq!(summary["improved"], false);
    assert!(summary["final_iteration"].is_null());
    let policy: SavedPolicy = serde_json::from_value(json("policy/final.json")).unwrap();
    assert_eq!(policy, loaded.task.nominal_policy().unwrap());
    let reward = |what: &str| summary[what]["mean_reward"].as_f64().unwrap();
    assert!((reward("final") - reward("nominal")).abs() < 1e-9);
    // What was tried, and what it cost: two batches of 6 and two proofs of 4 strides.
    assert_eq!(summary["strides"]["training"], 20);
    for i in summary["iterations"].as_array().unwrap() {
        assert!(i["evaluated_mean_reward"].is_number());
    }

    // Nor does anything where too few strides reach the next section for a map: here all fall.
    loaded.task.action[0].bounds = [-1.5, 5.0];
    loaded.task.action[0].explore.center = [4.0, 4.0];
    loaded.task.failure.psi_roll_below_deg = Some(2.6);
    loaded.task.algorithm.falls_at_most = 1000;
    let run = dir.path().join("falls");
    learn(&run, &loaded, 7);
    let text = std::fs::read_to_string(run.join("summary.json")).unwrap();
    let summary: Summary = serde_json::from_str(&text).unwrap();
    assert!(summary.iterations[0].falls > 3, "{summary:?}");
    assert_eq!(summary.improved, Some(false));
    assert!(run.join("policy/final.json").exists());
}

/// No table of strides has a fall in a start: behind a link, where it cannot be made again, an event keeps it.
#[test]
fn a_fall_in_a_start_behind_a_link_survives_a_kill() {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    let loaded = builtin::load("small-stepping", &[]).unwrap();
    let loaded = loaded.on(Some(RobotChoice::Ros2), 1).unwrap();
    let mut directory = create(&run, &loaded, 1).unwrap();
    let fall = serde_json::json!({"criterion": "tilt", "value": 50.0, "threshold": 45.0});
    let mut after = |events: &[&str]| {
        for event in events {
            directory.event(event, fall.clone()).unwrap();
        }
    };
    after(&[FELL_IN_START, "checkpoint", FELL_IN_START]);
    drop(directory);
    let open = FinishedRun::open(&run, &[]).unwrap();
    let (_, progress) = RunDirectory::resume(&open, never(), Box::new(NoWatcher)).unwrap();
    let [fell] = progress.falls.as_slice() else {
        panic!("{:?}", progress.falls);
    };
    assert_eq!((fell.stride, fell.fall.criterion), (None, FallCriterion::Tilt));
}
