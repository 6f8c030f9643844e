//! The robot's own guard: what it does with commands, and without them.

use serde::{Deserialize, Serialize};
use stridemap_robot::{JointLimits, JointState, hold_to_limits};

use crate::trajectory::{Trajectory, TrajectoryFault};

/// Bounds of a [`CommandGuard`], in robot time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GuardBounds {
    /// Without a command for this long the robot holds its last one.
    pub hold_after_s: f64,
    /// Without a command for this long it damps: it gives way.
    pub damp_after_s: f64,
    /// A command that answers a state older than this is stale.
    pub stale_s: f64,
    /// A writer that was silent for this long may be followed by another.
    pub writer_s: f64,
}

impl Default for GuardBounds {
    fn default() -> Self {
        Self { hold_after_s: 0.05, damp_after_s: 0.5, stale_s: 0.05, writer_s: 1.0 }
    }
}

/// How often the guard stepped in since the robot was switched on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusals {
    /// Commands with NaN or an infinity.
    pub not_finite: u64,
    /// Commands with too few or too many numbers.
    pub wrong_length: u64,
    /// Commands of a second writer.
    pub second_writer: u64,
    /// Commands that answer a state that is too old, or from the future.
    pub stale: u64,
    /// Heartbeats whose sequence or stamp did not advance: duplicated, reordered, or of a clock that ran
    /// backwards.
    pub out_of_order: u64,
    /// Commands while the emergency stop was latched.
    pub stopped: u64,
    /// Joint commands moved into the joint's range.
    pub position_clamped: u64,
    /// Joint commands held back to the joint's rate.
    pub rate_limited: u64,
    /// Joint commands eased because the joint pushed harder than it may.
    pub torque_limited: u64,
    /// Times the robot began to hold for want of commands.
    pub holds: u64,
    /// Times it began to damp.
    pub damps: u64,
    /// Emergency stops.
    pub stops: u64,
}

impl Refusals {
    /// Why a stride in which the counts grew from `before` to these is spoiled; `None` if it is not. Clamped
    /// commands do not spoil it (they are what the robot was made to do), nor do heartbeats that came twice.
    #[must_use]
    pub fn spoil(&self, before: &Self) -> Option<String> {
        let more = |now: u64, then: u64| now.saturating_sub(then);
        [
            (more(self.second_writer, before.second_writer), "somebody else commands the robot as well"),
            (more(self.stale, before.stale), "the robot refused commands that came too late"),
            (more(self.holds, before.holds) + more(self.damps, before.damps), "the robot had no commands and held"),
            (
                more(self.wrong_length, before.wrong_length) + more(self.not_finite, before.not_finite),
                "the robot refused commands that were no good",
            ),
            (more(self.stops, before.stops) + more(self.stopped, before.stopped), "the emergency stop was pressed"),
        ]
        .into_iter()
        .find(|(times, _)| *times > 0)
        .map(|(times, what)| format!("{what} ({times} times)"))
    }
}

/// What the servos are to do in the next period.
#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// Follow this command.
    Follow(Vec<f64>),
    /// Hold this one: commands are missing.
    Hold(Vec<f64>),
    /// Give way: follow the measured angles, so that only friction and damping resist.
    Damp,
}

/// Who writes, and when he last did.
#[derive(Clone, Copy, Debug)]
struct Writer {
    id: u128,
    last_s: f64,
}

/// What was asked for last.
#[derive(Clone, Debug)]
enum Wanted {
    /// A posture, and when it was asked for.
    Posture(f64, Vec<f64>),
    /// A trajectory, and where it started from, once it has.
    Way(Trajectory, Option<Vec<f64>>),
}

impl Wanted {
    /// Until when it tells the robot what to do.
    fn until_s(&self) -> f64 {
        match self {
            Self::Posture(at_s, _) => *at_s,
            Self::Way(trajectory, _) => trajectory.end_s(),
        }
    }
}

/// Stands between the network and the servos: pure logic, no clock and no network of its own.
///
/// - A command must be finite, one number per joint, from the one writer, and not stale.
/// - It is clamped to each joint's range, then to what its rate allows from the last command; the first
///   after a hold, a stop or a start counts from the measured angles. Where a joint pushes harder than it
///   may, its command is eased ([`JointLimits::hold`]).
/// - A trajectory is a command that lasts until its end; silence begins there.
/// - Heartbeats must advance in sequence and stamp. A writer that sends none is obeyed by its commands
///   alone; one that has sent any is held to them.
/// - Silence: hold, then damp. An emergency stop damps at once and latches until it is re-armed.
#[derive(Clone, Debug)]
pub struct CommandGuard {
    bounds: GuardBounds,
    limits: Vec<JointLimits>,
    writer: Option<Writer>,
    heartbeat: Option<(u64, u64, u128)>,
    wanted: Option<Wanted>,
    acting: Option<Vec<f64>>,
    silent: Silence,
    stopped: Option<String>,
    refusals: Refusals,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Silence {
    None,
    Holding,
    Damping,
}

impl CommandGuard {
    /// A guard for joints with these limits.
    #[must_use]
    pub fn new(limits: Vec<JointLimits>, bounds: GuardBounds) -> Self {
        Self {
            bounds,
            limits,
            writer: None,
            heartbeat: None,
            wanted: None,
            acting: None,
            silent: Silence::None,
            stopped: None,
            refusals: Refusals::default(),
        }
    }

