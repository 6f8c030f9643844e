//! The robot's end of the link: any machine, served over ROS 2 behind a guard of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use ros2_client::{Publisher, Subscription};
use stridemap_robot::Machine;

use crate::error::LinkError;
use crate::guard::{Act, CommandGuard, Refusals};
use crate::messages::{
    Clock, Float64MultiArray, Header, Imu, JointState, JointTrajectory, RosTime, Text, UInt64MultiArray, WrenchStamped,
    to_messages,
};
use crate::ros2::node::{LinkNode, NAP, Topics, drain, writer_of};
use crate::served::{Serve, ServerReport, Status};
use crate::trajectory::Trajectory;

struct Out {
    clock: Publisher<Clock>,
    joints: Publisher<JointState>,
    imu: Publisher<Imu>,
    feet: [Publisher<WrenchStamped>; 2],
    status: Publisher<Text>,
}

struct In {
    commands: Subscription<Float64MultiArray>,
    trajectory: Subscription<JointTrajectory>,
    heartbeat: Subscription<UInt64MultiArray>,
    stop: Subscription<Text>,
    rearm: Subscription<Text>,
    set_up: Subscription<Text>,
}

/// Tilt beyond which a simulated robot lies and is not simulated further until it is set up.
const LIES_COS: f64 = 0.2;
/// How long lock step waits for an answer before it goes on without, in real time.
const LOCK_STEP_WAIT: Duration = Duration::from_millis(500);
/// How long a slow robot may sleep before it looks whether it must end.
const LONGEST_NAP: Duration = Duration::from_millis(100);
/// Status messages per second of robot time.
const STATUS_HZ: f64 = 10.0;

/// Serves a machine until `stop` is set or its time is over. `posture` is how it stands at first.
///
/// `ready` is called once, when the robot stands and speaks.
///
/// # Errors
///
/// [`LinkError`] if the network cannot be joined or the machine fails.
pub fn serve<M: Machine>(
    machine: &mut M,
    posture: &[f64],
    config: &Serve,
    stop: &AtomicBool,
    ready: &mut dyn FnMut(),
) -> Result<ServerReport, LinkError> {
    let period_s = machine.description().control_period_s;
    let paced = config.period(period_s)?;
    let mut node = LinkNode::open(&config.link, &config.node)?;
    let link = &config.link;
    let out = Out {
        clock: node.publisher(&link.clock)?,
        joints: node.publisher(&link.joint_states)?,
        imu: node.publisher(&link.imu)?,
        feet: [node.publisher(&link.left_foot)?, node.publisher(&link.right_foot)?],
        status: node.publisher(Topics::STATUS)?,
    };
    let input = In {
        commands: node.subscription(&link.commands)?,
        trajectory: node.subscription(Topics::TRAJECTORY)?,
        heartbeat: node.subscription(Topics::HEARTBEAT)?,
        stop: node.subscription(Topics::STOP)?,
        rearm: node.subscription(Topics::REARM)?,
        set_up: node.subscription(Topics::SET_UP)?,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    machine.reset(posture, &mut rng)?;
    let mut server = Server {
        guard: CommandGuard::new(machine.description().limits.clone(), config.bounds),
        names: machine.description().joint_names.clone(),
        out,
        input,
        report: ServerReport::default(),
        set_ups: 0,
        period_s,
        told: ("", Refusals::default()),
        pending: 0,
        answers_ms: Vec::new(),
    };
    ready();

    let period_ns = (period_s * 1e9).round() as u64;
    let mut next = Instant::now();
    let mut act = Act::Hold(posture.to_vec());
    while !stop.load(Ordering::Relaxed) {
        let now_ns = server.report.periods * period_ns;
        let now_s = now_ns as f64 * 1e-9;
        if config.most_s.is_some_and(|most_s| now_s > most_s) {
            break;
        }
        server.tell(now_ns, machine, &act);
        match paced {
            Some(period) => {
                next += period;
                let now = Instant::now();
                if now > next + period / 2 {
                    // A late period is counted, and the clock does not hurry to catch up.
                    server.report.late += 1;
                    next = now;
                }
                server.listen_until(next, now_ns, now_s, stop);
            }
            None => server.listen_for_answer(now_ns, now_s),
        }
        if server.wants_set_up() {
            machine.reset(posture, &mut rng)?;
            server.guard.forget();
            server.set_ups += 1;
            act = Act::Hold(posture.to_vec());
            server.report.periods += 1;
            continue;
        }
        act = server.guard.act(now_s, period_s, &machine.frame().joints);
        let lies = machine.true_state().is_some_and(|s| s.base.tilt_rad().cos() < LIES_COS);
        if !lies {
            let command = match &act {
                Act::Follow(command) | Act::Hold(command) => command.clone(),
                Act::Damp => {
                    let joints = &machine.frame().joints;
                    joints.iter().map(|j| j.position_rad).collect()
                }
            };
            machine.step(&command)?;
        }
        server.report.periods += 1;
    }
    server.report.refusals = server.guard.refusals();
    let mut answers = std::mem::take(&mut server.answers_ms);
    answers.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * answers.len() as f64) as usize;
        answers.get(index.min(answers.len().saturating_sub(1))).copied().unwrap_or(0.0)
    };
    server.report.round_trip_p50_ms = at(0.5);
    server.report.round_trip_p99_ms = at(0.99);
    server.report.round_trip_max_ms = at(1.0);
    Ok(server.report)
}

