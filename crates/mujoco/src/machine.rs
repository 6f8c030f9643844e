//! A simulated robot seen as a machine: every servo, every sensor, and what hardware does to both.

use std::any::Any;
use std::collections::VecDeque;

use mujoco_rs::wrappers::mj_model::{MjtJoint, MjtObjBase};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_robot::kinematics::about;
use stridemap_robot::{
    Body, BodyPoint, Estimator, Hinge, JointTargets, KinematicModel, Machine, MachineDescription, Pose, Robot,
    RobotError, RobotState, SensorFrame, Shape, check_command,
};

use crate::binding::Binding;
use crate::config::MujocoConfig;
use crate::engine::{allocation, name_of, own_bodies};
use crate::error::MujocoError;
use crate::hardware::{HardwareConfig, Individual};
use crate::robot::MujocoRobot;
use crate::rotation::{product, turn};
use crate::sole;
use crate::store::load;

use mujoco_rs::prelude::MjData;

/// A simulated machine: commands for every joint in, readings of every sensor out.
///
/// With hardware effects the body itself is changed (friction, masses, servos), commands and readings
/// are late, noisy and biased, and a few commands are lost. Without, readings are exact.
pub struct SimulatedMachine {
    robot: MujocoRobot,
    hardware: Option<(HardwareConfig, Individual)>,
    description: MachineDescription,
    rng: ChaCha8Rng,
    /// Commands under way; the front one acts next.
    commands: VecDeque<Vec<f64>>,
    acting: Vec<f64>,
    /// Readings under way; the front one is the next to be told.
    readings: VecDeque<SensorFrame>,
    frame: SensorFrame,
}

impl SimulatedMachine {
    /// A machine from a configuration, with its hardware effects if it has any.
    ///
    /// # Errors
    ///
    /// [`MujocoError`], as [`MujocoRobot::new`]; or a value of the hardware out of its domain.
    pub fn new(config: &MujocoConfig) -> Result<Self, MujocoError> {
        let ideal = MujocoConfig { hardware: None, estimated: false, ..config.clone() };
        let robot = match &config.hardware {
            None => MujocoRobot::new(ideal)?,
            Some(hardware) => {
                hardware.validate()?;
                MujocoRobot::new(body_of(hardware, &ideal))?
            }
        };
        let joints = &robot.description().joints;
        let joint_names: Vec<_> = joints.iter().map(|joint| joint.name.clone()).collect();
        let limits = joints.iter().map(|joint| joint.limits).collect();
        let hardware = config
            .hardware
            .clone()
            .map(|h| (Individual::new(&h, joint_names.len()), h))
            .map(|(individual, h)| (h, individual));
        Ok(Self {
            hardware,
            description: MachineDescription {
                name: robot.description().name.clone(),
                joint_names,
                control_period_s: config.control_period_s,
                limits,
            },
            rng: ChaCha8Rng::seed_from_u64(0),
            commands: VecDeque::new(),
            acting: Vec::new(),
            readings: VecDeque::new(),
            frame: SensorFrame::default(),
            robot,
        })
    }

    /// The simulated robot inside.
    #[must_use]
    pub const fn robot(&self) -> &MujocoRobot {
        &self.robot
    }

    fn periods(&self, delay_s: f64) -> usize {
        (delay_s / self.description.control_period_s).round().max(0.0) as usize
    }

    /// What the sensors say now.
    fn read(&mut self) -> SensorFrame {
        let truth = self.robot.true_frame();
        match &self.hardware {
            None => truth,
            Some((config, individual)) => individual.read(&truth, config, &mut self.rng),
        }
    }
}

impl Machine for SimulatedMachine {
    fn description(&self) -> &MachineDescription {
        &self.description
    }

