//! The controller's end of the link: a machine that is somewhere else.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use ros2_client::{Publisher, Subscription};
use serde::Serialize;
use stridemap_robot::{
    BaseState, JointLimits, JointState as JointReading, Machine, RobotError, Ros2Config,
    SensorFrame, check_command,
};

use crate::error::LinkError;
use crate::messages::{Float64MultiArray, Imu, JointState, Text, UInt64MultiArray, WrenchStamped};
use crate::node::{LinkNode, NAP, Topics, drain};
use crate::server::Status;

/// The person beside the robot, or whoever stands in for him.
pub trait Operator: Send {
    /// Asks that the robot be set on its feet, ready to move; `why` says what happened. `false`: do not go on.
    fn set_up(&mut self, why: &str) -> bool;
}

/// An operator who always agrees: for robots that set themselves up, and for scripts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Yes;

impl Operator for Yes {
    fn set_up(&mut self, _why: &str) -> bool {
        true
    }
}

/// What the controller's end of the link counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounts {
    /// States received whole.
    pub states: u64,
    /// Periods of which no whole state came.
    pub missed: u64,
    /// States whose clock did not advance.
    pub out_of_order: u64,
    /// States with NaN or the wrong number of joints.
    pub unusable: u64,
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Commands held back to a joint's rate or range.
    pub limited: u64,
    /// Commands sent.
    pub commands: u64,
}

/// The parts of one reading, gathered by their stamp.
#[derive(Default)]
struct Parts {
    joints: Option<JointState>,
    imu: Option<Imu>,
    feet: [Option<f64>; 2],
}

/// A machine behind ROS 2.
///
/// A step sends the command (with a heartbeat that says which state it answers) and waits for the next whole
/// state. Silence, a gap, a clock that runs backwards, NaN, a wrong number of joints, a robot whose emergency
/// stop is latched: each is an error, and the stride is then aborted, never data.
pub struct RemoteMachine {
    node: LinkNode,
    config: Ros2Config,
    name: String,
    joint_names: Vec<String>,
    limits: Vec<JointLimits>,
    period_s: f64,
    states: Subscription<JointState>,
    imu: Subscription<Imu>,
    feet: [Subscription<WrenchStamped>; 2],
    status: Subscription<Text>,
    commands: Publisher<Float64MultiArray>,
    heartbeat: Publisher<UInt64MultiArray>,
    set_up: Publisher<Text>,
    operator: Box<dyn Operator>,
    parts: BTreeMap<u64, Parts>,
    last_stamp_ns: Option<u64>,
    zero_ns: u64,
    frame: SensorFrame,
    sent: Option<Vec<f64>>,
    sequence: u64,
    newest_status: Option<Status>,
    refused_before: u64,
    trouble: Option<String>,
    watch: Watch,
    counts: LinkCounts,
}

impl RemoteMachine {
    /// Joins the network. `joint_names` and `limits` are what the joint map expects, in the machine's order and
    /// signs; whether the robot has them is seen at the first reset.
    ///
    /// # Errors
    ///
    /// [`LinkError`] if the network cannot be joined.
    pub fn open(
        config: &Ros2Config,
        joint_names: Vec<String>,
        limits: Vec<JointLimits>,
        period_s: f64,
        operator: Box<dyn Operator>,
    ) -> Result<Self, LinkError> {
        let mut node = LinkNode::open(config, "stridemap_controller")?;
        Ok(Self {
            states: node.subscription(&config.joint_states)?,
            imu: node.subscription(&config.imu)?,
            feet: [
                node.subscription(&config.left_foot)?,
                node.subscription(&config.right_foot)?,
            ],
            status: node.subscription(Topics::STATUS)?,
            commands: node.publisher(&config.commands)?,
            heartbeat: node.publisher(Topics::HEARTBEAT)?,
            set_up: node.publisher(Topics::SET_UP)?,
            node,
            name: format!("ros2 domain {}", config.domain),
            config: config.clone(),
            joint_names,
            limits,
            period_s,
            operator,
            parts: BTreeMap::new(),
            last_stamp_ns: None,
            zero_ns: 0,
            frame: SensorFrame::default(),
            sent: None,
            sequence: 0,
            newest_status: None,
            refused_before: 0,
            trouble: None,
            watch: Watch::default(),
            counts: LinkCounts::default(),
        })
    }

