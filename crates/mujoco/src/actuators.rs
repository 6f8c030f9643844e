//! What each actuator of a model is to us: a position servo, a torque motor, at rest at zero control, or
//! something that cannot be driven by angles.

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::mj_model::{MjtBias, MjtDyn, MjtGain, MjtObjBase, MjtTrn};

use crate::axis::{Axis, Drive};
use crate::engine::{Data, name_of, own_bodies};
use crate::error::MujocoError;

/// An actuator, by dynamics, gain and bias together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Force = gain (ctrl, or ctrl through a filter) + b0 + b1 length + b2 velocity with b1 < 0: it pulls to the
    /// length at which `ctrl = per_length * length + offset`.
    Servo {
        /// Control per length: 1 for `<position>`.
        per_length: f64,
        /// Control at length 0.
        offset: f64,
    },
    /// Force = gain ctrl.
    Motor {
        /// Force per control.
        gain: f64,
    },
    /// No force at zero control but damping, and nothing that takes angles or torques.
    Idle(&'static str),
    /// Anything else: why it cannot be driven.
    Other(&'static str),
}

/// Sorts an actuator.
pub(crate) fn kind(model: &MjModel, actuator: usize) -> Kind {
    let dynamics = model.actuator_dyntype()[actuator];
    let gain_type = model.actuator_gaintype()[actuator];
    let bias_type = model.actuator_biastype()[actuator];
    let gain = model.actuator_gainprm()[actuator][0];
    let bias = model.actuator_biasprm()[actuator];
    let why = match dynamics {
        MjtDyn::mjDYN_INTEGRATOR => Some("integrates its control, as <intvelocity> does: it takes rates"),
        MjtDyn::mjDYN_MUSCLE => Some("is a muscle: it takes an excitation"),
        MjtDyn::mjDYN_NONE | MjtDyn::mjDYN_FILTER | MjtDyn::mjDYN_FILTEREXACT => None,
        _ => Some("has activation dynamics (dyntype) that are neither \"none\", \"filter\" nor \"filterexact\""),
    };
    let fixed = gain_type == MjtGain::mjGAIN_FIXED && gain.abs() > 0.0;
    let no_bias = bias_type == MjtBias::mjBIAS_NONE
        || (bias_type == MjtBias::mjBIAS_AFFINE && bias[..3].iter().all(|b| b.abs() <= 0.0));
    let affine = bias_type == MjtBias::mjBIAS_AFFINE;
    let stateless = dynamics == MjtDyn::mjDYN_NONE;
    match why {
        None if fixed && affine && bias[1] < 0.0 => {
            Kind::Servo { per_length: -bias[1] / gain, offset: -bias[0] / gain }
        }
        None if fixed && no_bias && stateless => Kind::Motor { gain },
        // What follows exerts no force at zero control and activation, whatever it would take otherwise.
        _ if no_bias => Kind::Idle(why.unwrap_or(if fixed {
            "is a motor behind a filter, as <cylinder> is: its torque lags"
        } else {
            "has a gain that is not fixed, as <damper> and <muscle> have"
        })),
        _ if affine && bias[0].abs() <= 0.0 && bias[1].abs() <= 0.0 => {
            Kind::Idle(why.unwrap_or("takes rates, as <velocity> does: its force does not depend on the angle"))
        }
        _ => Kind::Other(why.unwrap_or("has a force that is not that of a position servo")),
    }
}

/// Whether MuJoCo leaves an actuator out: its group is among `actuatorgroupdisable`.
pub(crate) fn is_disabled(model: &MjModel, actuator: usize) -> bool {
    let group = model.actuator_group()[actuator];
    (0..31).contains(&group) && model.opt().disableactuator & (1 << group) != 0
}

/// How a joint is driven, and by which of the model's actuators.
pub(crate) fn drive(model: &MjModel, joint: usize) -> Result<(Drive, Option<usize>), MujocoError> {
    let on_joint: Vec<usize> = (0..model.nactuator() as usize)
        .filter(|&a| {
            let to = model.actuator_trntype()[a];
            (to == MjtTrn::mjTRN_JOINT || to == MjtTrn::mjTRN_JOINTINPARENT)
                && model.actuator_trnid()[a][0] as usize == joint
                && !is_disabled(model, a)
        })
        .collect();
    let refused = |actuator: usize, problem: String| MujocoError::Actuator {
        joint: name_of(model, MjtObjBase::mjOBJ_JOINT, joint),
        actuator: name_of(model, MjtObjBase::mjOBJ_ACTUATOR, actuator),
        problem,
    };
    let gear = |a: usize| model.actuator_gear()[model.actuator_outadr()[a] as usize][0];
    let usable = |a: &usize| model.actuator_ctrlnum()[*a] == 1 && gear(*a).abs() > 0.0;
    let mut servos = (on_joint.iter().copied()).filter(|a| usable(a)).filter_map(|a| match kind(model, a) {
        Kind::Servo { per_length, offset } => Some((a, per_length, offset)),
        _ => None,
    });
    if let Some((a, per_length, offset)) = servos.next() {
        if let Some((second, ..)) = servos.next() {
            let other = name_of(model, MjtObjBase::mjOBJ_ACTUATOR, second);
            return Err(refused(a, format!("is one of two position servos on it, with {other:?}")));
        }
        let ctrl = model.actuator_ctrladr()[a] as usize;
        let per_rad = per_length * gear(a);
        return Ok((
            Drive::Servo { ctrl, per_rad, offset, act: usize::try_from(model.actuator_actadr()[a]).ok() },
            Some(a),
        ));
    }
    let motor = (on_joint.iter().copied()).filter(|a| usable(a)).find_map(|a| match kind(model, a) {
        Kind::Motor { gain } => Some((a, gain)),
        _ => None,
    });
    match (motor, on_joint.first()) {
        (Some((a, gain)), _) => {
            let ctrl = model.actuator_ctrladr()[a] as usize;
            let ctrl_per_nm = 1.0 / (gear(a) * gain);
            Ok((Drive::Motor { ctrl, ctrl_per_nm }, Some(a)))
        }
        (None, None) => Ok((Drive::Applied, None)),
        (None, Some(&a)) => Err(refused(
            a,
            match kind(model, a) {
                Kind::Idle(why) | Kind::Other(why) => why.into(),
                _ => "has a gear of zero, or more than one control".into(),
            },
        )),
    }
}

/// The torques that a joint's own and its actuator's ranges leave it either way; infinite without a limit.
///
/// # Errors
///
/// [`MujocoError::Actuator`] if that is none in one direction.
pub(crate) fn torque_range(model: &MjModel, axis: &Axis) -> Result<f64, MujocoError> {
    let limit = crate::axis::torque_limit(model, axis);
    if limit > 0.0 {
        return Ok(limit);
    }
    Err(MujocoError::Actuator {
        joint: name_of(model, MjtObjBase::mjOBJ_JOINT, axis.joint),
        actuator: axis.actuator.map_or_else(String::new, |a| name_of(model, MjtObjBase::mjOBJ_ACTUATOR, a)),
        problem: "leaves it no torque in one direction (forcerange, ctrlrange, or the joint's actuatorfrcrange): \
                  a range needs 0 inside"
            .into(),
    })
}

/// A position servo that is on no joint of its own, such as one on a tendon, held where a posture puts it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Held {
    /// Where its length stands.
    pub length: usize,
    /// Where its control stands.
    pub ctrl: usize,
    /// Where its activation stands, if it has one.
    pub act: Option<usize>,
    /// Control per length.
    pub per_length: f64,
    /// Control at length 0.
    pub offset: f64,
}

