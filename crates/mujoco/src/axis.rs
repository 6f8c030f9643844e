//! One hinge of a robot, and how it is driven.

use mujoco_rs::prelude::MjModel;

use crate::config::MujocoConfig;
use crate::per_joint::PerJoint;

/// How a torque reaches a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Drive {
    /// A position actuator of the model: `ctrl` takes `per_rad` times the model's angle, plus `offset`.
    Servo {
        /// Index of the control.
        ctrl: usize,
        /// Control per radian: the actuator's gear, for `<position>`.
        per_rad: f64,
        /// Control at angle 0: zero, for `<position>`.
        offset: f64,
        /// Index of the activation, for a servo with a time constant.
        act: Option<usize>,
    },
    /// A torque actuator of the model, under our PD law.
    Motor {
        /// Index of the control.
        ctrl: usize,
        /// Control per newton metre.
        ctrl_per_nm: f64,
    },
    /// No actuator: our PD law applies its torque to the joint itself.
    Applied,
}

/// What a configuration says of one leg joint; `None` is the model's own.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Given {
    pub kp: Option<f64>,
    pub kv: Option<f64>,
    pub torque_nm: Option<f64>,
    pub armature: Option<f64>,
    pub damping: Option<f64>,
}

impl Given {
    pub fn of(config: &MujocoConfig, role: &str, name: &str) -> Self {
        let of = |numbers: &Option<PerJoint>| numbers.as_ref().and_then(|numbers| numbers.of(role, name));
        Self {
            kp: of(&config.kp_nm_rad),
            kv: of(&config.kv_nms_rad),
            torque_nm: of(&config.torque_limit_nm),
            armature: of(&config.armature_kg_m2),
            damping: of(&config.joint_damping_nms_rad),
        }
    }
}

/// One hinge that is driven.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// Index of the joint in the model.
    pub joint: usize,
    /// Index of its angle in `qpos`.
    pub qpos: usize,
    /// Index of its rate in `qvel`.
    pub dof: usize,
    /// Whether it is a leg's, with the gains and limits of the legs.
    pub of_leg: bool,
    /// What the configuration says of it.
    pub given: Given,
    /// How it is driven.
    pub drive: Drive,
    /// Its actuator in the model.
    pub actuator: Option<usize>,
    /// Angle at rest.
    pub rest_rad: f64,
}

/// The largest torque that the model allows a joint; infinite if it sets no limit.
pub(crate) fn torque_limit(model: &MjModel, axis: &Axis) -> f64 {
    let mut limit = f64::INFINITY;
    let largest = |range: [f64; 2]| range[0].abs().min(range[1].abs());
    if model.jnt_actfrclimited()[axis.joint] {
        limit = limit.min(largest(model.jnt_actfrcrange()[axis.joint]));
    }
    if let Some(a) = axis.actuator {
        let gear = model.actuator_gear()[model.actuator_outadr()[a] as usize][0].abs();
        if model.actuator_forcelimited()[a] {
            limit = limit.min(gear * largest(model.actuator_forcerange()[a]));
        }
        if let Drive::Motor { ctrl, ctrl_per_nm } = axis.drive
            && model.actuator_ctrllimited()[ctrl]
        {
            limit = limit.min(largest(model.actuator_ctrlrange()[ctrl]) / ctrl_per_nm.abs());
        }
    }
    limit
}
