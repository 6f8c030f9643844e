//! Any recorded episode of a simulated run can be run again alone.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::path::Path;
use std::sync::Arc;

use stridemap_lab::run::{FinishedRun, NoWatcher, RunDirectory};
use stridemap_lab::{Algorithm, builtin, episodes, provenance_of, replay};
use stridemap_process::StrideEnd;
use stridemap_record::Columns;

/// Twenty strides that explore under a threshold which the robot passes now and then; in `dir`, opened again.
fn explored(task: &str, sets: &[&str], dir: &Path) -> FinishedRun {
    let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
    let task = builtin::load(task, &sets).unwrap().task;
    let record = provenance_of(&task, 5, None, "stridemap collect".into()).unwrap();
    let mut run = RunDirectory::create(dir, &task, &record, Arc::default(), Box::new(NoWatcher)).unwrap();
    Algorithm::new(&task, 5).unwrap().collect(&mut run).unwrap();
    FinishedRun::open(dir, &[]).unwrap()
}

/// Every episode comes out the same to the byte, in any order: also those that begin in the middle of a batch, after a
/// fall, on the biped and on the small humanoid with its noisy sensors.
#[test]
fn every_episode_alone_gives_the_same_rows() {
    for (task, below) in [("stepping", "2.4"), ("small-stepping", "4.5")] {
        let dir = tempfile::tempdir().unwrap();
        let threshold = format!("failure.psi_roll_below_deg={below}");
        let sets = [threshold.as_str(), "collect.strides=[20]", "algorithm.falls_at_most=100", "record.pose_seconds=0"];
        let run = explored(task, &sets, &dir.path().join("run"));
        let all = episodes(&run).unwrap();
        let fell = all.iter().filter(|e| e.end == StrideEnd::Fell).count();
        assert!(fell >= 2, "{task}: {fell} falls in {} episodes", all.len());
        let log = std::fs::read_to_string(run.path.join("transitions.csv")).unwrap();
        let mut rows: Vec<&str> = log.lines().skip(1).collect();
        let table = Columns::new(&run.task.process_spec().unwrap());
        for episode in all.iter().rev() {
            let again = replay(&run, episode).unwrap();
            let made: Vec<String> = again.transitions.iter().map(|t| table.row(t)).collect();
            assert_eq!(made, rows.split_off(rows.len() - made.len()), "{task}, episode {}", episode.episode);
            assert!(again.recording.is_some_and(|film| film.frames.len() > 10));
        }
        assert!(rows.is_empty());
    }
}

#[test]
fn what_cannot_be_the_same_is_refused_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let mut run = explored("stepping", &["collect.strides=[3]", "record.pose_seconds=0"], &dir.path().join("run"));
    let episode = episodes(&run).unwrap().remove(0);
    let refused = |run: &FinishedRun| replay(run, &episode).err().unwrap();

    let version = std::mem::replace(&mut run.provenance.version, "0.0.1".into());
    let error = refused(&run);
    assert!(error.is_request() && error.to_string().contains("0.0.1"), "{error}");
    run.provenance.version = version;
    let model = std::mem::replace(&mut run.provenance.model_hash, "0".repeat(64));
    let error = refused(&run);
    assert!(error.is_request() && error.to_string().contains("model"), "{error}");
    run.provenance.model_hash = model;
    run.task.link = Some(stridemap_robot::Ros2Config::default());
    let error = refused(&run);
    assert!(error.is_request() && error.to_string().contains("behind a link"), "{error}");
    run.task.link = None;
    replay(&run, &episode).unwrap();

    std::fs::write(run.path.join("events.ndjson"), "{\"format\":1}\n").unwrap();
    let error = replay(&run, &episodes(&run).unwrap()[0]).err().unwrap();
    assert!(error.to_string().contains("earlier version"), "{error}");
}
