//! The fault table: every fault, tried on a running link, and what was seen.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use ros2_client::{Publisher, Subscription};
use serde::Serialize;
use stridemap_robot::{
    JointLimits, JointState as JointReading, Machine, RobotError, Ros2Config, SensorFrame,
    check_command,
};

use crate::error::LinkError;
use crate::guard::GuardBounds;
use crate::messages::{
    Float64MultiArray, Header, Imu, JointState, RosTime, Text, UInt64MultiArray, WrenchStamped,
};
use crate::node::{LinkNode, Topics, drain};
use crate::remote::{RemoteMachine, Yes};
use crate::server::{Serve, ServerReport, Status, send_stop, serve, to_messages};

const PERIOD_S: f64 = 0.008;
const JOINTS: usize = 4;

/// One row of the fault table.
#[derive(Clone, Debug, Serialize)]
pub struct FaultRow {
    /// What was done to the link.
    pub fault: String,
    /// What was seen of the robot and of the controller.
    pub seen: String,
    /// Within how many milliseconds of robot time the robot was safe; `None` where it needed not react.
    pub within_ms: Option<f64>,
    /// Whether no stride with the fault in it could become data: it was aborted, or the fault did not
    /// reach the robot's motion.
    pub no_bad_stride: bool,
    /// Whether everything was as it must be.
    pub ok: bool,
}

/// A machine of four perfect servos that stands: what the faults are tried on.
struct StandIn {
    names: Vec<String>,
    limits: Vec<JointLimits>,
    frame: SensorFrame,
    periods: u64,
}

fn names() -> Vec<String> {
    (0..JOINTS).map(|i| format!("joint_{i}")).collect()
}

fn limits() -> Vec<JointLimits> {
    let one = JointLimits {
        lower_rad: -1.0,
        upper_rad: 1.0,
        velocity_rad_s: 5.0,
        torque_nm: 1.0,
    };
    vec![one; JOINTS]
}

fn standing() -> SensorFrame {
    SensorFrame {
        joints: vec![JointReading::default(); JOINTS],
        orientation: [1.0, 0.0, 0.0, 0.0],
        loads_n: [15.0, 15.0],
        ..SensorFrame::default()
    }
}

impl StandIn {
    fn new() -> Self {
        Self {
            names: names(),
            limits: limits(),
            frame: standing(),
            periods: 0,
        }
    }
}

impl Machine for StandIn {
    fn name(&self) -> &str {
        "stand-in"
    }

    fn joint_names(&self) -> &[String] {
        &self.names
    }

    fn control_period_s(&self) -> f64 {
        PERIOD_S
    }

    fn limits(&self) -> &[JointLimits] {
        &self.limits
    }

    fn reset(
        &mut self,
        command_rad: &[f64],
        _rng: &mut ChaCha8Rng,
    ) -> Result<&SensorFrame, RobotError> {
        self.periods = 0;
        self.frame = standing();
        self.step(command_rad)
    }

    fn frame(&self) -> &SensorFrame {
        &self.frame
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.names)?;
        self.periods += 1;
        self.frame.time_s = self.periods as f64 * PERIOD_S;
        for (joint, want) in self.frame.joints.iter_mut().zip(command_rad) {
            joint.position_rad = *want;
        }
        Ok(&self.frame)
    }
}

/// A served stand-in, and an ear for what it says.
struct Rig {
    link: Ros2Config,
    stop: Arc<AtomicBool>,
    server: Option<JoinHandle<Result<ServerReport, LinkError>>>,
    node: LinkNode,
    ear: Subscription<Text>,
    heard: Vec<Status>,
}

impl Rig {
    fn start(link: &Ros2Config) -> Result<Self, LinkError> {
        let link = Ros2Config {
            silence_s: 0.5,
            ..link.clone()
        };
        let stop = Arc::new(AtomicBool::new(false));
        let mut node = LinkNode::open(&link, "fault_ear")?;
        let ear = node.subscription(Topics::STATUS)?;
        let config = Serve {
            link: link.clone(),
            bounds: GuardBounds::default(),
            realtime_factor: 1.0,
            seed: 1,
            most_s: Some(60.0),
            node: "stand_in".into(),
        };
        let flag = Arc::clone(&stop);
        let server = std::thread::spawn(move || {
            serve(
                &mut StandIn::new(),
                &[0.0; JOINTS],
                &config,
                &flag,
                &mut || {},
            )
        });
        let mut rig = Self {
            link,
            stop,
            server: Some(server),
            node,
            ear,
            heard: Vec::new(),
        };
        rig.until(10.0, |heard| !heard.is_empty());
        Ok(rig)
    }

