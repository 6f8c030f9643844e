//! The run directory: everything that a run leaves behind, written as it happens.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_returnmap::LearnedMap;

use crate::algorithm::{Iteration, Phase, Progress, Recorder, Seconds};
use crate::error::LabError;
use crate::poses::{Pace, Recording};
use crate::provenance::Provenance;
use crate::run::files::{
    Log, append_line, create_dir, read_json, read_text, write_json, write_whole,
};
use crate::run::grid;
use crate::run::summary::Summary;
use crate::run::table::TransitionTable;
use crate::strides::{Performance, StridePhase, Transition};
use crate::task::Task;

/// The version of the run directory that this crate writes and reads.
const FORMAT: u32 = 1;

/// What a killed run goes on from.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Checkpoint {
    format: u32,
    phase: Phase,
    transition_rows: usize,
    record_rows: usize,
    learning_rows: usize,
    policies: usize,
    iterations: Vec<Iteration>,
    nominal: Option<Performance>,
    final_performance: Option<Performance>,
    record_strides: usize,
    seconds: Seconds,
}

/// Names of the components, for readers of the CSV files.
#[derive(Debug, Serialize)]
struct Columns<'a> {
    state: Vec<&'a str>,
    action: Vec<&'a str>,
}

/// Tells a watcher (a terminal) what happens; never touches the run.
pub trait Watcher {
    /// A stride was made on the robot.
    fn stride(&mut self, _transition: &Transition, _what: Option<&str>) {}
    /// A trial in the map ended.
    fn trial(&mut self, _iteration: usize, _trial: &TrialSummary) {}
    /// A phase ended.
    fn phase(&mut self, _phase: Phase, _progress: &Progress) {}
}

/// A watcher that looks away.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoWatcher;

impl Watcher for NoWatcher {}

/// A run directory that is being written.
pub struct RunDirectory {
    path: PathBuf,
    task: Task,
    seed: u64,
    table: TransitionTable,
    transitions: Log,
    record: Log,
    learning: Log,
    events: Log,
    stop: Arc<AtomicBool>,
    watcher: Box<dyn Watcher>,
    /// The map just fitted, until the policy that comes of it is known.
    fitted: Option<(usize, LearnedMap)>,
}

const LEARNING_HEADER: &str = "iteration,trial,world,average_reward,falls,strides";

