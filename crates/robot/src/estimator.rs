//! Where a robot is, from what it can measure itself.

use std::any::Any;

use rand_chacha::ChaCha8Rng;

use crate::command::JointTargets;
use crate::error::RobotError;
use crate::kinematics::{KinematicModel, inverse, of_rotation_vector, product, rotation_vector};
use crate::legs::{LegRole, Legs, Side};
use crate::machine::{Machine, SensorFrame};
use crate::robot::{JointDescription, Robot, RobotDescription};
use crate::shape::{Pose, Shape};
use crate::state::{BaseState, CentreOfMass, FootState, RobotState};

/// A foot becomes the one that stands still when it carries more than this share of the load.
const ANCHOR_SHARE: f64 = 0.6;
/// Gravity, for the weight on a foot that no sensor feels.
const GRAVITY_M_S2: f64 = 9.81;
/// Time constant with which the attitude follows the inertial unit's angles; within it the gyroscope
/// leads. A noise of 0.2 deg at 125 Hz becomes one of 0.04 deg; a gyroscope that is off by 0.5 deg/s
/// turns the attitude by 0.05 deg.
const ATTITUDE_FILTER_S: f64 = 0.1;

/// Estimates a [`RobotState`] from joint angles, an inertial unit, foot loads and a kinematic model.
///
/// The world is anchored at the foot that carries the load: its sole is taken to stand still on the
/// floor, so that
///
/// ```text
/// base = anchor − R(imu) · sole(joints),   com = base + R(imu) · com(joints),   v = Δcom / Δt
/// ```
///
/// The attitude is that of the inertial unit, smoothed by its gyroscope (a complementary filter): with
/// the plain angles a section is found more often where noise has just moved the mass inwards, so that
/// the mean of `ψ_roll` was 0.19 deg above the truth on the small humanoid.
///
/// When the load passes to the other foot, the anchor passes to where that foot's sole is then
/// (leg odometry; height 0). The velocity is the plain difference of two ticks: whoever needs less noise
/// filters it, and knows with what delay. The centre of pressure lies between the soles' centres, by the
/// share of the load. Slip, soft soles and biases of the sensors go unseen, as they do on a real robot.
#[derive(Clone, Debug)]
pub struct Estimator {
    model: KinematicModel,
    legs: Legs<Option<LegRole>>,
    rest_rad: Vec<f64>,
    anchor: Option<(Side, [f64; 2])>,
    state: RobotState,
    angles_rad: Vec<f64>,
    attitude: Option<Attitude>,
    attitude_filter_s: f64,
    /// Without force sensors: how much higher the foot that stands must be until the other stands.
    hysteresis_m: Option<f64>,
}

/// The attitude and rate at the last reading.
#[derive(Clone, Copy, Debug)]
struct Attitude {
    time_s: f64,
    orientation: [f64; 4],
    rate_rad_s: [f64; 3],
}

impl Attitude {
    /// The attitude after one more reading.
    fn next(before: Option<Self>, frame: &SensorFrame, filter_s: f64) -> Self {
        let (time_s, rate_rad_s) = (frame.time_s, frame.angular_velocity_rad_s);
        let orientation = match before {
            Some(before) if time_s > before.time_s && filter_s > 0.0 => {
                let dt_s = time_s - before.time_s;
                let turned = [0, 1, 2].map(|k| 0.5 * dt_s * (before.rate_rad_s[k] + rate_rad_s[k]));
                let predicted = product(before.orientation, of_rotation_vector(turned));
                let error = rotation_vector(product(inverse(predicted), frame.orientation));
                let share = dt_s / (filter_s + dt_s);
                product(predicted, of_rotation_vector(error.map(|e| share * e)))
            }
            _ => frame.orientation,
        };
        Self { time_s, orientation, rate_rad_s }
    }
}

impl Estimator {
    /// An estimator that has seen nothing, for a robot with these leg joints and this rest posture.
    ///
    /// # Errors
    ///
    /// [`RobotError::Kinematics`] if model and posture have different numbers of joints.
    pub fn new(model: KinematicModel, legs: Legs<Option<LegRole>>, rest_rad: Vec<f64>) -> Result<Self, RobotError> {
        if model.joints() != rest_rad.len() {
            return Err(RobotError::Kinematics { what: "another number of joints than the rest posture" });
        }
        Ok(Self {
            model,
            legs,
            rest_rad,
            anchor: None,
            state: RobotState::default(),
            angles_rad: Vec::new(),
            attitude: None,
            attitude_filter_s: ATTITUDE_FILTER_S,
            hysteresis_m: None,
        })
    }

