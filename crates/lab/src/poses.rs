//! Recorded poses, so that a report can show the robot moving without its simulator.

use std::sync::{Arc, Mutex};

use serde::{Deserialize, Serialize};
use stridemap_robot::{Pose, Robot, RobotState, Shape};
use stridemap_section::Crossing;

use crate::plant::TickObserver;

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

/// Records poses while a plant walks, from `begin_s` to `end_s` of robot time.
pub struct PoseRecorder {
    recording: Arc<Mutex<Recording>>,
    begin_s: f64,
    end_s: f64,
    next_s: f64,
    crossing: bool,
    scratch: Vec<Pose>,
}

impl PoseRecorder {
    /// A recorder with one frame every `period_s`, and the place where the recording grows.
    #[must_use]
    pub fn new(
        robot: &dyn Robot,
        period_s: f64,
        begin_s: f64,
        end_s: f64,
    ) -> (Self, Arc<Mutex<Recording>>) {
        let recording = Arc::new(Mutex::new(Recording {
            format: 1,
            shapes: robot.geometry(),
            period_s,
            frames: Vec::new(),
        }));
        let recorder = Self {
            recording: Arc::clone(&recording),
            begin_s,
            end_s,
            next_s: begin_s,
            crossing: false,
            scratch: Vec::new(),
        };
        (recorder, recording)
    }
}

/// Six digits are a micrometre, and keep files small.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

impl TickObserver for PoseRecorder {
    fn tick(
        &mut self,
        robot: &dyn Robot,
        state: &RobotState,
        crossing: Option<&Crossing>,
        push_n: Option<[f64; 3]>,
    ) {
        self.crossing |= crossing.is_some();
        if state.time_s < self.begin_s
            || state.time_s > self.end_s
            || state.time_s < self.next_s - 1e-9
        {
            return;
        }
        let Ok(mut recording) = self.recording.lock() else {
            return;
        };
        // After a fall the robot's clock starts anew: one unbroken stretch is recorded.
        if recording
            .frames
            .last()
            .is_some_and(|last| last.time_s > state.time_s)
        {
            return;
        }
        self.next_s += recording.period_s;
        robot.poses(&mut self.scratch);
        recording.frames.push(Frame {
            time_s: rounded(state.time_s),
            poses: self
                .scratch
                .iter()
                .map(|p| {
                    let [x, y, z] = p.position_m;
                    let [qw, qx, qy, qz] = p.orientation;
                    [x, y, z, qw, qx, qy, qz].map(rounded)
                })
                .collect(),
            cop_m: state.cop_m.map(|c| c.map(rounded)),
            loads_n: [rounded(state.feet[0].load_n), rounded(state.feet[1].load_n)],
            crossing: std::mem::take(&mut self.crossing),
            push_n,
        });
    }
}
