//! The controller's end of the link: a machine that is somewhere else.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use ros2_client::{Publisher, Subscription};
use serde::Serialize;
use stridemap_robot::{
    BaseState, JointLimits, Machine, MachineDescription, RobotError, Ros2Config, SensorFrame, check_command,
    hold_to_limits,
};

use crate::assemble::{self, Assembler};
use crate::error::LinkError;
use crate::guard::Refusals;
use crate::messages::{Float64MultiArray, RosMessage, Text, UInt64MultiArray};
use crate::node::{LinkNode, NAP, Topics, drain};
use crate::readings::Readings;
use crate::server::Status;
use crate::stop::{STOP_PERIOD, send_stop};
use crate::stream::Unusable;
use crate::watch::Watch;

/// The person beside the robot, or whoever stands in for him.
pub trait Operator: Send {
    /// Asks that the robot be set on its feet, ready to move; `why` says what happened. `false`: do not go on.
    fn set_up(&mut self, why: &str) -> bool;

    /// Whether somebody is there who can mend what keeps the robot from starting, and is then asked again.
    fn can_mend(&self) -> bool {
        false
    }
}

/// An operator who always agrees: for robots that set themselves up, and for scripts.
#[derive(Clone, Copy, Debug, Default)]
pub struct AlwaysConfirms;

impl Operator for AlwaysConfirms {
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
    /// Messages that came twice.
    pub doubled: u64,
    /// Joint states without another sensor's message near enough in time.
    pub unpaired: u64,
    /// Messages that say nothing usable: NaN, another number of joints, no orientation.
    pub unusable: u64,
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Commands held back to a joint's range, rate or torque.
    pub limited: u64,
    /// Commands sent.
    pub commands: u64,
}

/// A machine behind ROS 2.
///
/// A step sends the command (with a heartbeat that says which state it answers) and waits for the next whole
/// state. Silence, a gap, a clock that runs backwards, NaN, a wrong number of joints, a robot whose emergency
/// stop is latched or whose own guard held it back: each is an error, and the stride is then aborted, never
/// data.
///
/// A start refuses a robot that somebody else commands, whose joints are not those of the map, that is not
/// upright or not still; it brings the robot from its measured pose to the posture slowly.
pub struct RemoteMachine {
    node: LinkNode,
    config: Ros2Config,
    description: MachineDescription,
    readings: Readings,
    commands: Publisher<Float64MultiArray>,
    heartbeat: Publisher<UInt64MultiArray>,
    set_up: Publisher<Text>,
    stop: Publisher<Text>,
    /// Ears on the commands' topic: somebody else's are heard while this end is silent.
    others: Subscription<Float64MultiArray>,
    operator: Box<dyn Operator>,
    halt: Option<Arc<AtomicBool>>,
    frame: SensorFrame,
    sent: Option<Vec<f64>>,
    sent_at: Option<Instant>,
    sequence: u64,
    /// What the robot's guard had done when the present start was complete.
    before: Option<(Refusals, u64)>,
    /// Whether the present start is complete.
    walking: bool,
    trouble: Option<String>,
    /// Whether the link fell silent: the next start joins the network anew.
    lost: bool,
    watch: Watch,
    counts: LinkCounts,
}

/// Periods for which the robot must stand before it is commanded.
const LOOK_PERIODS: usize = 5;
/// Periods for which the posture is commanded before the walk begins: what the robot's guard did at the start
/// is then known.
const SETTLE_PERIODS: usize = 3;
/// How long a start waits for another writer to fall silent: a controller that was killed counts as a writer
/// for a second.
const WRITER_GONE: Duration = Duration::from_secs(3);
/// Somebody else may have taken over after this end was silent for this long.
const SILENT: Duration = Duration::from_secs(1);
/// How long the robot may take to hear the commands before this end joins the network anew.
const HEARD: Duration = Duration::from_secs(2);
/// How long the robot may take to say that it stopped before it is told by another way.
const STOPPED: Duration = Duration::from_millis(500);
/// An angle that needs no ramp: encoders are off by as much.
const NEAR_RAD: f64 = 0.05;

