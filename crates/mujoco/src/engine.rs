//! MuJoCo itself: loading a model with the user's overrides, its log, its warnings, its version.

use std::cell::RefCell;
use std::io::Write;
use std::sync::{Arc, Once};

use mujoco_rs::prelude::{MjCache, MjData, MjModel, set_log_handler};
use mujoco_rs::wrappers::mj_logging::{MjLogMessage, MjtLogLevel};
use mujoco_rs::wrappers::mj_model::{MjtDisableBit, MjtIntegrator, MjtJoint, MjtObjBase, MjtSameFrame};
use sha2::{Digest, Sha256};

use crate::config::{ModelSource, MujocoConfig};
use crate::error::MujocoError;
use crate::store::load;

/// The built-in biped, as MJCF text.
pub const BIPED_XML: &str = include_str!("../models/biped.xml");

/// ROBOTIS OP3, as MJCF text; written from the facts of the open model, with its licence (Apache-2.0).
pub const OP3_XML: &str = include_str!("../models/op3.xml");

/// Data of a simulation that owns its share of the model.
pub(crate) type Data = MjData<Arc<MjModel>>;

thread_local! {
    /// The last warning that MuJoCo raised on this thread, in its own words.
    static LAST_WARNING: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Version of the MuJoCo library, e.g. `"3.17.0"`.
///
/// # Example
///
/// ```
/// assert_eq!(stridemap_mujoco::mujoco_version(), "3.17.0");
/// ```
#[must_use]
pub fn mujoco_version() -> &'static str {
    mujoco_rs::mujoco_version()
}

/// Routes MuJoCo's messages to this crate, once per process and before any model is loaded.
///
/// MuJoCo's own handler prints, and appends to a file in the working directory.
fn install_log_handler() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        // SAFETY: no other thread may use MuJoCo meanwhile. This crate is the only one of the workspace that
        // uses MuJoCo, it reaches every use through `load`, which begins here, and `Once` holds all other threads there.
        #[allow(unsafe_code)]
        unsafe {
            set_log_handler(keep_warning);
        }
        // MuJoCo's own cache of meshes tells a changed file by its time in whole seconds.
        MjCache::current().set_capacity(0);
    });
}

/// Keeps a warning for [`take_warning`]; tells the user of an error, after which MuJoCo ends the process.
fn keep_warning(message: &MjLogMessage) {
    match message.level() {
        MjtLogLevel::mjLOG_WARNING => LAST_WARNING.with_borrow_mut(|last| {
            last.clear();
            last.push_str(message.subject().trim_end());
        }),
        MjtLogLevel::mjLOG_ERROR => {
            writeln!(std::io::stderr(), "MuJoCo: {}", message.subject()).ok();
        }
        _ => {}
    }
}

/// The last warning on this thread, which is then forgotten.
pub(crate) fn take_warning() -> String {
    LAST_WARNING.with_borrow_mut(std::mem::take)
}

/// Compiles a model as it is; [`load`](crate::store::load) does it once.
pub(crate) fn compile(source: &ModelSource) -> Result<MjModel, MujocoError> {
    install_log_handler();
    let error = |reason: String| MujocoError::Load { model: source.to_string(), reason };
    match source {
        ModelSource::Biped => MjModel::from_xml_string(BIPED_XML),
        ModelSource::Op3 => MjModel::from_xml_string(OP3_XML),
        ModelSource::File(path) => {
            // MuJoCo's own message does not tell a missing file from a bad one.
            std::fs::metadata(path).map_err(|e| error(e.to_string()))?;
            if path.extension().is_some_and(|kind| kind == "mjb") {
                MjModel::from_buffer(&std::fs::read(path).map_err(|e| error(e.to_string()))?)
            } else {
                MjModel::from_xml(path)
            }
        }
    }
    .map_err(|e| error(e.to_string()))
}

/// A model as MuJoCo compiles it, meshes included and without overrides: as a file `*.mjb` it stands for the
/// original wherever a model file is named, in this version of MuJoCo.
///
/// # Errors
///
/// [`MujocoError::Load`].
pub fn compiled(source: &ModelSource) -> Result<Vec<u8>, MujocoError> {
    let model = load(source)?;
    bytes(&model)
}

