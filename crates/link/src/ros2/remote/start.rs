//! A start: the robot is found, looked at, set up, heard, and brought to its posture.

use std::time::{Duration, Instant};

use stridemap_robot::{BaseState, RobotError};

use super::RemoteMachine;
use crate::messages::{Float64MultiArray, RosMessage, Text};
use crate::ros2::node::drain;
use crate::ros2::readings::Readings;

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
/// An angle that needs no ramp: encoders are off by as much.
const NEAR_RAD: f64 = 0.05;

impl RemoteMachine {
    /// Finds the robot: all its topics, and somebody to hear the commands.
    fn connect(&mut self) -> Result<(), RobotError> {
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        let mut heard = false;
        while Instant::now() < deadline {
            heard |= match self.gather() {
                Err(RobotError::Link { what, .. }) => {
                    let misfits = self.wire.readings.misfits(&self.wire.node, &self.config);
                    return Err(self.fault(what + &misfits));
                }
                other => other?,
            };
            self.obey_halt()?;
            let listeners = [
                self.wire.commands.get_subscription_count(self.wire.node.node()),
                self.wire.heartbeat.get_subscription_count(self.wire.node.node()),
            ];
            let ready = !self.config.sets_itself_up
                || (listeners[1] > 0
                    && self.wire.set_up.get_subscription_count(self.wire.node.node()) > 0
                    && self.wire.readings.status_is_told(&self.wire.node));
            if heard && listeners[0] > 0 && ready {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        self.lost = true;
        let told = self.wire.readings.heard(&self.wire.node, &self.config);
        let listens = self.wire.commands.get_subscription_count(self.wire.node.node());
        let asks = (self.wire.node).asks(&self.config.commands, Float64MultiArray::TYPE, listens);
        let what = match (heard, listens) {
            (false, _) if !self.wire.readings.assembler.heard_any() => {
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
        while !self.wire.readings.assembler.knows_pace() {
            self.wait_periods(1, None)?;
        }
        match self.wire.readings.assembler.off_pace() {
            Some(why) => Err(self.fault(why)),
            None => Ok(()),
        }
    }

    /// Refuses a robot that somebody else commands. The robot's own word counts where it has one; else what is
    /// heard on the commands' topic while this end is silent.
    fn check_nobody_else(&mut self) -> Result<(), RobotError> {
        let deadline = Instant::now() + WRITER_GONE;
        let told = self.wire.readings.status_is_told(&self.wire.node);
        let before = self.wire.readings.statuses;
        loop {
            let _ = drain(&self.wire.others, &mut self.counts.unreadable);
            self.wait_periods(LOOK_PERIODS, None)?;
            let others = !drain(&self.wire.others, &mut self.counts.unreadable).is_empty();
            let status = self.wire.readings.newest_status.as_ref();
            let known = !told || self.wire.readings.statuses > before;
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
            if !self.wire.readings.status_is_told(&self.wire.node) || self.is_heard()? {
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
        let (before, began) = (self.wire.readings.statuses, Instant::now());
        while began.elapsed() < HEARD {
            self.wait_periods(LOOK_PERIODS, Some(&pose))?;
            let status = self.wire.readings.newest_status.as_ref();
            if self.wire.readings.statuses > before && status.is_some_and(|s| s.commanded) {
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

    pub(super) fn tilt_deg(&self) -> f64 {
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
        let before = set_ups(&self.wire.readings);
        let deadline = Instant::now() + Duration::from_secs_f64(self.config.connect_s);
        let mut asked: Option<Instant> = None;
        while Instant::now() < deadline {
            if asked.is_none_or(|at| at.elapsed() > Duration::from_millis(500)) {
                let _ = self.wire.set_up.publish(Text::default());
                asked = Some(Instant::now());
            }
            self.gather()?;
            self.obey_halt()?;
            let now = set_ups(&self.wire.readings);
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
    pub(super) fn start(&mut self, posture: &[f64]) -> Result<(), RobotError> {
        if std::mem::take(&mut self.lost)
            && let Err(error) = self.rejoin()
        {
            self.lost = true;
            return Err(self.fault(error.to_string()));
        }
        self.wire.readings.assembler.clear();
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