impl RemoteMachine {
    /// Joins the network. `joint_names` and `limits` are what the joint map expects, in the machine's order and
    /// signs, and `link.limits` tightens them; whether the robot has these joints is seen at the first reset.
    ///
    /// # Errors
    ///
    /// [`LinkError`] if the network cannot be joined, or the configuration names a joint that is not there.
    pub fn open(
        config: &Ros2Config,
        joint_names: Vec<String>,
        mut limits: Vec<JointLimits>,
        period_s: f64,
        operator: Box<dyn Operator>,
    ) -> Result<Self, LinkError> {
        let names = joint_names.clone();
        let assembler = Assembler::new(config, names, limits.clone(), period_s, false)?;
        for (joint, tighter) in &config.limits {
            let at = joint_names.iter().position(|name| name == joint);
            let (Some(at), true) = (at, limits.len() == joint_names.len()) else {
                return Err(LinkError::Config {
                    field: "limits",
                    value: joint.clone(),
                    problem: format!("is not a joint of the robot; its joints are {joint_names:?}"),
                });
            };
            limits[at] = tighter.of(limits[at]);
        }
        let mut node = LinkNode::open(config, "stridemap_controller")?;
        Ok(Self {
            readings: Readings::open(&mut node, config, assembler)?,
            commands: node.publisher(&config.commands)?,
            heartbeat: node.publisher(Topics::HEARTBEAT)?,
            set_up: node.publisher(Topics::SET_UP)?,
            stop: node.publisher(Topics::STOP)?,
            others: node.sensor(&config.commands)?,
            node,
            description: MachineDescription {
                name: format!("ros2 domain {}", config.domain),
                joint_names,
                control_period_s: period_s,
                limits,
            },
            config: config.clone(),
            operator,
            halt: None,
            frame: SensorFrame::default(),
            sent: None,
            sent_at: None,
            sequence: 0,
            before: None,
            walking: false,
            trouble: None,
            lost: false,
            watch: Watch::default(),
            counts: LinkCounts::default(),
        })
    }

    /// Joins the network anew. A reliable reader that missed messages (its process was stopped, the network was
    /// down) may wait for them longer than a new one needs to find the robot.
    fn rejoin(&mut self) -> Result<(), LinkError> {
        let config = &self.config;
        let mut node = LinkNode::open(config, "stridemap_controller")?;
        self.readings = Readings::open(&mut node, config, self.readings.assembler.clone())?;
        self.commands = node.publisher(&config.commands)?;
        self.heartbeat = node.publisher(Topics::HEARTBEAT)?;
        self.set_up = node.publisher(Topics::SET_UP)?;
        self.stop = node.publisher(Topics::STOP)?;
        self.others = node.sensor(&config.commands)?;
        self.node = node;
        self.sent_at = None;
        Ok(())
    }

    /// Presses the robot's emergency stop as soon as this flag is set (Ctrl-C).
    pub fn halt_on(&mut self, flag: Arc<AtomicBool>) {
        self.halt = Some(flag);
    }

    /// What was counted so far.
    #[must_use]
    pub const fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// What the robot last said of itself.
    #[must_use]
    pub const fn status(&self) -> Option<&Status> {
        self.readings.newest_status.as_ref()
    }

    fn fault(&mut self, what: impl Into<String>) -> RobotError {
        let what = what.into();
        self.trouble = Some(what.clone());
        RobotError::Link { time_s: self.frame.time_s, what }
    }

    /// Presses the emergency stop if this end was told to.
    fn obey_halt(&mut self) -> Result<(), RobotError> {
        let asked = self.halt.as_ref().is_some_and(|h| h.load(Ordering::Relaxed));
        if !asked {
            return Ok(());
        }
        let mut reason = "Ctrl-C at the controller".to_owned();
        // A robot that does not tell its status cannot confirm, and one that was never commanded from here need not;
        // one that does may not know of this writer.
        let told = self.counts.commands > 0 && self.readings.status_is_told(&self.node);
        let stopped = self.press_stop(&reason) || !told || matches!(send_stop(&self.config, &reason, false), Ok(true));
        if !stopped {
            reason += "; THE ROBOT HAS NOT SAID THAT IT STOPPED";
        }
        self.trouble = Some(reason.clone());
        Err(RobotError::EmergencyStop { reason })
    }

    /// Presses the emergency stop until the robot says that it stopped, for a moment; tells whether it did.
    fn press_stop(&mut self, reason: &str) -> bool {
        let began = Instant::now();
        while began.elapsed() < STOPPED {
            let _ = self.stop.publish(Text { data: reason.to_owned() });
            std::thread::sleep(STOP_PERIOD);
            // Nothing but the status counts now.
            let _ = self.readings.gather(&mut self.counts);
            let status = self.readings.newest_status.as_ref();
            if status.is_some_and(|s| s.stopped.is_some()) {
                return true;
            }
        }
        false
    }

