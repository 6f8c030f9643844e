//! Runs behind the figures: kept beside them, and taken from there the next time.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use stridemap_lab::builtin::{self, LoadedTask};
use stridemap_record::{Run, Summary};

use crate::args::Common;
use crate::commands::learn::start_or_go_on;
use crate::failure::Failure;
use crate::parallel;
use crate::stop::stop_flag;

/// Where runs are, of which seeds, and how they are made.
pub struct Runs<'a> {
    dir: PathBuf,
    seeds: u64,
    common: &'a Common,
    stop: Arc<AtomicBool>,
}

/// The runs of one task.
pub struct RunsOfTask {
    /// The first seed's, with everything that can be drawn.
    pub first: Run,
    /// Every seed's numbers.
    pub summaries: Vec<Summary>,
}

impl<'a> Runs<'a> {
    /// Runs in the folder `runs` of the directory of the figures.
    pub fn new(dir: &Path, seeds: u64, common: &'a Common) -> Self {
        Self { dir: dir.join("runs"), seeds, common, stop: stop_flag() }
    }

    /// The command that makes a task's runs.
    pub fn command(&self, task: &str) -> String {
        let mut words = format!("learn {task} --seeds {}", self.seeds);
        if self.common.seed != 1 {
            words += &format!(" --seed {}", self.common.seed);
        }
        for set in &self.common.sets {
            words += &format!(" --set {set}");
        }
        words
    }

    /// Runs of tasks, in their order. Those that are there are taken, those that were cut off go on.
    pub fn of(&self, tasks: &[&str]) -> Result<Vec<RunsOfTask>, Failure> {
        let loaded =
            tasks.iter().map(|name| builtin::load(name, &self.common.sets)).collect::<Result<Vec<LoadedTask>, _>>()?;
        let seeds = parallel::seeds(self.common.seed, self.seeds)?;
        let jobs: Vec<(usize, u64)> =
            (0..tasks.len()).flat_map(|task| seeds.iter().map(move |seed| (task, *seed))).collect();
        let told = |(task, seed): &(usize, u64), made: &Result<(Summary, &str), Failure>| {
            let how = made.as_ref().map_or("failed", |(_, how)| how);
            format!("{}, seed {seed}: {how}", tasks[*task])
        };
        let made = parallel::over(&jobs, self.common.threads, told, |&(task, seed)| {
            self.one(tasks[task], &loaded[task], seed)
        })?;
        let mut summaries = made.into_iter().map(|(summary, _)| summary);
        tasks
            .iter()
            .map(|name| {
                Ok(RunsOfTask {
                    first: Run::read(&self.path(name, self.common.seed))?,
                    summaries: summaries.by_ref().take(seeds.len()).collect(),
                })
            })
            .collect()
    }

    fn path(&self, task: &str, seed: u64) -> PathBuf {
        self.dir.join(format!("{task}-{seed}"))
    }

    /// One run, and how it was come by.
    fn one(&self, name: &str, loaded: &LoadedTask, seed: u64) -> Result<(Summary, &'static str), Failure> {
        let path = self.path(name, seed);
        let common = Common { seed, json: false, ..self.common.clone() };
        start_or_go_on(name, loaded, &path, &common, &self.stop)
    }
}
