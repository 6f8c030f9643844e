//! Recorded poses, so that a report can show the robot moving without its simulator.

use std::sync::{Arc, Mutex};

use stridemap_record::{Frame, Pace, Recording, Transition};
use stridemap_robot::{Pose, Robot, RobotState};
use stridemap_section::Crossing;

use crate::error::LabError;
use crate::plant::{Plant, TickObserver};
use crate::recorder::Recorder;

/// Recordings of one batch that grow while the plant walks.
#[derive(Default)]
pub(crate) struct Filming {
    growing: Vec<(Pace, Arc<Mutex<Recording>>)>,
}

impl Filming {
    /// Has `plant` recorded at these paces, each from and to its robot time.
    pub(crate) fn begin(plant: &mut Plant, takes: &[(Pace, [f64; 2])]) -> Self {
        let (mut observers, mut growing) = (Vec::new(), Vec::new());
        for &(pace, [begin_s, end_s]) in takes {
            let (observer, recording) = PoseRecorder::new(plant.robot(), pace.period_s(), begin_s, end_s);
            observers.push(observer);
            growing.push((pace, recording));
        }
        if !observers.is_empty() {
            plant.observe(Some(Box::new(observers)));
        }
        Self { growing }
    }

    /// Ends recording.
    pub(crate) fn end(self, plant: &mut Plant) -> Takes {
        plant.observe(None);
        let taken = self.growing.into_iter().filter_map(|(pace, growing)| {
            let recording = Arc::into_inner(growing)?.into_inner().ok()?;
            Some((pace, recording))
        });
        Takes(taken.collect())
    }
}

/// What was recorded of one batch.
pub(crate) struct Takes(Vec<(Pace, Recording)>);

impl Takes {
    /// The film among them.
    pub(crate) fn film(self) -> Option<Recording> {
        self.0.into_iter().find(|(pace, _)| *pace == Pace::Film).map(|(_, recording)| recording)
    }

    /// Hands them out. A time lapse begins with the first of `strides`.
    pub(crate) fn keep(self, what: &str, strides: &[Transition], recorder: &mut dyn Recorder) -> Result<(), LabError> {
        for (pace, mut recording) in self.0 {
            if pace == Pace::Lapse {
                recording.begin_with(strides);
            }
            recorder.poses(what, pace, &recording)?;
        }
        Ok(())
    }
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
    pub fn new(robot: &dyn Robot, period_s: f64, begin_s: f64, end_s: f64) -> (Self, Arc<Mutex<Recording>>) {
        let recording =
            Arc::new(Mutex::new(Recording { format: 1, shapes: robot.geometry(), period_s, frames: Vec::new() }));
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

impl TickObserver for Vec<PoseRecorder> {
    fn tick(&mut self, robot: &dyn Robot, state: &RobotState, crossing: Option<&Crossing>, push_n: Option<[f64; 3]>) {
        for recorder in self {
            recorder.tick(robot, state, crossing, push_n);
        }
    }
}

impl TickObserver for PoseRecorder {
    fn tick(&mut self, robot: &dyn Robot, state: &RobotState, crossing: Option<&Crossing>, push_n: Option<[f64; 3]>) {
        self.crossing |= crossing.is_some();
        if state.time_s < self.begin_s || state.time_s > self.end_s || state.time_s < self.next_s - 1e-9 {
            return;
        }
        let Ok(mut recording) = self.recording.lock() else {
            return;
        };
        // After a fall the robot's clock starts anew: one unbroken stretch is recorded.
        if recording.frames.last().is_some_and(|last| last.time_s > state.time_s) {
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
