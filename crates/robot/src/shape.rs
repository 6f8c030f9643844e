//! What a robot looks like, so that a report can draw and replay it without its simulator.

use serde::{Deserialize, Serialize};

/// Where a body is in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Origin of the body.
    pub position_m: [f64; 3],
    /// Orientation, unit quaternion (w, x, y, z).
    pub orientation: [f64; 4],
}

impl Default for Pose {
    fn default() -> Self {
        Self { position_m: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0] }
    }
}

/// Form and size of a shape, in its own frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "type")]
pub enum ShapeKind {
    /// A ball about the origin.
    Sphere {
        /// Radius.
        radius_m: f64,
    },
    /// A cylinder along z with a half ball on either end.
    Capsule {
        /// Radius.
        radius_m: f64,
        /// Half the length of the cylinder, without the half balls.
        half_length_m: f64,
    },
    /// A cylinder along z.
    Cylinder {
        /// Radius.
        radius_m: f64,
        /// Half the length.
        half_length_m: f64,
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Semi-axes along x, y, z.
        semi_axes_m: [f64; 3],
    },
    /// A box.
    Box {
        /// Half the edges along x, y, z.
        half_extents_m: [f64; 3],
    },
    /// A surface of triangles, coarse enough to be drawn many times a second.
    Mesh {
        /// Corners, x, y, z.
        vertices_m: Vec<[f32; 3]>,
        /// Three corners each, by index, anticlockwise seen from outside.
        triangles: Vec<[u32; 3]>,
    },
}

impl ShapeKind {
    /// Volume, cubic metres; of a mesh, that of the box along its axes that holds it.
    #[must_use]
    pub fn volume_m3(&self) -> f64 {
        use std::f64::consts::PI;
        match self {
            Self::Mesh { vertices_m, .. } => {
                let edge = |axis: usize| {
                    let along = || vertices_m.iter().map(|v| f64::from(v[axis]));
                    (along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)).max(0.0)
                };
                edge(0) * edge(1) * edge(2)
            }
            Self::Box { half_extents_m: [x, y, z] } => 8.0 * x * y * z,
            Self::Sphere { radius_m: r } => 4.0 / 3.0 * PI * r.powi(3),
            Self::Ellipsoid { semi_axes_m: [x, y, z] } => 4.0 / 3.0 * PI * x * y * z,
            Self::Capsule { radius_m: r, half_length_m: h } => PI * r * r * (2.0 * h + 4.0 / 3.0 * r),
            Self::Cylinder { radius_m: r, half_length_m: h } => 2.0 * PI * r * r * h,
        }
    }
}

/// One visible piece of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Name for reports; may be empty.
    pub name: String,
    /// Which body carries it: an index into what [`Robot::poses`](crate::Robot::poses) writes.
    pub body: usize,
    /// Form and size.
    pub kind: ShapeKind,
    /// Where the shape's frame lies in the body's.
    pub pose: Pose,
    /// Red, green, blue, opacity, each in \[0, 1\].
    pub rgba: [f32; 4],
}
