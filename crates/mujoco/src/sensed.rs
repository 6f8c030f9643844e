//! A simulated robot that knows of itself what its sensors say, and takes gains, rates and torques as the simulation does.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_robot::{
    EstimatedRobot, Estimator, Hold, JointTargets, LEG_JOINTS, LegJoint, Pose, Robot, RobotDescription, RobotError,
    RobotState, SensorFrame, Shape, Side,
};

use crate::changes::ChangesConfig;
use crate::config::MujocoConfig;
use crate::error::MujocoError;
use crate::machine::{SimulatedMachine, estimator};
use crate::payload::{mount, seen_from};
use crate::robot::MujocoRobot;
use crate::rotation::{about_y, about_z, inverse, product, turn};
use crate::sensors::{SensorConfig, SpeedSource, WiringFault};

/// A simulated robot seen through its sensors ([`SensorConfig`]), with the changes that it has ([`ChangesConfig`]).
///
/// ```text
/// gravity g, rates ω in the unit's axes ──▶ roll = atan2(−g_y, −g_z), pitch = atan2(g_x, √(g_y² + g_z²))
/// heading += (ω_y sin roll + ω_z cos roll) / cos pitch · dt
/// base = where the lower foot stands − R · foot(joints)        (the nominal model's kinematics)
/// ```
///
/// [`state`](Robot::state) is what is sensed, [`true_state`](Robot::true_state) the simulator's truth.
pub struct SensedRobot {
    robot: MujocoRobot,
    sensors: SensorConfig,
    noise: f64,
    mount: [f64; 4],
    offset_rad: Vec<f64>,
    estimator: Estimator,
    rng: ChaCha8Rng,
    heading_rad: f64,
    yaw_rate_rad_s: Option<f64>,
    drift_m: [f64; 2],
    targets: JointTargets,
    state: RobotState,
    wiring: Wiring,
}

/// Where readings come from and commands go, with which signs: straight, unless a fault is injected.
#[derive(Clone, Debug)]
struct Wiring {
    fault: Option<WiringFault>,
    readings: Vec<(usize, f64)>,
    commands: Vec<(usize, f64)>,
}

impl Wiring {
    fn new(fault: Option<WiringFault>, robot: &RobotDescription) -> Self {
        let n = robot.joints.len();
        let straight: Vec<(usize, f64)> = (0..n).map(|j| (j, 1.0)).collect();
        let at = |side: Side, joint: LegJoint, else_at: usize| {
            robot.legs[(side, joint)].map_or(else_at.min(n.saturating_sub(1)), |role| role.joint)
        };
        let (hip, knee) = (at(Side::Left, LegJoint::HipPitch, 1), at(Side::Left, LegJoint::Knee, 2));
        let (roll, yaw) = (at(Side::Left, LegJoint::HipRoll, 0), at(Side::Left, LegJoint::HipYaw, 2));
        let (mut readings, mut commands) = (straight.clone(), straight);
        match fault {
            Some(WiringFault::CommandOrder) => commands.swap(hip, knee),
            Some(WiringFault::JointOrder) => {
                readings.swap(roll, yaw);
                commands.swap(roll, yaw);
            }
            Some(WiringFault::LegsExchanged) => {
                for joint in LEG_JOINTS {
                    if let (Some(left), Some(right)) =
                        (robot.legs[(Side::Left, joint)], robot.legs[(Side::Right, joint)])
                    {
                        readings.swap(left.joint, right.joint);
                        commands.swap(left.joint, right.joint);
                    }
                }
            }
            Some(WiringFault::JointSign) => {
                readings[hip].1 = -1.0;
                commands[hip].1 = -1.0;
            }
            Some(WiringFault::ReadingSign) => readings[knee].1 = -1.0,
            _ => {}
        }
        Self { fault, readings, commands }
    }

    fn is(&self, fault: WiringFault) -> bool {
        self.fault == Some(fault)
    }
}

