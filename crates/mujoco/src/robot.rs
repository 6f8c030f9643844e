//! The simulated robot.

use std::any::Any;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_data::MjtWarning;
use mujoco_rs::wrappers::mj_model::MjtObjBase;
use rand_chacha::ChaCha8Rng;
use rand_distr::Distribution;
use stridemap_robot::{
    BaseState, CentreOfMass, FootState, Hold, JointDescription, JointState, JointTargets, Pose, Robot,
    RobotDescription, RobotError, RobotState, Shape, Side,
};

use crate::actuators::{self, Held};
use crate::axis::{Axis, Drive};
use crate::binding::Binding;
use crate::changes::ChangesConfig;
use crate::config::{MujocoConfig, steps_per_period};
use crate::engine::{Data, Provenance, allocation, hash, mujoco_version, name_of, take_warning};
use crate::error::MujocoError;
use crate::hardware::noise;
use crate::law::{Law, laws, limits};
use crate::overrides::apply;
use crate::rotation::{about_y, about_z, inverse, product, to_world, turn};
use crate::sole::{self, Sole};
use crate::store::load;
use crate::strap::Strap;

/// Kinds of warnings that MuJoCo counts.
const WARNINGS: usize = MjtWarning::mjNWARNING as usize;
/// A biped simulated by MuJoCo.
///
/// Positions, velocities and the feet's places are those at the end of the control period; contact forces
/// (foot loads, centre of pressure) and torques are those of its last physics step. Heights are above the
/// floor. The base is the body with the free joint, its axes those of the world in the model's reference
/// posture. The joints are the model's, in its order and signs: those of the legs, and every other hinge and slide.
///
/// A joint with a motor or without an actuator takes gains, a rate and a torque ([`JointCommand`](stridemap_robot::JointCommand)); one with a position
/// servo of the model's takes angles, and refuses the rest by name.
///
/// # Example
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use stridemap_mujoco::{MujocoConfig, MujocoRobot};
/// use stridemap_robot::Robot;
///
/// let mut robot = MujocoRobot::new(MujocoConfig::default())?;
/// let rest = robot.description().rest();
/// robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
/// for _ in 0..250 {
///     robot.step(&rest)?;
/// }
/// assert!((robot.state().com.position_m[2] - 0.812).abs() < 0.005);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct MujocoRobot {
    pub(crate) config: MujocoConfig,
    pub(crate) model: Arc<MjModel>,
    pub(crate) binding: Binding,
    pub(crate) soles: [Sole; 2],
    pub(crate) data: Data,
    /// Height of the floor under the robot's start.
    pub(crate) floor_m: f64,
    /// Position servos that drive no joint of their own.
    pub(crate) held: Vec<Held>,
    pub(crate) description: RobotDescription,
    pub(crate) steps_per_period: usize,
    /// PD laws of the joints; those of servos are not used.
    pub(crate) laws: Vec<Law>,
    /// Whether any joint is under a PD law of ours.
    has_laws: bool,
    /// Physics steps by which commands are late, and the commands that are under way, oldest first.
    pub(crate) delay_steps: usize,
    pub(crate) late: VecDeque<JointTargets>,
    pub(crate) held_by: Option<Strap>,
    /// Inverse of the base's orientation in the reference posture, unless that is the identity.
    base_inverse: Option<[f64; 4]>,
    pub(crate) state: RobotState,
    pub(crate) periods: u64,
    warnings: [i32; WARNINGS],
    pub(crate) failure: Option<RobotError>,
    engine: Duration,
    /// The body on which pushes act.
    pushed: usize,
}

