//! Where the soles are: found once, in the reference posture, from all contact geoms of the feet. A foot need not be flat
//! there: its plane is the one on which it would come to rest.

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::mj_model::MjtGeomBase;

use crate::binding::{Binding, collides};
use crate::engine::Data;
use crate::error::MujocoError;
use crate::rotation::{to_body, to_world};

/// Points this near to the plane on which a foot rests belong to its sole.
const SOLE_THICKNESS_M: f64 = 0.005;
/// A sole that is tilted by less is taken as level.
const LEVEL_RAD: f64 = 0.01;
/// Tangent of the largest tilt of a sole in the reference posture.
const STEEPEST: f64 = 0.6;

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

/// Finds both soles. `data` holds the reference posture, its kinematics computed.
pub(crate) fn find(model: &MjModel, data: &Data, binding: &Binding, name: &str) -> Result<[Sole; 2], MujocoError> {
    let mut soles = [Sole::default(), Sole::default()];
    for (side, sole) in soles.iter_mut().enumerate() {
        let body = binding.feet[side];
        let geoms: Vec<usize> = (0..model.ngeom() as usize)
            .filter(|&g| binding.foot_of_geom[g] == Some(side as u8) && collides(model, g))
            .collect();
        if geoms.is_empty() {
            return Err(MujocoError::NotABiped {
                model: name.into(),
                reason: format!(
                    "the {} foot has no geom that can touch the floor (contype or conaffinity not 0)",
                    ["left", "right"][side]
                ),
            });
        }
        let (origin, rotation) = (data.xpos()[body], &data.xmat()[body]);
        let points =
            |down: [f64; 3]| -> Vec<[f64; 3]> { geoms.iter().flat_map(|&g| lowest(model, data, g, down)).collect() };
        let up = resting(&points, origin);
        let (sin, cos) = binding.heading_rad.sin_cos();
        let forward = unit(minus([cos, sin, 0.0], up, dot([cos, sin, 0.0], up)));
        let left = cross(up, forward);
        let points: Vec<[f64; 3]> = (points(up.map(|v| -v)).into_iter())
            .map(|point| [dot(point, forward), dot(point, left), dot(point, up)])
            .collect();
        let bottom = points.iter().map(|p| p[2]).fold(f64::MAX, f64::min);
        let touching: Vec<[f64; 3]> = points.into_iter().filter(|p| p[2] < bottom + SOLE_THICKNESS_M).collect();
        let middle = |axis: usize| {
            let values = || touching.iter().map(|p| p[axis]);
            0.5 * (values().fold(f64::MAX, f64::min) + values().fold(f64::MIN, f64::max))
        };
        let local = |[x, y, z]: [f64; 3]| {
            let point = [0, 1, 2].map(|i| x * forward[i] + y * left[i] + z * up[i] - origin[i]);
            to_body(rotation, point)
        };
        *sole = Sole {
            centre_m: local([middle(0), middle(1), bottom]),
            forward: to_body(rotation, forward),
            corners_m: touching.into_iter().map(local).collect(),
        };
    }
    Ok(soles)
}

/// Upward normal of the plane on which a foot rests: where its height over the plane, as that tilts, is least nearby.
fn resting(points: &impl Fn([f64; 3]) -> Vec<[f64; 3]>, ankle: [f64; 3]) -> [f64; 3] {
    let tilted = |[a, b]: [f64; 2]| unit([a, b, -1.0]);
    let all = points([0.0, 0.0, -1.0]);
    let middle = [0, 1].map(|axis| {
        let values = || all.iter().map(|p| p[axis]);
        0.5 * (values().fold(f64::MAX, f64::min) + values().fold(f64::MIN, f64::max))
    });
    let centre = [middle[0], middle[1], ankle[2]];
    let height = |tilt: [f64; 2]| {
        let down = tilted(tilt);
        points(down).into_iter().map(|p| dot(p, down)).fold(f64::MIN, f64::max) - dot(centre, down)
    };
    let (mut tilt, mut step) = ([0.0, 0.0], 0.1);
    let mut least = height(tilt);
    while step > 1e-5 {
        let near = (0..16).map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_8).sin_cos();
            [tilt[0] + step * cos, tilt[1] + step * sin]
        });
        let flat_enough = near.filter(|t| t[0].hypot(t[1]) < STEEPEST);
        match flat_enough.map(|t| (height(t), t)).min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((lower, there)) if lower < least - 1e-9 => (least, tilt) = (lower, there),
            _ => step *= 0.5,
        }
    }
    if tilt[0].hypot(tilt[1]) < LEVEL_RAD { [0.0, 0.0, 1.0] } else { tilted(tilt).map(|v| -v) }
}

/// The points of a geom that can be its lowest along a direction, in the world.
fn lowest(model: &MjModel, data: &Data, geom: usize, down: [f64; 3]) -> Vec<[f64; 3]> {
    let (origin, rotation) = (data.geom_xpos()[geom], &data.geom_xmat()[geom]);
    let [a, b, _] = model.geom_size()[geom];
    let kind = model.geom_type()[geom];
    let place = |local: [f64; 3]| {
        let turned = to_world(rotation, local);
        [0, 1, 2].map(|i| origin[i] + turned[i])
    };
    let below = |point: [f64; 3]| [0, 1, 2].map(|i| point[i] + a * down[i]);
    match kind {
        MjtGeomBase::mjGEOM_SPHERE => vec![below(origin)],
        MjtGeomBase::mjGEOM_CAPSULE => [-b, b].map(|end| below(place([0.0, 0.0, end]))).into(),
        MjtGeomBase::mjGEOM_CYLINDER => {
            let rim = |i: i32, end: f64| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_8).sin_cos();
                place([a * cos, a * sin, end])
            };
            (0..16).flat_map(|i| [rim(i, -b), rim(i, b)]).collect()
        }
        MjtGeomBase::mjGEOM_MESH => {
            let mesh = usize::try_from(model.geom_dataid()[geom]).unwrap_or_default();
            let (first, count) = (model.mesh_vertadr()[mesh] as usize, model.mesh_vertnum()[mesh] as usize);
            model.mesh_vert()[first..first + count].iter().map(|v| place(v.map(f64::from))).collect()
        }
        _ => {
            let aabb = model.geom_aabb()[geom];
            let corner = |corner: usize| {
                place([0, 1, 2].map(|i| {
                    let side = if corner >> i & 1 == 0 { -1.0 } else { 1.0 };
                    aabb[i] + side * aabb[3 + i]
                }))
            };
            (0..8).map(corner).collect()
        }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a - scale * b`.
fn minus(a: [f64; 3], b: [f64; 3], scale: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - scale * b[i])
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|v| v / length)
}