    /// For a robot without force sensors: the lower foot is the one that stands, until it is higher than the other by
    /// `hysteresis_m`; it carries the whole weight. The attitude is taken as it is told.
    #[must_use]
    pub fn without_forces(self, hysteresis_m: f64) -> Self {
        Self { attitude_filter_s: 0.0, hysteresis_m: Some(hysteresis_m), ..self }
    }

    /// The kinematic model.
    #[must_use]
    pub const fn model(&self) -> &KinematicModel {
        &self.model
    }

    /// The newest estimate.
    #[must_use]
    pub const fn state(&self) -> &RobotState {
        &self.state
    }

    /// Forgets everything seen; the world begins anew, midway between the feet.
    pub fn reset(&mut self) {
        self.anchor = None;
        self.attitude = None;
        self.state = RobotState::default();
    }

    /// Takes the newest reading.
    ///
    /// # Errors
    ///
    /// [`RobotError::BadState`] if a number is not finite, [`RobotError::CommandLength`] if the
    /// reading is not one per joint; the estimate is then unchanged.
    pub fn update(&mut self, frame: &SensorFrame) -> Result<&RobotState, RobotError> {
        if let Some(field) = frame.first_not_finite() {
            return Err(RobotError::BadState { time_s: frame.time_s, field });
        }
        if frame.joints.len() != self.model.joints() {
            return Err(RobotError::CommandLength { expected: self.model.joints(), found: frame.joints.len() });
        }
        self.angles_rad.clear();
        self.angles_rad.extend(frame.joints.iter().map(|j| j.position_rad));
        let attitude = Attitude::next(self.attitude, frame, self.attitude_filter_s);
        self.attitude = Some(attitude);
        let placed = self.model.place(&self.angles_rad, attitude.orientation);
        let loads_n = match self.hysteresis_m {
            None => frame.loads_n,
            Some(hysteresis_m) => {
                let [left_m, right_m] = placed.soles_m.map(|sole| sole[2]);
                let before = self.anchor.map(|(side, _)| side);
                let least = if before.is_some() { hysteresis_m } else { 0.0 };
                let left = match before {
                    Some(Side::Right) => left_m < right_m - least,
                    _ => left_m <= right_m + least,
                };
                let weight_n = self.model.mass_kg() * GRAVITY_M_S2;
                if left { [weight_n, 0.0] } else { [0.0, weight_n] }
            }
        };
        let [left, right] = loads_n.map(|load| load.max(0.0));
        let share = (left + right > 0.0).then(|| right / (left + right));

        let first = self.anchor.is_none();
        let (mut side, mut at) = self.anchor.unwrap_or_else(|| {
            // The world's origin lies midway between the soles.
            let [l, r] = placed.soles_m;
            let side = if share.is_some_and(|s| s > 0.5) { Side::Right } else { Side::Left };
            let sign = side.lateral_sign();
            (side, [0, 1].map(|k| 0.5 * sign * (l[k] - r[k])))
        });
        let on = match (side, share) {
            (Side::Left, Some(s)) if s > ANCHOR_SHARE => Side::Right,
            (Side::Right, Some(s)) if s < 1.0 - ANCHOR_SHARE => Side::Left,
            _ => side,
        };
        if on != side {
            let (from, to) = (placed.soles_m[side.index()], placed.soles_m[on.index()]);
            at = [0, 1].map(|k| at[k] + to[k] - from[k]);
            side = on;
        }
        self.anchor = Some((side, at));

        let sole = placed.soles_m[side.index()];
        let base_m = [at[0] - sole[0], at[1] - sole[1], -sole[2]];
        let world = |point: [f64; 3]| [0, 1, 2].map(|k| base_m[k] + point[k]);
        let com_m = world(placed.com_m);
        let dt_s = frame.time_s - self.state.time_s;
        let velocity_m_s = if first || dt_s <= 0.0 {
            [0.0; 3]
        } else {
            [0, 1, 2].map(|k| (com_m[k] - self.state.com.position_m[k]) / dt_s)
        };
        let feet = [0, 1].map(|i| FootState { centre_m: world(placed.soles_m[i]), load_n: loads_n[i] });
        let mut joints = std::mem::take(&mut self.state.joints);
        joints.clone_from(&frame.joints);
        self.state = RobotState {
            time_s: frame.time_s,
            joints,
            base: BaseState {
                position_m: base_m,
                orientation: attitude.orientation,
                angular_velocity_rad_s: frame.angular_velocity_rad_s,
            },
            com: CentreOfMass { position_m: com_m, velocity_m_s },
            cop_m: share.map(|s| {
                let [l, r] = feet.map(|f: FootState| f.centre_m);
                [0, 1].map(|k| (1.0 - s) * l[k] + s * r[k])
            }),
            feet,
        };
        Ok(&self.state)
    }
}