    /// What was counted so far.
    #[must_use]
    pub const fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// What the robot last said of itself.
    #[must_use]
    pub const fn status(&self) -> Option<&Status> {
        self.newest_status.as_ref()
    }

    fn fault(&mut self, what: impl Into<String>) -> RobotError {
        let what = what.into();
        self.trouble = Some(what.clone());
        RobotError::Link {
            time_s: self.frame.time_s,
            what,
        }
    }

    /// Takes in what has arrived; the newest whole reading that is newer than the last, if there is one.
    fn gather(&mut self) -> Result<Option<u64>, RobotError> {
        let bad = &mut self.counts.unreadable;
        for (message, _) in drain(&self.states, bad) {
            let stamp = message.header.stamp.nanoseconds();
            self.parts.entry(stamp).or_default().joints = Some(message);
        }
        for (message, _) in drain(&self.imu, bad) {
            let stamp = message.header.stamp.nanoseconds();
            self.parts.entry(stamp).or_default().imu = Some(message);
        }
        for side in 0..2 {
            for (message, _) in drain(&self.feet[side], bad) {
                let stamp = message.header.stamp.nanoseconds();
                self.parts.entry(stamp).or_default().feet[side] = Some(message.force.z);
            }
        }
        for (message, _) in drain(&self.status, bad) {
            match serde_json::from_str(&message.data) {
                Ok(status) => self.newest_status = Some(status),
                Err(_) => *bad += 1,
            }
        }
        let whole =
            |p: &Parts| p.joints.is_some() && p.imu.is_some() && p.feet.iter().all(Option::is_some);
        let newest = self
            .parts
            .iter()
            .rev()
            .find(|(_, p)| whole(p))
            .map(|(s, _)| *s);
        let Some(stamp) = newest else {
            // A silent sensor must not fill the memory.
            while self.parts.len() > 64 {
                self.parts.pop_first();
            }
            return Ok(None);
        };
        if let Some(last) = self.last_stamp_ns
            && stamp <= last
        {
            self.counts.out_of_order += 1;
            self.parts.remove(&stamp);
            // A single old message is a network's doing. A clock that stays behind is the robot's.
            if last - stamp > 1_000_000_000 {
                self.last_stamp_ns = Some(stamp);
                return Err(self.fault(format!(
                    "the robot's clock went back by {:.3} s",
                    (last - stamp) as f64 * 1e-9
                )));
            }
            return Ok(None);
        }
        let Some(parts) = self.parts.remove(&stamp) else {
            return Ok(None);
        };
        self.parts = self.parts.split_off(&stamp);
        let before = self.last_stamp_ns.replace(stamp);
        let frame = self.assemble(stamp, parts)?;
        self.frame = frame;
        self.counts.states += 1;
        if let Some(before) = before {
            let gap_s = (stamp - before) as f64 * 1e-9;
            let missed = (gap_s / self.period_s).round() - 1.0;
            self.counts.missed += missed.max(0.0) as u64;
        }
        Ok(Some(stamp))
    }