impl RunDirectory {
    /// Creates a run directory for a task and a seed.
    ///
    /// `config` is the resolved task as TOML. `stop` is looked at after each stride and each trial.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if the directory holds a run already; [`LabError::File`].
    pub fn create(
        path: &Path,
        task: &Task,
        config: &str,
        provenance: &Provenance,
        stop: Arc<AtomicBool>,
        watcher: Box<dyn Watcher>,
    ) -> Result<Self, LabError> {
        if path.join("config.toml").exists() {
            return Err(LabError::RunDirectory {
                path: path.into(),
                problem: format!(
                    "holds a run already; go on with `stridemap learn --resume {0}`, or choose \
                     another directory with --out",
                    path.display()
                ),
            });
        }
        let occupied = std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some());
        if occupied {
            return Err(LabError::RunDirectory {
                path: path.into(),
                problem: "is not empty and holds no run; choose another directory with --out"
                    .into(),
            });
        }
        for sub in ["map", "policy", "figures/data", "poses", "lapse"] {
            create_dir(&path.join(sub))?;
        }
        write_json(&path.join("provenance.json"), provenance)?;
        let spec = task.process_spec()?;
        write_json(
            &path.join("columns.json"),
            &Columns {
                state: spec.state.iter().map(|d| d.name.as_str()).collect(),
                action: spec.action.iter().map(|d| d.name.as_str()).collect(),
            },
        )?;
        // Last, because its presence says that this is a run.
        write_whole(&path.join("config.toml"), config.as_bytes())?;
        Self::open_logs(path, task, provenance.seed, [0, 0, 0], stop, watcher)
    }

    fn open_logs(
        path: &Path,
        task: &Task,
        seed: u64,
        [transitions, record, learning]: [usize; 3],
        stop: Arc<AtomicBool>,
        watcher: Box<dyn Watcher>,
    ) -> Result<Self, LabError> {
        let table = TransitionTable::new(&task.process_spec()?);
        let header = table.header();
        let events_path = path.join("events.ndjson");
        let event_rows = read_text(&events_path).map_or(0, |t| t.lines().count().saturating_sub(1));
        Ok(Self {
            path: path.into(),
            task: task.clone(),
            seed,
            transitions: Log::open(&path.join("transitions.csv"), &header, transitions)?,
            record: Log::open(&path.join("record.csv"), &format!("what,{header}"), record)?,
            learning: Log::open(&path.join("learning.csv"), LEARNING_HEADER, learning)?,
            events: Log::open(&events_path, r#"{"format":1}"#, event_rows)?,
            table,
            stop,
            watcher,
            fitted: None,
        })
    }

    /// Opens a run directory to go on with its run, and reads what it achieved.
    ///
    /// What was written after the last checkpoint is dropped and made again, with the same result. A robot
    /// behind a link cannot repeat what it did: its training and evaluation strides are kept, and the run goes
    /// on after the last of them. Strides made only to report are measured anew.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if it holds no run; [`LabError::Content`] if a file is damaged;
    /// [`LabError::File`].
    pub fn resume(
        path: &Path,
        task: &Task,
        seed: u64,
        stop: Arc<AtomicBool>,
        watcher: Box<dyn Watcher>,
    ) -> Result<(Self, Progress), LabError> {
        let (mut progress, mut rows) = read_progress(path, task)?;
        if task.link.is_some() {
            progress.unfinished = read_unfinished(path, task, rows[0])?;
            rows[0] += progress.unfinished.len();
        }
        let mut directory = Self::open_logs(path, task, seed, rows, stop, watcher)?;
        directory.event(
            "resumed",
            serde_json::json!({
                "strides": rows[0],
                "of_an_unfinished_batch": progress.unfinished.len(),
            }),
        )?;
        Ok((directory, progress))
    }

    /// Where it lies.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends an event, with the wall-clock time.
    ///
    /// # Errors
    ///
    /// [`LabError::File`].
    pub fn event(&mut self, kind: &str, details: serde_json::Value) -> Result<(), LabError> {
        self.events.append(&event_line(kind, details))
    }

    fn check_stop(&self) -> Result<(), LabError> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(LabError::Interrupted {
                path: self.path.clone(),
            });
        }
        Ok(())
    }

    /// Notes in the run's record that it ended.
    ///
    /// # Errors
    ///
    /// [`LabError::File`] or [`LabError::Content`].
    pub fn end(&mut self) -> Result<(), LabError> {
        let path = self.path.join("provenance.json");
        let mut provenance: Provenance = read_json(&path)?;
        provenance.end = Some(jiff::Timestamp::now().to_string());
        write_json(&path, &provenance)?;
        self.event("end", serde_json::json!({}))
    }

    /// Writes `summary.json` and returns it.
    ///
    /// # Errors
    ///
    /// [`LabError::File`].
    pub fn write_summary(&mut self, progress: &Progress) -> Result<Summary, LabError> {
        let summary = Summary::of(&self.task, self.seed, progress);
        write_json(&self.path.join("summary.json"), &summary)?;
        Ok(summary)
    }
}

impl Recorder for RunDirectory {
    fn stride(&mut self, transition: &Transition, what: Option<&str>) -> Result<(), LabError> {
        let row = self.table.row(transition);
        if transition.phase == StridePhase::Record {
            self.record
                .append(&format!("{},{row}", what.unwrap_or_default()))?;
        } else {
            self.transitions.append(&row)?;
        }
        self.watcher.stride(transition, what);
        self.check_stop()
    }

    fn map(&mut self, iteration: usize, map: &LearnedMap) -> Result<(), LabError> {
        write_json(
            &self.path.join(format!("map/{iteration}.json")),
            &map.to_saved(iteration)?,
        )?;
        self.fitted = Some((iteration, map.clone()));
        Ok(())
    }

