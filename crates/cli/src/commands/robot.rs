//! Robots behind ROS 2: `robot` simulates one, `stop` stops one, and every command that moves a robot
//! comes here for its plant.

use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde::Serialize;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{
    Algorithm, Plant, Progress, RobotChoice, StrideObserver, StridePhase, StrideRole, Task,
    Transition, builtin,
};
use stridemap_link::{
    GuardBounds, Journal, LinkError, LoggedMachine, Operator, RemoteMachine, ReplayMachine, Serve,
    SharedJournal, fault_table, read_log, send_stop, serve,
};
use stridemap_mujoco::{MujocoConfig, SimulatedMachine, estimator, joints_at_rest};
use stridemap_returnmap::{StrideEnd, StrideProcess};
use stridemap_robot::{EstimatedRobot, JointLimits, Machine, Ros2Config};
use stridemap_section::Crossing;

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

/// Writes actions and sections into a robot's log.
struct LogStrides(SharedJournal);

impl StrideObserver for LogStrides {
    fn action(&mut self, action: &[f64]) {
        // A log that cannot be written is told by the machine that writes it as well.
        if let Ok(mut journal) = self.0.lock() {
            let _ = journal.action(action);
        }
    }

    fn section(&mut self, crossing: &Crossing) {
        let p = &crossing.pendulum;
        let numbers = [
            crossing.time_s,
            p.roll_rad.to_degrees(),
            p.pitch_rad.to_degrees(),
            p.stance.lateral_sign(),
        ];
        if let Ok(mut journal) = self.0.lock() {
            let _ = journal.section(&numbers);
        }
    }
}

/// The first name of a log in a run's directory that is not taken.
pub fn log_path(run: &Path) -> PathBuf {
    let named = |k: usize| match k {
        1 => run.join("log.mcap"),
        _ => run.join(format!("log-{k}.mcap")),
    };
    (1..10_000)
        .map(named)
        .find(|path| !path.exists())
        .unwrap_or_else(|| run.join("log.mcap"))
}

/// The plant of a task: simulated here, or behind its link. A robot behind a link writes a log if it is told
/// where; one simulated here only with `--log`.
pub fn plant(
    task: &Task,
    common: &Common,
    answers: &Answers,
    run: Option<&Path>,
) -> Result<Plant, Failure> {
    let lab = stridemap_lab::LabError::from;
    let logged = common.log || task.link.is_some();
    let path = run.filter(|_| logged).map(log_path);
    let machine: Box<dyn Machine> = match &task.link {
        None if path.is_none() || !task.robot.estimated => return Ok(task.plant()?),
        None => Box::new(SimulatedMachine::new(&task.robot).map_err(lab)?),
        Some(link) => {
            let (names, limits) = joints(task)?;
            let operator = Person {
                plan: plan(task),
                yes: common.yes,
                answers: Arc::clone(answers),
            };
            let period_s = task.robot.control_period_s;
            Box::new(RemoteMachine::open(
                link,
                names,
                limits,
                period_s,
                Box::new(operator),
            )?)
        }
    };
    let estimator = estimator(&here(task).robot).map_err(lab)?;
    let Some(path) = path else {
        let robot =
            EstimatedRobot::new(machine, estimator).map_err(stridemap_lab::LabError::from)?;
        return Ok(task.plant_on(Box::new(robot))?);
    };
    let link = task.link.clone().unwrap_or_default();
    let journal = Journal::create(&path, machine.joint_names(), &link)?;
    let machine = LoggedMachine::new(machine, Arc::clone(&journal));
    let robot = EstimatedRobot::new(machine, estimator).map_err(stridemap_lab::LabError::from)?;
    let mut plant = task.plant_on(Box::new(robot))?;
    plant.log(Some(Box::new(LogStrides(journal))));
    Ok(plant)
}

/// Names and limits of the joints that a task's joint map expects, in the robot's order and signs.
fn joints(task: &Task) -> Result<(Vec<String>, Vec<JointLimits>), Failure> {
    let ideal = MujocoConfig {
        hardware: None,
        ..task.robot.clone()
    };
    let model = SimulatedMachine::new(&ideal).map_err(stridemap_lab::LabError::from)?;
    Ok((model.joint_names().to_vec(), model.limits().to_vec()))
}

/// Strides from a log, with no robot at all.
pub fn strides_of_log(task: &Task, log: &Path) -> Result<Vec<Transition>, Failure> {
    let link = task.link.clone().unwrap_or_default();
    let episodes = read_log(log, &link)?;
    let starts = episodes.len();
    let (names, limits) = joints(task)?;
    let machine = ReplayMachine::new(episodes, names, limits, task.robot.control_period_s);
    let actions = machine.actions();
    let estimator = estimator(&here(task).robot).map_err(stridemap_lab::LabError::from)?;
    let robot = EstimatedRobot::new(machine, estimator).map_err(stridemap_lab::LabError::from)?;
    let mut plant = task.plant_on(Box::new(robot))?;
    let mut rng = stream(0, Role::Collect, 0);
    let mut transitions = Vec::new();
    for episode in 0..starts {
        // The log is over, or this start never came to a section: there is nothing more to learn from it.
        let Ok(mut state) = plant.reset(&mut rng) else {
            continue;
        };
        let mut k = 0;
        loop {
            let action = actions.lock().ok().and_then(|mut queue| queue.pop_front());
            let Some(action) = action else { break };
            let (stance, last_action) = (plant.stance(), plant.last_action().clone());
            let stride = plant
                .stride(&action, &mut rng)
                .map_err(stridemap_lab::LabError::from)?;
            if stride.end == StrideEnd::Aborted {
                break;
            }
            transitions.push(Transition {
                iteration: 1,
                phase: StridePhase::Collect,
                role: StrideRole::Training,
                episode,
                k,
                time_s: plant.robot().state().time_s,
                stance,
                state: state.clone(),
                last_action,
                action: stride.action,
                next_state: stride.next_state.clone(),
                reward: stride.reward,
                end: stride.end,
                measures: *plant.last_measures(),
                true_psi_roll_deg: None,
                true_forward_m: None,
            });
            if stride.end != StrideEnd::Crossing {
                break;
            }
            state = stride.next_state;
            k += 1;
        }
    }
    Ok(transitions)
}

