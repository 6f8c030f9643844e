//! A robot that cannot be commanded beyond its limits.

use rand_chacha::ChaCha8Rng;

use crate::error::RobotError;
use crate::legs::{JointTargets, Legs};
use crate::limit::{LimitCounts, within};
use crate::robot::{JointLimits, Robot, RobotDescription};
use crate::shape::{Pose, Shape};
use crate::state::RobotState;

/// What a guard holds a robot to.
#[derive(Clone, Debug, PartialEq)]
pub struct GuardLimits {
    /// Range, rate and torque of each joint.
    pub joints: Legs<JointLimits>,
    /// The emergency stop is pressed when the base tilts further; π for never.
    pub tilt_rad: f64,
    /// The emergency stop is pressed when the robot's clock jumps ahead by more in one period.
    pub clock_gap_s: f64,
}

impl GuardLimits {
    /// The limits that a robot states of itself, no limit on tilt, and a clock gap of ten control periods.
    #[must_use]
    pub fn of(robot: &RobotDescription) -> Self {
        Self {
            joints: robot.limits,
            tilt_rad: std::f64::consts::PI,
            clock_gap_s: 10.0 * robot.control_period_s,
        }
    }
}

/// How often a guard had to step in since it was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct GuardCounts {
    /// Joint commands moved into the joint's range.
    pub position_clamped: u64,
    /// Joint commands held back to the joint's rate.
    pub rate_limited: u64,
    /// Joint commands eased because the joint pushed harder than it may.
    #[serde(default)]
    pub torque_limited: u64,
    /// Commands refused because a target was not finite.
    pub not_finite: u64,
    /// Emergency stops.
    pub emergency_stops: u64,
}

/// A robot behind a guard: targets are kept within each joint's range, rate and torque, and the emergency stop latches
/// when the robot reports nonsense.
///
/// - Targets that are not finite are refused; nothing is sent.
/// - Each target is clamped to its joint's range, then to what the joint's rate allows from the last command
///   sent (after a reset: from the posture; after re-arming: from the measured angle), and eased where the
///   joint pushes harder than it may ([`JointLimits::hold`]).
/// - A state that is not finite, a clock that stands still, runs backwards or jumps, a tilt beyond the limit,
///   and every error of the robot's own press the emergency stop. Until [`rearm`](Self::rearm), every command
///   is refused with [`RobotError::EmergencyStop`], resets included.
///
/// A guard around a robot that obeys its limits changes nothing, to the bit.
///
/// # Example
///
/// ```
/// use stridemap_robot::{Guarded, JointTargets, Robot, RobotError};
///
/// fn shout(robot: &mut Guarded<impl Robot>) -> Result<(), RobotError> {
///     robot.stop("the operator pressed the button");
///     assert!(matches!(
///         robot.step(&JointTargets::default()),
///         Err(RobotError::EmergencyStop { .. })
///     ));
///     robot.rearm();
///     robot.step(&JointTargets::default()).map(|_| ())
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Guarded<R> {
    inner: R,
    limits: GuardLimits,
    /// The command from which rates are measured; `None` until the first reset and after re-arming.
    last: Option<JointTargets>,
    stopped: Option<String>,
    counts: GuardCounts,
}

impl<R: Robot> Guarded<R> {
    /// Guards a robot by the limits it states of itself.
    #[must_use]
    pub fn new(robot: R) -> Self {
        let limits = GuardLimits::of(robot.description());
        Self::with_limits(robot, limits)
    }

    /// Guards a robot by given limits.
    #[must_use]
    pub fn with_limits(robot: R, limits: GuardLimits) -> Self {
        Self {
            inner: robot,
            limits,
            last: None,
            stopped: None,
            counts: GuardCounts::default(),
        }
    }

    /// Presses the emergency stop.
    pub fn stop(&mut self, reason: &str) {
        if self.stopped.is_none() {
            self.stopped = Some(reason.to_owned());
            self.counts.emergency_stops += 1;
        }
    }

    /// Releases the emergency stop. Rates are then measured from where the joints are.
    pub fn rearm(&mut self) {
        self.stopped = None;
        self.last = None;
    }

    /// Why the emergency stop is pressed; `None` if it is not.
    #[must_use]
    pub fn stopped(&self) -> Option<&str> {
        self.stopped.as_deref()
    }

    /// How often the guard had to step in.
    #[must_use]
    pub fn counts(&self) -> GuardCounts {
        self.counts
    }

    /// The robot behind the guard, to look at.
    #[must_use]
    pub fn inner(&self) -> &R {
        &self.inner
    }

    /// The robot behind the guard, to configure; what is sent to it this way is not guarded.
    #[must_use]
    pub fn inner_mut(&mut self) -> &mut R {
        &mut self.inner
    }

