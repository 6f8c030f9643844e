//! A model with what the user's configuration changes in it.

use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_model::{MjtDisableBit, MjtIntegrator, MjtJoint};

use crate::axis::{Drive, Given};
use crate::binding::Binding;
use crate::config::MujocoConfig;
use crate::engine::{allocation, own_bodies};
use crate::error::MujocoError;
use crate::payload::free_frames;

/// Applies the user's overrides and recomputes what MuJoCo derives from them.
pub(crate) fn apply(model: &MjModel, config: &MujocoConfig, places: &Binding) -> Result<MjModel, MujocoError> {
    let mut model = model.clone();
    let options = model.opt_mut();
    // MuJoCo's default answer to a diverged state is to reset it and go on.
    options.disableflags |= MjtDisableBit::mjDSBL_AUTORESET as i32;
    // The period is driven in the two halves of a step, which Runge-Kutta does not have.
    if options.integrator == MjtIntegrator::mjINT_RK4 as i32 {
        options.integrator = MjtIntegrator::mjINT_IMPLICITFAST as i32;
    }
    if let Some(time_step_s) = config.time_step_s {
        options.timestep = time_step_s;
    }
    let changed = config.changes.as_ref().and_then(|changes| changes.resolved().friction);
    if let Some(friction) = changed.or(config.friction) {
        let contact_geoms = places.contact_geoms();
        for &geom in &contact_geoms {
            model.geom_friction_mut()[geom][0] = friction;
        }
        let touches_foot: Vec<bool> = model
            .pair_geom1()
            .iter()
            .zip(model.pair_geom2())
            .map(|(a, b)| {
                let known = |id: i32| contact_geoms.iter().any(|&g| g as i32 == id);
                known(*a) && known(*b)
            })
            .collect();
        for (pair, touches) in model.pair_friction_mut().iter_mut().zip(touches_foot) {
            if touches {
                pair[..2].fill(friction);
            }
        }
    }
    if !config.body_contacts {
        let own = own_bodies(&model, places.torso);
        for geom in 0..model.ngeom() as usize {
            if places.foot_of_geom[geom].is_none() && own.contains(&(model.geom_bodyid()[geom] as usize)) {
                model.geom_contype_mut()[geom] = 0;
                model.geom_conaffinity_mut()[geom] = 0;
            }
        }
    }
    for axis in &places.axes {
        if let Some(armature) = axis.given.armature {
            model.dof_armature_mut()[axis.dof] = armature;
        }
        if let Some(damping) = axis.given.damping {
            model.dof_damping_mut()[axis.dof] = damping;
            model.opt_mut().integrator = MjtIntegrator::mjINT_IMPLICITFAST as i32;
        }
    }
    tune_servos(&mut model, places);
    if let Some(friction_nm) = config.joint_friction_nm {
        let own = own_bodies(&model, places.torso);
        for dof in 0..model.nv() as usize {
            let joint = model.dof_jntid()[dof] as usize;
            let hinge = model.jnt_type()[joint] == MjtJoint::mjJNT_HINGE;
            if hinge && own.contains(&(model.dof_bodyid()[dof] as usize)) {
                model.dof_frictionloss_mut()[dof] = friction_nm;
            }
        }
    }
    scale_mass(&mut model, config.mass_scale, places.torso);
    shift_torso(&mut model, config.torso_offset_m, places.torso);
    if let Some(changes) = &config.changes {
        changes.resolved().load(&mut model, &places.parts())?;
    }

    let mut data = MjData::try_new(Box::new(model)).map_err(allocation)?;
    data.set_const();
    Ok(data.model().clone())
}

/// Gains and limit of the legs' position servos.
fn tune_servos(model: &mut MjModel, places: &Binding) {
    for axis in places.axes.iter().filter(|axis| matches!(axis.drive, Drive::Servo { .. })) {
        let (Some(servo), Given { kp, kv, torque_nm, .. }) = (axis.actuator, axis.given) else { continue };
        let gear = model.actuator_gear()[model.actuator_outadr()[servo] as usize][0].abs();
        if let Some(kp) = kp {
            let kp = kp / (gear * gear);
            // Control and offset in units of the length stay what they are.
            let own = -model.actuator_biasprm()[servo][1];
            let [per_length, offset] = [model.actuator_gainprm()[servo][0], model.actuator_biasprm()[servo][0]]
                .map(|parameter| parameter / own);
            // SAFETY: the first gain parameter of a fixed gain is a plain factor, never an index.
            #[allow(unsafe_code)]
            let gains = unsafe { model.actuator_gainprm_mut() };
            gains[servo][0] = kp * per_length;
            model.actuator_biasprm_mut()[servo][0] = kp * offset;
            model.actuator_biasprm_mut()[servo][1] = -kp;
        }
        if let Some(kv) = kv {
            model.actuator_biasprm_mut()[servo][2] = -kv / (gear * gear);
        }
        if let Some(limit) = torque_nm {
            model.actuator_forcelimited_mut()[servo] = true;
            model.actuator_forcerange_mut()[servo] = [-limit / gear, limit / gear];
        }
    }
}

/// Scales mass and inertia of every body of the robot.
fn scale_mass(model: &mut MjModel, scale: f64, torso: usize) {
    let own = own_bodies(model, torso);
    for body in own {
        model.body_mass_mut()[body] *= scale;
        for moment in &mut model.body_inertia_mut()[body] {
            *moment *= scale;
        }
    }
}

/// Shifts the torso's centre of mass, and nothing else.
fn shift_torso(model: &mut MjModel, offset_m: [f64; 3], torso: usize) {
    if offset_m.iter().all(|o| o.abs() <= 0.0) {
        return;
    }
    for (position, offset) in model.body_ipos_mut()[torso].iter_mut().zip(offset_m) {
        *position += offset;
    }
    free_frames(model, torso);
}
