//! The PD laws of joints that have no position servo, and the limits of all.

use mujoco_rs::prelude::MjModel;
use stridemap_robot::{JointCommand, JointLimits};

use crate::axis::{Axis, Drive, Given, torque_limit};
use crate::binding::{Binding, HOLD_RAD_S};
use crate::config::MujocoConfig;
use crate::per_joint::PerJoint;

/// A PD law on one joint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Law {
    /// Stiffness where the controller names none.
    pub kp: f64,
    /// Damping where the controller names none.
    pub kv: f64,
    /// Factor on stiffness and damping, whoever names them.
    pub gain: f64,
    /// Largest torque, either way.
    pub limit: f64,
    /// What is asked of it.
    pub asked: JointCommand,
}

/// The PD laws of every driven joint, at rest.
pub(crate) fn laws(model: &MjModel, config: &MujocoConfig, binding: &Binding) -> Vec<Law> {
    let most =
        |legs: &Option<PerJoint>| legs.iter().flat_map(PerJoint::values).reduce(f64::max).unwrap_or(f64::INFINITY);
    let law = |axis: &Axis| {
        let own = torque_limit(model, axis);
        let asked = JointCommand::position(axis.rest_rad);
        if axis.of_leg {
            let Given { kp, kv, torque_nm, .. } = axis.given;
            let limit = torque_nm.map_or(own, |limit| limit.min(own));
            return Law { kp: kp.unwrap_or(0.0), kv: kv.unwrap_or(0.0), gain: 1.0, limit, asked };
        }
        // Never stiffer than the legs.
        let inertia = model.dof_m0()[axis.dof];
        Law {
            kp: (inertia * HOLD_RAD_S * HOLD_RAD_S).min(most(&config.kp_nm_rad)),
            kv: (2.0 * inertia * HOLD_RAD_S).min(most(&config.kv_nms_rad)),
            gain: 1.0,
            limit: own,
            asked,
        }
    };
    binding.axes.iter().map(law).collect()
}

/// The limits of a joint.
pub(crate) fn limits(model: &MjModel, axis: &Axis, config: &MujocoConfig, torque_nm: f64) -> JointLimits {
    let [mut lower, mut upper] = match model.jnt_limited()[axis.joint] {
        true => model.jnt_range()[axis.joint],
        false => [-std::f64::consts::PI, std::f64::consts::PI],
    };
    // What MuJoCo would cut off a servo's command is no part of the range.
    if let Drive::Servo { ctrl, per_rad, offset, .. } = axis.drive
        && model.actuator_ctrllimited()[ctrl]
    {
        let ends = model.actuator_ctrlrange()[ctrl].map(|end| (end - offset) / per_rad);
        lower = lower.max(ends[0].min(ends[1]));
        upper = upper.min(ends[0].max(ends[1]));
    }
    JointLimits { lower_rad: lower, upper_rad: upper, velocity_rad_s: config.velocity_limit_rad_s, torque_nm }
}