/// Looks at every actuator of the robot that drives none of its axes: servos are held, what exerts no force at
/// zero control is left there.
///
/// # Errors
///
/// [`MujocoError::StrayActuator`] for one that would pull at the robot unasked. `data` holds the reference
/// posture, its transmissions computed.
pub(crate) fn aside(
    model: &MjModel,
    data: &Data,
    axes: &[Axis],
    torso: usize,
    own_damping: bool,
) -> Result<Vec<Held>, MujocoError> {
    let bodies = own_bodies(model, torso);
    let mut held = Vec::new();
    for a in 0..model.nactuator() as usize {
        if is_disabled(model, a) || axes.iter().any(|axis| axis.actuator == Some(a)) {
            continue;
        }
        let out = model.actuator_outadr()[a] as usize;
        let rows = out..out + model.actuator_outnum()[a] as usize;
        let dofs: Vec<usize> = rows
            .flat_map(|row| {
                let at = data.moment_rowadr()[row] as usize;
                let end = at + data.moment_rownnz()[row] as usize;
                data.moment_colind()[at..end].iter().map(|&dof| dof as usize)
            })
            .collect();
        if !(dofs.iter()).any(|&dof| bodies.contains(&(model.dof_bodyid()[dof] as usize))) {
            continue;
        }
        let on_leg = dofs.iter().any(|dof| axes.iter().any(|axis| axis.of_leg && axis.dof == *dof));
        let refused = |problem: &str| MujocoError::StrayActuator {
            actuator: name_of(model, MjtObjBase::mjOBJ_ACTUATOR, a),
            problem: problem.into(),
        };
        match kind(model, a) {
            Kind::Servo { .. } if on_leg => {
                return Err(refused(
                    "is a position servo that pulls at a leg joint through something else than that joint",
                ));
            }
            Kind::Servo { per_length, offset } if model.actuator_ctrlnum()[a] == 1 => held.push(Held {
                length: out,
                ctrl: model.actuator_ctrladr()[a] as usize,
                act: usize::try_from(model.actuator_actadr()[a]).ok(),
                per_length,
                offset,
            }),
            Kind::Idle(_) if on_leg && own_damping && model.actuator_biasprm()[a][2] < 0.0 => {
                return Err(refused("adds its own damping to a leg joint, beside robot.kv_nms_rad"));
            }
            Kind::Motor { .. } | Kind::Idle(_) => {}
            Kind::Servo { .. } => return Err(refused("is a servo with more than one control")),
            Kind::Other(why) => return Err(refused(why)),
        }
    }
    Ok(held)
}