    /// A reading from its parts, checked.
    fn assemble(&mut self, stamp: u64, parts: Parts) -> Result<SensorFrame, RobotError> {
        let (Some(joints), Some(imu), [Some(left), Some(right)]) =
            (parts.joints, parts.imu, parts.feet)
        else {
            return Err(self.fault("a reading is not whole"));
        };
        let n = joints.name.len();
        if joints.position.len() != n {
            self.counts.unusable += 1;
            return Err(self.fault(format!("{} angles for {n} joints", joints.position.len())));
        }
        let mut readings = Vec::with_capacity(self.joint_names.len());
        for name in &self.joint_names {
            let Some(at) = joints.name.iter().position(|have| have == name) else {
                return Err(RobotError::JointMap {
                    joint: name.clone(),
                    why: "is not a joint of the robot",
                });
            };
            let offset = self.config.offset_deg.get(name).copied().unwrap_or(0.0);
            // Rates and torques may be absent.
            readings.push(JointReading {
                position_rad: joints.position[at] - offset.to_radians(),
                velocity_rad_s: joints.velocity.get(at).copied().unwrap_or(0.0),
                torque_nm: joints.effort.get(at).copied().unwrap_or(0.0),
            });
        }
        let q = imu.data.orientation;
        let frame = SensorFrame {
            time_s: stamp.saturating_sub(self.zero_ns) as f64 * 1e-9,
            joints: readings,
            orientation: [q.w, q.x, q.y, q.z],
            angular_velocity_rad_s: imu.data.angular_velocity.into(),
            loads_n: [left, right],
        };
        if let Some(field) = frame.first_not_finite() {
            self.counts.unusable += 1;
            return Err(self.fault(format!("the robot's {field} is not finite")));
        }
        let norm: f64 = frame.orientation.iter().map(|v| v * v).sum();
        if (norm - 1.0).abs() > 0.01 {
            self.counts.unusable += 1;
            return Err(self.fault("the robot's orientation is no rotation"));
        }
        Ok(frame)
    }

    /// Waits for a whole reading newer than the last.
    fn next_frame(&mut self) -> Result<(), RobotError> {
        let silence = Duration::from_secs_f64(self.config.silence_s);
        let start = Instant::now();
        loop {
            if self.gather()?.is_some() {
                return Ok(());
            }
            if start.elapsed() > silence {
                let said = self.parts.values().next_back().map(|p| {
                    let mut missing = Vec::new();
                    for (there, what) in [
                        (p.joints.is_some(), "joint states"),
                        (p.imu.is_some(), "inertial unit"),
                        (p.feet[0].is_some(), "left foot's load"),
                        (p.feet[1].is_some(), "right foot's load"),
                    ] {
                        if !there {
                            missing.push(what);
                        }
                    }
                    missing.join(", ")
                });
                let what = match said {
                    Some(missing) => format!("silent: {missing}"),
                    None => "nothing was heard".into(),
                };
                return Err(self.fault(format!("{what} for {:.1} s", silence.as_secs_f64())));
            }
            std::thread::sleep(NAP);
        }
    }

    /// What the robot's status forbids.
    fn obey_status(&mut self) -> Result<(), RobotError> {
        let Some(status) = &self.newest_status else {
            return Ok(());
        };
        if let Some(reason) = status.stopped.clone() {
            self.trouble = Some(reason.clone());
            return Err(RobotError::EmergencyStop { reason });
        }
        let others = status.refusals.second_writer;
        if others > self.refused_before {
            self.refused_before = others;
            return Err(self.fault("somebody else commands the robot as well"));
        }
        Ok(())
    }

    /// Sends a command, held to range and rate.
    fn send(&mut self, command_rad: &[f64]) {
        let from: Vec<f64> = match &self.sent {
            Some(sent) => sent.clone(),
            None => self.frame.joints.iter().map(|j| j.position_rad).collect(),
        };
        let mut limited = 0;
        let next: Vec<f64> = command_rad
            .iter()
            .zip(&from)
            .zip(&self.limits)
            .map(|((want, from), limits)| {
                let reach = limits.velocity_rad_s * self.period_s;
                let within = want.clamp(limits.lower_rad, limits.upper_rad.max(limits.lower_rad));
                let next = within.clamp(from - reach, from + reach);
                limited += u64::from((next - want).abs() > 0.0);
                next
            })
            .collect();
        self.counts.limited += limited;
        self.sequence += 1;
        self.counts.commands += 1;
        let stamp = self.last_stamp_ns.unwrap_or(0);
        let data = next
            .iter()
            .zip(&self.joint_names)
            .map(|(angle, name)| {
                angle
                    + self
                        .config
                        .offset_deg
                        .get(name)
                        .copied()
                        .unwrap_or(0.0)
                        .to_radians()
            })
            .collect();
        // What cannot be sent is missed by the robot, whose own guard then holds.
        let _ = self.commands.publish(Float64MultiArray {
            data,
            ..Float64MultiArray::default()
        });
        let _ = self.heartbeat.publish(UInt64MultiArray {
            data: vec![self.sequence, stamp],
            ..UInt64MultiArray::default()
        });
        self.sent = Some(next);
    }

