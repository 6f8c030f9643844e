//! The runs of a shard, one line each.

use std::collections::{BTreeMap, HashSet};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use stridemap_files::LockError;
use stridemap_record::RecordError;
use stridemap_record::files::{create_dir, lock, read_json, write_json};

use super::{Planned, Shard, Study, StudyTask};
use crate::algorithm::Algorithm;
use crate::error::LabError;
use crate::provenance::task_differences;
use crate::recorder::NoRecorder;
use crate::task::Task;

/// The lines of a shard, in its directory below `shards`.
const LINES: &str = "results.ndjson";
/// The study, in the directory of its results.
pub(super) const STUDY: &str = "study.json";

/// What one run came to. No clock is in it: the same run gives the same line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunLine {
    /// Its number in the study.
    pub run: u64,
    /// Its seed.
    pub seed: u64,
    /// Its own values.
    pub set: BTreeMap<String, Value>,
    /// Why it has no result: it went wrong while working.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// What was measured, by name; empty after an error.
    pub values: BTreeMap<String, f64>,
}

impl RunLine {
    /// Makes a run in memory: nothing of it is kept but this line.
    ///
    /// # Errors
    ///
    /// [`LabError`] for a wrong request. What goes wrong while working is in the line.
    fn made(task: &StudyTask, planned: &Planned) -> Result<Self, LabError> {
        let line =
            |values, error| Self { run: planned.run, seed: planned.seed, set: planned.set.clone(), error, values };
        let values = || -> Result<BTreeMap<String, f64>, LabError> {
            let task = task.of(planned)?;
            crate::verbs::refuse_misfit(&task, planned.seed)?;
            let mut algorithm = Algorithm::new(&task, planned.seed)?;
            algorithm.learn(&mut NoRecorder)?;
            Ok(measured(&task, &algorithm))
        };
        match values() {
            Ok(values) => Ok(line(values, None)),
            Err(error) if error.is_request() => Err(error),
            Err(error) => Ok(line(BTreeMap::new(), Some(error.to_string()))),
        }
    }
}

/// The numbers of a run that has ended.
fn measured(task: &Task, algorithm: &Algorithm<'_>) -> BTreeMap<String, f64> {
    let summary = algorithm.progress.summary(task, algorithm.seed);
    let strides = summary.strides.training + summary.strides.evaluation;
    let falls: usize = summary.iterations.iter().map(|i| i.falls).sum();
    let last = summary.final_policy.map(|m| m.performance);
    let flag = |holds: bool| Some(f64::from(u8::from(holds)));
    let all = [
        ("strides", Some(strides as f64)),
        ("falls", Some(falls as f64)),
        ("falls_in_final", last.map(|p| p.falls as f64)),
        ("mean_reward", last.map(|p| p.mean_reward)),
        ("mean_psi_roll_deg", last.and_then(|p| p.mean_psi_roll_deg)),
        ("speed_m_s", last.and_then(|p| p.walk).map(|w| w.speed_m_s)),
        ("nominal_mean_reward", summary.nominal.map(|m| m.performance.mean_reward)),
        ("improved", summary.improved.and_then(flag)),
        ("success", last.and_then(|p| flag(task.is_success(&p, strides, falls)))),
    ];
    all.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
}

/// Writes the study into the directory of its results, or refuses one that is not the same.
fn enter(study: &Study, out: &Path) -> Result<(), LabError> {
    create_dir(out)?;
    let path = out.join(STUDY);
    if !path.exists() {
        write_json(&path, study)?;
    }
    // Another shard may have been quicker.
    let there: Study = read_json(&path)?;
    if there == *study {
        return Ok(());
    }
    let mut differences = Vec::new();
    let same_task = there.task == study.task;
    if !same_task {
        let task = |text: &str| toml::from_str::<Task>(text).ok();
        let both = task(&there.task).zip(task(&study.task));
        differences = both.map_or(Ok(Vec::new()), |(then, now)| task_differences(&then, &now))?;
    }
    if there.version != study.version {
        differences.push(format!("the program was version {}, is {} now", there.version, study.version));
    }
    let rest = |s: &Study| Study { version: String::new(), task: String::new(), ..s.clone() };
    if rest(&there) != rest(study) {
        differences.push("its runs are others".into());
    }
    Err(LabError::RunDirectory {
        path: out.into(),
        problem: format!("holds results of another study ({}); choose another --out", differences.join("; ")),
    })
}

