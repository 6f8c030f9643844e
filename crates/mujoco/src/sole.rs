//! Where the soles are: found once, in the reference posture, from the feet's collision geoms.

use mujoco_rs::prelude::MjModel;

use crate::binding::{Binding, collides};
use crate::engine::Data;
use crate::error::MujocoError;
use crate::rotation::{to_body, to_world};

/// Geoms whose lowest points differ by less than this belong to one sole.
const SOLE_THICKNESS_M: f64 = 0.005;

/// One sole, in the frame of its foot's body.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sole {
    /// Centre of the footprint.
    pub centre_m: [f64; 3],
    /// Unit vector that points forward when the foot is flat.
    pub forward: [f64; 3],
    /// Corners of the geoms of the sole.
    pub corners_m: Vec<[f64; 3]>,
}

/// Finds both soles. `data` holds the reference posture, its kinematics computed; there the feet are flat.
pub(crate) fn find(model: &MjModel, data: &Data, binding: &Binding, name: &str) -> Result<[Sole; 2], MujocoError> {
    let mut soles = [Sole::default(), Sole::default()];
    for (side, sole) in soles.iter_mut().enumerate() {
        let body = binding.feet[side];
        let geoms: Vec<Vec<[f64; 3]>> = (0..model.ngeom() as usize)
            .filter(|&g| binding.foot_of_geom[g] == Some(side as u8) && collides(model, g))
            .map(|g| corners(model, data, g))
            .collect();
        let lowest = |corners: &[[f64; 3]]| corners.iter().map(|c| c[2]).fold(f64::MAX, f64::min);
        let bottom = geoms.iter().map(|c| lowest(c)).fold(f64::MAX, f64::min);
        let touching: Vec<[f64; 3]> =
            geoms.into_iter().filter(|corners| lowest(corners) < bottom + SOLE_THICKNESS_M).flatten().collect();
        if touching.is_empty() {
            return Err(MujocoError::NotABiped {
                model: name.into(),
                reason: format!(
                    "the {} foot has no geom that can touch the floor (contype or conaffinity not 0)",
                    ["left", "right"][side]
                ),
            });
        }
        let middle = |axis: usize| {
            let values = || touching.iter().map(|c| c[axis]);
            0.5 * (values().fold(f64::MAX, f64::min) + values().fold(f64::MIN, f64::max))
        };
        let (origin, rotation) = (&data.xpos()[body], &data.xmat()[body]);
        let local = |point: [f64; 3]| {
            let relative = [0, 1, 2].map(|i| point[i] - origin[i]);
            to_body(rotation, relative)
        };
        *sole = Sole {
            centre_m: local([middle(0), middle(1), bottom]),
            forward: to_body(rotation, [1.0, 0.0, 0.0]),
            corners_m: touching.into_iter().map(local).collect(),
        };
    }
    Ok(soles)
}

/// The eight corners of a geom's bounding box, in the world.
fn corners(model: &MjModel, data: &Data, geom: usize) -> Vec<[f64; 3]> {
    let aabb = model.geom_aabb()[geom];
    let (origin, rotation) = (&data.geom_xpos()[geom], &data.geom_xmat()[geom]);
    (0..8)
        .map(|corner| {
            let local = [0, 1, 2].map(|i| {
                let side = if corner >> i & 1 == 0 { -1.0 } else { 1.0 };
                aabb[i] + side * aabb[3 + i]
            });
            let turned = to_world(rotation, local);
            [0, 1, 2].map(|i| origin[i] + turned[i])
        })
        .collect()
}
