//! `poses/` and `lapse/`: recorded motion, so that a report can show the robot moving without its simulator.

use serde::{Deserialize, Serialize};
use stridemap_robot::Shape;

use crate::stride::Transition;

/// One picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// A stretch of a robot's motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