    fn trial(&mut self, iteration: usize, trial: &TrialSummary) -> Result<(), LabError> {
        self.learning.append(&format!(
            "{iteration},{},map,{},{},{}",
            trial.trial, trial.mean_reward, trial.falls, trial.strides
        ))?;
        self.watcher.trial(iteration, trial);
        self.check_stop()
    }

    fn policy(&mut self, iteration: usize, policy: &SavedPolicy) -> Result<(), LabError> {
        write_json(&self.path.join(format!("policy/{iteration}.json")), policy)?;
        // For figures the map is cut where the policy is, so only now.
        if let Some((of, map)) = self.fitted.take().filter(|(of, _)| *of == iteration) {
            let data = |name: &str| self.path.join(format!("figures/data/{name}-{of}.csv"));
            write_whole(&data("map"), grid::map_table(&map, policy)?.as_bytes())?;
            write_whole(&data("lines"), grid::line_table(&map, policy)?.as_bytes())?;
        }
        let table = grid::policy_table(policy, &self.task.map.start_range);
        write_whole(
            &self
                .path
                .join(format!("figures/data/policy-{iteration}.csv")),
            table.as_bytes(),
        )
    }

    fn poses(&mut self, what: &str, pace: Pace, recording: &Recording) -> Result<(), LabError> {
        let folder = self.path.join(pace.folder());
        create_dir(&folder)?; // A run of an earlier version may lack it.
        let path = folder.join(format!("{what}.json"));
        let text = serde_json::to_string(recording).map_err(|error| LabError::Content {
            path: path.clone(),
            line: None,
            problem: format!("cannot be written as JSON: {error}"),
        })?;
        write_whole(&path, text.as_bytes())
    }

    fn checkpoint(&mut self, phase: Phase, progress: &Progress) -> Result<(), LabError> {
        let robot = match phase {
            Phase::Evaluate => progress.iterations.last().and_then(|i| i.evaluation),
            Phase::Record => progress.iterations.last().and_then(|i| i.record),
            _ => None,
        };
        if let Some(p) = robot {
            let iteration = progress.iterations.len();
            let world = if phase == Phase::Evaluate {
                "robot-evaluation"
            } else {
                "robot"
            };
            self.learning.append(&format!(
                "{iteration},{},{world},{},{},{}",
                iteration, p.mean_reward, p.falls, p.strides
            ))?;
        }
        for log in [&self.transitions, &self.record, &self.learning] {
            log.sync()?;
        }
        if phase == Phase::Final && progress.final_performance.is_some() {
            let policy = progress.final_policy(&self.task)?;
            write_json(&self.path.join("policy/final.json"), &policy)?;
        }
        write_json(
            &self.path.join("checkpoint.json"),
            &Checkpoint {
                format: FORMAT,
                phase,
                transition_rows: self.transitions.rows(),
                record_rows: self.record.rows(),
                learning_rows: self.learning.rows(),
                policies: progress.policies.len(),
                iterations: progress.iterations.clone(),
                nominal: progress.nominal,
                final_performance: progress.final_performance,
                record_strides: progress.record_strides,
                seconds: progress.seconds,
            },
        )?;
        self.event(
            "checkpoint",
            serde_json::json!({
                "phase": phase,
                "iteration": progress.iterations.len(),
                "strides": self.transitions.rows(),
            }),
        )?;
        self.watcher.phase(phase, progress);
        Ok(())
    }
}

fn event_line(kind: &str, details: serde_json::Value) -> String {
    let mut event = serde_json::json!({
        "time": jiff::Timestamp::now().to_string(),
        "event": kind,
    });
    if let (Some(map), serde_json::Value::Object(more)) = (event.as_object_mut(), details) {
        map.extend(more);
    }
    event.to_string()
}

/// Appends an event to a run's `events.ndjson` at once, whoever else writes into it: for those beside the run,
/// such as the person who was asked something.
///
/// # Errors
///
/// [`LabError::File`].
pub fn append_event(run: &Path, kind: &str, details: serde_json::Value) -> Result<(), LabError> {
    append_line(&run.join("events.ndjson"), &event_line(kind, details))
}

