//! The run directory: everything that a run leaves behind, written as it happens.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use stridemap_files::Lock;
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_map::LearnedMap;
use stridemap_record::{
    Checkpoint, Columns, EPISODE_BEGUN, EVENTS, EVENTS_HEADER, EpisodeStart, FORMAT, LearningRow, Pace, Phase,
    Provenance, RecordError, Recording, RobotFall, StridePhase, Summary, Transition, World, event_line,
    falls_in_starts,
    files::{Keep, Log, check_dir, create_dir, read_json, write_json, write_whole},
    files::{lock, sweep, write_json_line},
    grid,
};

use crate::error::LabError;
use crate::recorder::{Progress, Recorder};
use crate::run::beginning::{build, logs, refuse_occupied};
use crate::run::finished::{FinishedRun, read_progress, read_unfinished};
use crate::task::Task;

/// Tells a watcher (a terminal) what happens; never touches the run.
pub trait Watcher {
    /// A stride was made on the robot.
    fn stride(&mut self, _transition: &Transition, _what: Option<&str>) {}
    /// A trial in the map ended.
    fn trial(&mut self, _iteration: usize, _trial: &TrialSummary) {}
    /// A phase ended.
    fn phase(&mut self, _phase: Phase, _progress: &Progress) {}
    /// Something that a person should know.
    fn note(&mut self, _text: &str) {}
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
    table: Columns,
    transitions: Log,
    record: Log,
    learning: Log,
    events: Log,
    stop: Arc<AtomicBool>,
    watcher: Box<dyn Watcher>,
    /// Strides since the last checkpoint, those of a broken batch that a robot behind a link cannot repeat among them.
    unfinished: Vec<Transition>,
    /// The map just fitted, until the policy that comes of it is known.
    fitted: Option<(usize, LearnedMap)>,
    /// Nobody else writes here meanwhile.
    _lock: Lock,
}

impl RunDirectory {
    /// Creates a run directory for a task and a seed. It appears whole or not at all; one that is there
    /// and holds no stride yet, half made or of a run that ended before its first, is made anew, its events kept.
    ///
    /// `stop` is looked at after each stride and each trial.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if the directory holds something already; [`RecordError::Locked`] if another process
    /// writes there; [`LabError::Record`].
    pub fn create(
        path: &Path,
        task: &Task,
        provenance: &Provenance,
        stop: Arc<AtomicBool>,
        watcher: Box<dyn Watcher>,
    ) -> Result<Self, LabError> {
        let unwritable = |source| RecordError::Unwritable { path: path.into(), source };
        let place = stridemap_files::resolved(path).map_err(unwritable)?;
        let lock = if place.symlink_metadata().is_ok() {
            // A run is locked before it is looked at; nothing is made where there is none.
            let held = path.join("config.toml").exists().then(|| lock(path));
            let held = held.transpose()?;
            refuse_occupied(path, task)?;
            check_dir(path)?;
            let lock = held.map_or_else(|| lock(path), Ok)?;
            sweep(path)?;
            build(path, path, task, provenance)?;
            lock
        } else {
            let (Some(parent), Some(name)) = (place.parent(), place.file_name()) else {
                return Err(unwritable(std::io::ErrorKind::InvalidInput.into()).into());
            };
            let mut aside = std::ffi::OsString::from(".");
            aside.push(name);
            aside.push(".new");
            let aside = parent.join(aside);
            check_dir(&aside)?;
            refuse_occupied(&aside, task)?; // Of a killed process, or somebody else's.
            create_dir(&aside)?;
            let lock = lock(&aside)?;
            sweep(&aside)?;
            build(&aside, path, task, provenance)?;
            std::fs::rename(&aside, &place).map_err(RecordError::file(path, "create directory"))?;
            lock
        };
        let rows = [0, 0, 0];
        Self::open_logs(path, task, provenance.seed, rows, lock, stop, watcher)
    }

