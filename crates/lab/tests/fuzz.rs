//! Whatever a file holds: what it says, or an error that names it. The corpora are in `crates/mutate/corpus`;
//! RELIABILITY.md has the command that runs these for longer.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points, SparseGp, SparseMethod};
use stridemap_lab::builtin;
use stridemap_lab::run::FinishedRun;
use stridemap_learn::{Policy, SavedPolicy};
use stridemap_map::SavedMap;
use stridemap_mutate::{Corpus, fuzz};
use stridemap_process::Situation;
use stridemap_record::{Columns, Rows, files};

fn corpus(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../mutate/corpus").join(kind)
}

/// A file that is there for one case after another.
struct Slot(tempfile::TempDir, &'static str);

impl Slot {
    fn new(name: &'static str) -> Self {
        Self(tempfile::tempdir().unwrap(), name)
    }

    fn with(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(self.1);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn names(error: &dyn std::error::Error, path: &Path) {
    let (text, name) = (error.to_string(), path.file_name().unwrap().to_str().unwrap());
    assert!(text.contains(name) || text.contains("built-in"), "{text:?} does not name {name}");
}

#[test]
fn task_files() {
    let slot = Slot::new("task.toml");
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments");
    let corpus = Corpus::read(&own).unwrap().and(Corpus::read(&corpus("task")).unwrap());
    fuzz("task", &corpus, |_, bytes| {
        let path = slot.with(bytes);
        match builtin::load_file(&path, &[]) {
            Ok(loaded) => {
                loaded.task.process_spec().unwrap();
                // What is written down is the same task.
                let again = slot.with(loaded.resolved.as_bytes());
                assert_eq!(builtin::load_file(&again, &[]).unwrap().task, loaded.task);
            }
            Err(error) => names(&error, &path),
        }
    });
}

#[test]
fn tables_of_strides() {
    let slot = Slot::new("strides.csv");
    let task = builtin::load("stepping", &[]).unwrap().task;
    let table = Columns::new(&task.process_spec().unwrap());
    fuzz("table", &Corpus::read(&corpus("table")).unwrap(), |_, bytes| {
        let path = slot.with(bytes);
        match table.read(&path, Rows::All) {
            Ok(strides) => {
                for t in strides {
                    assert!(t.reward.is_finite() && t.state.iter().chain(&t.action).all(|x| x.is_finite()));
                }
            }
            Err(error) => names(&error, &path),
        }
    });
}

#[test]
fn maps() {
    let slot = Slot::new("map.json");
    let (x, y) = ([0.0, 1.0, 3.0, 4.0], [1.0, 0.5, -0.5, 0.0]);
    let (points, h) = (
        Points::new(&x, 1).unwrap(),
        Hyperparameters { length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.1 },
    );
    let (kernel, method) = (Kernel::Matern52, SparseMethod::default());
    let exact = Gp::condition(points, &y, kernel, Mean::Linear, h.clone()).unwrap();
    let sparse = SparseGp::condition(points, &y, kernel, method, h, points).unwrap();
    let corpus = Corpus::read(&corpus("map")).unwrap();
    let corpus = corpus.with("exact", exact.to_json().unwrap().into_bytes());
    let corpus = corpus.with("sparse", sparse.to_json().unwrap().into_bytes());
    fuzz("map", &corpus, |_, bytes| {
        let text = String::from_utf8_lossy(bytes);
        for p in [
            Gp::from_json(&text).and_then(|gp| gp.predict(&vec![1.0; gp.dims()])),
            SparseGp::from_json(&text).and_then(|gp| gp.predict(&vec![1.0; gp.dims()])),
        ]
        .into_iter()
        .flatten()
        {
            assert!(p.mean.is_finite() && p.latent_variance.is_finite());
        }
        let path = slot.with(bytes);
        match files::read_json::<SavedMap>(&path) {
            Ok(map) => {
                for output in map.outputs {
                    let at = vec![1.0; output.gp.dims()];
                    if let Ok(p) = output.gp.predict(&at) {
                        assert!(p.mean.is_finite() && p.latent_variance.is_finite());
                    }
                }
            }
            Err(error) => names(&error, &path),
        }
    });
}

#[test]
fn policies() {
    let slot = Slot::new("policy.json");
    fuzz("policy", &Corpus::read(&corpus("policy")).unwrap(), |_, bytes| {
        let path = slot.with(bytes);
        match files::read_json::<SavedPolicy>(&path) {
            Ok(policy) => {
                for x in [0.0, 3.0, -1e3] {
                    let action = policy.mean(&Situation::of_state(&vec![x; policy.spec().state.len()]));
                    for (u, bounds) in action.iter().zip(&policy.spec().action) {
                        assert!((bounds.lower..=bounds.upper).contains(u), "{u} of {bounds:?}");
                    }
                }
            }
            Err(error) => names(&error, &path),
        }
    });
}

#[test]
fn run_directories() {
    let dir = tempfile::tempdir().unwrap();
    let whole = Corpus::read(&corpus("run")).unwrap();
    std::fs::create_dir(dir.path().join("policy")).unwrap();
    for (name, bytes) in Corpus::read(&corpus("policy")).unwrap().files() {
        std::fs::write(dir.path().join("policy").join(name), bytes).unwrap();
    }
    fuzz("run", &whole, |name, bytes| {
        for (other, bytes) in whole.files() {
            std::fs::write(dir.path().join(other), bytes).unwrap();
        }
        std::fs::write(dir.path().join(name), bytes).unwrap();
        if let Err(error) = FinishedRun::open(dir.path(), &[]) {
            let (text, path) = (error.to_string(), dir.path().to_str().unwrap());
            assert!(text.contains(path), "{text:?} names no file of {path}");
        }
    });
}