    /// Takes in what has arrived; whether that made a whole reading newer than the last.
    fn gather(&mut self) -> Result<bool, RobotError> {
        match self.readings.gather(&mut self.counts) {
            Ok(Some(frame)) => {
                self.frame = frame;
                Ok(true)
            }
            Ok(None) => Ok(false),
            Err(Unusable::Said(what)) => Err(self.fault(what)),
            Err(Unusable::Map(error)) => {
                self.trouble = Some(error.to_string());
                Err(error)
            }
        }
    }

    /// Waits for a whole reading newer than the last.
    fn next_frame(&mut self) -> Result<(), RobotError> {
        let silence = Duration::from_secs_f64(self.config.silence_s);
        let start = Instant::now();
        loop {
            if self.gather()? {
                return Ok(());
            }
            self.obey_halt()?;
            if start.elapsed() > silence {
                let what = match self.readings.assembler.missing() {
                    Some(missing) => format!("silent: {missing}"),
                    None => "nothing was heard".into(),
                };
                self.lost = true;
                return Err(self.fault(format!("{what} for {:.1} s", silence.as_secs_f64())));
            }
            std::thread::sleep(NAP);
        }
    }

    /// What the robot's status forbids: a latched stop, and every intervention of its guard since the start.
    fn obey_status(&mut self) -> Result<(), RobotError> {
        let Some(status) = &self.readings.newest_status else {
            return Ok(());
        };
        if let Some(reason) = status.stopped.clone() {
            self.trouble = Some(reason.clone());
            return Err(RobotError::EmergencyStop { reason });
        }
        let (refusals, set_ups) = (status.refusals, status.set_ups);
        // Before a start is complete there is no stride to spoil: the robot holds between batches.
        if !self.walking {
            return Ok(());
        }
        let before = *self.before.get_or_insert((refusals, set_ups));
        if set_ups != before.1 {
            return Err(self.fault("the robot was set up anew by somebody else"));
        }
        match refusals.spoil(&before.0) {
            Some(why) => Err(self.fault(why)),
            None => Ok(()),
        }
    }

    /// Takes the robot's present status as the one from which it is judged.
    fn judge_from_here(&mut self) {
        let status = self.readings.newest_status.as_ref();
        self.before = status.map(|s| (s.refusals, s.set_ups));
    }

    /// Sends a command, held to range, rate and torque.
    fn send(&mut self, command_rad: &[f64]) {
        let measured = &self.frame.joints;
        let from: Vec<f64> = match &self.sent {
            Some(sent) => sent.clone(),
            None => measured.iter().map(|j| j.position_rad).collect(),
        };
        let limits = &self.description.limits;
        let period_s = self.description.control_period_s;
        let (next, held) = hold_to_limits(command_rad, &from, measured, limits, period_s);
        self.counts.limited += held.position_clamped + held.rate_limited + held.torque_limited;
        self.sequence += 1;
        self.counts.commands += 1;
        let stamp = self.readings.last_stamp_ns().unwrap_or(0);
        // What cannot be sent is missed by the robot, whose own guard then holds.
        let _ = self
            .commands
            .publish(Float64MultiArray { data: self.readings.wiring().write(&next), ..Float64MultiArray::default() });
        let _ = self
            .heartbeat
            .publish(UInt64MultiArray { data: vec![self.sequence, stamp], ..UInt64MultiArray::default() });
        self.sent = Some(next);
        self.sent_at = Some(Instant::now());
    }