    fn open_logs(
        path: &Path,
        task: &Task,
        seed: u64,
        rows: [usize; 3],
        lock: Lock,
        stop: Arc<AtomicBool>,
        watcher: Box<dyn Watcher>,
    ) -> Result<Self, LabError> {
        let table = Columns::new(&task.process_spec()?);
        let [transitions, record, learning] = logs(path, &table, rows)?;
        Ok(Self {
            path: path.into(),
            task: task.clone(),
            seed,
            table,
            transitions,
            record,
            learning,
            events: Log::open(&path.join(EVENTS), EVENTS_HEADER, Keep::Lines)?,
            stop,
            watcher,
            unfinished: Vec::new(),
            fitted: None,
            _lock: lock,
        })
    }

    /// Opens a run directory to go on with its run, and reads what it achieved. Nothing is written before there is
    /// something to write.
    ///
    /// What was written after the last checkpoint is dropped and made again, with the same result. A robot
    /// behind a link cannot repeat what it did: its training and evaluation strides are kept, and the run goes
    /// on after the last of them. Strides made only to report are measured anew.
    ///
    /// # Errors
    ///
    /// [`RecordError::Locked`] if another process writes there; [`LabError::Mixed`] if model, simulator, program, seed or
    /// task are not those of the run; [`LabError::RunDirectory`] if it holds no run; [`LabError::Record`] if a file
    /// is damaged; [`LabError::FallBudget`] if the robot fell more often than the task allows; [`LabError::Record`].
    pub fn resume(
        run: &FinishedRun,
        stop: Arc<AtomicBool>,
        watcher: Box<dyn Watcher>,
    ) -> Result<(Self, Progress), LabError> {
        let FinishedRun { path, task, provenance, .. } = run;
        let lock = lock(path)?;
        run.refuse_others()?;
        let (mut progress, mut rows, _) = read_progress(path, task)?;
        let table = Columns::new(&task.process_spec()?);
        let mut unfinished = read_unfinished(&table, &path.join("transitions.csv"), rows[0]);
        if task.link.is_some() {
            progress.unfinished = unfinished?;
            rows[0] += progress.unfinished.len();
            // Record strides are made anew; the robot has fallen in them all the same.
            let measured = read_unfinished(&table, &path.join("record.csv"), rows[1])?;
            progress.falls.extend(RobotFall::among(&measured));
            let iteration = progress.iterations.len() + 1;
            progress.falls.extend(falls_in_starts(path, iteration));
            unfinished = Ok(progress.unfinished.clone());
        }
        // A spent budget is told before anything is dropped or made again.
        let mut falls = progress.falls.clone();
        falls.extend(RobotFall::among(&unfinished.unwrap_or_default()));
        task.check_fall_budget(&falls)?;
        sweep(path)?;
        let opened = Self::open_logs(path, task, provenance.seed, rows, lock, stop, watcher);
        let mut directory = opened.map_err(|error| match error {
            LabError::Record(error) => provenance.blame(error).into(),
            other => other,
        })?;
        directory.unfinished = progress.unfinished.clone();
        Ok((directory, progress))
    }

    /// Drops a last line of the events that was cut off, and begins them anew where they are gone, with a word.
    ///
    /// # Errors
    ///
    /// [`LabError::Record`].
    pub fn mend(&mut self) -> Result<(), LabError> {
        let said = if self.events.is_new() {
            "was emptied or deleted since this run began; what it held is lost, and it begins anew"
        } else if self.events.has_cut_line() {
            "the last line was cut off and is dropped"
        } else {
            return Ok(());
        };
        self.events.begin()?;
        let events = self.path.join(EVENTS);
        self.watcher.note(&format!("{}: {said}", events.display()));
        Ok(())
    }

