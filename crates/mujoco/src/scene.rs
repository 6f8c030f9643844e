//! What a model looks like.

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtObjBase};
use stridemap_robot::{Pose, Shape, ShapeKind};

/// The groups that MuJoCo's own viewer shows; models put collision geometry into higher ones.
const VISIBLE_GROUPS: std::ops::RangeInclusive<i32> = 0..=2;

/// Every visible geom but planes and height fields; a mesh as its bounding box.
pub(crate) fn shapes(model: &MjModel) -> Vec<Shape> {
    (0..model.ngeom() as usize)
        .filter(|&geom| VISIBLE_GROUPS.contains(&model.geom_group()[geom]))
        .filter_map(|geom| shape(model, geom))
        .collect()
}

/// One geom; `None` for one without a finite shape or fully transparent.
fn shape(model: &MjModel, geom: usize) -> Option<Shape> {
    let [a, b, c] = model.geom_size()[geom];
    let mut position_m = model.geom_pos()[geom];
    let orientation = model.geom_quat()[geom];
    let kind = match model.geom_type()[geom] {
        MjtGeomBase::mjGEOM_SPHERE => ShapeKind::Sphere { radius_m: a },
        MjtGeomBase::mjGEOM_CAPSULE => ShapeKind::Capsule { radius_m: a, half_length_m: b },
        MjtGeomBase::mjGEOM_CYLINDER => ShapeKind::Cylinder { radius_m: a, half_length_m: b },
        MjtGeomBase::mjGEOM_ELLIPSOID => ShapeKind::Ellipsoid { semi_axes_m: [a, b, c] },
        MjtGeomBase::mjGEOM_BOX => ShapeKind::Box { half_extents_m: [a, b, c] },
        MjtGeomBase::mjGEOM_MESH | MjtGeomBase::mjGEOM_SDF => {
            let aabb = model.geom_aabb()[geom];
            let centre = crate::rotation::turn(orientation, [aabb[0], aabb[1], aabb[2]]);
            position_m = [0, 1, 2].map(|i| position_m[i] + centre[i]);
            ShapeKind::Box { half_extents_m: [aabb[3], aabb[4], aabb[5]] }
        }
        MjtGeomBase::mjGEOM_PLANE | MjtGeomBase::mjGEOM_HFIELD => return None,
    };
    let rgba = match usize::try_from(model.geom_matid()[geom]) {
        Ok(material) => model.mat_rgba()[material],
        Err(_) => model.geom_rgba()[geom],
    };
    (rgba[3] > 0.0).then(|| Shape {
        name: model.id_to_name(MjtObjBase::mjOBJ_GEOM, geom).unwrap_or_default().to_owned(),
        body: model.geom_bodyid()[geom] as usize,
        kind,
        pose: Pose { position_m, orientation },
        rgba,
    })
}