/// Reads what a run achieved up to its last checkpoint, and how many rows of each log belong to it.
fn read_progress(path: &Path, task: &Task) -> Result<(Progress, [usize; 3]), LabError> {
    let checkpoint_path = path.join("checkpoint.json");
    if !checkpoint_path.exists() {
        return Ok((Progress::default(), [0, 0, 0]));
    }
    let c: Checkpoint = read_json(&checkpoint_path)?;
    if c.format != FORMAT {
        return Err(LabError::Content {
            path: checkpoint_path,
            line: None,
            problem: format!(
                "has format {}; this version reads format {FORMAT}",
                c.format
            ),
        });
    }
    let table = TransitionTable::new(&task.process_spec()?);
    let transitions = table.read(&path.join("transitions.csv"), Some(c.transition_rows))?;
    if transitions.len() < c.transition_rows {
        return Err(LabError::Content {
            path: path.join("transitions.csv"),
            line: None,
            problem: format!(
                "holds {} strides where the checkpoint counts {}",
                transitions.len(),
                c.transition_rows
            ),
        });
    }
    let policies = (1..=c.policies)
        .map(|i| read_json(&path.join(format!("policy/{i}.json"))))
        .collect::<Result<_, _>>()?;
    let progress = Progress {
        // Aborted strides are in the log but are no data.
        transitions: transitions
            .into_iter()
            .filter(|t| t.end != stridemap_returnmap::StrideEnd::Aborted)
            .collect(),
        iterations: c.iterations,
        policies,
        nominal: c.nominal,
        final_performance: c.final_performance,
        record_strides: c.record_strides,
        seconds: c.seconds,
        unfinished: Vec::new(),
        total_seconds: c.seconds.simulation + c.seconds.fit + c.seconds.improve,
    };
    Ok((
        progress,
        [c.transition_rows, c.record_rows, c.learning_rows],
    ))
}

/// Reads the strides that were made after the last checkpoint, which counts `checkpoint_rows`. A last line that
/// was cut short is no stride.
fn read_unfinished(
    path: &Path,
    task: &Task,
    checkpoint_rows: usize,
) -> Result<Vec<Transition>, LabError> {
    let log = path.join("transitions.csv");
    if !log.exists() {
        return Ok(Vec::new());
    }
    // Every row ends with a line break, and so does the header.
    let whole = read_text(&log)?.matches('\n').count().saturating_sub(1);
    let table = TransitionTable::new(&task.process_spec()?);
    let mut all = table.read(&log, Some(whole.max(checkpoint_rows)))?;
    Ok(all.split_off(checkpoint_rows.min(all.len())))
}

/// A run that was made before, read for further use. The directory is not changed.
pub struct FinishedRun {
    /// Where it lies.
    pub path: PathBuf,
    /// Its task.
    pub task: Task,
    /// Where its numbers came from.
    pub provenance: Provenance,
    /// What it achieved.
    pub progress: Progress,
}

impl FinishedRun {
    /// Reads a run directory.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if it holds no run; [`LabError::Content`] or [`LabError::File`].
    pub fn open(path: &Path, sets: &[String]) -> Result<Self, LabError> {
        let config = path.join("config.toml");
        if !config.exists() {
            return Err(LabError::RunDirectory {
                path: path.into(),
                problem: "holds no run (there is no config.toml in it)".into(),
            });
        }
        let task = crate::builtin::load_file(&config, sets)?.task;
        let provenance = read_json(&path.join("provenance.json"))?;
        let (progress, _) = read_progress(path, &task)?;
        Ok(Self {
            path: path.into(),
            task,
            provenance,
            progress,
        })
    }

    /// The run's policy: the final one; before there is one the best so far, or the newest if none is proven.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if it has none yet; [`LabError::Content`] or [`LabError::File`].
    pub fn policy(&self) -> Result<SavedPolicy, LabError> {
        let Progress { policies, .. } = &self.progress;
        if self.progress.final_performance.is_some() {
            return read_json(&self.path.join("policy/final.json"));
        }
        let policy = self.progress.best_policy().or(policies.last());
        policy.cloned().ok_or_else(|| LabError::RunDirectory {
            path: self.path.clone(),
            problem: "has no policy yet; `stridemap learn --resume` it first".into(),
        })
    }
}
