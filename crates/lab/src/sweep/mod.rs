//! Sweeps: a study is a task, seeds, and a design of settings; its runs are made in shards by any number of processes
//! on any number of machines that share a directory.
//!
//! ```toml
//! name = "friction"
//! task = "stepping"              # a built-in task, or a file beside the study
//! seeds = { first = 1, count = 10 }
//!
//! [set]                          # values of every run
//! algorithm.iterations = 1
//!
//! [grid]                         # every combination
//! robot.friction = [0.6, 0.8, 1.0]
//!
//! [random]                       # and so many draws, uniform between two ends
//! draws = 20
//! robot.mass_scale = [0.9, 1.1]
//! ```
//!
//! Run r of a study is one seed with one combination. Its result depends on the study and on r alone, so that the same
//! lines come of any shards, in any order, however often a shard is killed and begun again.

mod merge;
mod shard;

pub use merge::{Cell, Merged, merge};
pub use shard::{RunLine, run_shard};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use stridemap_config::Document;

use crate::builtin::{self, LoadedTask, TASKS};
use crate::error::LabError;
use crate::task::Task;

/// Most runs of a study.
const MOST: u64 = 1_000_000;

/// The seeds of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seeds {
    /// The first.
    pub first: u64,
    /// How many.
    pub count: u64,
}

/// A study as its file has it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StudyFile {
    name: String,
    task: String,
    seeds: Seeds,
    #[serde(default)]
    set: Map<String, Value>,
    #[serde(default)]
    grid: Map<String, Value>,
    #[serde(default)]
    random: Option<RandomFile>,
}

#[derive(Clone, Debug, Deserialize)]
struct RandomFile {
    draws: u64,
    #[serde(default = "one")]
    seed: u64,
    #[serde(flatten)]
    ranges: Map<String, Value>,
}

const fn one() -> u64 {
    1
}

/// A study: which runs there are. As it is written into the directory of its results, to be compared there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// Its name.
    pub name: String,
    /// Version of the program, whose numbers are only its own.
    pub version: String,
    /// The task, resolved, with the values of every run.
    pub task: String,
    /// The seeds.
    pub seeds: Seeds,
    /// Values of each key of the grid.
    pub grid: BTreeMap<String, Vec<Value>>,
    /// Range of each key that is drawn.
    pub random: BTreeMap<String, [f64; 2]>,
    /// How many draws; 1 where nothing is drawn.
    pub draws: u64,
    /// The seed of the draws.
    pub design_seed: u64,
}

/// What one run is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// Its number, from 0.
    pub run: u64,
    /// Its seed.
    pub seed: u64,
    /// Its own values, by dotted key.
    pub set: BTreeMap<String, Value>,
}

/// Tables within tables as one, by dotted key.
fn flat(table: Map<String, Value>, prefix: &str, out: &mut BTreeMap<String, Value>) {
    for (key, value) in table {
        let key = format!("{prefix}{key}");
        match value {
            Value::Object(inner) => flat(inner, &format!("{key}."), out),
            leaf => {
                out.insert(key, leaf);
            }
        }
    }
}

fn flattened(table: Map<String, Value>) -> BTreeMap<String, Value> {
    let mut out = BTreeMap::new();
    flat(table, "", &mut out);
    out
}

/// A value as `--set` takes it.
fn set(key: &str, value: &Value) -> String {
    format!("{key}={value}")
}

impl Study {
    /// Reads a study and its task.
    ///
    /// # Errors
    ///
    /// [`LabError::Config`] with file, line and key at fault, in the study or in its task.
    pub fn load(path: &Path) -> Result<(Self, StudyTask), LabError> {
        let document = Document::load_file(path, &[], &[]).map_err(Box::new)?;
        let file: StudyFile = document.deserialize().map_err(Box::new)?;
        let located = |key: &str, problem: &str| LabError::from(Box::new(document.located(key, problem)));
        let sets: Vec<String> = flattened(file.set).iter().map(|(key, value)| set(key, value)).collect();
        let is_built_in = TASKS.iter().any(|(name, _)| *name == file.task);
        let beside = || path.parent().unwrap_or(Path::new("")).join(&file.task);
        let task = StudyTask { file: (!is_built_in).then(beside), named: file.task.clone(), sets };
        let mut grid = BTreeMap::new();
        for (key, values) in flattened(file.grid) {
            match values {
                Value::Array(values) if !values.is_empty() => grid.insert(key, values),
                _ => return Err(located(&format!("grid.{key}"), "needs a list of values")),
            };
        }
        let (mut random, mut draws, mut design_seed) = (BTreeMap::new(), 1, 1);
        if let Some(file) = file.random {
            (draws, design_seed) = (file.draws, file.seed);
            for (key, range) in flattened(file.ranges) {
                let range = serde_json::from_value::<[f64; 2]>(range).ok().filter(|[low, high]| low < high);
                let range = range.ok_or_else(|| located(&format!("random.{key}"), "needs [lowest, highest]"))?;
                random.insert(key, range);
            }
        }
        let study = Self {
            name: file.name,
            version: env!("CARGO_PKG_VERSION").into(),
            task: task.with([])?.resolved,
            seeds: file.seeds,
            grid,
            random,
            draws,
            design_seed,
        };
        if study.seeds.count == 0 || study.draws == 0 || study.runs() > MOST {
            return Err(located("seeds.count", &format!("makes {} runs; a study has 1 to {MOST}", study.runs())));
        }
        // One combination, so that a misspelt key is told before the first run.
        task.with(study.planned(0).set.iter().map(|(key, value)| set(key, value)))?;
        Ok((study, task))
    }

