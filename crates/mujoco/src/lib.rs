//! Legged robots simulated by MuJoCo: the 1.6 m, 95 kg biped, and any MJCF with a joint map.
//!
//! [`MujocoRobot`] implements [`Robot`](stridemap_robot::Robot) from a [`MujocoConfig`]. This is the only crate
//! of the workspace that touches MuJoCo. Its build script fetches MuJoCo's shared library; x86-64 and aarch64
//! Linux with glibc are supported.
//!
//! What the simulator warns of is an error here: a state that MuJoCo itself would reset in silence never
//! reaches a return map.

mod actuators;
mod axis;
mod binding;
mod changes;
mod config;
mod dimensions;
mod drive;
mod engine;
mod error;
mod floor;
mod foreign;
mod guess;
mod hardware;
mod law;
mod machine;
mod mesh;
mod moment;
mod overrides;
mod payload;
mod per_joint;
mod report;
mod robot;
mod rotation;
mod scene;
mod sensed;
mod sensors;
mod sole;
mod store;
mod strap;
mod world;

pub use changes::{ChangePreset, ChangesConfig};
pub use config::{LegMap, Missing, ModelSource, MujocoConfig};
pub use dimensions::Dimensions;
pub use engine::{BIPED_XML, OP3_XML, Provenance, mujoco_version, sha256};
pub use error::MujocoError;
pub use guess::{Guess, GuessedJoint, guess};
pub use hardware::HardwareConfig;
pub use machine::{SimulatedMachine, estimator, kinematic_model};
pub use moment::Snapshot;
pub use per_joint::{PerJoint, Posture, RestAngle};
pub use report::{ActuatorKind, JointReport};
pub use robot::MujocoRobot;
pub use sensed::SensedRobot;
pub use sensors::{SensorConfig, SpeedSource, WiringFault};
pub use store::compiled;