struct Server {
    guard: CommandGuard,
    names: Vec<String>,
    out: Out,
    input: In,
    report: ServerReport,
    set_ups: u64,
    period_s: f64,
    /// Whether it follows, holds or gives way, and what the guard has refused, as last told.
    told: (&'static str, Refusals),
    /// States in a row that were not answered.
    pending: u64,
    /// Time from telling each state to having its answer.
    answers_ms: Vec<f64>,
}

impl Server {
    /// Publishes the newest reading.
    fn tell<M: Machine>(&mut self, now_ns: u64, machine: &M, act: &Act) {
        let stamp = RosTime::from_nanoseconds(now_ns);
        let header = Header { stamp, frame_id: "base".into() };
        let (joints, imu, feet) = to_messages(machine.frame(), &self.names, &header);
        // A reader that is slow or gone must not stop the robot: what cannot be sent is dropped.
        let _ = self.out.clock.publish(Clock { clock: stamp });
        let [left, right] = feet;
        let _ = self.out.feet[0].publish(left);
        let _ = self.out.feet[1].publish(right);
        let _ = self.out.imu.publish(imu);
        let _ = self.out.joints.publish(joints);
        let every = (1.0 / (STATUS_HZ * self.period_s)).round().max(1.0) as u64;
        let doing = match act {
            Act::Follow(_) => "follow",
            Act::Hold(_) => "hold",
            Act::Damp => "damp",
        };
        let (now, before) = ((doing, self.guard.refusals()), self.told);
        self.told = now;
        if now != before || self.report.periods.is_multiple_of(every) {
            let time_s = now_ns as f64 * 1e-9;
            let status = Status {
                time_s,
                set_ups: self.set_ups,
                stopped: self.guard.stopped().map(ToOwned::to_owned),
                commanded: self.guard.has_writer(time_s),
                act: doing.into(),
                silence_s: self.guard.silence_s(time_s),
                refusals: self.guard.refusals(),
            };
            if let Ok(data) = serde_json::to_string(&status) {
                let _ = self.out.status.publish(Text { data });
            }
        }
    }

