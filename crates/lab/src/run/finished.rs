//! A run that was made before: what it achieved, and by what.

use std::path::{Path, PathBuf};

use stridemap_learn::SavedPolicy;
use stridemap_mujoco::{ModelSource, sha256};

use crate::error::LabError;
use crate::provenance::provenance_of;
use crate::recorder::Progress;
use crate::task::Task;
use stridemap_record::{
    Checkpoint, Columns, Provenance, RecordError, Rows, Transition,
    files::read_bytes,
    files::{read_json, read_text},
};

/// A run's copy of the model file that its task names.
pub(super) const MODEL_COPY: &str = "model.mjb";

/// The policy from which a run began that adapts to a robot that has changed.
pub(super) const PROVEN: &str = "policy/0.json";

pub(super) const STRIDES: [&str; 2] = ["transitions.csv", "record.csv"];

/// Whether a directory holds a run with at least one stride.
///
/// # Errors
///
/// [`LabError::Record`].
pub fn has_begun(path: &Path) -> Result<bool, LabError> {
    Ok(path.join("config.toml").exists() && has_strides(path)?)
}

/// Whether a run or the beginning of one holds a stride, or anything else that took work.
pub(super) fn has_strides(path: &Path) -> Result<bool, LabError> {
    if path.join("checkpoint.json").exists() {
        return Ok(true);
    }
    for log in STRIDES.map(|name| path.join(name)) {
        // Bytes, since a damaged log is not none.
        let bytes = match std::fs::read(&log) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => return Err(RecordError::file(log, "read")(error).into()),
        };
        if bytes.iter().filter(|byte| **byte == b'\n').count() > 1 {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Reads what a run achieved up to its last checkpoint, how many rows of each log belong to it, and its seed.
pub(super) fn read_progress(path: &Path, task: &Task) -> Result<(Progress, [usize; 3], Option<u64>), LabError> {
    let checkpoint_path = path.join("checkpoint.json");
    if !checkpoint_path.exists() {
        return Ok((Progress::default(), [0, 0, 0], None));
    }
    let c: Checkpoint = read_json(&checkpoint_path)?;
    let table = Columns::new(&task.process_spec()?);
    let transitions = table.read(&path.join("transitions.csv"), Rows::First(c.transition_rows))?;
    if transitions.len() < c.transition_rows {
        let (made, counted) = (transitions.len(), c.transition_rows);
        let problem = format!("holds {made} strides where the checkpoint counts {counted}");
        return Err(RecordError::content(path.join("transitions.csv"), None, problem).into());
    }
    let policies =
        (1..=c.policies).map(|i| read_json(&path.join(format!("policy/{i}.json")))).collect::<Result<_, _>>()?;
    let progress = Progress {
        // Aborted strides are in the log but are no data.
        transitions: transitions.into_iter().filter(|t| t.end != stridemap_process::StrideEnd::Aborted).collect(),
        iterations: c.iterations,
        policies,
        nominal: c.nominal,
        final_performance: c.final_performance,
        record_strides: c.record_strides,
        seconds: c.seconds,
        falls: c.falls,
        unfinished: Vec::new(),
        prior: None,
        total_seconds: c.seconds.simulation + c.seconds.fit + c.seconds.improve,
    };
    Ok((progress, [c.transition_rows, c.record_rows, c.learning_rows], c.seed))
}

/// Reads the strides that were made after the last checkpoint, which counts `checkpoint_rows`. A last line that
/// was cut short is no stride.
pub(super) fn read_unfinished(
    table: &Columns,
    log: &Path,
    checkpoint_rows: usize,
) -> Result<Vec<Transition>, LabError> {
    if !log.exists() {
        return Ok(Vec::new());
    }
    // Every row ends with a line break, and so does the header.
    let whole = read_text(log)?.matches('\n').count().saturating_sub(1);
    let mut all = table.read(log, Rows::First(whole.max(checkpoint_rows)))?;
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
    /// Rows of `transitions.csv` and of `record.csv` that are part of it.
    pub rows: [usize; 2],
    /// The seed by which it achieved that, where its checkpoint says it.
    checkpoint_seed: Option<u64>,
}

/// Puts the run's own copy of its model in the place of a model file that is not there any more.
fn use_copy(path: &Path, task: &mut Task, provenance: &Provenance) -> Result<(), LabError> {
    let (ModelSource::File(model), Some(hash)) = (&mut task.robot.model, &provenance.model_copy_sha256) else {
        return Ok(());
    };
    let copy = path.join(MODEL_COPY);
    if model.exists() || !copy.exists() {
        return Ok(());
    }
    if sha256(&read_bytes(&copy)?) != *hash {
        let problem =
            format!("is damaged (provenance.json names another SHA-256), and {} is not there", model.display());
        return Err(RecordError::content(copy, None, problem).into());
    }
    *model = copy;
    Ok(())
}

impl FinishedRun {
    /// Reads a run directory.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if it holds no run; [`LabError::Record`].
    pub fn open(path: &Path, sets: &[String]) -> Result<Self, LabError> {
        let config = path.join("config.toml");
        if !config.exists() {
            return Err(LabError::RunDirectory {
                path: path.into(),
                problem: "holds no run (there is no config.toml in it)".into(),
            });
        }
        let mut task = crate::builtin::load_file(&config, sets)?.task;
        let provenance: Provenance = read_json(&path.join("provenance.json"))?;
        use_copy(path, &mut task, &provenance)?;
        let proven = path.join(PROVEN);
        task.proven = proven.exists().then(|| read_json(&proven)).transpose()?;
        let (progress, [transitions, record, _], checkpoint_seed) = read_progress(path, &task)?;
        Ok(Self { path: path.into(), task, provenance, progress, rows: [transitions, record], checkpoint_seed })
    }

    /// What differs between what made this run and what would go on with it: model, simulator, program, seed, values
    /// of the task. One sentence each.
    ///
    /// # Errors
    ///
    /// [`LabError::Mujoco`] if the robot cannot be built.
    pub fn differences(&self) -> Result<Vec<String>, LabError> {
        let seed = self.checkpoint_seed.unwrap_or(self.provenance.seed);
        let now = provenance_of(&self.task, seed, None, String::new())?;
        let mut then = self.provenance.clone();
        then.task = then.task.map(crate::builtin::in_words_of_now);
        Ok(then.differences(&now))
    }

    /// Refuses to go on with a run by other means than those that made it.
    ///
    /// # Errors
    ///
    /// [`LabError::Mixed`] with what differs; as [`Self::differences`].
    pub fn refuse_others(&self) -> Result<(), LabError> {
        match self.differences()? {
            same if same.is_empty() => Ok(()),
            differences => Err(LabError::Mixed { begun: has_begun(&self.path)?, path: self.path.clone(), differences }),
        }
    }

    /// Whether the run reached its end, and everything of it is written.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.progress.final_performance.is_some()
            && self.provenance.end.is_some()
            && self.path.join("summary.json").exists()
    }

    /// The strides by which the final policy was measured: settled ones of it on the robot that was learned.
    ///
    /// # Errors
    ///
    /// [`LabError::Record`].
    pub fn final_strides(&self) -> Result<Vec<Transition>, LabError> {
        let table = Columns::new(&self.task.process_spec()?);
        let mut made = table.read_recorded(&self.path.join("record.csv"), Rows::First(self.rows[1]))?;
        // One that was rejected as final was measured before the one that is.
        let begins = |(what, t): &(String, Transition)| what == "final" && (t.episode, t.k) == (0, 0);
        let last = made.iter().rposition(begins).unwrap_or(made.len());
        Ok(made.split_off(last).into_iter().map(|(_, t)| t).collect())
    }

    /// The run's policy: the final one; before there is one the best so far, or the newest if none is proven.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if it has none yet; [`LabError::Record`].
    pub fn policy(&self) -> Result<SavedPolicy, LabError> {
        let Progress { policies, .. } = &self.progress;
        if self.progress.final_performance.is_some() {
            return Ok(read_json(&self.path.join("policy/final.json"))?);
        }
        let policy = self.progress.best_policy().or(policies.last());
        policy.cloned().ok_or_else(|| LabError::RunDirectory {
            path: self.path.clone(),
            problem: "has no policy yet; `stridemap learn --resume` it first".into(),
        })
    }
}
