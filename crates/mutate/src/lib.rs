//! Damaged copies of valid files, and a driver that gives them to a reader: fuzzing on stable Rust.
//!
//! `cargo fuzz` needs a nightly compiler, and an engine guided by coverage little that these readers lack: what
//! stands behind their first check is reached by files that are nearly right. So the cases are files of a corpus
//! with a few mutations each, of bytes, numbers, words and lines; and `proptest` draws them, catches a panic and
//! shrinks the mutations to those that matter.
//!
//! ```
//! use stridemap_mutate::{Corpus, fuzz};
//!
//! let corpus = Corpus::from([("numbers", b"a = 1\nb = 2\n".to_vec())]);
//! fuzz("doc", &corpus, |_, bytes| {
//!     let _ = String::from_utf8_lossy(bytes);
//! });
//! // The same seed gives the same mutants.
//! assert!(corpus.mutants(1).take(20).eq(corpus.mutants(1).take(20)));
//! ```

mod mutation;

use std::path::Path;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner};

use mutation::{Mutation, mutation};

/// Seconds that each target is run for; without it some hundred cases, always the same.
const SECONDS: &str = "STRIDEMAP_FUZZ_SECONDS";

/// Cases of the short form, and of one round of the long one.
const CASES: u32 = 256;

/// Longest that one case may take in the long form.
const SLOW: Duration = Duration::from_secs(5);

/// Valid files, with their names.
#[derive(Clone, Debug, Default)]
pub struct Corpus(Vec<(String, Vec<u8>)>);

impl<const N: usize> From<[(&str, Vec<u8>); N]> for Corpus {
    fn from(files: [(&str, Vec<u8>); N]) -> Self {
        Self(files.map(|(name, bytes)| (name.to_owned(), bytes)).to_vec())
    }
}

impl Corpus {
    /// The files of a directory, in the order of their names.
    ///
    /// # Errors
    ///
    /// Those of reading a directory and its files.
    pub fn read(dir: &Path) -> std::io::Result<Self> {
        let entries = std::fs::read_dir(dir)?.collect::<Result<Vec<_>, _>>()?;
        let mut paths: Vec<_> = entries.iter().map(std::fs::DirEntry::path).collect();
        paths.sort();
        let files = paths.iter().filter(|path| path.is_file());
        let read = |path: &std::path::PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            Ok((name.into_owned(), std::fs::read(path)?))
        };
        Ok(Self(files.map(read).collect::<std::io::Result<_>>()?))
    }

    /// The files of both.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.0.extend(other.0);
        self
    }

    /// The same and one more file.
    #[must_use]
    pub fn with(mut self, name: &str, bytes: Vec<u8>) -> Self {
        self.0.push((name.to_owned(), bytes));
        self
    }

    /// The files.
    #[must_use]
    pub fn files(&self) -> &[(String, Vec<u8>)] {
        &self.0
    }

    /// Mutants without end, with the names of their files; the same for the same seed.
    pub fn mutants(&self, seed: u64) -> impl Iterator<Item = (String, Vec<u8>)> {
        let mut runner = runner(seed);
        let cases = self.cases();
        let files = self.0.clone();
        std::iter::from_fn(move || {
            let (file, mutations) = cases.new_tree(&mut runner).ok()?.current();
            Some((files[file].0.clone(), mutant(&files, file, &mutations)))
        })
    }

    /// Which file, and what is done to it.
    fn cases(&self) -> impl Strategy<Value = (usize, Vec<Mutation>)> + use<> {
        (0..self.0.len(), prop::collection::vec(mutation(), 1..4))
    }
}

fn mutant(files: &[(String, Vec<u8>)], file: usize, mutations: &[Mutation]) -> Vec<u8> {
    let mut bytes = files[file].1.clone();
    for mutation in mutations {
        mutation.apply(&mut bytes, files);
    }
    bytes
}

fn runner(seed: u64) -> TestRunner {
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let config = Config { cases: CASES, failure_persistence: None, max_shrink_time: 60_000, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &bytes))
}

/// Gives every file of a corpus, and then mutants, to a target that must not panic whatever it gets.
///
/// Without `STRIDEMAP_FUZZ_SECONDS` some hundred mutants, always the same. With it mutants for so many seconds,
/// every time others; a case that takes more than five seconds then fails as well, and the case at work is kept
/// in the file `stridemap-fuzz-NAME` of the directory for temporary files, should the process end with it.
///
/// # Panics
///
/// With the smallest mutant found and its file, if the target panics.
pub fn fuzz(name: &str, corpus: &Corpus, target: impl Fn(&str, &[u8])) {
    assert!(!corpus.files().is_empty(), "the corpus of {name} is empty");
    for (file, bytes) in corpus.files() {
        target(file, bytes);
    }
    let seconds = std::env::var(SECONDS).ok().and_then(|s| s.parse().ok());
    let at_work = std::env::temp_dir().join(format!("stridemap-fuzz-{name}"));
    let long = seconds.map(Duration::from_secs_f64);
    let started = Instant::now();
    let mut seed = 1;
    if long.is_some() {
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        seed = now.map_or(1, |d| d.as_secs());
    }
    loop {
        let ran = runner(seed).run(&corpus.cases(), |(file, mutations)| {
            let bytes = mutant(corpus.files(), file, &mutations);
            let file = corpus.files()[file].0.as_str();
            if long.is_none() {
                target(file, &bytes);
                return Ok(());
            }
            // Only a help: without the file the run is as good.
            let _ = std::fs::write(&at_work, &bytes);
            let began = Instant::now();
            target(file, &bytes);
            match began.elapsed() {
                took if took > SLOW => Err(TestCaseError::fail(format!("took {took:?}"))),
                _ => Ok(()),
            }
        });
        if let Err(TestError::Fail(why, (file, mutations))) = ran {
            let bytes = mutant(corpus.files(), file, &mutations);
            let _ = std::fs::write(&at_work, &bytes);
            let (path, text) = (at_work.display(), String::from_utf8_lossy(&bytes));
            assert!(bytes.is_empty(), "{name}, seed {seed}: {why}\n{mutations:?}\nin {path}:\n{text:.3000}");
        }
        seed += 1;
        if long.is_none_or(|long| started.elapsed() >= long) {
            break;
        }
    }
    let _ = std::fs::remove_file(&at_work);
}