/// A [`Robot`] made of a [`Machine`] and an [`Estimator`]: the same code whether the machine is
/// simulated in this process, simulated in another, or real.
pub struct EstimatedRobot<M> {
    machine: M,
    estimator: Estimator,
    description: RobotDescription,
    command_rad: Vec<f64>,
}

impl<M: Machine> EstimatedRobot<M> {
    /// Puts an estimator on a machine.
    ///
    /// # Errors
    ///
    /// [`RobotError::Kinematics`] if they have different numbers of joints.
    pub fn new(machine: M, estimator: Estimator) -> Result<Self, RobotError> {
        let own = machine.description();
        if own.joint_names.len() != estimator.model.joints() {
            return Err(RobotError::Kinematics { what: "another number of joints than the robot" });
        }
        let description = RobotDescription {
            name: own.name.clone(),
            control_period_s: own.control_period_s,
            mass_kg: estimator.model.mass_kg(),
            joints: (own.joint_names.iter().zip(&own.limits))
                .zip(&estimator.rest_rad)
                .map(|((name, limits), rest_rad)| JointDescription {
                    name: name.clone(),
                    limits: *limits,
                    rest_rad: *rest_rad,
                })
                .collect(),
            legs: estimator.legs,
        };
        Ok(Self { machine, estimator, description, command_rad: Vec::new() })
    }

    /// Takes the angles of targets. A machine takes nothing else.
    fn take(&mut self, targets: &JointTargets) -> Result<(), RobotError> {
        self.description.check(targets)?;
        for (command, joint) in targets.joints.iter().zip(&self.description.joints) {
            if let Some(what) = command.beyond_position() {
                let joint = joint.name.clone();
                return Err(RobotError::JointCannot { joint, what });
            }
        }
        self.command_rad.clear();
        let angles = targets.joints.iter().map(|command| command.position_rad);
        self.command_rad.extend(angles);
        Ok(())
    }

    /// The machine inside.
    #[must_use]
    pub const fn machine(&self) -> &M {
        &self.machine
    }
}

impl<M: Machine + 'static> Robot for EstimatedRobot<M> {
    fn description(&self) -> &RobotDescription {
        &self.description
    }

    fn reset(&mut self, posture: &JointTargets, rng: &mut ChaCha8Rng) -> Result<&RobotState, RobotError> {
        self.take(posture)?;
        let frame = self.machine.reset(&self.command_rad, rng)?;
        self.estimator.reset();
        self.estimator.update(frame)
    }

    fn state(&self) -> &RobotState {
        self.estimator.state()
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        self.take(targets)?;
        let frame = self.machine.step(&self.command_rad)?;
        self.estimator.update(frame)
    }

    fn true_state(&self) -> Option<&RobotState> {
        self.machine.true_state()
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        self.machine.set_push(force_n)
    }

    fn push_on(&mut self, body: &str) -> Result<(), RobotError> {
        self.machine.push_on(body)
    }

    fn take_over(&mut self, from: &dyn Robot) -> Result<(), RobotError> {
        let other = from.as_any().and_then(|other| other.downcast_ref::<Self>());
        let other = other.ok_or(RobotError::Unsupported { what: "taking over from a robot of another kind" })?;
        self.machine.take_over(&other.machine)?;
        self.estimator = other.estimator.clone();
        Ok(())
    }

    fn as_any(&self) -> Option<&dyn Any> {
        Some(self)
    }

    fn engine_seconds(&self) -> Option<f64> {
        self.machine.engine_seconds()
    }

    fn geometry(&self) -> Vec<Shape> {
        self.machine.geometry()
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        self.machine.poses(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A base that turns about x at a constant rate, its gyroscope exact, its angles off by ±1 deg in
    /// turn: the attitude follows the turn, and the noise is divided by 2 τ/dt (up to second order).
    #[test]
    fn the_gyroscope_smooths_the_attitude_without_delaying_it() {
        let (rate, dt_s) = (0.5, 0.008);
        let mut attitude = None;
        for k in 0..500 {
            let time_s = f64::from(k) * dt_s;
            let noise = if k % 2 == 0 { 1_f64 } else { -1.0 }.to_radians();
            let frame = SensorFrame {
                time_s,
                orientation: of_rotation_vector([rate * time_s + noise, 0.0, 0.0]),
                angular_velocity_rad_s: [rate, 0.0, 0.0],
                ..SensorFrame::default()
            };
            attitude = Some(Attitude::next(attitude, &frame, ATTITUDE_FILTER_S));
            let off = rotation_vector(attitude.unwrap().orientation)[0] - rate * time_s;
            if k > 200 {
                assert!(off.abs().to_degrees() < 1.1 * 0.5 * dt_s / ATTITUDE_FILTER_S, "{off}");
            }
        }
    }
}