    /// Finds the robot: all its topics, and somebody to hear the commands.
    fn connect(&mut self) -> Result<(), RobotError> {
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        let mut heard = false;
        while Instant::now() < deadline {
            heard |= self.gather()?.is_some();
            let listeners = [
                self.commands.get_subscription_count(self.node.node()),
                self.heartbeat.get_subscription_count(self.node.node()),
            ];
            let ready = !self.config.sets_itself_up
                || self.set_up.get_subscription_count(self.node.node()) > 0;
            if heard && listeners[0] > 0 && ready {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Err(self.fault(if heard {
            "the robot speaks, but nobody listens to the commands (topic, type or quality of service?)"
        } else {
            "no robot was heard (is it switched on; are domain, interface and topics right?)"
        }))
    }

    /// Waits some periods, commanding a fixed posture if one is given.
    fn wait_periods(&mut self, periods: usize, hold: Option<&[f64]>) -> Result<(), RobotError> {
        for _ in 0..periods {
            if let Some(hold) = hold {
                self.send(hold);
            }
            self.next_frame()?;
            self.obey_status()?;
        }
        Ok(())
    }

    fn tilt_deg(&self) -> f64 {
        let base = BaseState {
            orientation: self.frame.orientation,
            ..BaseState::default()
        };
        base.tilt_rad().to_degrees()
    }

    /// Refuses a robot that is not upright, or not still.
    fn check_upright_and_still(&mut self) -> Result<(), RobotError> {
        let tilt = self.tilt_deg();
        if tilt > self.config.upright_deg {
            return Err(self.fault(format!("the robot is not upright: tilted by {tilt:.0} deg")));
        }
        let rates = self.frame.joints.iter().map(|j| j.velocity_rad_s.abs());
        let fastest = rates.fold(0.0, f64::max);
        if fastest > self.config.still_rad_s {
            return Err(self.fault(format!(
                "the robot is not still: a joint turns at {fastest:.2} rad/s"
            )));
        }
        Ok(())
    }

    /// Asks a robot that can do so to put itself on its feet, and waits until it says it has.
    fn ask_to_set_up(&mut self) -> Result<(), RobotError> {
        let before = self.newest_status.as_ref().map(|s| s.set_ups);
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        let mut asked: Option<Instant> = None;
        while Instant::now() < deadline {
            if asked.is_none_or(|at| at.elapsed() > Duration::from_millis(500)) {
                let _ = self.set_up.publish(Text::default());
                asked = Some(Instant::now());
            }
            self.gather()?;
            let now = self.newest_status.as_ref().map(|s| s.set_ups);
            if now.is_some() && now > before.or(Some(0)) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Err(self.fault("the robot did not set itself up"))
    }
}

/// Compares what the joints were told with what they do, over windows.
#[derive(Clone, Debug, Default)]
struct Watch {
    since_s: f64,
    told: Vec<[f64; 2]>,
    seen: Vec<[f64; 2]>,
}

impl Watch {
    /// Length of a window: longer than a stride.
    const WINDOW_S: f64 = 1.5;
    /// A joint that was told to move by this much over a window, ...
    const TOLD_RAD: f64 = 0.05;
    /// ... and moved by less than this share of it, is stuck.
    const SHARE: f64 = 0.15;

    /// Takes one period; the joint that is stuck, if one is.
    fn joint_stuck(&mut self, now_s: f64, told: &[f64], seen: &[JointReading]) -> Option<usize> {
        if self.told.len() != told.len() || now_s < self.since_s {
            *self = Self {
                since_s: now_s,
                told: told.iter().map(|v| [*v; 2]).collect(),
                seen: seen.iter().map(|j| [j.position_rad; 2]).collect(),
            };
            return None;
        }
        let grow = |range: &mut [f64; 2], value: f64| {
            *range = [range[0].min(value), range[1].max(value)];
        };
        for (range, value) in self.told.iter_mut().zip(told) {
            grow(range, *value);
        }
        for (range, joint) in self.seen.iter_mut().zip(seen) {
            grow(range, joint.position_rad);
        }
        if now_s - self.since_s < Self::WINDOW_S {
            return None;
        }
        let width = |range: &[f64; 2]| range[1] - range[0];
        let stuck = self.told.iter().zip(&self.seen).position(|(told, seen)| {
            width(told) > Self::TOLD_RAD && width(seen) < Self::SHARE * width(told)
        });
        self.told.clear();
        stuck
    }
}

/// Periods for which the robot must stand before it is commanded.
const LOOK_PERIODS: usize = 5;

impl Machine for RemoteMachine {
    fn name(&self) -> &str {
        &self.name
    }

    fn joint_names(&self) -> &[String] {
        &self.joint_names
    }

    fn control_period_s(&self) -> f64 {
        self.period_s
    }

    fn limits(&self) -> &[JointLimits] {
        &self.limits
    }

    fn reset(
        &mut self,
        command_rad: &[f64],
        _rng: &mut ChaCha8Rng,
    ) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.joint_names)?;
        let first = self.last_stamp_ns.is_none();
        let tilt = self.tilt_deg();
        let why = self.trouble.take().unwrap_or_else(|| {
            if !first && tilt > self.config.upright_deg {
                return format!("the robot fell (tilted by {tilt:.0} deg)");
            }
            if first {
                "before the first stride"
            } else {
                "a new start"
            }
            .to_owned()
        });
        if !self.operator.set_up(&why) {
            return Err(self.fault("the operator said no"));
        }
        self.parts.clear();
        self.sent = None;
        self.connect()?;
        // Look before speaking: is somebody else at it, is it stopped?
        self.wait_periods(LOOK_PERIODS, None)?;
        let commanded = self.newest_status.as_ref().is_some_and(|s| s.commanded);
        if commanded && first {
            return Err(self.fault("somebody else commands the robot already"));
        }
        if self.config.sets_itself_up {
            self.ask_to_set_up()?;
            self.wait_periods(LOOK_PERIODS, None)?;
        }
        self.check_upright_and_still()?;
        // From the measured pose to the posture, slowly.
        let from: Vec<f64> = self.frame.joints.iter().map(|j| j.position_rad).collect();
        let far = from
            .iter()
            .zip(command_rad)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        /// An angle that needs no ramp: encoders are off by as much.
        const NEAR_RAD: f64 = 0.05;
        if far > NEAR_RAD {
            let periods = (self.config.ramp_s / self.period_s).ceil().max(1.0);
            for k in 1..=(periods as usize) {
                let share = k as f64 / periods;
                let command: Vec<f64> = from
                    .iter()
                    .zip(command_rad)
                    .map(|(a, b)| a + share * (b - a))
                    .collect();
                self.wait_periods(1, Some(&command))?;
            }
            let settle = (0.5 / self.period_s).ceil() as usize;
            self.wait_periods(settle, Some(command_rad))?;
            self.check_upright_and_still()?;
        } else {
            self.wait_periods(1, Some(command_rad))?;
        }
        self.refused_before = self
            .newest_status
            .as_ref()
            .map_or(0, |s| s.refusals.second_writer);
        self.zero_ns = self.last_stamp_ns.unwrap_or(0);
        self.frame.time_s = 0.0;
        self.watch = Watch::default();
        Ok(&self.frame)
    }

    fn frame(&self) -> &SensorFrame {
        &self.frame
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.joint_names)?;
        let before = self.last_stamp_ns;
        self.send(command_rad);
        self.next_frame()?;
        self.obey_status()?;
        if let (Some(before), Some(now)) = (before, self.last_stamp_ns) {
            let gap_s = (now - before) as f64 * 1e-9;
            if gap_s > self.config.gap_s {
                return Err(self.fault(format!("no state for {gap_s:.3} s of robot time")));
            }
        }
        let told = self.sent.clone().unwrap_or_default();
        let stuck = self
            .watch
            .joint_stuck(self.frame.time_s, &told, &self.frame.joints);
        if let Some(joint) = stuck {
            let name = self.joint_names.get(joint).cloned().unwrap_or_default();
            return Err(self.fault(format!("joint {name} does not follow its commands")));
        }
        Ok(&self.frame)
    }
}
