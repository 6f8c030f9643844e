//! What the files of a run directory hold, as this crate reads them.
//!
//! Unknown keys are passed over; a key that a report can do without may be missing.

use serde::{Deserialize, Serialize};

/// `provenance.json`: where the numbers come from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Provenance {
    /// Version of Stridemap.
    pub version: String,
    /// Revision of the source, if it was built from a repository.
    pub git_revision: Option<String>,
    /// Version of the simulator; empty on a real robot.
    pub mujoco_version: String,
    /// Hash of the robot's model.
    pub model_hash: String,
    /// Root of every random stream.
    pub seed: u64,
    /// Processor and operating system.
    pub machine: String,
    /// The command that repeats the run.
    pub command: String,
    /// When it began.
    pub start: String,
    /// When it ended; `None` while it runs, or if it was killed.
    pub end: Option<String>,
}

/// `columns.json`: which columns of the stride tables are state and action.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Columns {
    /// Names of the state's components, with their unit: `psi_roll_deg`.
    pub state: Vec<String>,
    /// Names of the action's components: `step_amplitude_deg`.
    pub action: Vec<String>,
}

/// How a stride ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrideEnd {
    /// At the next section.
    Crossing,
    /// The robot fell.
    Fell,
    /// No section within the time.
    NoCrossing,
    /// Equipment failed; no datum.
    Aborted,
}

/// A line of `transitions.csv` or `record.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrideRow {
    /// `nominal`, `iteration-1`, ..., `final`; empty in `transitions.csv`.
    pub what: String,
    /// Iteration of Algorithm 1, from 1; 0 outside.
    pub iteration: u32,
    /// `collect` (exploring, or sampling the policy), `evaluate` (its mean, to try it) or `record`; empty
    /// if unknown.
    #[serde(default)]
    pub phase: String,
    /// `training`, `evaluation` or `record`.
    pub role: String,
    /// Episode, one unbroken stretch of strides.
    pub episode: u64,
    /// Stride within the episode.
    pub k: u64,
    /// Robot time at the section that begins the stride, seconds.
    pub time_s: f64,
    /// `left` or `right`; empty if unknown.
    pub stance: String,
    /// State at the section, in the order and units of [`Columns::state`].
    pub state: Vec<f64>,
    /// Action of the stride.
    pub action: Vec<f64>,
    /// State at the next section.
    pub next_state: Vec<f64>,
    /// Reward.
    pub reward: f64,
    /// How it ended.
    pub end: StrideEnd,
    /// Why, if it was a fall or a stall; unknown in runs of earlier versions.
    #[serde(default)]
    pub fall: Option<Fall>,
}

/// The cause of a fall or a stall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fall {
    /// `psi_roll` (deg), `height` (share of the first), `tilt` (deg) or `no_section` (s).
    pub criterion: String,
    /// What was measured.
    pub value: f64,
    /// What it passed.
    pub threshold: f64,
}

/// A fall as `summary.json` lists it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RobotFall {
    /// Iteration, from 1; 0 outside.
    pub iteration: u32,
    /// `collect`, `evaluate` or `record`.
    pub phase: String,
    /// The measured policy of a record stride.
    #[serde(default)]
    pub what: Option<String>,
    /// Stride of its batch, from 1; `None` in a start.
    pub stride: Option<u64>,
    /// Its cause.
    #[serde(flatten)]
    pub fall: Fall,
}

/// A line of `learning.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearningRow {
    /// Iteration, from 1.
    pub iteration: u32,
    /// Trial within the iteration.
    pub trial: u32,
    /// `map`, `robot` or `robot-evaluation`.
    pub world: String,
    /// Average reward of a stride.
    pub average_reward: f64,
    /// Falls in the trial.
    pub falls: u32,
    /// Strides of the trial.
    pub strides: u32,
}

/// Strides on the robot by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct StrideCounts {
    /// Offered to the map.
    pub training: u64,
    /// To choose, prove or stop.
    pub evaluation: u64,
    /// Before learning.
    pub warm_up: u64,
    /// Only to report; outside of the budget.
    pub record: u64,
}

