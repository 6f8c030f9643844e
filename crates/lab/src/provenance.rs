//! Where numbers come from.

use serde::{Deserialize, Serialize};

use crate::error::LabError;
use crate::task::Task;

/// Where a run's numbers come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of Stridemap.
    pub version: String,
    /// Git revision of its source, where it was built from a checkout; with `-dirty` if that was
    /// changed.
    pub git_revision: Option<String>,
    /// Version of MuJoCo.
    pub mujoco_version: String,
    /// SHA-256 of the robot's model as compiled, with overrides.
    pub model_hash: String,
    /// Root of every random stream.
    pub seed: u64,
    /// Operating system, architecture and number of processors.
    pub machine: String,
    /// The command that repeats the run.
    pub command: String,
    /// When it began.
    pub start: String,
    /// When it ended; null while it runs, or if it was killed.
    pub end: Option<String>,
}

impl Provenance {
    /// The record of a run that begins now.
    ///
    /// # Errors
    ///
    /// [`LabError::Mujoco`] if the robot cannot be built.
    pub fn begin(
        task: &Task,
        seed: u64,
        git_revision: Option<&str>,
        command: String,
    ) -> Result<Self, LabError> {
        let robot = stridemap_mujoco::MujocoRobot::new(task.robot.clone())?;
        let engine = robot.provenance();
        let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").into(),
            git_revision: git_revision.map(Into::into),
            mujoco_version: engine.engine.clone(),
            model_hash: engine.model_sha256.clone(),
            seed,
            machine: format!(
                "{} {}, {processors} processors",
                std::env::consts::OS,
                std::env::consts::ARCH
            ),
            command,
            start: jiff::Timestamp::now().to_string(),
            end: None,
        })
    }
}