    /// Takes in everything that has arrived.
    fn listen(&mut self, now_s: f64) {
        let unreadable = &mut self.report.unreadable;
        for (message, _) in drain(&self.input.stop, unreadable) {
            self.guard.stop(&message.data);
        }
        for _ in drain(&self.input.rearm, unreadable) {
            self.guard.rearm();
        }
        for (message, info) in drain(&self.input.heartbeat, unreadable) {
            // Heartbeats of one process come from another writer entity than its commands.
            if let [sequence, stamp_ns] = message.data[..] {
                let participant = writer_of(&info) >> 32;
                self.guard.heartbeat(participant, sequence, stamp_ns);
            }
        }
        for (message, info) in drain(&self.input.commands, unreadable) {
            let participant = writer_of(&info) >> 32;
            self.guard.command(now_s, participant, &message.data);
        }
        for (message, info) in drain(&self.input.trajectory, unreadable) {
            let participant = writer_of(&info) >> 32;
            let trajectory = to_trajectory(&message, &self.names, now_s);
            self.guard.trajectory(now_s, participant, trajectory);
        }
    }

    /// Paced: waits for the period's end. What arrives acts at that boundary.
    fn listen_until(&mut self, deadline: Instant, now_ns: u64, now_s: f64, stop: &AtomicBool) {
        let told = Instant::now();
        if self.guard.has_writer(now_s) {
            loop {
                self.listen(now_s);
                if self.is_answered(now_ns, told) {
                    break;
                }
                let left = deadline.saturating_duration_since(Instant::now());
                if left.is_zero() || stop.load(Ordering::Relaxed) {
                    self.pending += 1;
                    return;
                }
                std::thread::sleep(left.min(NAP));
            }
        }
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || stop.load(Ordering::Relaxed) {
                break;
            }
            std::thread::sleep(left.min(LONGEST_NAP));
        }
        self.listen(now_s);
    }

    /// Lock step: waits until the state of this period was answered. Without a controller, after one has kept
    /// it waiting, and while the robot is stopped, real time.
    fn listen_for_answer(&mut self, now_ns: u64, now_s: f64) {
        let told = Instant::now();
        loop {
            self.listen(now_s);
            let writer = self.guard.has_writer(now_s);
            let waits = writer && self.pending == 0 && self.guard.stopped().is_none();
            let patience = if waits { LOCK_STEP_WAIT } else { Duration::from_secs_f64(self.period_s) };
            let answered = self.is_answered(now_ns, told);
            let over = told.elapsed() >= patience;
            if answered || over {
                self.pending += u64::from(writer && !answered);
                return;
            }
            std::thread::sleep(NAP);
        }
    }

    /// Whether the state of this period was answered; takes note of how long it took.
    fn is_answered(&mut self, now_ns: u64, told: Instant) -> bool {
        /// Enough for the percentiles of hours.
        const MOST: usize = 1_000_000;
        let answered = self.guard.answered().is_some_and(|stamp| stamp >= now_ns);
        if answered {
            // What was not answered because the controller had gone for good is not counted.
            let pending = std::mem::take(&mut self.pending);
            self.report.commanded += 1 + pending;
            self.report.unanswered += pending;
        }
        if answered && self.answers_ms.len() < MOST {
            self.answers_ms.push(1e3 * told.elapsed().as_secs_f64());
        }
        answered
    }

    fn wants_set_up(&mut self) -> bool {
        !drain(&self.input.set_up, &mut self.report.unreadable).is_empty()
    }
}

/// A message as a trajectory of the machine's joints; a message that names a joint which the machine does not
/// have, or has not one angle per name, becomes one without points, which is refused.
fn to_trajectory(message: &JointTrajectory, names: &[String], now_s: f64) -> Trajectory {
    let known = message.joint_names.iter().all(|n| names.contains(n));
    let width = message.joint_names.len();
    let whole = message.points.iter().all(|p| p.positions.len() == width);
    let stamp_s = message.header.stamp.seconds();
    let points = message.points.iter().filter(|_| known && whole);
    Trajectory {
        // A stamp of 0 says: now.
        start_s: if stamp_s > 0.0 { stamp_s } else { now_s },
        points: points
            .map(|point| {
                let angle = |name| {
                    let at = message.joint_names.iter().position(|n| n == name);
                    at.and_then(|i| point.positions.get(i)).copied()
                };
                let positions = names.iter().map(angle).collect();
                (point.time_from_start.seconds(), positions)
            })
            .collect(),
    }
}