    /// How many runs there are.
    #[must_use]
    pub fn runs(&self) -> u64 {
        let grid = self.grid.values().map(|values| values.len() as u64);
        let sizes = grid.chain([self.draws, self.seeds.count]);
        sizes.fold(1, u64::saturating_mul)
    }

    /// What run `run` is made of: the seed changes fastest, then the last key of the grid.
    #[must_use]
    pub fn planned(&self, run: u64) -> Planned {
        let seed = self.seeds.first + run % self.seeds.count;
        let mut rest = run / self.seeds.count;
        let mut set = BTreeMap::new();
        for (key, values) in self.grid.iter().rev() {
            let count = values.len() as u64;
            set.insert(key.clone(), values[(rest % count) as usize].clone());
            rest /= count;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.design_seed);
        rng.set_stream(rest);
        for (key, [low, high]) in &self.random {
            set.insert(key.clone(), (low + (high - low) * rng.random::<f64>()).into());
        }
        Planned { run, seed, set }
    }

    /// The keys that differ from run to run.
    #[must_use]
    pub fn keys(&self) -> Vec<&str> {
        self.grid.keys().chain(self.random.keys()).map(String::as_str).collect()
    }
}

/// A part of a study: the runs whose number leaves the same rest by `count` as `index`, so that `index` may count from
/// 0 or from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which part.
    pub index: u64,
    /// Of how many.
    pub count: u64,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.trim().parse::<u64>().ok();
        let parts = text.split_once('/').and_then(|(i, n)| Some((number(i)?, number(n)?)));
        match parts {
            Some((index, count)) if count > 0 && index <= count => Ok(Self { index: index % count, count }),
            _ => Err(format!("{text:?} is no shard; write i/n, i from 0 to n - 1 or from 1 to n")),
        }
    }
}

/// Where a study's task is, and the values of every run.
#[derive(Clone, Debug)]
pub struct StudyTask {
    named: String,
    file: Option<PathBuf>,
    sets: Vec<String>,
}

impl StudyTask {
    /// The task with more values.
    fn with(&self, own: impl IntoIterator<Item = String>) -> Result<LoadedTask, LabError> {
        let sets: Vec<String> = self.sets.iter().cloned().chain(own).collect();
        match &self.file {
            Some(file) => builtin::load_file(file, &sets),
            None => builtin::load(&self.named, &sets),
        }
    }

    /// The task of a run, as its robot tells what the file leaves to it.
    fn of(&self, planned: &Planned) -> Result<Task, LabError> {
        let mut loaded = self.with(planned.set.iter().map(|(key, value)| set(key, value)))?.on(None, planned.seed)?;
        loaded.task.tell()?;
        Ok(loaded.task)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(text: &str) -> Result<Study, LabError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("study.toml");
        std::fs::write(&path, text).unwrap();
        Study::load(&path).map(|(study, _)| study)
    }

    /// 2 seeds × 2 × 3 of the grid × 4 draws, each combination once.
    #[test]
    fn every_combination_is_planned_once() {
        let study = study(
            "name = \"s\"\ntask = \"stepping\"\nseeds = { first = 5, count = 2 }\n[grid]\nrobot.friction = [0.6, 0.8]\n\
             algorithm.iterations = [1, 2, 3]\n[random]\ndraws = 4\nrobot.mass_scale = [0.9, 1.1]\n",
        )
        .unwrap();
        assert_eq!(study.runs(), 48);
        let all: Vec<Planned> = (0..48).map(|run| study.planned(run)).collect();
        let distinct: std::collections::BTreeSet<String> =
            all.iter().map(|p| format!("{} {:?}", p.seed, p.set)).collect();
        assert_eq!(distinct.len(), 48);
        assert!(all.iter().all(|p| {
            let scale = p.set["robot.mass_scale"].as_f64().unwrap();
            (0.9..1.1).contains(&scale) && (5..=6).contains(&p.seed)
        }));
        assert_eq!(study.keys(), ["algorithm.iterations", "robot.friction", "robot.mass_scale"]);
    }

    #[test]
    fn faults_are_told_with_line_and_key() {
        let head = "name = \"s\"\ntask = \"stepping\"\nseeds = { first = 1, count = 2 }\n";
        for (text, says) in [
            ("[grid]\nrobot.friction = 0.5\n", "study.toml:5: grid.robot.friction: needs a list"),
            ("[random]\ndraws = 2\nrobot.friction = [2, 1]\n", "study.toml:6: random.robot.friction: needs [lowest"),
            ("[gird]\n", "study.toml:4: gird: unknown key; did you mean `grid`?"),
            ("[grid]\nrobot.frictoin = [0.5]\n", "frictoin"),
        ] {
            let error = study(&format!("{head}{text}")).unwrap_err();
            assert!(error.is_request() && error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn shards_count_from_0_or_from_1() {
        let of = |text: &str| text.parse::<Shard>().map(|s| s.index);
        assert_eq!((of("0/4"), of("4/4"), of("3/4")), (Ok(0), Ok(0), Ok(3)));
        assert!(of("5/4").is_err() && of("1/0").is_err() && of("1").is_err());
    }
}
