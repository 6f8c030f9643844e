//! The plant of a task whose robot is behind ROS 2, logged.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use stridemap_lab::{Algorithm, Plant, Progress, Task};
use stridemap_link::{Journal, LoggedMachine, RemoteMachine};
use stridemap_mujoco::{MujocoConfig, SimulatedMachine, estimator};
use stridemap_record::files;
use stridemap_robot::{EstimatedRobot, JointLimits, Machine};

use super::beside::{LastFall, Person, Purpose, Watcher, plan};
use crate::args::Common;
use crate::failure::Failure;
use crate::stop::robot_stop_flag;

/// The first name of a log in a run's directory that is not taken.
pub fn log_path(run: &Path) -> PathBuf {
    let named = |k: usize| match k {
        1 => run.join("log.mcap"),
        _ => run.join(format!("log-{k}.mcap")),
    };
    (1..10_000).map(named).find(|path| !path.exists()).unwrap_or_else(|| run.join("log.mcap"))
}

/// The plant of a task: simulated here, or behind its link. A robot behind a link writes a log if it is told
/// where; one simulated here only with `--log`.
pub fn plant(task: &Task, common: &Common, purpose: &Purpose, run: Option<&Path>) -> Result<Plant, Failure> {
    let lab = |error| task.located(error);
    let logged = common.log || task.link.is_some();
    let path = run.filter(|_| logged).map(log_path);
    let last_fall = LastFall::default();
    let machine: Box<dyn Machine> = match &task.link {
        None if path.is_none() || !task.robot.estimated => return Ok(task.plant()?),
        None => Box::new(SimulatedMachine::new(&task.robot).map_err(lab)?),
        Some(link) => {
            let (names, limits) = joints(task)?;
            let stop = robot_stop_flag(link);
            let (text, halt) = (plan(task, purpose), Arc::clone(&stop));
            let operator = Person::new(text, common.yes, run, &last_fall, stop);
            let period_s = task.robot.control_period_s;
            let operator = Box::new(operator);
            let mut machine = RemoteMachine::open(link, names, limits, period_s, operator)?;
            machine.halt_on(halt);
            Box::new(machine)
        }
    };
    let estimator = estimator(&here(task).robot).map_err(lab)?;
    let Some(path) = path else {
        let robot = EstimatedRobot::new(machine, estimator).map_err(stridemap_lab::LabError::from)?;
        let mut plant = task.plant_on(Box::new(robot))?;
        plant.log(Some(Box::new(Watcher { journal: None, last_fall, run: None, in_stride: false })));
        return Ok(plant);
    };
    let link = task.link.clone().unwrap_or_default();
    let journal = Journal::create(&path, &machine.description().joint_names, &link)?;
    let machine = LoggedMachine::new(machine, Arc::clone(&journal));
    let robot = EstimatedRobot::new(machine, estimator).map_err(stridemap_lab::LabError::from)?;
    let mut plant = task.plant_on(Box::new(robot))?;
    plant.log(Some(Box::new(Watcher {
        journal: Some(journal),
        last_fall,
        run: run
            .filter(|_| task.link.is_some() && matches!(purpose, Purpose::Learn | Purpose::Collect))
            .map(Path::to_path_buf),
        in_stride: false,
    })));
    Ok(plant)
}

/// Where a command that has no run of its own keeps log and answers of a robot behind a link: the run whose policy
/// it applies, or a directory of the task's nominal gait.
pub fn beside_run(task: &Task, run: Option<&Path>) -> Result<Option<PathBuf>, Failure> {
    if task.link.is_none() {
        return Ok(None);
    }
    let path = run.map_or_else(|| Path::new("runs").join(format!("{}-nominal", task.name)), Path::to_path_buf);
    files::create_dir(&path)?;
    Ok(Some(path))
}

/// Names and limits of the joints that a task's joint map expects, in the robot's order and signs.
pub fn joints(task: &Task) -> Result<(Vec<String>, Vec<JointLimits>), Failure> {
    let ideal = MujocoConfig { hardware: None, ..task.robot.clone() };
    let model = SimulatedMachine::new(&ideal).map_err(|error| task.located(error))?;
    let own = model.description();
    Ok((own.joint_names.clone(), own.limits.clone()))
}

/// A run of a task on its robot; `run` is its directory, where the log goes.
pub fn algorithm<'a>(
    task: &'a Task,
    seed: u64,
    progress: Progress,
    common: &Common,
    purpose: &Purpose,
    run: Option<&Path>,
) -> Result<Algorithm<'a>, Failure> {
    let plant = plant(task, common, purpose, run)?;
    Ok(Algorithm::on(task, seed, plant, progress))
}

/// A task as if its robot were simulated here: for work that needs a plant's shape, not its robot.
pub fn here(task: &Task) -> Task {
    Task { link: None, ..task.clone() }
}
