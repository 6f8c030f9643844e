//! Robots behind ROS 2: `robot` simulates one, `stop` stops one, and every command that moves a robot
//! comes here for its plant.

use std::io::{BufRead, Write};
use std::sync::{Arc, Mutex};

use stridemap_lab::{Algorithm, Plant, Progress, RobotChoice, Task, builtin};
use stridemap_link::{GuardBounds, LinkError, Operator, RemoteMachine, Serve, send_stop, serve};
use stridemap_mujoco::{MujocoConfig, SimulatedMachine, estimator, joints_at_rest};
use stridemap_robot::{EstimatedRobot, Machine, Ros2Config};

use crate::args::{Common, Network};
use crate::failure::Failure;
use crate::output;
use crate::progress::stop_flag;

/// The task whose robot is simulated.
const TASK: &str = "small-stepping";

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Self {
        match error {
            LinkError::Config { .. } => Self::Request(error.into()),
            _ => Self::Working(error.into()),
        }
    }
}

fn link_of(network: &Network) -> Ros2Config {
    Ros2Config {
        domain: network.domain,
        interface: network.interface.clone(),
        ..Ros2Config::default()
    }
}

/// Simulates the small humanoid behind ROS 2 until it is stopped.
pub fn robot(
    ideal: bool,
    rate: f64,
    seed: u64,
    realtime_factor: f64,
    seconds: Option<f64>,
    network: &Network,
) -> Result<(), Failure> {
    if !(rate.is_finite() && (10.0..=1000.0).contains(&rate)) {
        return Err(Failure::request("--rate must be 10 to 1000"));
    }
    if !(realtime_factor.is_finite() && (0.0..=1000.0).contains(&realtime_factor)) {
        return Err(Failure::request("--realtime-factor must be 0 to 1000"));
    }
    let choice = if ideal {
        RobotChoice::Op3Ideal
    } else {
        RobotChoice::Op3
    };
    let task = builtin::load(TASK, &[])?.on(Some(choice), seed)?.task;
    let config = MujocoConfig {
        control_period_s: 1.0 / rate,
        ..task.robot
    };
    config.validate().map_err(stridemap_lab::LabError::from)?;
    let mut machine = SimulatedMachine::new(&config).map_err(stridemap_lab::LabError::from)?;
    let rest = joints_at_rest(&config).map_err(stridemap_lab::LabError::from)?;
    let posture: Vec<f64> = rest.iter().map(|(_, angle)| *angle).collect();
    let options = Serve {
        link: link_of(network),
        bounds: GuardBounds::default(),
        realtime_factor,
        seed,
        most_s: seconds,
        node: "op3".into(),
    };
    let stop = stop_flag();
    let report = serve(&mut machine, &posture, &options, &stop, &mut || {
        output::note(format!(
            "op3{} stands at {rate} Hz, domain {}, interface {}; Ctrl-C ends it, `stridemap stop` stops it",
            if ideal { " (ideal)" } else { "" },
            network.domain,
            network.interface
        ));
    })?;
    output::json(&report)
}

/// Presses or releases the emergency stop.
pub fn stop(rearm: bool, reason: &str, network: &Network) -> Result<(), Failure> {
    if send_stop(&link_of(network), reason, rearm)? {
        output::line(if rearm { "re-armed" } else { "stopped" });
        Ok(())
    } else {
        Err(Failure::working("no robot was found on this network"))
    }
}

/// What was asked, and what was answered.
pub type Answers = Arc<Mutex<Vec<(String, bool)>>>;

/// The person at the terminal.
struct Person {
    plan: String,
    yes: bool,
    answers: Answers,
}

impl Operator for Person {
    fn set_up(&mut self, why: &str) -> bool {
        // Between batches nothing has happened that a person must look at.
        if why == "a new start" {
            return true;
        }
        let answer = self.yes || {
            output::note(format!("{why}: {}", self.plan));
            let mut stderr = std::io::stderr();
            let _ = write!(
                stderr,
                "is the robot set up, upright and clear to move? [y/N] "
            );
            let _ = stderr.flush();
            let mut line = String::new();
            let read = std::io::stdin().lock().read_line(&mut line);
            read.is_ok() && matches!(line.trim(), "y" | "Y" | "yes")
        };
        if let Ok(mut answers) = self.answers.lock() {
            answers.push((why.to_owned(), answer));
        }
        answer
    }
}

/// What a task will do to a robot, in a sentence.
fn plan(task: &Task) -> String {
    let counts = &task.collect.strides;
    let training: usize = (0..task.algorithm.iterations)
        .map(|i| counts.get(i).or(counts.last()).copied().unwrap_or(0))
        .sum();
    let measured = 2 * (task.record.strides + task.record.discard)
        + task.algorithm.iterations * (task.record.iteration_strides + task.record.discard);
    let bounds: Vec<String> = task
        .action
        .iter()
        .map(|a| format!("{} in [{}, {}]", a.modulates, a.bounds[0], a.bounds[1]))
        .collect();
    format!(
        "{} will make about {training} strides to learn and {measured} to measure, with {}; joints turn at up \
         to {:.1} rad/s; at most {} falls are expected while learning",
        task.name,
        bounds.join(", "),
        task.robot.velocity_limit_rad_s,
        task.success.falls_at_most
    )
}

/// The plant of a task: simulated here, or behind its link.
pub fn plant(task: &Task, common: &Common, answers: &Answers) -> Result<Plant, Failure> {
    let Some(link) = &task.link else {
        return Ok(task.plant()?);
    };
    let lab = stridemap_lab::LabError::from;
    let ideal = MujocoConfig {
        hardware: None,
        ..task.robot.clone()
    };
    let model = SimulatedMachine::new(&ideal).map_err(lab)?;
    let operator = Person {
        plan: plan(task),
        yes: common.yes,
        answers: Arc::clone(answers),
    };
    let machine = RemoteMachine::open(
        link,
        model.joint_names().to_vec(),
        model.limits().to_vec(),
        task.robot.control_period_s,
        Box::new(operator),
    )?;
    let robot = EstimatedRobot::new(machine, estimator(&ideal).map_err(lab)?)
        .map_err(stridemap_lab::LabError::from)?;
    Ok(task.plant_on(Box::new(robot))?)
}

/// A run of a task on its robot.
pub fn algorithm<'a>(
    task: &'a Task,
    seed: u64,
    progress: Progress,
    common: &Common,
    answers: &Answers,
) -> Result<Algorithm<'a>, Failure> {
    Ok(Algorithm::on(
        task,
        seed,
        plant(task, common, answers)?,
        progress,
    ))
}

/// A task as if its robot were simulated here: for work that needs a plant's shape, not its robot.
pub fn here(task: &Task) -> Task {
    Task {
        link: None,
        ..task.clone()
    }
}
