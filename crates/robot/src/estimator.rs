//! Where a robot is, from what it can measure itself.

use rand_chacha::ChaCha8Rng;

use crate::error::RobotError;
use crate::kinematics::KinematicModel;
use crate::legs::{JointTargets, Side};
use crate::machine::{JointMap, Machine, SensorFrame};
use crate::robot::{Robot, RobotDescription};
use crate::shape::{Pose, Shape};
use crate::state::{BaseState, CentreOfMass, FootState, RobotState};

/// A foot becomes the one that stands still when it carries more than this share of the load.
const ANCHOR_SHARE: f64 = 0.6;

/// Estimates a [`RobotState`] from joint angles, an inertial unit, foot loads and a kinematic model.
///
/// The world is anchored at the foot that carries the load: its sole is taken to stand still on the
/// floor, so that
///
/// ```text
/// base = anchor − R(imu) · sole(joints),   com = base + R(imu) · com(joints),   v = Δcom / Δt
/// ```
///
/// When the load passes to the other foot, the anchor passes to where that foot's sole is then
/// (leg odometry; height 0). The velocity is the plain difference of two ticks: whoever needs less noise
/// filters it, and knows with what delay. The centre of pressure lies between the soles' centres, by the
/// share of the load. Slip, soft soles and biases of the sensors go unseen, as they do on a real robot.
#[derive(Clone, Debug)]
pub struct Estimator {
    model: KinematicModel,
    map: JointMap,
    anchor: Option<(Side, [f64; 2])>,
    state: RobotState,
    angles_rad: Vec<f64>,
}

impl Estimator {
    /// An estimator that has seen nothing.
    ///
    /// # Errors
    ///
    /// [`RobotError::Kinematics`] if model and map belong to machines with different joints.
    pub fn new(model: KinematicModel, map: JointMap) -> Result<Self, RobotError> {
        if model.joints() != map.hold_rad.len() {
            return Err(RobotError::Kinematics {
                what: "another number of joints than the joint map",
            });
        }
        Ok(Self {
            model,
            map,
            anchor: None,
            state: RobotState::default(),
            angles_rad: Vec::new(),
        })
    }

    /// The joint map.
    #[must_use]
    pub const fn map(&self) -> &JointMap {
        &self.map
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
            return Err(RobotError::BadState {
                time_s: frame.time_s,
                field,
            });
        }
        if frame.joints.len() != self.model.joints() {
            return Err(RobotError::CommandLength {
                expected: self.model.joints(),
                found: frame.joints.len(),
            });
        }
        self.angles_rad.clear();
        self.angles_rad
            .extend(frame.joints.iter().map(|j| j.position_rad));
        let placed = self.model.place(&self.angles_rad, frame.orientation);
        let [left, right] = frame.loads_n.map(|load| load.max(0.0));
        let share = (left + right > 0.0).then(|| right / (left + right));

        let first = self.anchor.is_none();
        let (mut side, mut at) = self.anchor.unwrap_or_else(|| {
            // The world's origin lies midway between the soles.
            let [l, r] = placed.soles_m;
            let side = if share.is_some_and(|s| s > 0.5) {
                Side::Right
            } else {
                Side::Left
            };
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
        let feet = [0, 1].map(|i| FootState {
            centre_m: world(placed.soles_m[i]),
            load_n: frame.loads_n[i],
        });
        self.state = RobotState {
            time_s: frame.time_s,
            joints: self.map.legs_of(&frame.joints),
            base: BaseState {
                position_m: base_m,
                orientation: frame.orientation,
                angular_velocity_rad_s: frame.angular_velocity_rad_s,
            },
            com: CentreOfMass {
                position_m: com_m,
                velocity_m_s,
            },
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
}

impl<M: Machine> EstimatedRobot<M> {
    /// Puts an estimator on a machine.
    ///
    /// # Errors
    ///
    /// [`RobotError::Kinematics`] if they have different numbers of joints.
    pub fn new(machine: M, estimator: Estimator) -> Result<Self, RobotError> {
        if machine.joint_names().len() != estimator.model.joints() {
            return Err(RobotError::Kinematics {
                what: "another number of joints than the robot",
            });
        }
        let description = RobotDescription {
            name: machine.name().to_owned(),
            control_period_s: machine.control_period_s(),
            mass_kg: estimator.model.mass_kg(),
            limits: estimator.map.limits_of(machine.limits()),
        };
        Ok(Self {
            machine,
            estimator,
            description,
        })
    }

    /// The machine inside.
    #[must_use]
    pub const fn machine(&self) -> &M {
        &self.machine
    }

    /// The machine inside, to change.
    pub const fn machine_mut(&mut self) -> &mut M {
        &mut self.machine
    }
}

impl<M: Machine> Robot for EstimatedRobot<M> {
    fn description(&self) -> &RobotDescription {
        &self.description
    }

    fn reset(
        &mut self,
        posture: &JointTargets,
        rng: &mut ChaCha8Rng,
    ) -> Result<&RobotState, RobotError> {
        posture.check_finite()?;
        let command = self.estimator.map.command(posture);
        let frame = self.machine.reset(&command, rng)?;
        self.estimator.reset();
        self.estimator.update(frame)
    }

    fn state(&self) -> &RobotState {
        self.estimator.state()
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        targets.check_finite()?;
        let command = self.estimator.map.command(targets);
        let frame = self.machine.step(&command)?;
        self.estimator.update(frame)
    }

    fn true_state(&self) -> Option<&RobotState> {
        self.machine.true_state()
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        self.machine.set_push(force_n)
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