impl MujocoRobot {
    /// Builds a robot; it hangs in the model's reference posture until its first reset.
    ///
    /// # Errors
    ///
    /// [`MujocoError`]: a bad value, a model that cannot be loaded or is no biped on a floor, a name that the model
    /// does not have (with the nearest ones), a joint that cannot be driven.
    pub fn new(config: MujocoConfig) -> Result<Self, MujocoError> {
        config.validate()?;
        let mut bare = load(&config.model, &config.add)?;
        if !config.actuators {
            let mut without = (*bare).clone();
            without.opt_mut().disableactuator = i32::MAX;
            bare = Arc::new(without);
        }
        let binding = Binding::find(&bare, &config)?;
        let model = Arc::new(apply(&bare, &config, &binding)?);
        let time_step_s = model.opt().timestep;
        let steps_per_period = steps_per_period(config.control_period_s, time_step_s)?;
        let mut data = MjData::try_new(Arc::clone(&model)).map_err(allocation)?;
        data.forward();
        let name = config.model.to_string();
        let soles = sole::find(&model, &data, &binding, &name)?;
        let damped = config.kv_nms_rad.is_some();
        let held = actuators::aside(&model, &data, &binding.axes, binding.torso, damped)?;
        let mut laws = laws(&model, &config, &binding);
        let mut delay_steps = 0;
        if let Some(changes) = config.changes.as_ref().map(ChangesConfig::resolved) {
            let factors = changes.gain_factors(&model, &binding.parts())?;
            laws.iter_mut().zip(factors).for_each(|(law, factor)| law.gain = factor);
            delay_steps = (changes.action_delay_s.unwrap_or(0.0) / time_step_s).round() as usize;
        }
        let mass_kg = model.body_subtreemass()[binding.torso];
        let joints = (binding.axes.iter().zip(&laws))
            .map(|(axis, law)| JointDescription {
                name: name_of(&model, MjtObjBase::mjOBJ_JOINT, axis.joint),
                limits: limits(&model, axis, &config, law.limit),
                rest_rad: axis.rest_rad,
            })
            .collect();
        let q0 = &model.qpos0()[binding.root_qpos + 3..binding.root_qpos + 7];
        let q0 = [q0[0], q0[1], q0[2], q0[3]];
        let turned = q0[1..].iter().any(|v| v.abs() > 1e-12) || binding.heading_rad.abs() > 0.0;
        let servo = |axis: &Axis| matches!(axis.drive, Drive::Servo { .. });
        let mut robot = Self {
            description: RobotDescription {
                name,
                control_period_s: config.control_period_s,
                mass_kg,
                joints,
                legs: binding.legs,
            },
            steps_per_period,
            has_laws: !binding.axes.iter().all(servo),
            laws,
            delay_steps,
            late: VecDeque::new(),
            held_by: None,
            base_inverse: turned.then(|| product(inverse(q0), about_z(binding.heading_rad))),
            state: RobotState { joints: vec![JointState::default(); binding.axes.len()], ..RobotState::default() },
            periods: 0,
            warnings: [0; WARNINGS],
            failure: None,
            engine: Duration::ZERO,
            pushed: binding.torso,
            config,
            model,
            binding,
            soles,
            data,
            floor_m: 0.0,
            held,
        };
        robot.find_floor()?;
        robot.read_forces();
        robot.read_motion();
        Ok(robot)
    }

    /// The configuration with which the robot was built.
    #[must_use]
    pub fn config(&self) -> &MujocoConfig {
        &self.config
    }

    /// Engine, model, hash, mass, gravity and periods, for a run's record. Hashing a model with meshes takes a
    /// good part of a second.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Load`] if MuJoCo cannot write the model down.
    pub fn provenance(&self) -> Result<Provenance, MujocoError> {
        Ok(Provenance {
            engine: format!("MuJoCo {}", mujoco_version()),
            model: self.config.model.to_string(),
            model_sha256: hash(&self.model)?,
            mass_kg: self.description.mass_kg,
            gravity_m_s2: self.gravity_m_s2(),
            time_step_s: self.model.opt().timestep,
            control_period_s: self.config.control_period_s,
        })
    }

    /// Gravity (x, y, z).
    #[must_use]
    pub fn gravity_m_s2(&self) -> [f64; 3] {
        self.model.opt().gravity
    }

    /// Physics steps in one control period.
    #[must_use]
    pub fn steps_per_period(&self) -> usize {
        self.steps_per_period
    }

    /// Reads what the last solution of the contacts says: loads, centre of pressure, torques.
    fn read_forces(&mut self) {
        let mut load = [0.0; 2];
        let mut moment = [0.0; 2];
        for (index, contact) in self.data.contact().iter().enumerate() {
            let [one, two] = contact.geom;
            let (Ok(one), Ok(two)) = (usize::try_from(one), usize::try_from(two)) else {
                continue;
            };
            let (side, sign) = match (self.binding.foot_of_geom[one], self.binding.foot_of_geom[two]) {
                // MuJoCo reports the force on the second geom.
                (None, Some(side)) if self.binding.is_floor[one] => (side, 1.0),
                (Some(side), None) if self.binding.is_floor[two] => (side, -1.0),
                _ => continue,
            };
            let force = self.data.contact_force(index);
            let up = sign * (contact.frame[2] * force[0] + contact.frame[5] * force[1] + contact.frame[8] * force[2]);
            load[usize::from(side)] += up;
            moment[0] += up * contact.pos[0];
            moment[1] += up * contact.pos[1];
        }
        let total = load[0] + load[1];
        self.state.feet[0].load_n = load[0];
        self.state.feet[1].load_n = load[1];
        self.state.cop_m = (total > 0.0).then(|| moment.map(|m| m / total));
        let (actuator, applied, rates) = (self.data.qfrc_actuator(), self.data.qfrc_applied(), self.data.qvel());
        for (joint, axis) in self.state.joints.iter_mut().zip(&self.binding.axes) {
            joint.torque_nm = actuator[axis.dof] + applied[axis.dof];
            if let Some(damping) = axis.given.damping {
                joint.torque_nm -= damping * rates[axis.dof];
            }
        }
    }