impl SensedRobot {
    /// A robot from a configuration.
    ///
    /// # Errors
    ///
    /// [`MujocoError`], as [`MujocoRobot::new`], and for a model whose kinematics are not a tree of hinges.
    pub fn new(config: &MujocoConfig) -> Result<Self, MujocoError> {
        let robot = MujocoRobot::new(config.clone())?;
        let changes = config.changes.as_ref().map(ChangesConfig::resolved).unwrap_or_default();
        let sensors = config.sensors.clone().unwrap_or_default();
        let mut offset_rad = changes.offsets(&robot.model, &robot.binding.parts())?;
        if sensors.fault == Some(WiringFault::RestPose) {
            for side in Side::BOTH {
                if let Some(knee) = robot.description().legs[(side, LegJoint::Knee)] {
                    offset_rad[knee.joint] += 0.3;
                }
            }
        }
        Ok(Self {
            estimator: estimator(config)?.without_forces(sensors.stance_hysteresis_m),
            mount: mount(changes.imu_pitch_rad.unwrap_or(0.0), changes.imu_roll_rad.unwrap_or(0.0)),
            noise: changes.sensor_noise.unwrap_or(1.0),
            offset_rad,
            state: robot.state().clone(),
            wiring: Wiring::new(sensors.fault, robot.description()),
            robot,
            sensors,
            rng: ChaCha8Rng::seed_from_u64(0),
            heading_rad: 0.0,
            yaw_rate_rad_s: None,
            drift_m: [0.0; 2],
            targets: JointTargets::default(),
        })
    }

    fn normal(&mut self, standard_deviation: f64) -> f64 {
        let z: f64 = StandardNormal.sample(&mut self.rng);
        self.noise * standard_deviation * z
    }

    /// Reads every sensor and estimates the state from them.
    fn sense(&mut self) -> Result<(), RobotError> {
        let truth = self.robot.state();
        let stretch = if self.wiring.is(WiringFault::Rate) { 1.5 } else { 1.0 };
        let (time_s, base) = (stretch * truth.time_s, truth.base);
        let mut joints = truth.joints.clone();
        let down = seen_from(self.mount, turn(inverse(base.orientation), [0.0, 0.0, -1.0]));
        let rates = seen_from(self.mount, base.angular_velocity_rad_s);
        let s = self.sensors.clone();
        let mut gravity = down.map(|g| g + self.normal(s.gravity_noise));
        let mut gyro = rates.map(|w| w + self.normal(s.gyro_noise_rad_s));
        match s.fault {
            Some(WiringFault::GyroAxes) => gyro.swap(0, 1),
            Some(WiringFault::GyroSign) => gyro = gyro.map(|w| -w),
            Some(WiringFault::GyroScale) => gyro = gyro.map(f64::to_degrees),
            Some(WiringFault::GravityInverted) => gravity = gravity.map(|g| -g),
            _ => {}
        }
        for (joint, offset) in joints.iter_mut().zip(self.offset_rad.clone()) {
            joint.position_rad += offset + self.normal(s.joint_noise_rad);
            joint.velocity_rad_s += self.normal(s.joint_rate_noise_rad_s);
        }
        if s.fault.is_some() {
            let straight = joints.clone();
            for (joint, (from, sign)) in joints.iter_mut().zip(&self.wiring.readings) {
                *joint = straight[*from];
                joint.position_rad *= sign;
                joint.velocity_rad_s *= sign;
                if self.wiring.is(WiringFault::RateScale) {
                    joint.velocity_rad_s = joint.velocity_rad_s.to_degrees();
                }
            }
        }
        let roll = (-gravity[1]).atan2(-gravity[2]);
        let pitch = gravity[0].atan2(gravity[1].hypot(gravity[2]));
        let yaw_rate = (gyro[1] * roll.sin() + gyro[2] * roll.cos()) / pitch.cos();
        let dt_s = time_s - self.state.time_s;
        match (self.yaw_rate_rad_s.replace(yaw_rate), s.speed) {
            (Some(before), SpeedSource::StanceLeg) => self.heading_rad += 0.5 * dt_s * (before + yaw_rate),
            _ => self.heading_rad = base.heading_rad(),
        }
        let (sin, cos) = (0.5 * roll).sin_cos();
        let orientation = product(product(about_z(self.heading_rad), about_y(pitch)), [cos, sin, 0.0, 0.0]);
        let frame = SensorFrame { time_s, joints, orientation, angular_velocity_rad_s: gyro, loads_n: [0.0; 2] };
        let mut state = self.estimator.update(&frame)?.clone();
        if s.speed != SpeedSource::StanceLeg {
            let mut place = base.position_m;
            if s.speed == SpeedSource::Odometry {
                let (sin, cos) = self.heading_rad.sin_cos();
                let [ahead, left] = s.odometry_bias_m_s.map(|bias| bias * dt_s);
                self.drift_m[0] += cos * ahead - sin * left;
                self.drift_m[1] += sin * ahead + cos * left;
                place[0] += self.drift_m[0] + self.normal(s.odometry_noise_m);
                place[1] += self.drift_m[1] + self.normal(s.odometry_noise_m);
            }
            let shift = [0, 1].map(|k| place[k] - state.base.position_m[k]);
            let moved = |[x, y, z]: [f64; 3]| [x + shift[0], y + shift[1], z];
            state.base.position_m = moved(state.base.position_m);
            state.com.position_m = moved(state.com.position_m);
            for foot in &mut state.feet {
                foot.centre_m = moved(foot.centre_m);
            }
            state.cop_m = state.cop_m.map(|[x, y]| [x + shift[0], y + shift[1]]);
        }
        self.state = state;
        Ok(())
    }