fn bytes(model: &MjModel) -> Result<Vec<u8>, MujocoError> {
    let mut bytes = vec![0; model.size()];
    model
        .save_to_buffer(&mut bytes)
        .map_err(|e| MujocoError::Load { model: "compiled model".into(), reason: e.to_string() })?;
    Ok(bytes)
}

/// SHA-256 of the compiled model: everything that the simulation reads, overrides and meshes included.
pub(crate) fn hash(model: &MjModel) -> Result<String, MujocoError> {
    Ok(sha256(&bytes(model)?))
}

/// SHA-256 of bytes, in hex.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What [`apply`] must know of where things are in the model.
pub(crate) struct Places<'a> {
    /// Root body of the robot.
    pub torso: usize,
    /// Geoms of the feet and of the floor.
    pub contact_geoms: &'a [usize],
    /// Position actuators of the leg joints.
    pub servos: &'a [usize],
}

/// Applies the user's overrides and recomputes what MuJoCo derives from them.
pub(crate) fn apply(model: &MjModel, config: &MujocoConfig, places: &Places<'_>) -> Result<MjModel, MujocoError> {
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
    if let Some(friction) = config.friction {
        for &geom in places.contact_geoms {
            model.geom_friction_mut()[geom][0] = friction;
        }
        let touches_foot: Vec<bool> = model
            .pair_geom1()
            .iter()
            .zip(model.pair_geom2())
            .map(|(a, b)| {
                let known = |id: i32| places.contact_geoms.iter().any(|&g| g as i32 == id);
                known(*a) && known(*b)
            })
            .collect();
        for (pair, touches) in model.pair_friction_mut().iter_mut().zip(touches_foot) {
            if touches {
                pair[..2].fill(friction);
            }
        }
    }
    tune_servos(&mut model, config, places.servos);
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

    let mut data = MjData::try_new(Box::new(model)).map_err(allocation)?;
    data.set_const();
    Ok(data.model().clone())
}

/// Gains and limit of position servos.
fn tune_servos(model: &mut MjModel, config: &MujocoConfig, servos: &[usize]) {
    for &servo in servos {
        let gear = model.actuator_gear()[model.actuator_outadr()[servo] as usize][0].abs();
        if let Some(kp) = config.kp_nm_rad {
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
        if let Some(kv) = config.kv_nms_rad {
            model.actuator_biasprm_mut()[servo][2] = -kv / (gear * gear);
        }
        if let Some(limit) = config.torque_limit_nm {
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
    // Shortcuts for frames that coincide no longer hold: a geom must not move with the mass.
    model.body_sameframe_mut()[torso] = MjtSameFrame::mjSAMEFRAME_NONE;
    let on_torso = |bodies: &[i32]| -> Vec<bool> { bodies.iter().map(|&b| b as usize == torso).collect() };
    let geoms = on_torso(model.geom_bodyid());
    for (frame, _) in (model.geom_sameframe_mut().iter_mut().zip(geoms)).filter(|(_, own)| *own) {
        *frame = MjtSameFrame::mjSAMEFRAME_NONE;
    }
    let sites = on_torso(model.site_bodyid());
    for (frame, _) in (model.site_sameframe_mut().iter_mut().zip(sites)).filter(|(_, own)| *own) {
        *frame = MjtSameFrame::mjSAMEFRAME_NONE;
    }
}

/// The bodies of the tree whose root is `torso`.
pub(crate) fn own_bodies(model: &MjModel, torso: usize) -> Vec<usize> {
    let roots = model.body_rootid();
    (0..roots.len()).filter(|&body| roots[body] as usize == torso).collect()
}

/// The error for data that cannot be allocated.
pub(crate) fn allocation(error: impl std::fmt::Display) -> MujocoError {
    MujocoError::Load { model: "simulation data".into(), reason: error.to_string() }
}

/// The name of an object, or `#id` for one without.
pub(crate) fn name_of(model: &MjModel, kind: MjtObjBase, id: usize) -> String {
    match model.id_to_name(kind, id) {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => format!("#{id}"),
    }
}