    /// Reads positions and velocities; kinematics must be up to date.
    fn read_motion(&mut self) {
        self.data.subtree_vel();
        let floor_m = self.floor_m;
        let above_floor = |[x, y, z]: [f64; 3]| [x, y, z - floor_m];
        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        for (joint, axis) in self.state.joints.iter_mut().zip(&self.binding.axes) {
            joint.position_rad = qpos[axis.qpos];
            joint.velocity_rad_s = qvel[axis.dof];
        }
        let (q, v) = (self.binding.root_qpos, self.binding.root_dof + 3);
        let mut base = BaseState {
            position_m: above_floor([qpos[q], qpos[q + 1], qpos[q + 2]]),
            orientation: [qpos[q + 3], qpos[q + 4], qpos[q + 5], qpos[q + 6]],
            angular_velocity_rad_s: [qvel[v], qvel[v + 1], qvel[v + 2]],
        };
        if let Some(base_inverse) = self.base_inverse {
            base.orientation = product(base.orientation, base_inverse);
            base.angular_velocity_rad_s = turn(inverse(base_inverse), base.angular_velocity_rad_s);
        }
        self.state.base = base;
        self.state.com = CentreOfMass {
            position_m: above_floor(self.data.subtree_com()[self.binding.torso]),
            velocity_m_s: self.data.subtree_linvel()[self.binding.torso],
        };
        for side in Side::BOTH {
            let point = self.on_foot(side, self.soles[side.index()].centre_m);
            let foot: &mut FootState = &mut self.state.feet[side.index()];
            foot.centre_m = above_floor(point);
        }
        #[expect(clippy::cast_precision_loss)] // 2^53 periods are half a million years.
        let periods = self.periods as f64;
        self.state.time_s = periods * self.config.control_period_s;
    }

    /// A point of a foot, in the world.
    pub(crate) fn on_foot(&self, side: Side, local: [f64; 3]) -> [f64; 3] {
        let body = self.binding.feet[side.index()];
        let (origin, turned) = (self.data.xpos()[body], to_world(&self.data.xmat()[body], local));
        [0, 1, 2].map(|i| origin[i] + turned[i])
    }

    /// Takes note of the warnings so far.
    pub(crate) fn count_warnings(&mut self) {
        for (count, stat) in self.warnings.iter_mut().zip(self.data.warning()) {
            *count = stat.number;
        }
    }

    /// A new warning of the engine, or a state that is not finite, as an error.
    fn new_warning(&mut self) -> Option<RobotError> {
        let stats = self.data.warning();
        let new = (0..WARNINGS).find(|&kind| stats[kind].number > self.warnings[kind])?;
        let mut warning = take_warning();
        if warning.is_empty() {
            warning = format!("MuJoCo warning of kind {new}");
        }
        self.count_warnings();
        Some(RobotError::Simulator { time_s: self.state.time_s, warning })
    }

    /// Puts the base upright and looking along +x, turned in pitch so that the soles are level, the lower sole on the floor.
    /// Returns the angle by which the toes were up before.
    pub(crate) fn stand(&mut self) -> f64 {
        let q = self.binding.root_qpos;
        if self.binding.heading_rad.abs() > 0.0 {
            let qpos = self.data.qpos_mut();
            let reference = [qpos[q + 3], qpos[q + 4], qpos[q + 5], qpos[q + 6]];
            qpos[q + 3..q + 7].copy_from_slice(&product(about_z(-self.binding.heading_rad), reference));
        }
        self.data.kinematics();
        let mut pitch_rad = 0.0;
        for side in Side::BOTH.into_iter().filter(|_| !self.binding.point_feet) {
            let foot = &self.data.xmat()[self.binding.feet[side.index()]];
            let forward = to_world(foot, self.soles[side.index()].forward);
            pitch_rad += 0.5 * forward[2].atan2(forward[0]);
        }
        let qpos = self.data.qpos_mut();
        // Toes up by `pitch_rad`: turn the whole robot about +y, which lowers them.
        let upright = [qpos[q + 3], qpos[q + 4], qpos[q + 5], qpos[q + 6]];
        qpos[q + 3..q + 7].copy_from_slice(&product(about_y(pitch_rad), upright));
        self.data.kinematics();
        let mut lowest = f64::MAX;
        for side in Side::BOTH {
            for &corner in &self.soles[side.index()].corners_m {
                lowest = lowest.min(self.on_foot(side, corner)[2]);
            }
        }
        self.data.qpos_mut()[q + 2] += self.floor_m - lowest;
        pitch_rad
    }
}