    /// How often it stepped in.
    #[must_use]
    pub const fn refusals(&self) -> Refusals {
        self.refusals
    }

    /// Why the emergency stop is latched, if it is.
    #[must_use]
    pub fn stopped(&self) -> Option<&str> {
        self.stopped.as_deref()
    }

    /// Whether somebody commanded within the writer's time.
    #[must_use]
    pub fn has_writer(&self, now_s: f64) -> bool {
        self.writer.is_some_and(|w| now_s - w.last_s <= self.bounds.writer_s)
    }

    /// Time since the last accepted command; `None` before the first.
    #[must_use]
    pub fn silence_s(&self, now_s: f64) -> Option<f64> {
        self.wanted.as_ref().map(|w| (now_s - w.until_s()).max(0.0))
    }

    /// The stamp, in nanoseconds, of the state that the newest heartbeat answers.
    #[must_use]
    pub fn answered(&self) -> Option<u64> {
        self.heartbeat.map(|(_, stamp, _)| stamp)
    }

    /// Takes a heartbeat: a sequence number, and the stamp of the state that is being answered.
    pub fn heartbeat(&mut self, writer: u128, sequence: u64, stamp_ns: u64) {
        if let Some((last_sequence, last_stamp, of)) = self.heartbeat
            && of == writer
            && (sequence <= last_sequence || stamp_ns < last_stamp)
        {
            self.refusals.out_of_order += 1;
            return;
        }
        if self.writer.is_none_or(|w| w.id == writer) || self.heartbeat.is_none() {
            self.heartbeat = Some((sequence, stamp_ns, writer));
        }
    }

    /// Whether somebody may command: not while stopped, not a second one, not late.
    fn admits(&mut self, now_s: f64, writer: u128) -> bool {
        if self.stopped.is_some() {
            self.refusals.stopped += 1;
            return false;
        }
        let other = self.writer.is_some_and(|w| w.id != writer && now_s - w.last_s <= self.bounds.writer_s);
        if other {
            self.refusals.second_writer += 1;
            return false;
        }
        if let Some((_, stamp_ns, of)) = self.heartbeat
            && of == writer
        {
            let age_s = now_s - stamp_ns as f64 * 1e-9;
            // Half a microsecond: stamps are whole nanoseconds.
            if age_s > self.bounds.stale_s || age_s < -5e-7 {
                self.refusals.stale += 1;
                return false;
            }
        }
        true
    }

    /// Takes a command; tells whether it will be followed.
    pub fn command(&mut self, now_s: f64, writer: u128, command_rad: &[f64]) -> bool {
        if command_rad.len() != self.limits.len() {
            self.refusals.wrong_length += 1;
            return false;
        }
        if command_rad.iter().any(|v| !v.is_finite()) {
            self.refusals.not_finite += 1;
            return false;
        }
        if !self.admits(now_s, writer) {
            return false;
        }
        self.writer = Some(Writer { id: writer, last_s: now_s });
        self.wanted = Some(Wanted::Posture(now_s, command_rad.to_vec()));
        true
    }

    /// Takes a trajectory; tells whether it will be followed.
    pub fn trajectory(&mut self, now_s: f64, writer: u128, trajectory: Trajectory) -> bool {
        match trajectory.check(self.limits.len()) {
            Err(TrajectoryFault::WrongLength) => {
                self.refusals.wrong_length += 1;
                return false;
            }
            Err(TrajectoryFault::NotFinite) => {
                self.refusals.not_finite += 1;
                return false;
            }
            Err(TrajectoryFault::Times) => {
                self.refusals.out_of_order += 1;
                return false;
            }
            Ok(()) => {}
        }
        let over = now_s - trajectory.end_s() > self.bounds.stale_s;
        if over || trajectory.start_s - now_s > self.bounds.writer_s {
            self.refusals.stale += 1;
            return false;
        }
        if !self.admits(now_s, writer) {
            return false;
        }
        self.writer = Some(Writer { id: writer, last_s: trajectory.end_s().max(now_s) });
        self.wanted = Some(Wanted::Way(trajectory, None));
        true
    }

    /// Presses the emergency stop.
    pub fn stop(&mut self, reason: &str) {
        if self.stopped.is_none() {
            self.refusals.stops += 1;
            self.stopped = Some(reason.to_owned());
        }
        self.wanted = None;
        self.acting = None;
    }

