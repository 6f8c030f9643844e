//! MuJoCo itself: loading a model, its log, its warnings, its version.

use std::cell::RefCell;
use std::io::Write;
use std::sync::{Arc, Once};

use mujoco_rs::prelude::{MjCache, MjData, MjModel, set_log_handler};
use mujoco_rs::wrappers::mj_logging::{MjLogMessage, MjtLogLevel};
use mujoco_rs::wrappers::mj_model::MjtObjBase;
use sha2::{Digest, Sha256};

use crate::config::{Missing, ModelSource};
use crate::error::MujocoError;
use crate::foreign;

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

/// Where numbers came from.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Provenance {
    /// The simulator and its version.
    pub engine: String,
    /// The model: `biped` or a path.
    pub model: String,
    /// SHA-256 of the compiled model, overrides and meshes included, in hex.
    pub model_sha256: String,
    /// Mass of the robot.
    pub mass_kg: f64,
    /// Gravity (x, y, z).
    pub gravity_m_s2: [f64; 3],
    /// Time between two physics steps.
    pub time_step_s: f64,
    /// Time between two commands.
    pub control_period_s: f64,
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

/// Compiles a model as it is, with what it lacks, anew each time.
pub(crate) fn compile(source: &ModelSource, added: &[Missing]) -> Result<MjModel, MujocoError> {
    install_log_handler();
    let error = |reason: String| MujocoError::Load { model: source.to_string(), reason };
    match source {
        ModelSource::Biped => MjModel::from_xml_string(BIPED_XML).map_err(|e| error(e.to_string())),
        ModelSource::Op3 => MjModel::from_xml_string(OP3_XML).map_err(|e| error(e.to_string())),
        ModelSource::File(path) => {
            // MuJoCo's own message does not tell a missing file from a bad one.
            std::fs::metadata(path)
                .map_err(|e| error(stridemap_files::fetch_hint(path).unwrap_or_else(|| e.to_string())))?;
            if path.extension().is_some_and(|kind| kind == "mjb") {
                let bytes = std::fs::read(path).map_err(|e| error(e.to_string()))?;
                return MjModel::from_buffer(&bytes).map_err(|e| error(e.to_string()));
            }
            if added.is_empty() && !foreign::is_urdf(path) {
                // A file that is not there may be a picture's.
                let whole = MjModel::from_xml(path).map_err(|e| e.to_string());
                return whole
                    .or_else(|told| match told.contains("Error opening file") {
                        true => foreign::compile(path, added).map_err(|why| format!("{told}; {why}")),
                        false => Err(told),
                    })
                    .map_err(error);
            }
            foreign::compile(path, added).map_err(error)
        }
    }
}

/// A compiled model as a file.
pub(crate) fn bytes(model: &MjModel) -> Result<Vec<u8>, MujocoError> {
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