impl Robot for MujocoRobot {
    fn description(&self) -> &RobotDescription {
        &self.description
    }

    fn reset(&mut self, posture: &JointTargets, rng: &mut ChaCha8Rng) -> Result<&RobotState, RobotError> {
        self.check(posture)?;
        self.data.reset();
        self.held_by = None;
        self.failure = None;
        self.periods = 0;
        self.state.time_s = 0.0;
        self.command(posture);
        self.late = std::iter::repeat_n(posture.clone(), self.delay_steps.div_ceil(self.steps_per_period)).collect();
        let angle_noise = noise(self.config.start_joint_noise_deg.to_radians());
        let velocity_noise = noise(self.config.start_velocity_noise_m_s);
        for (axis, law) in self.binding.axes.iter().zip(&self.laws) {
            self.data.qpos_mut()[axis.qpos] = law.asked.position_rad;
        }
        if let Some(normal) = angle_noise {
            for (_, _, role) in self.binding.legs.roles() {
                let qpos = self.binding.axes[role.joint].qpos;
                self.data.qpos_mut()[qpos] += normal.sample(rng);
            }
        }
        self.stand();
        if let Some(normal) = velocity_noise {
            let v = self.binding.root_dof;
            for rate in &mut self.data.qvel_mut()[v..v + 2] {
                *rate = normal.sample(rng);
            }
        }
        if self.has_laws {
            self.drive();
        }
        actuators::settle(&self.model, &mut self.data, &self.binding.axes, &self.held);
        self.data.forward();
        self.warnings = [0; WARNINGS];
        if let Some(error) = self.new_warning() {
            self.failure = Some(error.clone());
            return Err(error);
        }
        self.read_forces();
        self.read_motion();
        Ok(&self.state)
    }

    fn state(&self) -> &RobotState {
        &self.state
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        self.check(targets)?;
        if let Some(failure) = &self.failure {
            return Err(failure.clone());
        }
        let late = self.delay_steps > 0;
        if late {
            self.late.push_back(targets.clone());
        } else {
            self.command(targets);
        }
        let mut start = Instant::now();
        // A step of MuJoCo is step1 (what follows from positions and velocities) and step2 (forces, and the step
        // in time). Each period ends with step1, so that the state read there is that of its end.
        for last in (0..self.steps_per_period).rev() {
            if late {
                self.command_late(self.steps_per_period - 1 - last);
            }
            if self.has_laws {
                self.drive();
            }
            self.pull_strap();
            self.data.step2();
            if last == 0 {
                self.engine += start.elapsed();
                self.read_forces();
                start = Instant::now();
            }
            self.data.step1();
        }
        self.engine += start.elapsed();
        if late {
            self.late.pop_front();
        }
        self.periods += 1;
        if let Some(error) = self.new_warning() {
            self.failure = Some(error.clone());
            return Err(error);
        }
        self.read_motion();
        Ok(&self.state)
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        if force_n.iter().any(|f| !f.is_finite()) {
            return Err(RobotError::Unsupported { what: "a push that is not finite" });
        }
        self.data.xfrc_applied_mut()[self.pushed][..3].copy_from_slice(&force_n);
        Ok(())
    }

    fn hold(&mut self, hold: Option<Hold>) -> Result<(), RobotError> {
        self.strap(hold);
        Ok(())
    }

    fn push_on(&mut self, body: &str) -> Result<(), RobotError> {
        self.pushed = self.body(body)?;
        Ok(())
    }

    fn take_over(&mut self, from: &dyn Robot) -> Result<(), RobotError> {
        let other = from.as_any().and_then(|other| other.downcast_ref::<Self>());
        let other = other.ok_or(RobotError::Unsupported { what: "taking over from a robot of another kind" })?;
        let foreign = RobotError::Unsupported { what: "taking over from a robot of another shape" };
        self.late.clone_from(&other.late);
        self.restore(&other.snapshot()).map_err(|_| foreign)
    }

    fn as_any(&self) -> Option<&dyn Any> {
        Some(self)
    }

    fn geometry(&self) -> Vec<Shape> {
        crate::scene::shapes(&self.model)
    }

    fn engine_seconds(&self) -> Option<f64> {
        Some(self.engine.as_secs_f64())
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        out.clear();
        let floor_m = self.floor_m;
        let bodies = self.data.xpos().iter().zip(self.data.xquat());
        out.extend(bodies.map(|(&[x, y, z], &orientation)| Pose { position_m: [x, y, z - floor_m], orientation }));
    }
}

#[cfg(test)]
mod tests;