    fn reset(&mut self, command_rad: &[f64], rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.description.joint_names)?;
        let posture = JointTargets::positions(command_rad.iter().copied());
        self.robot.reset(&posture, rng)?;
        self.acting = command_rad.to_vec();
        let (command_delay, sensor_delay) = match &self.hardware {
            None => (0, 0),
            Some((config, _)) => {
                self.rng = ChaCha8Rng::seed_from_u64(rng.random());
                (self.periods(config.command_delay_s), self.periods(config.sensor_delay_s))
            }
        };
        self.commands = (0..command_delay).map(|_| self.acting.clone()).collect();
        let first = self.read();
        self.readings = (0..sensor_delay).map(|_| first.clone()).collect();
        self.frame = first;
        Ok(&self.frame)
    }

    fn frame(&self) -> &SensorFrame {
        &self.frame
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.description.joint_names)?;
        let lost = match &self.hardware {
            None => false,
            Some((config, _)) => self.rng.random::<f64>() < config.lost_commands,
        };
        // A command that is lost leaves the one before in force.
        let sent = match (lost, self.commands.back()) {
            (true, Some(before)) => before.clone(),
            (true, None) => self.acting.clone(),
            (false, _) => command_rad.to_vec(),
        };
        self.commands.push_back(sent);
        if let Some(next) = self.commands.pop_front() {
            self.acting = next;
        }
        let targets = JointTargets::positions(self.acting.iter().copied());
        self.robot.step(&targets)?;
        let mut read = self.read();
        let now_s = read.time_s;
        if let Some(oldest) = self.readings.pop_front() {
            self.readings.push_back(std::mem::replace(&mut read, oldest));
        }
        // The clock is the machine's own and is not late: a reading is stamped when it is told.
        read.time_s = now_s;
        self.frame = read;
        Ok(&self.frame)
    }

    fn true_state(&self) -> Option<&RobotState> {
        Some(self.robot.state())
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        self.robot.set_push(force_n)
    }

    fn push_on(&mut self, body: &str) -> Result<(), RobotError> {
        self.robot.push_on(body)
    }

    fn take_over(&mut self, from: &dyn Machine) -> Result<(), RobotError> {
        let other = from.as_any().and_then(|other| other.downcast_ref::<Self>());
        let other = other.ok_or(RobotError::Unsupported { what: "taking over from a machine of another kind" })?;
        self.robot.take_over(&other.robot)?;
        self.rng = other.rng.clone();
        self.commands.clone_from(&other.commands);
        self.acting.clone_from(&other.acting);
        self.readings.clone_from(&other.readings);
        self.frame = other.frame.clone();
        Ok(())
    }

    fn as_any(&self) -> Option<&dyn Any> {
        Some(self)
    }

    fn engine_seconds(&self) -> Option<f64> {
        self.robot.engine_seconds()
    }

    fn geometry(&self) -> Vec<Shape> {
        self.robot.geometry()
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        self.robot.poses(out);
    }
}

impl MujocoRobot {
    /// What perfect sensors would say.
    fn true_frame(&self) -> SensorFrame {
        let state = self.state();
        SensorFrame {
            time_s: state.time_s,
            joints: state.joints.clone(),
            orientation: state.base.orientation,
            angular_velocity_rad_s: state.base.angular_velocity_rad_s,
            loads_n: [state.feet[0].load_n, state.feet[1].load_n],
        }
    }
}

/// The body that has these effects of hardware, from one that has not.
fn body_of(hardware: &HardwareConfig, ideal: &MujocoConfig) -> MujocoConfig {
    MujocoConfig {
        friction: Some(hardware.friction),
        mass_scale: ideal.mass_scale * hardware.mass_scale,
        torso_offset_m: [0, 1, 2].map(|k| ideal.torso_offset_m[k] + hardware.torso_offset_m[k]),
        kp_nm_rad: Some(hardware.kp_nm_rad.into()),
        joint_friction_nm: Some(hardware.joint_friction_nm),
        torque_limit_nm: Some(hardware.torque_limit_nm.into()),
        hardware: None,
        estimated: false,
        ..ideal.clone()
    }
}

