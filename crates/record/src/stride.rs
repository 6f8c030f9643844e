//! Strides made on the robot, one record each, and why they fell.

use std::fmt;

use serde::{Deserialize, Serialize};
use stridemap_process::{Action, Goal, Situation, State, StrideEnd};
use stridemap_robot::Side;

/// Why a stride was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrideRole {
    /// Offered to the map.
    #[default]
    Training,
    /// Run to choose, prove or stop.
    Evaluation,
    /// Run only to report.
    Record,
}

impl StrideRole {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Training, Self::Evaluation, Self::Record];

    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Evaluation => "evaluation",
            Self::Record => "record",
        }
    }
}

/// In which phase of a run a stride was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StridePhase {
    /// Exploring, or drawing from the stochastic policy.
    #[default]
    Collect,
    /// Running the policy's mean to see how good it is.
    Evaluate,
    /// Running a policy's mean to report.
    Record,
}

impl StridePhase {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Collect, Self::Evaluate, Self::Record];

    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Collect => "collect",
            Self::Evaluate => "evaluate",
            Self::Record => "record",
        }
    }
}

/// One stride on the robot: (x, u, x′, reward, how it ended), and where it comes from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Transition {
    /// Iteration of Algorithm 1, from 1.
    pub iteration: usize,
    /// In which phase it was made.
    pub phase: StridePhase,
    /// What it is for. Evaluation strides that are offered to the map have the training role.
    pub role: StrideRole,
    /// Episode within its phase, from 0; a new one begins with each fresh start.
    pub episode: usize,
    /// Stride within its episode, from 0.
    pub k: usize,
    /// Robot time at its end, since the fresh start.
    pub time_s: f64,
    /// The leg that carried the robot at the section where it began.
    pub stance: Option<Side>,
    /// x(k).
    pub state: State,
    /// u(k−1), as applied.
    pub last_action: Action,
    /// What it was asked to do; empty in tasks with one purpose.
    pub goal: Goal,
    /// u(k), as applied.
    pub action: Action,
    /// x(k+1); the last state known where the stride did not reach the section.
    pub next_state: State,
    /// r(k+1).
    pub reward: f64,
    /// How it ended.
    pub end: StrideEnd,
    /// Why, if it was a fall or a stall; unknown in tables of earlier versions.
    pub fall: Option<Fall>,
    /// What was measured of it.
    pub measures: StrideMeasures,
    /// `ψ_roll` at its end as a simulator knows it, where the robot only estimates it. Not in files.
    pub true_psi_roll_deg: Option<f64>,
    /// Way of the centre of mass along the episode's first heading, likewise. Not in files.
    pub true_forward_m: Option<f64>,
}

impl Transition {
    /// Where it began, as policy and map see it.
    #[must_use]
    pub fn situation(&self) -> Situation {
        Situation { state: self.state.clone(), last_action: self.last_action.clone(), goal: self.goal.clone() }
    }

    /// The word for its stance leg that is used in files, empty if it is not known.
    #[must_use]
    pub const fn stance_name(&self) -> &'static str {
        side_name(self.stance)
    }
}

pub(crate) const fn side_name(side: Option<Side>) -> &'static str {
    match side {
        Some(Side::Left) => "left",
        Some(Side::Right) => "right",
        None => "",
    }
}

macro_rules! measures {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// What is measured of one stride. Each is a column of the tables: `duration_s` is `stride_duration_s`.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct StrideMeasures {
            $($(#[$doc])* pub $name: f64,)*
            /// How the base moved, as the robot measures it.
            #[serde(default)]
            pub motion: Motion,
            /// The same as a simulator knows it; what the robot measures where nobody knows better.
            #[serde(default)]
            pub true_motion: Motion,
        }

        impl StrideMeasures {
            pub(crate) const COLUMNS: &[&str] = &[$(concat!("stride_", stringify!($name)),)*];

            /// Its numbers, in the order of their columns.
            pub(crate) fn values(&self) -> Vec<f64> {
                vec![$(self.$name,)*]
            }

            /// The measures whose columns hold these numbers.
            pub(crate) fn read<E>(mut number: impl FnMut(&str) -> Result<f64, E>) -> Result<Self, E> {
                Ok(Self { $($name: number(concat!("stride_", stringify!($name)))?,)* ..Self::default() })
            }
        }
    };
}

measures! {
    /// From section to section.
    duration_s,
    /// Way of the centre of mass along the episode's first heading.
    forward_m,
    /// Way of the centre of mass to the left of the episode's first heading.
    left_m,
    /// Change of heading, + to the left.
    turn_deg,
    /// `ψ_roll` at the section that ends the stride, mirrored.
    psi_roll_deg,
    /// `ψ_pitch` at the section that ends the stride.
    psi_pitch_deg,
    /// `ψ̇_pitch` at the section that ends the stride.
    psi_pitch_rate_deg_s,
    /// Yaw rate of the pelvis at the section that ends the stride, mirrored: + towards the side of the
    /// stance leg.
    yaw_rate_deg_s,
    /// Heading at the section that ends the stride, relative to the episode's first and mirrored
    /// likewise; it goes on growing over whole turns.
    heading_deg,
    /// Phase of the gait at the section that ends the stride, as the swing leg sees it, in
    /// [−180, 180); 0 for a gait without one.
    gait_phase_deg,
    /// `(1/T) ∫ ψ̇_pitch dt` over the stride \[MA09, eq. (31)\].
    mean_psi_pitch_rate_deg_s,
    /// `Σ ∫ |τ ω| dt` over the leg joints.
    energy_j,
    /// Largest vertical force on one foot.
    peak_foot_load_n,
    /// Root mean square of the difference between the leg joints' angles and the rest posture.
    posture_deviation_deg,
    /// Way of the centre of mass along the heading with which the stride began.
    ahead_m,
    /// Energy over weight and the way ahead; ways under a centimetre count as one, because in place
    /// it would be infinite.
    cost_of_transport,
}