    /// Notes in the run's events that it goes on from what it achieved.
    ///
    /// # Errors
    ///
    /// [`LabError::Record`].
    pub fn goes_on(&mut self) -> Result<(), LabError> {
        self.mend()?;
        self.event(
            "resumed",
            serde_json::json!({
                "strides": self.transitions.rows(),
                "of_an_unfinished_batch": self.unfinished.len(),
                "falls_at_most": self.task.algorithm.falls_at_most,
            }),
        )
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
    /// [`LabError::Record`].
    pub fn event(&mut self, kind: &str, details: serde_json::Value) -> Result<(), LabError> {
        Ok(self.events.append(&event_line(kind, details))?)
    }

    fn check_stop(&self) -> Result<(), LabError> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(LabError::Interrupted { path: self.path.clone() });
        }
        Ok(())
    }

    /// Notes in the run's record that it ended.
    ///
    /// # Errors
    ///
    /// [`LabError::Record`].
    pub fn end(&mut self) -> Result<(), LabError> {
        let path = self.path.join("provenance.json");
        let mut provenance: Provenance = read_json(&path)?;
        provenance.end = Some(jiff::Timestamp::now().to_string());
        write_json(&path, &provenance)?;
        self.event("end", serde_json::json!({}))
    }

    /// Writes `summary.json` and returns it; strides of a phase that was broken off are counted.
    ///
    /// # Errors
    ///
    /// [`LabError::Record`].
    pub fn write_summary(&mut self, progress: &Progress) -> Result<Summary, LabError> {
        let mut summary = progress.summary(&self.task, self.seed);
        summary.count(&self.unfinished);
        write_json(&self.path.join("summary.json"), &summary)?;
        Ok(summary)
    }
}

impl Recorder for RunDirectory {
    fn stride(&mut self, transition: &Transition, what: Option<&str>) -> Result<(), LabError> {
        let row = self.table.row(transition);
        if transition.phase == StridePhase::Record {
            self.record.append(&format!("{},{row}", what.unwrap_or_default()))?;
        } else {
            self.transitions.append(&row)?;
        }
        self.unfinished.push(transition.clone());
        self.watcher.stride(transition, what);
        self.check_stop()
    }

    fn episode(&mut self, (stream, word): (u64, u64), what: Option<&str>) -> Result<(), LabError> {
        let (log, rows) = match what {
            Some(_) => ("record.csv", self.record.rows()),
            None => ("transitions.csv", self.transitions.rows()),
        };
        let start = EpisodeStart { log: log.into(), row: rows, what: what.map(Into::into), stream, word };
        let start = serde_json::to_value(start).map_err(|e| RecordError::content(EVENTS, None, e.to_string()))?;
        self.event(EPISODE_BEGUN, start)
    }

    fn map(&mut self, iteration: usize, map: &LearnedMap) -> Result<(), LabError> {
        write_json(&self.path.join(format!("map/{iteration}.json")), &map.to_saved(iteration)?)?;
        self.fitted = Some((iteration, map.clone()));
        Ok(())
    }

    fn trial(&mut self, iteration: usize, trial: &TrialSummary) -> Result<(), LabError> {
        let row = LearningRow {
            iteration,
            trial: trial.trial,
            world: World::Map,
            average_reward: trial.mean_reward,
            falls: trial.falls,
            strides: trial.strides,
        };
        self.learning.append(&row.line())?;
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
        let name = format!("figures/data/policy-{iteration}.csv");
        Ok(write_whole(&self.path.join(name), table.as_bytes())?)
    }

    fn poses(&mut self, what: &str, pace: Pace, recording: &Recording) -> Result<(), LabError> {
        let folder = self.path.join(pace.folder());
        create_dir(&folder)?; // A run of an earlier version may lack it.
        Ok(write_json_line(&folder.join(format!("{what}.json")), recording)?)
    }

    fn checkpoint(&mut self, phase: Phase, progress: &Progress) -> Result<(), LabError> {
        let robot = match phase {
            Phase::Evaluate => progress.iterations.last().and_then(|i| i.evaluation),
            Phase::Record => progress.iterations.last().and_then(|i| i.record),
            _ => None,
        };
        if let Some(p) = robot {
            let iteration = progress.iterations.len();
            let row = LearningRow {
                iteration,
                trial: iteration,
                world: if phase == Phase::Evaluate { World::RobotEvaluation } else { World::Robot },
                average_reward: p.mean_reward,
                falls: p.falls,
                strides: p.strides,
            };
            self.learning.append(&row.line())?;
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
                seed: Some(self.seed),
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
                falls: progress.falls.clone(),
            },
        )?;
        self.unfinished.clear();
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
