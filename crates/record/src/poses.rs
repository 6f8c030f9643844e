//! `poses/` and `lapse/`: recorded motion, so that a report can show the robot moving without its simulator.

use serde::{Deserialize, Serialize};
use stridemap_robot::Shape;
use stridemap_robot::kinematics::rotate;

use crate::stride::Transition;

/// One picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Robot time.
    pub time_s: f64,
    /// Position and orientation (x, y, z, w, x, y, z) of each body.
    pub poses: Vec<[f64; 7]>,
    /// Centre of pressure; null in the air.
    pub cop_m: Option<[f64; 2]>,
    /// Load of the left and the right foot.
    pub loads_n: [f64; 2],
    /// Whether a section was found since the frame before.
    pub crossing: bool,
    /// A force on the torso; null without.
    pub push_n: Option<[f64; 3]>,
}

impl Frame {
    /// Where a point of a shape's own frame is in the world; `None` where the body has no pose.
    #[must_use]
    pub fn point_m(&self, shape: &Shape, local_m: [f64; 3]) -> Option<[f64; 3]> {
        let [x, y, z, qw, qx, qy, qz] = *self.poses.get(shape.body)?;
        let plus = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let in_body = plus(shape.pose.position_m, rotate(shape.pose.orientation, local_m));
        Some(plus([x, y, z], rotate([qw, qx, qy, qz], in_body)))
    }
}

/// A stretch of a robot's motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Version of this format.
    pub format: u32,
    /// What the robot looks like.
    pub shapes: Vec<Shape>,
    /// Time between frames.
    pub period_s: f64,
    /// The frames.
    pub frames: Vec<Frame>,
}

impl Recording {
    /// The largest shape: the torso, on which pushes act.
    #[must_use]
    pub fn torso(&self) -> Option<&Shape> {
        self.shapes.iter().max_by(|a, b| a.kind.volume_m3().total_cmp(&b.kind.volume_m3()))
    }

    /// Leaves out what came before the first stride of a batch: the gait's start and its warm-up.
    pub fn begin_with(&mut self, strides: &[Transition]) {
        if let Some(first) = strides.first() {
            let begin_s = first.time_s - first.measures.duration_s;
            self.frames.retain(|f| f.time_s >= begin_s - 1e-6);
        }
    }
}

/// What motion is recorded for, which decides how often a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// To be played: smooth to the eye, some seconds.
    Film,
    /// To be set side by side in a time lapse: a picture now and then, for a minute.
    Lapse,
}

impl Pace {
    /// Its folder in a run directory.
    #[must_use]
    pub const fn folder(self) -> &'static str {
        match self {
            Self::Film => "poses",
            Self::Lapse => "lapse",
        }
    }

    /// Time between pictures.
    #[must_use]
    pub const fn period_s(self) -> f64 {
        match self {
            Self::Film => 0.02,
            Self::Lapse => 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_robot::{Pose, ShapeKind};

    #[test]
    fn a_point_of_a_shape_turns_with_its_body() {
        // A quarter turn about x takes z to -y.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let frame = Frame { poses: vec![[1.0, 2.0, 3.0, half, half, 0.0, 0.0]], ..Frame::default() };
        let shape = |body| Shape {
            name: String::new(),
            body,
            kind: ShapeKind::Sphere { radius_m: 0.1 },
            pose: Pose { position_m: [0.0, 0.0, 0.5], ..Pose::default() },
            rgba: [1.0; 4],
        };
        let at = frame.point_m(&shape(0), [0.1, 0.0, 0.0]).unwrap();
        assert!(at.iter().zip([1.1, 1.5, 3.0]).all(|(found, wanted)| (found - wanted).abs() < 1e-12), "{at:?}");
        assert!(frame.point_m(&shape(1), [0.0; 3]).is_none());
    }
}