/// How the base moved over a stride: means over its time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Speed of the base along its heading.
    pub forward_speed_m_s: f64,
    /// Speed of the base to the left of its heading.
    pub lateral_speed_m_s: f64,
    /// Change of heading over time, + to the left.
    pub yaw_rate_rad_s: f64,
    /// Roll of the base, + to the right.
    pub mean_roll_rad: f64,
    /// Pitch of the base, + forward.
    pub mean_pitch_rad: f64,
    /// `Σ |τ ω|` over every joint.
    pub power_w: f64,
}

impl Motion {
    /// The names of its numbers.
    pub const NAMES: [&str; 6] =
        ["forward_speed_m_s", "lateral_speed_m_s", "yaw_rate_rad_s", "mean_roll_rad", "mean_pitch_rad", "power_w"];

    /// Its numbers, in the order of their names.
    #[must_use]
    pub const fn values(&self) -> [f64; 6] {
        [
            self.forward_speed_m_s,
            self.lateral_speed_m_s,
            self.yaw_rate_rad_s,
            self.mean_roll_rad,
            self.mean_pitch_rad,
            self.power_w,
        ]
    }

    /// From its numbers, in the order of their names.
    #[must_use]
    pub const fn of(values: [f64; 6]) -> Self {
        let [forward_speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, mean_roll_rad, mean_pitch_rad, power_w] = values;
        Self { forward_speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, mean_roll_rad, mean_pitch_rad, power_w }
    }
}

impl StrideMeasures {
    /// Speed of the stride along the heading with which it began, so that a robot that has turned is
    /// not called slow.
    #[must_use]
    pub fn speed_m_s(&self) -> f64 {
        if self.duration_s > 0.0 { self.ahead_m / self.duration_s } else { 0.0 }
    }
}

/// By what a fall is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FallCriterion {
    /// `ψ_roll` at a section, deg.
    PsiRoll,
    /// Height of the centre of mass, as a share of its first.
    Height,
    /// Tilt of the base, deg.
    Tilt,
    /// Time without a section, s: a stall.
    NoSection,
}

impl FallCriterion {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::PsiRoll, Self::Height, Self::Tilt, Self::NoSection];

    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PsiRoll => "psi_roll",
            Self::Height => "height",
            Self::Tilt => "tilt",
            Self::NoSection => "no_section",
        }
    }

    /// The key of a task that holds its threshold.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::PsiRoll => "failure.psi_roll_below_deg",
            Self::Height => "failure.com_height_below",
            Self::Tilt => "failure.tilt_above_deg",
            Self::NoSection => "failure.no_section_s",
        }
    }

    /// How a stride that it ended is said to have ended.
    #[must_use]
    pub const fn end(self) -> StrideEnd {
        match self {
            Self::NoSection => StrideEnd::NoCrossing,
            _ => StrideEnd::Fell,
        }
    }
}

/// The cause of a fall or a stall.
///
/// # Example
///
/// ```
/// use stridemap_record::{Fall, FallCriterion};
///
/// let fall = Fall { criterion: FallCriterion::PsiRoll, value: -0.312, threshold: 0.0 };
/// assert_eq!(fall.to_string(), "psi_roll -0.31 deg, below 0 (failure.psi_roll_below_deg)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fall {
    /// By what it is told.
    pub criterion: FallCriterion,
    /// What was measured, in the criterion's unit.
    pub value: f64,
    /// What it passed, in the same unit. A relative threshold is here as it was on this robot.
    pub threshold: f64,
}

impl fmt::Display for Fall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, key) = (self.value, self.criterion.key());
        // As many digits as a threshold needs, and no more.
        let threshold = (self.threshold * 1e3).round() / 1e3;
        match self.criterion {
            FallCriterion::PsiRoll => {
                write!(f, "psi_roll {value:.2} deg, below {threshold} ({key})")
            }
            FallCriterion::Height => {
                write!(f, "height {value:.2} of the first, below {threshold} ({key})")
            }
            FallCriterion::Tilt => write!(f, "tilt {value:.1} deg, above {threshold} ({key})"),
            FallCriterion::NoSection => {
                write!(f, "no section for {value:.2} s, more than {threshold} ({key})")
            }
        }
    }
}

/// A fall on the robot, and when it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RobotFall {
    /// Iteration of Algorithm 1, from 1.
    pub iteration: usize,
    /// In which phase of the run.
    pub phase: StridePhase,
    /// The measured policy (`"nominal"`, `"iteration-1"`, `"final"`) of a record stride.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what: Option<String>,
    /// The stride among those of its batch, from 1; null for a fall in a start, before the first stride.
    pub stride: Option<usize>,
    /// Its cause.
    #[serde(flatten)]
    pub fall: Fall,
}

impl RobotFall {
    /// The falls with a known cause among strides of one batch.
    pub fn among(strides: &[Transition]) -> impl Iterator<Item = Self> {
        strides.iter().enumerate().filter_map(|(i, t)| {
            Some(Self { iteration: t.iteration, phase: t.phase, what: None, stride: Some(i + 1), fall: t.fall? })
        })
    }
}

impl fmt::Display for RobotFall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.what, self.phase) {
            (Some(what), _) => write!(f, "measuring {what}")?,
            (None, phase) => write!(f, "iteration {}, {}", self.iteration, phase.name())?,
        }
        match self.stride {
            Some(stride) => write!(f, ", stride {stride}: {}", self.fall),
            None => write!(f, ", in a start: {}", self.fall),
        }
    }
}
