//! Legged robots simulated by MuJoCo.
/// v
#[must_use]
pub fn mujoco_version() -> &'static str { mujoco_rs::mujoco_version() }
