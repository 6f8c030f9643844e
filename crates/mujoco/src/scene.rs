//! What a model looks like.

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtObjBase};
use stridemap_robot::{Pose, Shape, ShapeKind};

/// The groups that MuJoCo's own viewer shows; models put collision geometry into higher ones.
const VISIBLE_GROUPS: std::ops::RangeInclusive<i32> = 0..=2;

/// Triangles of all meshes of a robot together: what a page draws at 30 pictures a second.
const TRIANGLES: f64 = 5000.0;
/// Triangles of a small mesh.
const FEW_TRIANGLES: f64 = 40.0;

/// Every visible geom but planes and height fields; a mesh coarse enough to be drawn quickly.
pub(crate) fn shapes(model: &MjModel) -> Vec<Shape> {
    let seen: Vec<usize> =
        (0..model.ngeom() as usize).filter(|&geom| VISIBLE_GROUPS.contains(&model.geom_group()[geom])).collect();
    // Larger pieces get more triangles, by their length.
    let length = |geom: usize| if is_mesh(model, geom) { model.geom_rbound()[geom] } else { 0.0 };
    let all: f64 = seen.iter().map(|&geom| length(geom)).sum();
    seen.into_iter()
        .filter_map(|geom| {
            let most = (TRIANGLES * length(geom) / all.max(1e-9)).max(FEW_TRIANGLES);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Between 40 and 5000.
            shape(model, geom, most as usize)
        })
        .collect()
}

fn is_mesh(model: &MjModel, geom: usize) -> bool {
    matches!(model.geom_type()[geom], MjtGeomBase::mjGEOM_MESH | MjtGeomBase::mjGEOM_SDF)
}

/// The form of a geom's mesh.
fn mesh_of(model: &MjModel, geom: usize, most_triangles: usize) -> Option<ShapeKind> {
    let mesh = usize::try_from(model.geom_dataid()[geom]).ok()?;
    let part = |first: i32, count: i32| Some(usize::try_from(first).ok()?..usize::try_from(first + count).ok()?);
    let vertices = model.mesh_vert().get(part(model.mesh_vertadr()[mesh], model.mesh_vertnum()[mesh])?)?;
    let faces = model.mesh_face().get(part(model.mesh_faceadr()[mesh], model.mesh_facenum()[mesh])?)?;
    let (vertices_m, triangles) = crate::mesh::coarse(vertices, faces, most_triangles);
    (!triangles.is_empty()).then_some(ShapeKind::Mesh { vertices_m, triangles })
}

/// One geom; `None` for one without a finite shape or fully transparent.
fn shape(model: &MjModel, geom: usize, most_triangles: usize) -> Option<Shape> {
    let [a, b, c] = model.geom_size()[geom];
    let position_m = model.geom_pos()[geom];
    let orientation = model.geom_quat()[geom];
    let kind = match model.geom_type()[geom] {
        MjtGeomBase::mjGEOM_SPHERE => ShapeKind::Sphere { radius_m: a },
        MjtGeomBase::mjGEOM_CAPSULE => ShapeKind::Capsule { radius_m: a, half_length_m: b },
        MjtGeomBase::mjGEOM_CYLINDER => ShapeKind::Cylinder { radius_m: a, half_length_m: b },
        MjtGeomBase::mjGEOM_ELLIPSOID => ShapeKind::Ellipsoid { semi_axes_m: [a, b, c] },
        MjtGeomBase::mjGEOM_BOX => ShapeKind::Box { half_extents_m: [a, b, c] },
        MjtGeomBase::mjGEOM_MESH | MjtGeomBase::mjGEOM_SDF => mesh_of(model, geom, most_triangles)?,
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