    /// Targets in the angles of the true joints.
    fn take(&mut self, targets: &JointTargets) {
        self.targets.clone_from(targets);
        if self.sensors.fault.is_some() && targets.joints.len() == self.wiring.commands.len() {
            for (from, (to, sign)) in targets.joints.iter().zip(&self.wiring.commands) {
                self.targets.joints[*to] = *from;
                self.targets.joints[*to].position_rad *= sign;
            }
        }
        for (target, offset) in self.targets.joints.iter_mut().zip(&self.offset_rad) {
            target.position_rad -= offset;
        }
    }
}

impl Robot for SensedRobot {
    fn description(&self) -> &RobotDescription {
        self.robot.description()
    }

    fn reset(&mut self, posture: &JointTargets, rng: &mut ChaCha8Rng) -> Result<&RobotState, RobotError> {
        self.take(posture);
        let targets = std::mem::take(&mut self.targets);
        self.robot.reset(&targets, rng)?;
        self.targets = targets;
        self.rng = ChaCha8Rng::seed_from_u64(rng.random());
        self.estimator.reset();
        self.yaw_rate_rad_s = None;
        self.drift_m = [0.0; 2];
        self.state.time_s = 0.0;
        self.sense()?;
        Ok(&self.state)
    }

    fn state(&self) -> &RobotState {
        &self.state
    }

    fn true_state(&self) -> Option<&RobotState> {
        Some(self.robot.state())
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        self.take(targets);
        let targets = std::mem::take(&mut self.targets);
        let stepped = self.robot.step(&targets).map(|_| ());
        self.targets = targets;
        stepped?;
        self.sense()?;
        Ok(&self.state)
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        self.robot.set_push(force_n)
    }

    fn push_on(&mut self, body: &str) -> Result<(), RobotError> {
        self.robot.push_on(body)
    }

    fn hold(&mut self, hold: Option<Hold>) -> Result<(), RobotError> {
        self.robot.hold(hold)
    }

    fn geometry(&self) -> Vec<Shape> {
        self.robot.geometry()
    }

    fn engine_seconds(&self) -> Option<f64> {
        self.robot.engine_seconds()
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        self.robot.poses(out);
    }
}

impl MujocoConfig {
    /// Builds the robot: the simulation itself, which knows its state; a [`SensedRobot`] where
    /// [`sensors`](Self::sensors) are given; or, where
    /// [`estimated`](Self::estimated) or [`hardware`](Self::hardware) ask for it, a simulated machine whose
    /// state is estimated from its sensors.
    ///
    /// # Errors
    ///
    /// [`MujocoError`], as [`MujocoRobot::new`] and [`kinematic_model`](crate::kinematic_model).
    pub fn build(&self) -> Result<Box<dyn Robot>, MujocoError> {
        if self.sensors.is_some() {
            return Ok(Box::new(SensedRobot::new(self)?));
        }
        if !self.estimated && self.hardware.is_none() {
            return Ok(Box::new(MujocoRobot::new(self.clone())?));
        }
        let robot = EstimatedRobot::new(SimulatedMachine::new(self)?, estimator(self)?)
            .map_err(|e| MujocoError::NotABiped { model: self.model.to_string(), reason: e.to_string() })?;
        Ok(Box::new(robot))
    }
}
