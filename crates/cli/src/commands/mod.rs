//! One module per group of commands.

pub mod analyse;
pub mod apply;
pub mod atlas;
pub mod bench;
pub mod bench_drift;
pub mod bench_learners;
pub mod bench_stability;
pub mod beside;
pub mod bring_up;
pub mod compare;
pub mod drift;
pub mod fetch;
pub mod from_log;
pub mod goals;
pub mod learn;
pub mod learners;
pub mod linked;
pub mod list;
pub mod picture;
pub mod preflight;
pub mod process;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod robot;
pub mod robots;
pub mod sweep;
pub mod task;
pub mod velocity;
pub mod verbs;
pub mod verdict;

use std::path::Path;

use stridemap_lab::builtin::{self, LoadedTask};
use stridemap_lab::run::FinishedRun;
use stridemap_lab::verbs::Request;
use stridemap_lab::{RobotChoice, Task, task_differences};

use clap::ValueEnum;

use crate::args::{Common, RobotName};
use crate::failure::Failure;
use crate::output;
use stridemap_record::Provenance;

/// A task on the robot, and in the network, that the command line names.
pub fn on_robot(loaded: LoadedTask, common: &Common) -> Result<LoadedTask, Failure> {
    let mut loaded = loaded.on(common.robot.map(Into::into), common.seed)?;
    in_network(&mut loaded.task, common)?;
    tell(&mut loaded)?;
    loaded.resolved = loaded.task.to_toml()?;
    Ok(loaded)
}

/// Asks the robot for what the file leaves to it, and says what it told.
pub fn tell(loaded: &mut LoadedTask) -> Result<(), Failure> {
    if loaded.task.tell()? {
        loaded.task.told.iter().for_each(output::note);
    }
    Ok(())
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
        None if common.domain.is_some() || common.interface.is_some() => {
            Err(Failure::request("--domain and --interface are for a robot behind ROS 2: add --robot ros2"))
        }
        None => Ok(()),
    }
}

/// Tells a person that a run was made by another robot, program or task than what is about to use it. Only for what
/// does not go on with the run: that is refused.
fn say_differences(path: &Path) {
    // As it stands, without overrides: those are asked for. What cannot be built is told where it is used.
    let found = FinishedRun::open(path, &[]).and_then(|run| run.differences());
    for difference in found.unwrap_or_default() {
        output::note(format!("{}: {difference}: what follows is not what this run was made of", path.display()));
    }
}

fn provenance(verb: &str, name: &str, loaded: &LoadedTask, common: &Common) -> Result<Provenance, Failure> {
    let robot = common.robot.map(RobotChoice::from);
    let (sets, seed, revision) = (common.sets.as_slice(), common.seed, crate::GIT_REVISION);
    Ok(Request { name, sets, robot, seed, revision }.provenance(verb, loaded)?)
}

/// Says in which keys the task file of a run was edited since the run began. The run goes on with its own task.
fn say_edited(run: &FinishedRun) {
    let Some(asked) = &run.provenance.asked else {
        return;
    };
    let robot = asked.robot.as_ref().and_then(|name| RobotName::from_str(name, false).ok());
    let edited = builtin::load_file(&asked.file, &asked.sets)
        .and_then(|loaded| loaded.on(robot.map(Into::into), run.provenance.seed))
        .and_then(|mut loaded| {
            // From the command line as well.
            loaded.task.learner.kind = run.task.learner.kind;
            task_differences(&run.task, &loaded.task)
        });
    // A file that is gone or broken says nothing about the run.
    for difference in edited.unwrap_or_default() {
        output::note(format!(
            "{} was edited since this run began ({difference}); the run goes on with its own task",
            asked.file.display()
        ));
    }
}
