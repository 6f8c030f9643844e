//! Whether a world is what a walk needs: gravity that points down, contacts, servos that act.

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::mj_model::MjtDisableBit;

/// Sideways part of gravity, of the whole, that is rounding.
const SIDEWAYS: f64 = 1e-9;

/// Why nothing can walk in this world as its options are.
pub(crate) fn problem(model: &MjModel) -> Option<String> {
    let flags = model.opt().disableflags;
    for (flag, name, effect) in [
        (MjtDisableBit::mjDSBL_GRAVITY, "gravity", "nothing has weight"),
        (MjtDisableBit::mjDSBL_CONTACT, "contact", "feet fall through the floor"),
        (MjtDisableBit::mjDSBL_CONSTRAINT, "constraint", "feet fall through the floor"),
        (MjtDisableBit::mjDSBL_ACTUATION, "actuation", "no joint can be driven"),
    ] {
        if flags & flag as i32 != 0 {
            return Some(format!("its <option><flag {name}=\"disable\"/> means that {effect}; remove it"));
        }
    }
    let [x, y, z] = model.opt().gravity;
    let level = x.hypot(y) <= SIDEWAYS * z.abs();
    (!(level && z < 0.0)).then(|| {
        format!("its gravity is ({x}, {y}, {z}) m/s2; it must point down along z, as in gravity=\"0 0 -9.81\"")
    })
}
