//! Robots behind ROS 2: `robot` simulates one, `stop` stops one, `bench-link` times one.

use nix::sys::signal::Signal;
use serde::Serialize;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{LabError, RobotChoice, builtin};
use stridemap_link::{GuardBounds, LinkError, Serve, check_network, send_stop, serve};
use stridemap_mujoco::{MujocoConfig, SimulatedMachine};
use stridemap_process::{Action, Next, Situation, StrideEnd, walk};
use stridemap_robot::{Robot, Ros2Config};

use super::beside::Purpose;
use super::linked::plant;
use super::process::Process;

use crate::args::{Common, Network};
use crate::failure::Failure;
use crate::output;
use crate::stop::stop_flag;

/// The task whose robot is simulated.
const TASK: &str = "small-stepping";

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Self {
        match error {
            LinkError::Config { .. } => Self::Request(error.into()),
            LinkError::NotBuilt => {
                let words: Vec<String> = std::env::args().skip(1).collect();
                Self::request(format!("{error}; with it: cargo run --release --features ros2 -- {}", words.join(" ")))
            }
            _ => Self::Working(error.into()),
        }
    }
}

fn link_of(network: &Network) -> Ros2Config {
    Ros2Config { domain: network.domain, interface: network.interface.clone(), ..Ros2Config::default() }
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
    let choice = if ideal { RobotChoice::Op3Ideal } else { RobotChoice::Op3 };
    let task = builtin::load(TASK, &[])?.on(Some(choice), seed)?.task;
    let config = MujocoConfig { control_period_s: 1.0 / rate, ..task.robot };
    config.validate().map_err(stridemap_lab::LabError::from)?;
    let mut machine = SimulatedMachine::new(&config).map_err(stridemap_lab::LabError::from)?;
    let joints = &machine.robot().description().joints;
    let posture: Vec<f64> = joints.iter().map(|joint| joint.rest_rad).collect();
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
        Err(Failure::working(format!(
            "no robot on domain {} said that it {}",
            network.domain,
            if rearm { "is re-armed" } else { "stopped" }
        )))
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
    check_network(&Ros2Config { domain, ..Ros2Config::default() })?;
    let network = domain.to_string();
    let mut child = Process::start(&["robot", "op3", "--domain", &network])?;
    let mut task = builtin::load(TASK, &[])?.on(Some(RobotChoice::Ros2), 1)?.task;
    if let Some(link) = &mut task.link {
        link.domain = domain;
    }
    let common = Common {
        seed: 1,
        sets: Vec::new(),
        robot: None,
        domain: None,
        interface: None,
        yes: true,
        log: false,
        json,
        threads: None,
    };
    let mut plant = plant(&task, &common, &Purpose::Collect, None)?;
    let mut rng = stream(1, Role::Run, 0);
    let child_id = child.id().to_string();
    let neutral: Action = task.action_limits()?.iter().map(|l| l.neutral).collect();
    let (mut strides, mut broken) = (0, None);
    // The start-up is over when the first action is asked for.
    let begun = std::cell::OnceCell::new();
    let begin = || (std::time::Instant::now(), cpu_s("self"), cpu_s(&child_id));
    let elapsed_s = || begun.get_or_init(begin).0.elapsed().as_secs_f64();
    let act = |_: &Situation| {
        elapsed_s();
        neutral.clone()
    };
    walk(&mut plant, usize::MAX, &mut rng, act, |_, made| {
        let elapsed_s = elapsed_s();
        if made.stride.end != StrideEnd::Crossing {
            broken = Some(Failure::working(format!(
                "stride {} ended as {:?}: the bench lasted {elapsed_s:.1} of {seconds} s",
                strides + 1,
                made.stride.end,
            )));
            return Next::Stop;
        }
        strides += 1;
        if elapsed_s < seconds { Next::Go } else { Next::Stop }
    })
    .map_err(LabError::from)?;
    let (started, before, child_before) = *begun.get_or_init(begin);
    let elapsed = started.elapsed().as_secs_f64();
    let share = |before: Option<f64>, after: Option<f64>| Some((after? - before?) / elapsed);
    let robot_cpu = share(child_before, cpu_s(&child_id));
    let controller_cpu = share(before, cpu_s("self"));
    // It prints its report and ends.
    child.signal(Signal::SIGTERM)?;
    let mut report = String::new();
    if let Some(mut stdout) = child.stdout() {
        let _ = std::io::Read::read_to_string(&mut stdout, &mut report);
    }
    let shown =
        LinkBench { seconds: elapsed, robot: serde_json::from_str(&report)?, robot_cpu, controller_cpu, strides };
    if json {
        output::json(&shown)?;
        return broken.map_or(Ok(()), Err);
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
    broken.map_or(Ok(()), Err)
}
