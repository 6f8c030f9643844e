//! The controller's end of the link: a machine that is somewhere else.

mod start;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use ros2_client::{Publisher, Subscription};
use stridemap_robot::{
    JointLimits, Machine, MachineDescription, RobotError, Ros2Config, SensorFrame, check_command, hold_to_limits,
};

use crate::assemble::{self, Assembler, LinkCounts};
use crate::error::LinkError;
use crate::guard::Refusals;
use crate::messages::{Float64MultiArray, Text, UInt64MultiArray};
use crate::operator::{FIRST_START, NEW_START, Operator};
use crate::ros2::node::{LinkNode, NAP, Topics};
use crate::ros2::readings::Readings;
use crate::ros2::stop::{STOP_PERIOD, send_stop};
use crate::ros2::watch::Watch;
use crate::served::Status;
use crate::stream::Unusable;

/// What the controller says and hears.
struct Wire {
    node: LinkNode,
    readings: Readings,
    commands: Publisher<Float64MultiArray>,
    heartbeat: Publisher<UInt64MultiArray>,
    set_up: Publisher<Text>,
    stop: Publisher<Text>,
    /// Ears on the commands' topic: somebody else's are heard while this end is silent.
    others: Subscription<Float64MultiArray>,
}

impl Wire {
    fn open(config: &Ros2Config, assembler: Assembler) -> Result<Self, LinkError> {
        let mut node = LinkNode::open(config, "stridemap_controller")?;
        Ok(Self {
            readings: Readings::open(&mut node, config, assembler)?,
            commands: node.publisher(&config.commands)?,
            heartbeat: node.publisher(Topics::HEARTBEAT)?,
            set_up: node.publisher(Topics::SET_UP)?,
            stop: node.publisher(Topics::STOP)?,
            others: node.sensor(&config.commands)?,
            node,
        })
    }
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
    wire: Wire,
    config: Ros2Config,
    description: MachineDescription,
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

/// How long the robot may take to say that it stopped before it is told by another way.
const STOPPED: Duration = Duration::from_millis(500);

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
        Ok(Self {
            wire: Wire::open(config, assembler)?,
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
        self.wire = Wire::open(&self.config, self.wire.readings.assembler.clone())?;
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
        self.wire.readings.newest_status.as_ref()
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
        let told = self.counts.commands > 0 && self.wire.readings.status_is_told(&self.wire.node);
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
            let _ = self.wire.stop.publish(Text { data: reason.to_owned() });
            std::thread::sleep(STOP_PERIOD);
            // Nothing but the status counts now.
            let _ = self.wire.readings.gather(&mut self.counts);
            let status = self.wire.readings.newest_status.as_ref();
            if status.is_some_and(|s| s.stopped.is_some()) {
                return true;
            }
        }
        false
    }

    /// Takes in what has arrived; whether that made a whole reading newer than the last.
    fn gather(&mut self) -> Result<bool, RobotError> {
        match self.wire.readings.gather(&mut self.counts) {
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
                let what = match self.wire.readings.assembler.missing() {
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
        let Some(status) = &self.wire.readings.newest_status else {
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
        let status = self.wire.readings.newest_status.as_ref();
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
        let stamp = self.wire.readings.last_stamp_ns().unwrap_or(0);
        // What cannot be sent is missed by the robot, whose own guard then holds.
        let _ = self.wire.commands.publish(Float64MultiArray {
            data: self.wire.readings.wiring().write(&next),
            ..Float64MultiArray::default()
        });
        let _ = self
            .wire
            .heartbeat
            .publish(UInt64MultiArray { data: vec![self.sequence, stamp], ..UInt64MultiArray::default() });
        self.sent = Some(next);
        self.sent_at = Some(Instant::now());
    }
}

impl Machine for RemoteMachine {
    fn description(&self) -> &MachineDescription {
        &self.description
    }

    fn reset(&mut self, command_rad: &[f64], _rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.description.joint_names)?;
        let tilt = self.tilt_deg();
        let mut why = match (self.trouble.take(), self.wire.readings.last_stamp_ns()) {
            (Some(trouble), _) => trouble,
            (None, None) => FIRST_START.into(),
            (None, Some(_)) if tilt > self.config.upright_deg => {
                format!("the robot fell (tilted by {tilt:.0} deg)")
            }
            (None, Some(_)) => NEW_START.into(),
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
        self.wire.readings.assembler.zero_ns = self.wire.readings.last_stamp_ns().unwrap_or(0);
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
        let before = self.wire.readings.last_stamp_ns();
        self.send(command_rad);
        self.next_frame()?;
        self.obey_status()?;
        if let (Some(before), Some(now)) = (before, self.wire.readings.last_stamp_ns())
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
