//! Where numbers come from.

use stridemap_record::{Provenance, RecordError, key_differences};

use crate::error::LabError;
use crate::task::Task;

/// The record of a run that begins now.
///
/// # Errors
///
/// [`LabError::Mujoco`] if the robot cannot be built.
pub fn provenance_of(
    task: &Task,
    seed: u64,
    git_revision: Option<&str>,
    command: String,
) -> Result<Provenance, LabError> {
    let robot = stridemap_mujoco::MujocoRobot::new(task.robot.clone()).map_err(|error| task.located(error))?;
    let engine = robot.provenance()?;
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    Ok(Provenance {
        version: env!("CARGO_PKG_VERSION").into(),
        git_revision: git_revision.map(Into::into),
        mujoco_version: engine.engine.clone(),
        model_hash: engine.model_sha256.clone(),
        model_copy_sha256: None,
        seed,
        machine: format!("{} {}, {processors} processors", std::env::consts::OS, std::env::consts::ARCH),
        command,
        start: jiff::Timestamp::now().to_string(),
        end: None,
        asked: None,
        task: Some(as_json(task)?),
    })
}

fn as_json(task: &Task) -> Result<serde_json::Value, LabError> {
    let value = serde_json::to_value(task).map_err(|error| {
        let problem = format!("the task cannot be written as JSON: {error}");
        RecordError::content("provenance.json", None, problem)
    });
    Ok(value?)
}

/// The keys in which two tasks differ, with both values. The path of a model file is none of them: files move, and
/// the model's hash is compared.
///
/// # Errors
///
/// [`LabError::Record`] if a task cannot be written as JSON.
pub fn task_differences(then: &Task, now: &Task) -> Result<Vec<String>, LabError> {
    Ok(key_differences(&as_json(then)?, &as_json(now)?))
}