    /// Finds the robot: all its topics, and somebody to hear the commands.
    fn connect(&mut self) -> Result<(), RobotError> {
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        let mut heard = false;
        while Instant::now() < deadline {
            heard |= match self.gather() {
                Err(RobotError::Link { what, .. }) => {
                    let misfits = self.readings.misfits(&self.node, &self.config);
                    return Err(self.fault(what + &misfits));
                }
                other => other?,
            };
            self.obey_halt()?;
            let listeners = [
                self.commands.get_subscription_count(self.node.node()),
                self.heartbeat.get_subscription_count(self.node.node()),
            ];
            let ready = !self.config.sets_itself_up
                || (listeners[1] > 0
                    && self.set_up.get_subscription_count(self.node.node()) > 0
                    && self.readings.status_is_told(&self.node));
            if heard && listeners[0] > 0 && ready {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        self.lost = true;
        let told = self.readings.heard(&self.node, &self.config);
        let listens = self.commands.get_subscription_count(self.node.node());
        let asks = (self.node).asks(&self.config.commands, Float64MultiArray::TYPE, listens);
        let what = match (heard, listens) {
            (false, _) if !self.readings.assembler.heard_any() => {
                "no robot was heard (is it switched on; are domain, interface and topics right?)"
            }
            (false, _) => "no whole reading was heard",
            (true, 0) => "the robot speaks, but nobody listens to the commands (topic, type or quality of service?)",
            (true, _) => {
                "the robot speaks, but does not set itself up (a robot that is set up by hand: \
                 link.sets_itself_up = false)"
            }
        };
        Err(self.fault(format!("{what}; {told}{asks}")))
    }

    /// Refuses a robot whose readings come at another rate than the gait is made for.
    fn check_pace(&mut self) -> Result<(), RobotError> {
        while !self.readings.assembler.knows_pace() {
            self.wait_periods(1, None)?;
        }
        match self.readings.assembler.off_pace() {
            Some(why) => Err(self.fault(why)),
            None => Ok(()),
        }
    }

    /// Refuses a robot that somebody else commands. The robot's own word counts where it has one; else what is
    /// heard on the commands' topic while this end is silent.
    fn check_nobody_else(&mut self) -> Result<(), RobotError> {
        let deadline = Instant::now() + WRITER_GONE;
        let told = self.readings.status_is_told(&self.node);
        let before = self.readings.statuses;
        loop {
            let _ = drain(&self.others, &mut self.counts.unreadable);
            self.wait_periods(LOOK_PERIODS, None)?;
            let others = !drain(&self.others, &mut self.counts.unreadable).is_empty();
            let status = self.readings.newest_status.as_ref();
            let known = !told || self.readings.statuses > before;
            let commanded = others || status.is_some_and(|s| s.commanded);
            if known && !commanded {
                return Ok(());
            }
            if Instant::now() > deadline {
                return Err(self.fault(if known {
                    "somebody else commands the robot already"
                } else {
                    "the robot does not tell its status"
                }));
            }
        }
    }

    /// Holds the measured pose until the robot says that it is commanded. A reader may know of a writer
    /// later than the writer of the reader, or not at all where a message of the discovery was lost: what is
    /// sent is lost then too, and a network joined anew is found. A robot that does not tell its status
    /// cannot be asked.
    fn make_heard(&mut self) -> Result<(), RobotError> {
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        loop {
            if !self.readings.status_is_told(&self.node) || self.is_heard()? {
                return Ok(());
            }
            self.lost = true;
            if Instant::now() > deadline {
                return Err(self.fault("the robot does not hear the commands"));
            }
            if let Err(error) = self.rejoin() {
                return Err(self.fault(error.to_string()));
            }
            self.sent = None;
            self.connect()?;
            self.lost = false;
        }
    }

    /// Whether the robot says before long that it is commanded.
    fn is_heard(&mut self) -> Result<bool, RobotError> {
        let pose: Vec<f64> = self.frame.joints.iter().map(|j| j.position_rad).collect();
        let (before, began) = (self.readings.statuses, Instant::now());
        while began.elapsed() < HEARD {
            self.wait_periods(LOOK_PERIODS, Some(&pose))?;
            let status = self.readings.newest_status.as_ref();
            if self.readings.statuses > before && status.is_some_and(|s| s.commanded) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Waits some periods, commanding a fixed posture if one is given.
    fn wait_periods(&mut self, periods: usize, hold: Option<&[f64]>) -> Result<(), RobotError> {
        for _ in 0..periods {
            if let Some(hold) = hold {
                self.send(hold);
            }
            self.next_frame()?;
            self.obey_halt()?;
            self.obey_status()?;
        }
        Ok(())
    }

    fn tilt_deg(&self) -> f64 {
        let base = BaseState { orientation: self.frame.orientation, ..BaseState::default() };
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
            return Err(self.fault(format!("the robot is not still: a joint turns at {fastest:.2} rad/s")));
        }
        Ok(())
    }

    /// Asks a robot that can do so to put itself on its feet, and waits until it says it has.
    fn ask_to_set_up(&mut self) -> Result<(), RobotError> {
        let set_ups = |readings: &Readings| readings.newest_status.as_ref().map(|s| s.set_ups);
        let before = set_ups(&self.readings);
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        let mut asked: Option<Instant> = None;
        while Instant::now() < deadline {
            if asked.is_none_or(|at| at.elapsed() > Duration::from_millis(500)) {
                let _ = self.set_up.publish(Text::default());
                asked = Some(Instant::now());
            }
            self.gather()?;
            self.obey_halt()?;
            let now = set_ups(&self.readings);
            if now.is_some() && now > before.or(Some(0)) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Err(self.fault("the robot did not set itself up"))
    }

    /// From the measured pose to the posture, slowly.
    fn ramp_to(&mut self, posture: &[f64]) -> Result<(), RobotError> {
        let from: Vec<f64> = self.frame.joints.iter().map(|j| j.position_rad).collect();
        let apart = from.iter().zip(posture).map(|(a, b)| (a - b).abs());
        if apart.fold(0.0, f64::max) <= NEAR_RAD {
            return self.wait_periods(SETTLE_PERIODS, Some(posture));
        }
        let period_s = self.description.control_period_s;
        let periods = (self.config.ramp_s / period_s).ceil().max(1.0);
        for k in 1..=(periods as usize) {
            let share = k as f64 / periods;
            let between = from.iter().zip(posture);
            let command: Vec<f64> = between.map(|(a, b)| a + share * (b - a)).collect();
            self.wait_periods(1, Some(&command))?;
        }
        let settle = (0.5 / period_s).ceil() as usize;
        self.wait_periods(settle, Some(posture))?;
        self.check_upright_and_still()
    }

    /// One start: look, set up, ramp.
    fn start(&mut self, posture: &[f64]) -> Result<(), RobotError> {
        if std::mem::take(&mut self.lost)
            && let Err(error) = self.rejoin()
        {
            self.lost = true;
            return Err(self.fault(error.to_string()));
        }
        self.readings.assembler.clear();
        self.sent = None;
        let was_silent = self.sent_at.is_none_or(|at| at.elapsed() > SILENT);
        self.walking = false;
        self.connect()?;
        // Look before speaking: is somebody else at it, is it stopped?
        if was_silent {
            self.check_nobody_else()?;
        } else {
            self.wait_periods(LOOK_PERIODS, None)?;
        }
        self.check_pace()?;
        if self.config.sets_itself_up {
            self.ask_to_set_up()?;
            self.wait_periods(LOOK_PERIODS, None)?;
        }
        self.check_upright_and_still()?;
        self.make_heard()?;
        self.ramp_to(posture)?;
        self.judge_from_here();
        self.walking = true;
        Ok(())
    }
}

impl Machine for RemoteMachine {
    fn description(&self) -> &MachineDescription {
        &self.description
    }

    fn reset(&mut self, command_rad: &[f64], _rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.description.joint_names)?;
        let tilt = self.tilt_deg();
        let mut why = match (self.trouble.take(), self.readings.last_stamp_ns()) {
            (Some(trouble), _) => trouble,
            (None, None) => Self::FIRST_START.into(),
            (None, Some(_)) if tilt > self.config.upright_deg => {
                format!("the robot fell (tilted by {tilt:.0} deg)")
            }
            (None, Some(_)) => Self::NEW_START.into(),
        };
        loop {
            self.obey_halt()?;
            if !self.operator.set_up(&why) {
                self.obey_halt()?;
                return Err(self.fault("the operator said no"));
            }
            match self.start(command_rad) {
                Ok(()) => break,
                Err(error) => {
                    let mendable = matches!(error, RobotError::Link { .. } | RobotError::EmergencyStop { .. });
                    if !(mendable && self.operator.can_mend()) {
                        return Err(error);
                    }
                    why = error.to_string();
                }
            }
        }
        self.trouble = None;
        self.readings.assembler.zero_ns = self.readings.last_stamp_ns().unwrap_or(0);
        self.frame.time_s = 0.0;
        self.watch = Watch::default();
        Ok(&self.frame)
    }

    fn frame(&self) -> &SensorFrame {
        &self.frame
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.description.joint_names)?;
        self.obey_halt()?;
        let before = self.readings.last_stamp_ns();
        self.send(command_rad);
        self.next_frame()?;
        self.obey_status()?;
        if let (Some(before), Some(now)) = (before, self.readings.last_stamp_ns())
            && let Some(gap) = assemble::gap(before, now, &self.config)
        {
            return Err(self.fault(gap));
        }
        let told = self.sent.clone().unwrap_or_default();
        let stuck = self.watch.joint_stuck(self.frame.time_s, &told, &self.frame.joints);
        if let Some(joint) = stuck {
            let names = &self.description.joint_names;
            let name = names.get(joint).cloned().unwrap_or_default();
            return Err(self.fault(format!("joint {name} does not follow its commands")));
        }
        Ok(&self.frame)
    }
}

impl RemoteMachine {
    /// What an operator is told before the first start.
    pub const FIRST_START: &'static str = "before the first stride";
    /// What an operator is told when nothing has happened that a person must look at: a batch begins.
    pub const NEW_START: &'static str = "a new start";
}