/// A least-squares line through a return map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReturnLine {
    /// Slope, dimensionless.
    pub slope: f64,
    /// Standard error of the slope.
    pub slope_std_error: f64,
    /// Where the line meets the identity, degrees; `None` for a slope of one.
    pub fixed_point_deg: Option<f64>,
    /// Pairs behind the line.
    pub pairs: u64,
}

/// A policy measured on the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Measured {
    /// Strides averaged.
    pub strides: u64,
    /// Mean reward of a stride.
    pub mean_reward: Option<f64>,
    /// Mean roll of the pendulum at the section, degrees.
    pub mean_psi_roll_deg: Option<f64>,
    /// Falls.
    pub falls: u64,
    /// Stalls.
    pub stalls: u64,
    /// Walking speed, m/s.
    pub speed_m_s: Option<f64>,
    /// Time without a fall, up to 60 s.
    pub upright_s: Option<f64>,
    /// Distance from the start, metres.
    pub drift_m: Option<f64>,
    /// Return map k to k + 1 without pushes.
    pub return_map_1: Option<ReturnLine>,
    /// Return map k to k + 2 without pushes.
    pub return_map_2: Option<ReturnLine>,
}

/// What became of a policy that was tried on the robot before it was trusted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Proof {
    /// `proven`, `slower`, `warned`, `fell` or `unfinished`.
    pub verdict: String,
    /// Speed along the first heading after the policy had settled, m/s.
    pub speed_m_s: f64,
    /// Mean action applied after the policy had settled.
    pub action: Vec<f64>,
}

/// A box of actions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Region {
    /// Lowest, per component.
    pub lower: Vec<f64>,
    /// Highest, per component.
    pub upper: Vec<f64>,
}

/// A warning of the guard.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Warning {
    /// Stride among those of its iteration, from 1.
    pub stride: usize,
    /// `flip`, `turn` or `low_roll`.
    pub warning: String,
}

/// One iteration in `summary.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct IterationSummary {
    /// From 1.
    pub iteration: u32,
    /// Strides of this iteration, training and evaluation.
    pub strides: u64,
    /// Falls in them.
    pub falls: u64,
    /// Strides of all iterations so far.
    pub strides_so_far: u64,
    /// Falls of all iterations so far.
    pub falls_so_far: u64,
    /// One per output of the map.
    pub log_marginal_likelihood: Vec<f64>,
    /// Mean reward of this iteration's policy.
    pub mean_reward: Option<f64>,
    /// Speed of this iteration's policy, m/s.
    pub speed_m_s: Option<f64>,
    /// What became of the policy on the robot; only where policies are proven.
    pub proof: Option<Proof>,
    /// Where the policy was allowed to lie; only where there is a trust region.
    pub trust_region: Option<Region>,
    /// Warnings of the guard.
    pub warnings: Vec<Warning>,
}

/// Seconds of computing by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Seconds {
    /// Simulating the robot.
    pub simulation: f64,
    /// Fitting maps.
    pub fit: f64,
    /// Improving policies in the map.
    pub improve: f64,
    /// All.
    pub total: f64,
}

/// `summary.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Summary {
    /// Name of the task.
    pub experiment: String,
    /// Root of every random stream.
    pub seed: u64,
    /// Strides on the robot.
    pub strides: StrideCounts,
    /// One per iteration.
    pub iterations: Vec<IterationSummary>,
    /// The iteration whose policy is final; `None` where that is the nominal gait.
    pub final_iteration: Option<u32>,
    /// Whether the final policy is a learned one; `None` if unknown.
    pub improved: Option<bool>,
    /// The gait without learning.
    pub nominal: Option<Measured>,
    /// The policy that the run recommends.
    #[serde(rename = "final")]
    pub final_policy: Option<Measured>,
    /// Every fall on the robot with its cause.
    pub falls: Vec<RobotFall>,
    /// Computing time.
    pub seconds: Option<Seconds>,
}

/// Predictions of each datum from the others.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LeaveOneOut {
    /// Predicted mean.
    pub mean: Vec<f64>,
    /// Predicted standard deviation of the observation, noise included.
    pub std: Vec<f64>,
    /// What happened.
    pub actual: Vec<f64>,
}