    /// Re-arms after an emergency stop, by hand. The next command counts from the measured angles.
    pub fn rearm(&mut self) {
        self.stopped = None;
        self.forget();
    }

    /// Forgets commands and writers: the robot was set up anew.
    pub fn forget(&mut self) {
        self.wanted = None;
        self.acting = None;
        self.writer = None;
        self.heartbeat = None;
        self.silent = Silence::None;
    }

    /// What the servos do in the period that begins now. `measured` are the joints as last read, `period_s`
    /// its length.
    pub fn act(&mut self, now_s: f64, period_s: f64, measured: &[JointState]) -> Act {
        if self.stopped.is_some() {
            return Act::Damp;
        }
        let here = || measured.iter().map(|j| j.position_rad).collect::<Vec<_>>();
        let Some(silence_s) = self.silence_s(now_s) else {
            // Nothing was ever asked: stand as you are.
            return Act::Hold(self.acting.get_or_insert_with(here).clone());
        };
        let silent = if silence_s > self.bounds.damp_after_s {
            Silence::Damping
        } else if silence_s > self.bounds.hold_after_s {
            Silence::Holding
        } else {
            Silence::None
        };
        if silent > self.silent {
            match silent {
                Silence::Damping => self.refusals.damps += 1,
                Silence::Holding | Silence::None => self.refusals.holds += 1,
            }
        }
        let was = std::mem::replace(&mut self.silent, silent);
        match silent {
            Silence::Damping => {
                self.acting = None;
                return Act::Damp;
            }
            Silence::Holding => {
                return Act::Hold(self.acting.get_or_insert_with(here).clone());
            }
            Silence::None => {}
        }
        let from = match (&self.acting, was) {
            (Some(acting), Silence::None) => acting.clone(),
            _ => here(),
        };
        let wanted = match &mut self.wanted {
            Some(Wanted::Posture(_, posture)) => posture.clone(),
            Some(Wanted::Way(trajectory, begun)) => trajectory.at(now_s, begun.get_or_insert_with(|| from.clone())),
            None => from.clone(),
        };
        let (next, held) = hold_to_limits(&wanted, &from, measured, &self.limits, period_s);
        self.refusals.position_clamped += held.position_clamped;
        self.refusals.rate_limited += held.rate_limited;
        self.refusals.torque_limited += held.torque_limited;
        self.acting = Some(next.clone());
        Act::Follow(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.008;

    /// Joints at rest at these angles.
    fn at(angles: &[f64]) -> Vec<JointState> {
        let joint = |&position_rad| JointState { position_rad, ..JointState::default() };
        angles.iter().map(joint).collect()
    }

    fn guard() -> CommandGuard {
        let limits = JointLimits { lower_rad: -1.0, upper_rad: 1.0, velocity_rad_s: 5.0, torque_nm: 1.0 };
        CommandGuard::new(vec![limits; 2], GuardBounds::default())
    }

    #[test]
    fn silence_holds_then_damps_and_a_command_wakes_it_from_the_measured_angles() {
        let mut guard = guard();
        assert!(guard.command(0.0, 1, &[0.01, 0.02]));
        assert_eq!(guard.act(0.0, PERIOD_S, &at(&[0.0; 2])), Act::Follow(vec![0.01, 0.02]));
        assert_eq!(guard.act(0.048, PERIOD_S, &at(&[0.0; 2])), Act::Follow(vec![0.01, 0.02]));
        assert_eq!(guard.act(0.056, PERIOD_S, &at(&[0.0; 2])), Act::Hold(vec![0.01, 0.02]));
        assert_eq!(guard.act(0.5, PERIOD_S, &at(&[0.0; 2])), Act::Hold(vec![0.01, 0.02]));
        assert_eq!(guard.act(0.508, PERIOD_S, &at(&[0.3, 0.3])), Act::Damp);
        assert!(guard.command(0.6, 1, &[0.0, 0.32]));
        let Act::Follow(next) = guard.act(0.6, PERIOD_S, &at(&[0.3, 0.3])) else {
            panic!("follows again");
        };
        assert!((next[0] - 0.26).abs() < 1e-12 && (next[1] - 0.32).abs() < 1e-12);
        let r = guard.refusals();
        assert_eq!((r.holds, r.damps, r.rate_limited), (1, 1, 1));
    }

    #[test]
    fn bad_commands_are_refused_and_counted() {
        let mut guard = guard();
        assert!(!guard.command(0.0, 1, &[0.0]));
        assert!(!guard.command(0.0, 1, &[0.0, f64::NAN]));
        assert!(!guard.command(0.0, 1, &[0.0, f64::INFINITY]));
        assert!(guard.command(0.0, 1, &[0.0, 3.0]));
        assert!(!guard.command(0.5, 2, &[0.0, 0.0]), "a second writer");
        assert!(guard.command(2.0, 2, &[0.0, 0.9]), "the first is gone");
        let Act::Follow(next) = guard.act(2.0, PERIOD_S, &at(&[0.0, 0.9])) else {
            panic!("follows");
        };
        assert!((next[1] - 0.9).abs() < 1e-12);
        let r = guard.refusals();
        assert_eq!((r.wrong_length, r.not_finite, r.second_writer), (1, 2, 1));
    }

    #[test]
    fn heartbeats_must_advance_and_a_stale_answer_is_refused() {
        let mut guard = guard();
        guard.heartbeat(1, 5, 1_000_000_000);
        assert!(guard.command(1.008, 1, &[0.0; 2]));
        guard.heartbeat(1, 5, 1_000_000_000);
        guard.heartbeat(1, 6, 900_000_000);
        assert_eq!(guard.refusals().out_of_order, 2);
        assert!(!guard.command(1.1, 1, &[0.0; 2]), "answers a state of 0.1 s ago");
        guard.heartbeat(1, 7, 9_000_000_000);
        assert!(!guard.command(1.2, 1, &[0.0; 2]), "answers a state of the future");
        assert_eq!(guard.refusals().stale, 2);
    }

    #[test]
    fn the_emergency_stop_latches_until_it_is_rearmed() {
        let mut guard = guard();
        assert!(guard.command(0.0, 1, &[0.0; 2]));
        guard.stop("button");
        guard.stop("again");
        assert_eq!(guard.act(0.0, PERIOD_S, &at(&[0.1; 2])), Act::Damp);
        assert!(!guard.command(0.01, 1, &[0.0; 2]));
        assert_eq!(guard.stopped(), Some("button"));
        guard.rearm();
        assert_eq!(guard.act(0.02, PERIOD_S, &at(&[0.1; 2])), Act::Hold(vec![0.1; 2]));
        assert!(guard.command(0.02, 1, &[0.1; 2]));
        assert_eq!((guard.refusals().stops, guard.refusals().stopped), (1, 1));
    }

    #[test]
    fn a_joint_that_pushes_too_hard_is_eased() {
        let mut guard = guard();
        let mut strained = at(&[0.0, 0.0]);
        assert!(guard.command(0.0, 1, &[0.03, 0.03]));
        guard.act(0.0, PERIOD_S, &strained);
        // The first joint is blocked and makes 2 N m at 0.03 rad: 0.015 rad make the 1 N m it may.
        strained[0].torque_nm = 2.0;
        assert!(guard.command(0.008, 1, &[0.03, 0.03]));
        let Act::Follow(next) = guard.act(0.008, PERIOD_S, &strained) else {
            panic!("follows");
        };
        assert!((next[0] - 0.015).abs() < 1e-15 && (next[1] - 0.03).abs() < 1e-15);
        assert_eq!(guard.refusals().torque_limited, 1);
    }

    #[test]
    fn a_trajectory_is_followed_to_its_end_and_then_held() {
        let mut guard = guard();
        let way = Trajectory { start_s: 0.0, points: vec![(1.0, vec![Some(0.5), None])] };
        assert!(guard.trajectory(0.0, 1, way.clone()));
        assert!(!guard.trajectory(0.0, 1, Trajectory { points: vec![], ..way.clone() }));
        let mut now_s = 0.0;
        let mut joints = at(&[0.0, 0.2]);
        while now_s < 1.0 {
            let Act::Follow(next) = guard.act(now_s, PERIOD_S, &joints) else {
                panic!("follows at {now_s}");
            };
            assert!((next[0] - 0.5 * now_s).abs() < 1e-9, "{now_s}: {}", next[0]);
            assert!((next[1] - 0.2).abs() < 1e-15);
            assert!(!guard.command(now_s, 2, &[0.0; 2]), "it has a writer");
            joints = at(&next);
            now_s += PERIOD_S;
        }
        guard.act(1.04, PERIOD_S, &joints);
        assert!(matches!(guard.act(1.06, PERIOD_S, &joints), Act::Hold(_)));
        assert_eq!(guard.act(1.6, PERIOD_S, &joints), Act::Damp);
        assert!(!guard.trajectory(2.6, 1, way), "it is over");
        assert_eq!(guard.refusals().stale, 1);
    }

    #[test]
    fn a_hold_and_a_refusal_spoil_a_stride_a_clamp_does_not() {
        let before = Refusals::default();
        let clamped = Refusals { position_clamped: 3, out_of_order: 2, ..before };
        assert_eq!(clamped.spoil(&before), None);
        let held = Refusals { holds: 1, ..before };
        assert!(held.spoil(&before).unwrap().contains("held"));
        assert_eq!(held.spoil(&held), None);
    }
}
