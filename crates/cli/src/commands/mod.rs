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
pub mod process;
pub mod report;
pub mod reproduce;
pub mod robot;
pub mod task;
pub mod verbs;

use std::path::{Path, PathBuf};

use stridemap_lab::builtin::LoadedTask;
use stridemap_lab::{LabError, Provenance, Task, config};

use crate::args::Common;
use crate::failure::Failure;

/// The directory of a run: as asked for, or `runs/TASK-SEED`.
fn run_path(out: Option<&Path>, task: &Task, seed: u64) -> PathBuf {
    out.map_or_else(
        || PathBuf::from("runs").join(format!("{}-{seed}", task.name)),
        Path::to_path_buf,
    )
}

/// A task on the robot, and in the network, that the command line names.
pub fn on_robot(loaded: LoadedTask, common: &Common) -> Result<LoadedTask, Failure> {
    let mut loaded = loaded.on(common.robot.map(Into::into), common.seed)?;
    in_network(&mut loaded.task, common)?;
    loaded.resolved = config::to_toml(&loaded.task).map_err(|e| LabError::Config(Box::new(e)))?;
    Ok(loaded)
}

/// Puts a task's robot into the network that the command line names, and refuses one that this machine cannot
/// join.
pub fn in_network(task: &mut Task, common: &Common) -> Result<(), Failure> {
    match &mut task.link {
        Some(link) => {
            link.domain = common.domain.unwrap_or(link.domain);
            if let Some(interface) = &common.interface {
                link.interface.clone_from(interface);
            }
            Ok(stridemap_link::check_network(link)?)
        }
        None if common.domain.is_some() || common.interface.is_some() => Err(Failure::request(
            "--domain and --interface are for a robot behind ROS 2: add --robot ros2",
        )),
        None => Ok(()),
    }
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