/// Holds the servos beside the axes where the posture puts them, and lets what an actuator remembers, a
/// filter's state or delayed commands, begin at its present command.
pub(crate) fn settle(model: &MjModel, data: &mut Data, axes: &[Axis], held: &[Held]) {
    if !held.is_empty() {
        data.forward();
        for held in held {
            let length = data.actuator_length()[held.length];
            data.ctrl_mut()[held.ctrl] = held.per_length * length + held.offset;
        }
    }
    let servos = axes.iter().filter_map(|axis| match axis.drive {
        Drive::Servo { ctrl, act, .. } => Some((ctrl, act?)),
        _ => None,
    });
    let held = held.iter().filter_map(|h| Some((h.ctrl, h.act?)));
    for (ctrl, act) in servos.chain(held).collect::<Vec<_>>() {
        let command = data.ctrl()[ctrl];
        let allowed = match model.actuator_ctrllimited()[ctrl] {
            true => model.actuator_ctrlrange()[ctrl],
            false => [f64::NEG_INFINITY, f64::INFINITY],
        };
        data.act_mut()[act] = command.max(allowed[0]).min(allowed[1]);
    }
    for actuator in 0..model.nactuator() as usize {
        let samples = model.actuator_history()[actuator][0];
        if samples > 0 {
            let ctrl = model.actuator_ctrladr()[actuator] as usize;
            let count = model.actuator_ctrlnum()[actuator] as usize;
            let values = data.ctrl()[ctrl..ctrl + count].repeat(samples as usize);
            // The lengths are the model's own, so this cannot be refused.
            let _ = data.init_ctrl_history(actuator, None, &values);
        }
    }
}