    /// The robot without its guard.
    #[must_use]
    pub fn into_inner(self) -> R {
        self.inner
    }

    /// An error while the emergency stop is pressed.
    fn armed(&self) -> Result<(), RobotError> {
        match &self.stopped {
            Some(reason) => Err(RobotError::EmergencyStop {
                reason: reason.clone(),
            }),
            None => Ok(()),
        }
    }

    /// An error for targets that are not finite.
    fn finite(&mut self, targets: &JointTargets) -> Result<(), RobotError> {
        targets.check_finite().inspect_err(|_| {
            self.counts.not_finite += 1;
        })
    }

    /// Targets within range and rate.
    fn limit(&mut self, targets: &JointTargets) -> JointTargets {
        let period_s = self.inner.description().control_period_s;
        let state = self.inner.state();
        let mut counts = LimitCounts::default();
        let position_rad = Legs::from_fn(|side, joint| {
            let measured = &state.joints[(side, joint)];
            let from = match &self.last {
                Some(last) => last.position_rad[(side, joint)],
                None => measured.position_rad,
            };
            let wanted = targets.position_rad[(side, joint)];
            let limits = &self.limits.joints[(side, joint)];
            let (held, one) = limits.hold(wanted, from, measured, period_s);
            counts += one;
            held
        });
        self.counts.position_clamped += counts.position_clamped;
        self.counts.rate_limited += counts.rate_limited;
        self.counts.torque_limited += counts.torque_limited;
        JointTargets { position_rad }
    }

    /// Why the present state must stop the robot, given the time of the state before it.
    fn fault(&self, before_s: Option<f64>) -> Option<String> {
        let state = self.inner.state();
        if let Some(field) = state.first_not_finite() {
            return Some(format!("the robot's {field} is not finite"));
        }
        if let Some(before_s) = before_s {
            let elapsed_s = state.time_s - before_s;
            if elapsed_s <= 0.0 {
                return Some(format!(
                    "the robot's clock went from {before_s} s to {} s",
                    state.time_s
                ));
            }
            if elapsed_s > self.limits.clock_gap_s {
                return Some(format!("nothing was heard for {elapsed_s:.3} s"));
            }
        }
        let tilt_rad = state.base.tilt_rad();
        (tilt_rad > self.limits.tilt_rad).then(|| {
            let [tilt, limit] = [tilt_rad, self.limits.tilt_rad].map(f64::to_degrees);
            format!("tilted by {tilt:.0} deg, the limit is {limit:.0} deg")
        })
    }

    /// Presses the emergency stop for a fault, as an error.
    fn press(&mut self, fault: Option<String>) -> Result<(), RobotError> {
        match fault {
            Some(reason) => {
                self.stop(&reason);
                self.armed()
            }
            None => Ok(()),
        }
    }
}

impl<R: Robot> Robot for Guarded<R> {
    fn description(&self) -> &RobotDescription {
        self.inner.description()
    }

    fn reset(
        &mut self,
        posture: &JointTargets,
        rng: &mut ChaCha8Rng,
    ) -> Result<&RobotState, RobotError> {
        self.armed()?;
        self.finite(posture)?;
        let mut clamped = 0;
        let posture = JointTargets {
            position_rad: Legs::from_fn(|side, joint| {
                let limits = &self.limits.joints[(side, joint)];
                let wanted = posture.position_rad[(side, joint)];
                let within = within(wanted, limits.lower_rad, limits.upper_rad);
                clamped += u64::from((within - wanted).abs() > 0.0);
                within
            }),
        };
        self.counts.position_clamped += clamped;
        if let Err(error) = self.inner.reset(&posture, rng) {
            self.stop(&error.to_string());
            return Err(error);
        }
        self.last = Some(posture);
        let fault = self.fault(None);
        self.press(fault)?;
        Ok(self.inner.state())
    }

    fn state(&self) -> &RobotState {
        self.inner.state()
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        self.armed()?;
        self.finite(targets)?;
        let targets = self.limit(targets);
        let before_s = self.inner.state().time_s;
        if let Err(error) = self.inner.step(&targets) {
            self.stop(&error.to_string());
            return Err(error);
        }
        self.last = Some(targets);
        let fault = self.fault(Some(before_s));
        self.press(fault)?;
        Ok(self.inner.state())
    }

    fn true_state(&self) -> Option<&RobotState> {
        self.inner.true_state()
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        self.inner.set_push(force_n)
    }

    fn engine_seconds(&self) -> Option<f64> {
        self.inner.engine_seconds()
    }

    fn geometry(&self) -> Vec<Shape> {
        self.inner.geometry()
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        self.inner.poses(out);
    }
}