    fn listen(&mut self) {
        let heard = drain(&self.ear, &mut 0);
        let read = heard
            .iter()
            .filter_map(|(text, _)| serde_json::from_str(&text.data).ok());
        self.heard.extend(read);
    }

    /// Listens until something was heard, or for this many seconds.
    fn until(&mut self, seconds: f64, done: impl Fn(&[Status]) -> bool) -> bool {
        let deadline = Instant::now() + Duration::from_secs_f64(seconds);
        loop {
            self.listen();
            if done(&self.heard) {
                return true;
            }
            if Instant::now() > deadline {
                return false;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Silence, in robot time, after which the robot was first heard to do this.
    fn silence_at(&self, act: &str) -> Option<f64> {
        let first = self
            .heard
            .iter()
            .find(|s| s.act == act && s.silence_s.is_some());
        first.and_then(|s| s.silence_s)
    }

    fn last(&self) -> Status {
        self.heard.last().cloned().unwrap_or_default()
    }

    fn controller(&self) -> Result<RemoteMachine, LinkError> {
        let mut machine =
            RemoteMachine::open(&self.link, names(), limits(), PERIOD_S, Box::new(Yes))?;
        machine.reset(&[0.0; JOINTS], &mut ChaCha8Rng::seed_from_u64(0))?;
        Ok(machine)
    }

    fn raw(&mut self) -> Result<Raw, LinkError> {
        let raw = Raw {
            commands: self.node.publisher(&self.link.commands)?,
            heartbeat: self.node.publisher(Topics::HEARTBEAT)?,
            states: self.node.subscription(&self.link.joint_states)?,
        };
        let deadline = Instant::now() + Duration::from_secs(10);
        while raw.commands.get_subscription_count(self.node.node()) == 0
            || raw.heartbeat.get_subscription_count(self.node.node()) == 0
        {
            if Instant::now() > deadline {
                return Err(LinkError::Network("the stand-in was not found".into()));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(raw)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(server) = self.server.take() {
            let _ = server.join();
        }
    }
}

/// A controller that may say anything.
struct Raw {
    commands: Publisher<Float64MultiArray>,
    heartbeat: Publisher<UInt64MultiArray>,
    states: Subscription<JointState>,
}

impl Raw {
    fn command(&self, data: Vec<f64>) {
        let _ = self.commands.publish(Float64MultiArray {
            data,
            ..Float64MultiArray::default()
        });
    }

    fn beat(&self, sequence: u64, stamp_ns: u64) {
        let _ = self.heartbeat.publish(UInt64MultiArray {
            data: vec![sequence, stamp_ns],
            ..UInt64MultiArray::default()
        });
    }

    /// Waits for the next state; its stamp.
    fn stamp(&self) -> u64 {
        let deadline = Instant::now() + Duration::from_millis(500);
        while Instant::now() < deadline {
            if let Some((state, _)) = drain(&self.states, &mut 0).pop() {
                return state.header.stamp.nanoseconds();
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        0
    }
}

/// Steps for some periods, swaying every joint.
fn walk(machine: &mut RemoteMachine, periods: usize) -> Result<(), RobotError> {
    for _ in 0..periods {
        let angle = 0.2 * (6.0 * machine.frame().time_s).sin();
        machine.step(&[angle; JOINTS])?;
    }
    Ok(())
}

fn row(
    fault: impl Into<String>,
    seen: impl Into<String>,
    within_s: Option<f64>,
    no_bad_stride: bool,
    ok: bool,
) -> FaultRow {
    FaultRow {
        fault: fault.into(),
        seen: seen.into(),
        within_ms: within_s.map(|s| 1e3 * s),
        no_bad_stride,
        ok: ok && no_bad_stride,
    }
}

/// Robot time within which the robot must hold: the bound, two periods, and what a loaded machine adds.
const HOLD_WITHIN_S: f64 = 0.05 + 2.0 * PERIOD_S + 0.05;

fn controller_gone(link: &Ros2Config, how: &str) -> Result<FaultRow, LinkError> {
    let mut rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    rig.heard.clear();
    // Nothing is said any more, no goodbye either: what a killed process leaves.
    std::mem::forget(controller);
    rig.until(3.0, |heard| heard.iter().any(|s| s.act == "damp"));
    let (hold, damp) = (rig.silence_at("hold"), rig.silence_at("damp"));
    let seen = format!(
        "robot holds after {:.0} ms, gives way after {:.0} ms",
        1e3 * hold.unwrap_or(f64::NAN),
        1e3 * damp.unwrap_or(f64::NAN)
    );
    let ok = hold.is_some_and(|s| s < HOLD_WITHIN_S) && damp.is_some();
    Ok(row(how, seen, hold, true, ok))
}

fn silence(link: &Ros2Config, fault: &str, pause_s: f64) -> Result<FaultRow, LinkError> {
    let mut rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    rig.heard.clear();
    std::thread::sleep(Duration::from_secs_f64(pause_s));
    let after = walk(&mut controller, 10);
    // Less than the bound: the silence after the walk is none of this row's.
    rig.until(0.02, |_| false);
    let (hold, damp) = (rig.silence_at("hold"), rig.silence_at("damp"));
    let aborted = matches!(after, Err(RobotError::Link { .. }));
    let seen = format!(
        "robot {}{}; stride {}",
        hold.map_or("follows on".into(), |s| format!(
            "holds after {:.0} ms",
            1e3 * s
        )),
        damp.map_or(String::new(), |s| format!(
            ", gives way after {:.0} ms",
            1e3 * s
        )),
        if aborted { "aborted" } else { "goes on" }
    );
    let long = pause_s > 0.055;
    let ok = if long {
        hold.is_some_and(|s| s < HOLD_WITHIN_S) && (pause_s < 0.55 || damp.is_some())
    } else {
        damp.is_none()
    };
    // Where the robot held, what followed must not be data.
    Ok(row(fault, seen, hold, hold.is_none() || aborted, ok))
}

fn robot_killed(link: &Ros2Config) -> Result<FaultRow, LinkError> {
    let rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    drop(rig);
    let start = Instant::now();
    let after = walk(&mut controller, 1000);
    let took_s = start.elapsed().as_secs_f64();
    let aborted = matches!(after, Err(RobotError::Link { .. }));
    let seen = format!(
        "controller gives up after {:.0} ms; stride aborted",
        1e3 * took_s
    );
    Ok(row(
        "robot killed",
        seen,
        Some(took_s),
        aborted,
        took_s < 1.5,
    ))
}

fn messages(link: &Ros2Config) -> Result<Vec<FaultRow>, LinkError> {
    let mut rig = Rig::start(link)?;
    let raw = rig.raw()?;
    let mut rows = Vec::new();
    let mut sequence = 0;
    let mut good = |raw: &Raw, data: Vec<f64>| {
        sequence += 1;
        raw.beat(sequence, raw.stamp());
        raw.command(data);
    };
    let quiet = vec![0.0; JOINTS];
    for _ in 0..20 {
        good(&raw, quiet.clone());
    }
    type Count = fn(&Status) -> u64;
    let mut refused = |rig: &mut Rig, fault: &str, count: Count, bad: &mut dyn FnMut()| {
        rig.until(0.25, |_| false);
        let before = count(&rig.last());
        bad();
        rig.until(2.0, |heard| heard.last().is_some_and(|s| count(s) > before));
        let refused = count(&rig.last()) - before;
        let seen = format!("robot refuses {refused}, its servos do not see them");
        rows.push(row(fault, seen, None, true, refused > 0));
    };
    refused(
        &mut rig,
        "NaN, infinite",
        |s| s.refusals.not_finite,
        &mut || {
            raw.command(vec![f64::NAN; JOINTS]);
            raw.command(vec![f64::INFINITY; JOINTS]);
        },
    );
    refused(
        &mut rig,
        "wrong length",
        |s| s.refusals.wrong_length,
        &mut || {
            raw.command(vec![0.0; JOINTS - 1]);
        },
    );
    refused(
        &mut rig,
        "duplicated, reordered",
        |s| s.refusals.out_of_order,
        &mut || {
            raw.beat(3, 1);
            raw.beat(2, 1);
        },
    );
    refused(
        &mut rig,
        "delayed by 200 ms",
        |s| s.refusals.stale,
        &mut || {
            raw.beat(1_000, raw.stamp());
            std::thread::sleep(Duration::from_millis(200));
            raw.command(quiet.clone());
        },
    );
    refused(
        &mut rig,
        "limits exceeded",
        |s| s.refusals.position_clamped,
        &mut || {
            raw.beat(2_000, raw.stamp());
            raw.command(vec![3.0; JOINTS]);
        },
    );
    Ok(rows)
}

fn lost(link: &Ros2Config) -> Result<FaultRow, LinkError> {
    let mut rig = Rig::start(link)?;
    let raw = rig.raw()?;
    rig.heard.clear();
    for k in 0..200_u64 {
        let stamp = raw.stamp();
        // Every 20th command is lost.
        if k % 20 != 7 {
            raw.beat(k + 1, stamp);
            raw.command(vec![0.1 * (0.05 * k as f64).sin(); JOINTS]);
        }
    }
    rig.listen();
    let damped = rig.heard.iter().any(|s| s.act == "damp");
    Ok(row(
        "5 % of the commands lost",
        "robot follows the command before; the stride goes on",
        None,
        true,
        !damped,
    ))
}

fn second_writer(link: &Ros2Config) -> Result<FaultRow, LinkError> {
    let mut rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    let raw = rig.raw()?;
    walk(&mut controller, 50)?;
    let start_s = controller.frame().time_s;
    let mut after = Ok(());
    for _ in 0..200 {
        raw.command(vec![0.9; JOINTS]);
        after = walk(&mut controller, 1);
        if after.is_err() {
            break;
        }
    }
    let took_s = controller.frame().time_s - start_s;
    rig.until(0.3, |_| false);
    let refused = rig.last().refusals.second_writer;
    let moved = controller
        .frame()
        .joints
        .iter()
        .any(|j| j.position_rad > 0.5);
    let aborted = after.is_err();
    let seen = format!(
        "robot refuses {refused} of the second's; stride aborted after {:.0} ms",
        1e3 * took_s
    );
    Ok(row(
        "second writer",
        seen,
        Some(took_s),
        aborted && !moved,
        refused > 0,
    ))
}

fn emergency_stop(link: &Ros2Config) -> Result<FaultRow, LinkError> {
    let mut rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    rig.heard.clear();
    let heard = rig.link.clone();
    let button = std::thread::spawn(move || send_stop(&heard, "fault table", false));
    let after = walk(&mut controller, 2000);
    let stopped = matches!(after, Err(RobotError::EmergencyStop { .. }));
    let _ = button.join();
    rig.until(0.3, |_| false);
    let damped = rig.last().act == "damp";
    let again = controller.reset(&[0.0; JOINTS], &mut ChaCha8Rng::seed_from_u64(0));
    let latched = matches!(again, Err(RobotError::EmergencyStop { .. }));
    let _ = send_stop(&rig.link, "", true)?;
    rig.until(1.0, |heard| {
        heard.last().is_some_and(|s| s.stopped.is_none())
    });
    let rearmed = controller
        .reset(&[0.0; JOINTS], &mut ChaCha8Rng::seed_from_u64(0))
        .is_ok();
    let seen = format!(
        "robot gives way in the same period, {}; moves again {} re-armed; stride aborted",
        if latched {
            "refuses to start"
        } else {
            "STARTS"
        },
        if rearmed { "once" } else { "NOT even when" }
    );
    let ok = damped && latched && rearmed;
    Ok(row(
        "e-stop during a stride",
        seen,
        Some(PERIOD_S),
        stopped,
        ok,
    ))
}

/// A robot whose sensors can be made to lie.
fn lying_robot(
    link: &Ros2Config,
    fault: &str,
    lie: fn(u64, &mut SensorFrame, &mut u64, &mut bool),
) -> Result<FaultRow, LinkError> {
    let link = Ros2Config {
        silence_s: 0.5,
        sets_itself_up: false,
        ..link.clone()
    };
    let mut node = LinkNode::open(&link, "liar")?;
    let joints = node.publisher::<JointState>(&link.joint_states)?;
    let imu = node.publisher::<Imu>(&link.imu)?;
    let feet = [
        node.publisher::<WrenchStamped>(&link.left_foot)?,
        node.publisher::<WrenchStamped>(&link.right_foot)?,
    ];
    let commands = node.subscription::<Float64MultiArray>(&link.commands)?;
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let lied_at = Arc::new(Mutex::new(None::<Instant>));
    let when = Arc::clone(&lied_at);
    let liar = std::thread::spawn(move || {
        // The node lives as long as its robot.
        let _node = node;
        let mut machine = StandIn::new();
        let mut lies_from = None;
        let mut commanded = 0_u64;
        for k in 0..10_000_u64 {
            if flag.load(Ordering::Relaxed) {
                break;
            }
            if let Some((message, _)) = drain(&commands, &mut 0).pop() {
                commanded += 1;
                let _ = machine.step(&message.data);
            }
            if commanded == 100 && lies_from.is_none() {
                lies_from = Some(k);
                if let Ok(mut at) = when.lock() {
                    *at = Some(Instant::now());
                }
            }
            let mut frame = machine.frame().clone();
            let mut stamp = 10_000_000_000 + k * 8_000_000;
            let mut foot = true;
            if let Some(from) = lies_from {
                lie(k - from, &mut frame, &mut stamp, &mut foot);
            }
            let [a, b, c, d] = [(); 4].map(|()| Header {
                stamp: RosTime::from_nanoseconds(stamp),
                frame_id: "base".into(),
            });
            let (js, im, [left, right]) = to_messages(&frame, &names(), a, b, [c, d]);
            if foot {
                let _ = feet[0].publish(left);
            }
            let _ = feet[1].publish(right);
            let _ = imu.publish(im);
            let _ = joints.publish(js);
            std::thread::sleep(Duration::from_millis(8));
        }
    });
    let result = (|| {
        let mut controller =
            RemoteMachine::open(&link, names(), limits(), PERIOD_S, Box::new(Yes))?;
        controller.reset(&[0.0; JOINTS], &mut ChaCha8Rng::seed_from_u64(0))?;
        let after = walk(&mut controller, 1000);
        // On this machine's clock: the robot's own may be what lies.
        let since = lied_at.lock().ok().and_then(|at| *at);
        let took_s = since.map_or(0.0, |at| at.elapsed().as_secs_f64());
        let said = after
            .as_ref()
            .err()
            .map(ToString::to_string)
            .unwrap_or_default();
        let aborted = matches!(after, Err(RobotError::Link { .. }));
        let seen = format!("stride aborted: {said}");
        Ok(row(fault, seen, Some(took_s), aborted, aborted))
    })();
    stop.store(true, Ordering::Relaxed);
    let _ = liar.join();
    result
}

/// Tries every fault on a running link and says what was seen. Each row uses a domain of its own, from the
/// configuration's on.
///
/// # Errors
///
/// [`LinkError`] if the network cannot be joined, or a link without a fault does not work.
pub fn fault_table(link: &Ros2Config) -> Result<Vec<FaultRow>, LinkError> {
    let mut domain = link.domain;
    let mut next = || {
        let link = Ros2Config {
            domain,
            ..link.clone()
        };
        domain += 1;
        link
    };
    let mut rows = vec![
        controller_gone(&next(), "controller killed")?,
        robot_killed(&next())?,
        silence(&next(), "controller stopped for 1 s", 1.0)?,
        silence(&next(), "cut for 20 ms", 0.02)?,
        silence(&next(), "cut for 60 ms", 0.06)?,
        silence(&next(), "cut for 500 ms", 0.5)?,
        silence(&next(), "cut for 5000 ms", 5.0)?,
    ];
    rows.extend(messages(&next())?);
    rows.push(lost(&next())?);
    rows.push(lying_robot(
        &next(),
        "clock jumped back",
        |_, _, stamp, _| {
            *stamp -= 5_000_000_000;
        },
    )?);
    rows.push(lying_robot(
        &next(),
        "clock jumped ahead",
        |_, _, stamp, _| {
            *stamp += 5_000_000_000;
        },
    )?);
    rows.push(lying_robot(&next(), "NaN in a state", |_, frame, _, _| {
        frame.orientation[2] = f64::NAN;
    })?);
    rows.push(emergency_stop(&next())?);
    rows.push(second_writer(&next())?);
    rows.push(lying_robot(&next(), "joint stuck", |_, frame, _, _| {
        frame.joints[2].position_rad = 0.1;
    })?);
    rows.push(lying_robot(
        &next(),
        "foot-load sensor silent",
        |_, _, _, foot| *foot = false,
    )?);
    Ok(rows)
}