/// The kinematic model of a configuration's robot, as its drawing says: no hardware effects, no changes of
/// mass. The joints are in the model's order.
///
/// # Errors
///
/// [`MujocoError`] if the model cannot be loaded, a name is not in it, or a body has a joint that is no hinge
/// or more than one.
pub fn kinematic_model(config: &MujocoConfig) -> Result<KinematicModel, MujocoError> {
    kinematics(config).map(|(model, _)| model)
}

/// The kinematic model, and where its joints are in the simulator's.
fn kinematics(config: &MujocoConfig) -> Result<(KinematicModel, Binding), MujocoError> {
    let model = load(&config.model, &config.add)?;
    let binding = Binding::find(&model, config)?;
    let mut data = MjData::try_new(std::sync::Arc::clone(&model)).map_err(allocation)?;
    data.forward();
    let name = config.model.to_string();
    let not_a_biped = |reason: String| MujocoError::NotABiped { model: name.clone(), reason };
    let owned = own_bodies(&model, binding.torso);
    let place = |body: usize| owned.iter().position(|&b| b == body).unwrap_or(0);
    let mut bodies = Vec::with_capacity(owned.len());
    for &body in &owned {
        let joints: Vec<usize> = (0..model.njnt() as usize)
            .filter(|&j| model.jnt_bodyid()[j] as usize == body && body != binding.torso)
            .collect();
        let hinge = match joints[..] {
            [] => None,
            [joint] if model.jnt_type()[joint] == MjtJoint::mjJNT_HINGE => Some(Hinge {
                joint: (binding.axes.iter()).position(|axis| axis.joint == joint).unwrap_or(usize::MAX),
                axis: model.jnt_axis()[joint],
                anchor_m: model.jnt_pos()[joint],
            }),
            _ => {
                let body = name_of(&model, MjtObjBase::mjOBJ_BODY, body);
                return Err(not_a_biped(format!(
                    "the body {body:?} hangs from something else than one hinge, so where it is cannot be \
                     estimated from joint angles"
                )));
            }
        };
        // The drawing shows each joint at its `ref`, which is where the angle has that value.
        let drawn_at = joints.first().map_or(0.0, |&j| model.qpos0()[model.jnt_qposadr()[j] as usize]);
        let (mut position_m, mut orientation) = (model.body_pos()[body], model.body_quat()[body]);
        if let Some(hinge) = hinge.as_ref().filter(|_| drawn_at.abs() > 0.0) {
            let back = about(hinge.axis, -drawn_at);
            let anchor = turn(back, hinge.anchor_m);
            let shift = turn(orientation, [0, 1, 2].map(|i| hinge.anchor_m[i] - anchor[i]));
            position_m = [0, 1, 2].map(|i| position_m[i] + shift[i]);
            orientation = product(orientation, back);
        }
        bodies.push(Body {
            parent: place(model.body_parentid()[body] as usize),
            position_m,
            orientation,
            mass_kg: model.body_mass()[body],
            com_m: model.body_ipos()[body],
            hinge,
        });
    }
    let robot_soles = sole::find(&model, &data, &binding, &name)?;
    let soles = [0, 1].map(|side| BodyPoint { body: place(binding.feet[side]), point_m: robot_soles[side].centre_m });
    let kinematics = KinematicModel::new(binding.axes.len(), bodies, soles).map_err(|e| not_a_biped(e.to_string()))?;
    Ok((kinematics, binding))
}

/// An estimator for a configuration's robot, whose machine is zeroed as its model is.
///
/// # Errors
///
/// As [`kinematic_model`].
pub fn estimator(config: &MujocoConfig) -> Result<Estimator, MujocoError> {
    let (model, binding) = kinematics(config)?;
    let rest_rad = binding.axes.iter().map(|axis| axis.rest_rad).collect();
    Estimator::new(model, binding.legs, rest_rad)
        .map_err(|e| MujocoError::NotABiped { model: config.model.to_string(), reason: e.to_string() })
}
