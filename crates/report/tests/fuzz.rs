//! Whatever the files of a run hold: a report of what can be read, and never a panic.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use stridemap_mutate::{Corpus, fuzz};
use stridemap_record::Run;
use stridemap_report::sections;

#[test]
fn run_directories_are_drawn() {
    let corpus = |kind: &str| -> PathBuf { Path::new(env!("CARGO_MANIFEST_DIR")).join("../mutate/corpus").join(kind) };
    let dir = tempfile::tempdir().unwrap();
    let whole = Corpus::read(&corpus("run")).unwrap();
    for kind in ["policy", "map"] {
        std::fs::create_dir(dir.path().join(kind)).unwrap();
        for (name, bytes) in Corpus::read(&corpus(kind)).unwrap().files() {
            std::fs::write(dir.path().join(kind).join(name), bytes).unwrap();
        }
    }
    fuzz("report", &whole, |name, bytes| {
        for (other, bytes) in whole.files() {
            std::fs::write(dir.path().join(other), bytes).unwrap();
        }
        std::fs::write(dir.path().join(name), bytes).unwrap();
        let run = Run::read(dir.path()).unwrap();
        for section in sections(&run) {
            assert!(!section.title.is_empty());
        }
    });
}
