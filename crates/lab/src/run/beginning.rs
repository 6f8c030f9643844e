//! The beginning of a run directory: whether a place is free, and what a new one consists of.

use std::path::{Path, PathBuf};

use stridemap_files::LOCK_FILE;
use stridemap_mujoco::{ModelSource, compiled, sha256};

use crate::error::LabError;
use crate::provenance::task_differences;
use crate::run::finished::{FinishedRun, MODEL_COPY, PROVEN, STRIDES, has_strides};
use crate::task::Task;
use stridemap_record::{
    Columns, EVENTS, EVENTS_HEADER, LearningRow, Provenance, RecordError,
    files::{Keep, Log, create_dir, write_json, write_whole},
};

/// What a new run consists of; `config.toml` is its last part, and says that it is one.
const NEW: [&str; 13] = [
    "map",
    "policy",
    "figures",
    "poses",
    "lapse",
    LOCK_FILE,
    MODEL_COPY,
    "provenance.json",
    "columns.json",
    "transitions.csv",
    "record.csv",
    "learning.csv",
    EVENTS,
];

/// Refuses a directory that holds anything but the beginning of a run without a stride, if it is there.
///
/// # Errors
///
/// [`LabError::RunDirectory`]; [`RecordError::Unwritable`] if it cannot be read.
pub fn refuse_occupied(path: &Path, task: &Task) -> Result<(), LabError> {
    let refuse = |problem: String| Err(LabError::RunDirectory { path: path.into(), problem });
    if path.symlink_metadata().is_err() {
        return Ok(());
    }
    let entries = std::fs::read_dir(path).map_err(|source| RecordError::Unwritable { path: path.into(), source })?;
    let is_run = path.join("config.toml").exists();
    let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    let known = |name: &std::ffi::OsString| {
        let name = name.to_string_lossy();
        // Earlier versions and killed processes left their files aside.
        NEW.contains(&&*name) || name.ends_with(".tmp")
    };
    if !has_strides(path)? && (is_run || names.iter().all(known)) {
        return Ok(());
    }
    if !is_run {
        return refuse("is not empty and holds no run; choose another directory with --out".into());
    }
    let edited = FinishedRun::open(path, &[]).and_then(|run| task_differences(&run.task, task)).unwrap_or_default();
    let differs = match edited.as_slice() {
        [] => String::new(),
        edited => format!(" of another task ({})", edited.join("; ")),
    };
    refuse(format!(
        "holds a run already{differs}; go on with `stridemap learn --resume {0}`, or choose another directory with --out",
        path.display()
    ))
}

/// Writes what a new run consists of into a directory that will stand at `place`.
pub(super) fn build(path: &Path, place: &Path, task: &Task, provenance: &Provenance) -> Result<(), LabError> {
    for sub in ["map", "policy", "figures/data", "poses", "lapse"] {
        create_dir(&path.join(sub))?;
    }
    let columns = Columns::new(&task.process_spec()?);
    write_json(&path.join("columns.json"), &columns)?;
    let (mut task, mut provenance) = (task.clone(), provenance.clone());
    if let ModelSource::File(model) = &mut task.robot.model {
        let bytes = compiled(&ModelSource::File(model.clone()), &task.robot.add)?;
        write_whole(&path.join(MODEL_COPY), &bytes)?;
        provenance.model_copy_sha256 = Some(sha256(&bytes));
        // From the run's own place, so that both can move together.
        *model = relative(place, model).unwrap_or_else(|| MODEL_COPY.into());
    }
    write_json(&path.join("provenance.json"), &provenance)?;
    if let Some(proven) = &task.proven {
        write_json(&path.join(PROVEN), proven)?;
    }
    // No row is in them: a header of another task may be.
    for name in STRIDES.iter().chain(&["learning.csv"]) {
        write_whole(&path.join(name), b"")?;
    }
    for mut log in logs(path, &columns, [0, 0, 0])? {
        log.begin()?;
    }
    Log::open(&path.join(EVENTS), EVENTS_HEADER, Keep::Lines)?.begin()?;
    write_whole(&path.join("config.toml"), task.to_toml()?.as_bytes())?;
    Ok(())
}

/// A file's path seen from a directory that need not be there yet; `None` if it is no text.
fn relative(dir: &Path, file: &Path) -> Option<PathBuf> {
    let absolute = |path: &Path| std::path::absolute(path).ok();
    // Links above would make `..` mean something else.
    let dir = absolute(dir)?;
    let dir = dir.canonicalize().ok().or_else(|| {
        let parent = dir.ancestors().find(|a| a.exists())?;
        Some(parent.canonicalize().ok()?.join(dir.strip_prefix(parent).ok()?))
    })?;
    let file = absolute(file)?.canonicalize().ok()?;
    let shared = dir.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = dir.components().skip(shared).map(|_| std::path::Component::ParentDir);
    let path: PathBuf = up.chain(file.components().skip(shared)).collect();
    path.to_str()?;
    Some(path)
}

/// The logs of strides and trials, of which so many rows are kept.
pub(super) fn logs(path: &Path, table: &Columns, rows: [usize; 3]) -> Result<[Log; 3], LabError> {
    let open = |name: &str, header: &str, rows| Log::open(&path.join(name), header, Keep::Rows(rows));
    Ok([
        open("transitions.csv", &table.header(), rows[0])?,
        open("record.csv", &table.record_header(), rows[1])?,
        open("learning.csv", LearningRow::HEADER, rows[2])?,
    ])
}