/// Every file of lines below a directory of results, by name.
pub(super) fn line_files(out: &Path) -> Result<Vec<PathBuf>, LabError> {
    let shards = out.join("shards");
    if !shards.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(&shards).map_err(RecordError::file(&shards, "read"))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|e| e.path().join(LINES)).filter(|p| p.exists()).collect();
    files.sort();
    Ok(files)
}

/// Reads the whole lines of a file; a last one that was cut off is none.
pub(super) fn each_line(path: &Path, mut see: impl FnMut(RunLine)) -> Result<(), LabError> {
    let file = File::open(path).map_err(RecordError::file(path, "read"))?;
    let (mut reader, mut text, mut number) = (BufReader::new(file), String::new(), 0);
    loop {
        text.clear();
        number += 1;
        reader.read_line(&mut text).map_err(RecordError::file(path, "read"))?;
        if !text.ends_with('\n') {
            return Ok(());
        }
        let line = serde_json::from_str(&text);
        see(line.map_err(|error| RecordError::content(path, Some(number), format!("is no result of a run: {error}")))?);
    }
}

/// Opens a shard's lines to append to; a last one that was cut off is dropped.
fn open(path: &Path) -> Result<File, LabError> {
    let open = || -> std::io::Result<File> {
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |end| end as u64 + 1);
        file.set_len(whole)?;
        file.seek(SeekFrom::End(0))?;
        Ok(file)
    };
    Ok(open().map_err(RecordError::file(path, "write"))?)
}

/// Makes the runs of a shard that no shard has made yet, and appends a line for each. A shard that was killed goes on
/// with the run that it was at; one that another process is at is waited for.
///
/// `told` hears how many runs of the shard are done, and of how many.
///
/// # Errors
///
/// [`LabError::RunDirectory`] if the directory holds another study; [`LabError`] for a wrong request, or a file that
/// cannot be written; [`LabError::Interrupted`].
///
/// # Returns
///
/// How many runs were made now.
pub fn run_shard(
    (study, task): &(Study, StudyTask),
    shard: Shard,
    out: &Path,
    stop: &AtomicBool,
    told: &mut dyn FnMut(u64, u64, Option<&RunLine>),
) -> Result<u64, LabError> {
    const WAIT: Duration = Duration::from_millis(200);
    let stopped =
        || stop.load(Ordering::Relaxed).then(|| LabError::Interrupted { path: out.into() }).map_or(Ok(()), Err);
    enter(study, out)?;
    let dir = out.join(format!("shards/{}-of-{}", shard.index, shard.count));
    create_dir(&dir)?;
    let _lock = loop {
        match lock(&dir) {
            Err(RecordError::Locked { source: LockError::Held { .. }, .. }) => std::thread::sleep(WAIT),
            other => break other?,
        }
        stopped()?;
    };
    let mut lines = open(&dir.join(LINES))?;
    let is_own = |run: u64| run % shard.count == shard.index;
    let mut done = HashSet::new();
    for file in line_files(out)? {
        each_line(&file, |line| {
            if is_own(line.run) {
                done.insert(line.run);
            }
        })?;
    }
    let all = (0..study.runs()).filter(|run| is_own(*run)).count() as u64;
    told(done.len() as u64, all, None);
    let mut made = 0;
    for run in (0..study.runs()).filter(|run| is_own(*run)) {
        if done.contains(&run) {
            continue;
        }
        stopped()?;
        let line = RunLine::made(task, &study.planned(run))?;
        let mut text = serde_json::to_string(&line).map_err(|e| RecordError::content(&dir, None, e.to_string()))?;
        text.push('\n');
        // One write, so that a line is whole or the last.
        lines.write_all(text.as_bytes()).map_err(RecordError::file(dir.join(LINES), "write"))?;
        made += 1;
        told(done.len() as u64 + made, all, Some(&line));
    }
    Ok(made)
}
