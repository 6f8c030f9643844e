//! One module per group of commands.

pub mod apply;
pub mod bench;
pub mod beside;
pub mod compare;
pub mod faults;
pub mod from_log;
pub mod learn;
pub mod learners;
pub mod linked;
pub mod report;
pub mod reproduce;
pub mod robot;
pub mod task;
pub mod verbs;

use std::path::{Path, PathBuf};

use stridemap_lab::{Provenance, Task};

use crate::args::Common;
use crate::failure::Failure;

/// The directory of a run: as asked for, or `runs/TASK-SEED`.
fn run_path(out: Option<&Path>, task: &Task, seed: u64) -> PathBuf {
    out.map_or_else(
        || PathBuf::from("runs").join(format!("{}-{seed}", task.name)),
        Path::to_path_buf,
    )
}

/// The command line that repeats a run, for its record: without the place where it was put.
fn command_line(verb: &str, task: &str, common: &Common) -> String {
    let mut words = vec!["stridemap".to_owned(), verb.into(), task.into()];
    words.push(format!("--seed {}", common.seed));
    if let Some(robot) = common.robot {
        words.push(format!(
            "--robot {}",
            stridemap_lab::RobotChoice::from(robot).name()
        ));
    }
    words.extend(common.sets.iter().map(|set| format!("--set {set}")));
    words.join(" ")
}

fn provenance(verb: &str, name: &str, task: &Task, common: &Common) -> Result<Provenance, Failure> {
    let command = command_line(verb, name, common);
    Ok(Provenance::begin(
        task,
        common.seed,
        crate::GIT_REVISION,
        command,
    )?)
}
