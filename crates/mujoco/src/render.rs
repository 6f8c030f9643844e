//! Pictures of shapes by MuJoCo's own renderer, without a window (feature `render`; needs EGL at run
//! time).

use std::fmt::Write as _;
use std::path::Path;

use mujoco_rs::prelude::{MjData, MjModel, MjvCamera};
use mujoco_rs::renderer::{MjRenderer, png};
use stridemap_robot::{Pose, ShapeKind};

use crate::error::MujocoError;

/// A shape that stands somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Form and size.
    pub kind: ShapeKind,
    /// Where it is; the floor is at height zero.
    pub pose: Pose,
    /// Red, green, blue, opacity, each in \[0, 1\].
    pub rgba: [f32; 4],
}

/// From where a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// In the middle of the picture, metres.
    pub target_m: [f64; 3],
    /// Where the camera is, metres; not straight above or below the target.
    pub from_m: [f64; 3],
    /// Vertical angle of view, degrees.
    pub view_deg: f64,
}

/// The scene as a model without anything that moves.
fn scene(solids: &[Solid], camera: Camera, [width, height]: [u32; 2]) -> String {
    let away = [0, 1, 2].map(|i| camera.from_m[i] - camera.target_m[i]);
    let distance = away.iter().map(|c| c * c).sum::<f64>().sqrt();
    // The camera's x axis lies level, its y axis above it, and it looks along its own -z.
    let level = away[0].hypot(away[1]).max(1e-9);
    let x = [-away[1] / level, away[0] / level, 0.0];
    let z = away.map(|c| c / distance.max(1e-9));
    let y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
    let [tx, ty, tz] = camera.target_m;
    let [fx, fy, fz] = camera.from_m;
    // Half the width of what is seen: shadows and clipping planes are measured by it. Shadows reach five
    // times as far, because in a corner of their map the floor shades itself in specks.
    let aspect = (f64::from(width) / f64::from(height.max(1))).max(1.0);
    let radius = distance * (0.5 * camera.view_deg.to_radians()).tan() * aspect;
    let sun = [0.2, 0.35, -1.0];
    let [lx, ly, lz] = [0, 1, 2].map(|i| [tx, ty, tz][i] - 3.0 * radius * sun[i]);
    let [sx, sy, sz] = sun;
    let mut xml = format!(
        r#"<mujoco>
  <statistic extent="{radius}" center="{tx} {ty} 0"/>
  <visual>
    <global offwidth="{width}" offheight="{height}"/>
    <quality shadowsize="8192" offsamples="8"/>
    <map znear="0.05" zfar="{far}" shadowclip="5"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.35 0.35 0.35" specular="0 0 0"/>
    <rgba haze="1 1 1 1"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="64" height="64"/>
  </asset>
  <worldbody>
    <light pos="{lx} {ly} {lz}" dir="{sx} {sy} {sz}" directional="true" diffuse="0.45 0.45 0.45" specular="0.1 0.1 0.1"/>
    <camera name="camera" pos="{fx} {fy} {fz}" xyaxes="{x0} {x1} {x2} {y0} {y1} {y2}" fovy="{view}"/>
    <geom type="plane" size="0 0 1" rgba="0.95 0.96 0.97 1"/>
"#,
        far = 3.0 * distance / radius.max(1e-9),
        x0 = x[0],
        x1 = x[1],
        x2 = x[2],
        y0 = y[0],
        y1 = y[1],
        y2 = y[2],
        view = camera.view_deg,
    );
    for solid in solids {
        let (kind, size) = match solid.kind {
            ShapeKind::Sphere { radius_m } => ("sphere", vec![radius_m]),
            ShapeKind::Capsule { radius_m, half_length_m } => ("capsule", vec![radius_m, half_length_m]),
            ShapeKind::Cylinder { radius_m, half_length_m } => ("cylinder", vec![radius_m, half_length_m]),
            ShapeKind::Ellipsoid { semi_axes_m } => ("ellipsoid", semi_axes_m.to_vec()),
            ShapeKind::Box { half_extents_m } => ("box", half_extents_m.to_vec()),
        };
        let numbers = |values: &[f64]| {
            let words: Vec<String> = values.iter().map(ToString::to_string).collect();
            words.join(" ")
        };
        let color = solid.rgba.map(f64::from);
        // Writing to a string cannot fail.
        let _ = writeln!(
            xml,
            r#"    <geom type="{kind}" size="{}" pos="{}" quat="{}" rgba="{}" contype="0" conaffinity="0"/>"#,
            numbers(&size),
            numbers(&solid.pose.position_m),
            numbers(&solid.pose.orientation),
            numbers(&color)
        );
    }
    xml += "  </worldbody>\n</mujoco>\n";
    xml
}

/// Renders solids on a floor and writes a PNG file.
///
/// # Errors
///
/// [`MujocoError::Load`] if MuJoCo does not take the scene (a size of zero, a number that is not finite);
/// [`MujocoError::Render`] if there is no EGL here or the file cannot be written.
pub fn render(solids: &[Solid], camera: Camera, size_px: [u32; 2], path: &Path) -> Result<(), MujocoError> {
    let xml = scene(solids, camera, size_px);
    let model = MjModel::from_xml_string(&xml)
        .map_err(|error| MujocoError::Load { model: "picture".into(), reason: error.to_string() })?;
    let failed = |error: &dyn std::fmt::Display| MujocoError::Render {
        path: path.display().to_string(),
        reason: error.to_string(),
    };
    let mut data = MjData::new(&model);
    data.forward();
    let mut renderer = MjRenderer::builder()
        .width(size_px[0])
        .height(size_px[1])
        .camera(MjvCamera::new_fixed(0))
        .png_compression(png::Compression::High)
        .build(&model)
        .map_err(|error| failed(&error))?;
    renderer.sync_data(&mut data).map_err(|error| failed(&error))?;
    renderer.render().map_err(|error| failed(&error))?;
    renderer.save_rgb(path).map_err(|error| failed(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The scene is a model that MuJoCo takes, with the floor and every solid; the camera is where it was
    /// put, looks at its target, and its picture is upright. (Drawing it needs EGL, which is not
    /// everywhere.)
    #[test]
    fn the_scene_has_every_solid_and_the_camera_looks_at_its_target() {
        let solid = |kind| Solid { kind, pose: Pose::default(), rgba: [1.0, 0.5, 0.0, 1.0] };
        let solids = [
            solid(ShapeKind::Sphere { radius_m: 0.1 }),
            solid(ShapeKind::Capsule { radius_m: 0.1, half_length_m: 0.2 }),
            solid(ShapeKind::Box { half_extents_m: [0.1, 0.2, 0.3] }),
        ];
        let camera = Camera { target_m: [1.0, 2.0, 0.5], from_m: [1.0, -2.0, 3.5], view_deg: 20.0 };
        let model = MjModel::from_xml_string(&scene(&solids, camera, [64, 32])).unwrap();
        assert_eq!((model.ngeom(), model.ncam()), (4, 1));
        let mut data = MjData::new(&model);
        data.forward();
        // Columns of the camera's matrix are its axes; it looks along -z: (0, 4, -3) / 5.
        let m = data.cam_xmat()[0];
        assert!((m[2]).abs() < 1e-9 && (m[5] + 0.8).abs() < 1e-9 && (m[8] - 0.6).abs() < 1e-9);
        assert!((m[0] - 1.0).abs() < 1e-9, "to the right is +x");
        assert!(m[7] > 0.0, "the picture's up is up");
    }
}