/// A run of a task on its robot; `run` is its directory, where the log goes.
pub fn algorithm<'a>(
    task: &'a Task,
    seed: u64,
    progress: Progress,
    common: &Common,
    answers: &Answers,
    run: Option<&Path>,
) -> Result<Algorithm<'a>, Failure> {
    let plant = plant(task, common, answers, run)?;
    Ok(Algorithm::on(task, seed, plant, progress))
}

/// A task as if its robot were simulated here: for work that needs a plant's shape, not its robot.
pub fn here(task: &Task) -> Task {
    Task {
        link: None,
        ..task.clone()
    }
}

/// Tries every fault and prints the table.
pub fn faults(json: bool, domain: u16) -> Result<(), Failure> {
    let link = Ros2Config {
        domain,
        ..Ros2Config::default()
    };
    let rows = fault_table(&link)?;
    if json {
        output::json(&rows)?;
    } else {
        for row in &rows {
            let within = row.within_ms.map_or("-".into(), |ms| format!("{ms:.0} ms"));
            output::line(format!(
                "{} {:<28} {within:>8}  {}",
                if row.ok { "ok  " } else { "FAIL" },
                row.fault,
                row.seen
            ));
        }
    }
    if rows.iter().all(|row| row.ok) {
        Ok(())
    } else {
        Err(Failure::working(
            "the link did not meet every fault as it must",
        ))
    }
}

/// What the bench of the link shows.
#[derive(Serialize)]
struct LinkBench {
    seconds: f64,
    /// What the robot's process counted.
    robot: serde_json::Value,
    /// Share of one processor that each process used; null where the system does not tell.
    robot_cpu: Option<f64>,
    controller_cpu: Option<f64>,
    strides: usize,
}

/// Processor time of a process, seconds; `None` where the system does not tell.
fn cpu_s(process: &str) -> Option<f64> {
    /// Ticks of a second on every Linux.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let (user, system): (f64, f64) = (fields.get(11)?.parse().ok()?, fields.get(12)?.parse().ok()?);
    Some((user + system) / TICKS)
}

/// Times the link: the nominal gait on a robot in another process.
pub fn bench_link(seconds: f64, json: bool, domain: u16) -> Result<(), Failure> {
    let me = std::env::current_exe().map_err(|e| Failure::working(e.to_string()))?;
    let mut child = std::process::Command::new(me)
        .args(["robot", "op3", "--domain", &domain.to_string()])
        .args(["--seconds", &(seconds + 10.0).to_string()])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .map_err(|e| Failure::working(format!("cannot start the robot: {e}")))?;
    let sets = [format!("link.domain={domain}")];
    let mut task = builtin::load(TASK, &[])?
        .on(Some(RobotChoice::Ros2), 1)?
        .task;
    if let Some(link) = &mut task.link {
        link.domain = domain;
    }
    let common = Common {
        seed: 1,
        sets: sets.to_vec(),
        robot: None,
        yes: true,
        log: false,
        json,
        threads: None,
    };
    let mut plant = plant(&task, &common, &Answers::default(), None)?;
    let mut rng = stream(1, Role::Run, 0);
    plant
        .reset(&mut rng)
        .map_err(stridemap_lab::LabError::from)?;
    let started = std::time::Instant::now();
    let (child_id, before) = (child.id().to_string(), cpu_s("self"));
    let child_before = cpu_s(&child_id);
    let neutral: Vec<f64> = task.action_limits()?.iter().map(|l| l.neutral).collect();
    let mut strides = 0;
    while started.elapsed().as_secs_f64() < seconds {
        let stride = plant
            .stride(&neutral, &mut rng)
            .map_err(stridemap_lab::LabError::from)?;
        if stride.end != StrideEnd::Crossing {
            break;
        }
        strides += 1;
    }
    let elapsed = started.elapsed().as_secs_f64();
    let share = |before: Option<f64>, after: Option<f64>| Some((after? - before?) / elapsed);
    let robot_cpu = share(child_before, cpu_s(&child_id));
    let controller_cpu = share(before, cpu_s("self"));
    let mut told = String::new();
    if let Some(mut stdout) = child.stdout.take() {
        let _ = std::io::Read::read_to_string(&mut stdout, &mut told);
    }
    let _ = child.wait();
    let shown = LinkBench {
        seconds: elapsed,
        robot: serde_json::from_str(&told)?,
        robot_cpu,
        controller_cpu,
        strides,
    };
    if json {
        return output::json(&shown);
    }
    let percent = |v: Option<f64>| v.map_or("?".into(), |v| format!("{:.1} %", 100.0 * v));
    let r = &shown.robot;
    output::line(format!(
        "125 Hz for {elapsed:.0} s, {strides} strides: round trip p50 {} / p99 {} / max {} ms; {} of {} states \
         not answered in time; processor: robot {}, controller {}",
        r["round_trip_p50_ms"],
        r["round_trip_p99_ms"],
        r["round_trip_max_ms"],
        r["unanswered"],
        r["commanded"],
        percent(robot_cpu),
        percent(controller_cpu)
    ));
    Ok(())
}