/// One output of a learned map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MapOutput {
    /// Component of the next state, or `reward`.
    pub name: String,
    /// Evidence at the fitted hyperparameters, nats.
    pub log_marginal_likelihood: Option<f64>,
    /// Length scales of the inputs, in their units.
    pub length_scales: Vec<f64>,
    /// Variance of the latent function.
    pub signal_variance: Option<f64>,
    /// Variance of the noise.
    pub noise_variance: Option<f64>,
    /// What the model's card warns of, in words.
    pub warnings: Vec<String>,
    /// Leave-one-out predictions.
    pub leave_one_out: Option<LeaveOneOut>,
}

/// `map/<iteration>.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MapCard {
    /// Version of the format.
    pub format: u32,
    /// Iteration, from 1.
    pub iteration: u32,
    /// One per component of the next state, and the reward if it has its own.
    pub outputs: Vec<MapOutput>,
}

/// `push.json`: what pushes showed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PushSummary {
    /// Slope of the return map k to k + 2.
    pub slope: Option<f64>,
    /// Where its line meets the identity, degrees.
    pub fixed_point_deg: Option<f64>,
    /// Standard error of the slope.
    pub slope_std_error: Option<f64>,
    /// The same pushes, k to k + 1.
    pub after_1: Option<ReturnLine>,
    /// Falls.
    pub falls: u32,
    /// Pairs behind the line.
    pub pairs: u64,
    /// Greatest force, newtons.
    pub force_n: Option<f64>,
    /// Duration of a push, seconds.
    pub duration_s: Option<f64>,
}

/// Where a body or a shape is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Origin, metres.
    pub position_m: [f64; 3],
    /// Unit quaternion (w, x, y, z).
    pub orientation: [f64; 4],
}

/// Form and size of a shape in its own frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "type")]
pub enum ShapeKind {
    /// A ball.
    Sphere {
        /// Radius.
        radius_m: f64,
    },
    /// A cylinder along z with half balls at its ends.
    Capsule {
        /// Radius.
        radius_m: f64,
        /// Half the length of the cylinder alone.
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
}

/// A visible piece of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// Name; may be empty.
    #[serde(default)]
    pub name: String,
    /// Index of the body that carries it.
    pub body: usize,
    /// Form and size.
    pub kind: ShapeKind,
    /// Its frame in the body's.
    pub pose: Pose,
    /// Red, green, blue, opacity, each in `[0, 1]`.
    pub rgba: [f32; 4],
}

/// One moment of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Robot time, seconds.
    pub time_s: f64,
    /// Position (metres) and orientation (w, x, y, z) of each body.
    pub poses: Vec<[f64; 7]>,
    /// Centre of pressure on the ground, metres; `None` in the air.
    #[serde(default)]
    pub cop_m: Option<[f64; 2]>,
    /// Load of the left and the right foot, newtons.
    #[serde(default)]
    pub loads_n: [f64; 2],
    /// Whether a section was crossed since the frame before.
    #[serde(default)]
    pub crossing: bool,
    /// Force of a push on the torso, newtons.
    #[serde(default)]
    pub push_n: Option<[f64; 3]>,
}

/// `poses/<what>.json`: a stretch of motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Version of the format.
    pub format: u32,
    /// What the robot looks like.
    pub shapes: Vec<Shape>,
    /// Time between frames, seconds.
    pub period_s: f64,
    /// The frames.
    pub frames: Vec<Frame>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shape_reads_as_the_robot_crate_writes_it() {
        let text = r#"{"name":"foot","body":3,"kind":{"type":"box","half_extents_m":[0.1,0.05,0.01]},
            "pose":{"position_m":[0,0,0],"orientation":[1,0,0,0]},"rgba":[0.5,0.5,0.5,1.0]}"#;
        let shape: Shape = serde_json::from_str(text).unwrap();
        assert_eq!(
            shape.kind,
            ShapeKind::Box {
                half_extents_m: [0.1, 0.05, 0.01]
            }
        );
    }

    #[test]
    fn a_summary_with_less_and_more_than_expected_is_read() {
        let text = r#"{"experiment":"stepping","new_key":1,"final":{"mean_reward":-0.002,"speed_m_s":null}}"#;
        let summary: Summary = serde_json::from_str(text).unwrap();
        assert_eq!(summary.final_policy.unwrap().mean_reward, Some(-0.002));
        assert!(summary.nominal.is_none());
    }
}
