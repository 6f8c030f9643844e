//! What can go wrong in the lab.

use std::path::PathBuf;

use stridemap_config::ConfigError;
use stridemap_gait::GaitError;
use stridemap_gp::GpError;
use stridemap_learn::LearnError;
use stridemap_map::MapError;
use stridemap_mujoco::MujocoError;
use stridemap_process::ProcessError;
use stridemap_record::{Fall, RecordError, RobotFall};
use stridemap_robot::RobotError;
use stridemap_section::SectionError;

/// A value of a task that its type allows and its meaning does not.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key}: {requirement}")]
pub struct Invalid {
    /// Key path in the task.
    pub key: String,
    /// What it must satisfy.
    pub requirement: String,
}

/// Refuses a value of the task unless it holds.
pub(crate) fn unless(holds: bool, key: impl Into<String>, requirement: impl Into<String>) -> Result<(), LabError> {
    match holds {
        true => Ok(()),
        false => Err(LabError::Invalid(Invalid { key: key.into(), requirement: requirement.into() })),
    }
}

/// What can go wrong in the lab.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LabError {
    /// A task file is wrong.
    #[error(transparent)]
    Config(#[from] Box<ConfigError>),
    /// A value of a task is wrong.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A task names a modulation that the gait does not have.
    #[error("{key} = \"{found}\": the gait has no such modulation")]
    UnknownModulation {
        /// Key path in the task.
        key: String,
        /// The name given.
        found: String,
        /// The gait's modulations.
        allowed: Vec<&'static str>,
    },
    /// The gait refuses.
    #[error(transparent)]
    Gait(#[from] GaitError),
    /// The section refuses.
    #[error(transparent)]
    Section(#[from] SectionError),
    /// The simulated robot refuses.
    #[error("robot: {0}")]
    Mujoco(#[from] MujocoError),
    /// The robot refuses or fails outside of a stride.
    #[error("robot: {0}")]
    Robot(#[from] RobotError),
    /// The robot of this task is behind a link, and this command works on a simulated one only.
    #[error("this robot is behind a link; the command works on a simulated one (--robot op3)")]
    NotHere,
    /// A process refuses or fails.
    #[error(transparent)]
    Process(#[from] ProcessError),
    /// The learner fails.
    #[error("learner: {0}")]
    Learn(#[from] LearnError),
    /// The map cannot be fitted or evaluated, or a return map found.
    #[error(transparent)]
    Map(MapError),
    /// The nominal gait does not carry this robot.
    #[error(
        "the nominal gait fell or stalled in {attempts} starts (the last at {time_s:.1} s: {fall}{how}); \
         `stridemap tune FILE` searches a gait that carries a robot of one's own"
    )]
    NominalGaitFails {
        /// Starts tried.
        attempts: usize,
        /// Robot time of the last failure.
        time_s: f64,
        /// Why it was one.
        fall: Fall,
        /// Where to it fell, and what was wrong before, where that was watched.
        how: String,
    },
    /// The robot fell more often than the task allows.
    #[error(
        "{} falls on the robot where algorithm.falls_at_most allows {at_most}: {}; every stride is kept, \
         `stridemap learn --resume RUN --set algorithm.falls_at_most=N` goes on",
        falls.len(),
        falls.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    )]
    FallBudget {
        /// Falls that the task allows.
        at_most: usize,
        /// Every fall that counts.
        falls: Vec<RobotFall>,
    },
    /// The equipment fails again and again.
    #[error("{aborts} strides in a row were aborted: {reason}")]
    Equipment {
        /// Strides in a row.
        aborts: usize,
        /// The robot's own words.
        reason: String,
    },
    /// There is not one stride to learn from.
    #[error("{found} usable strides for the map; at least {needed} are needed")]
    TooFewStrides {
        /// Strides that reached the next section.
        found: usize,
        /// Fewest that a map can be fitted to.
        needed: usize,
    },
    /// A file of a run cannot be read or written, or holds something else than it should.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// What would go on with a run is not what made it.
    #[error(
        "{path}: going on would mix two runs: {}; undo what was changed, or {}",
        differences.join("; "),
        if *begun {
            "start a run of its own with `stridemap learn` and another --out"
        } else {
            "begin anew, since no stride was made yet: `stridemap learn TASK` with the same --out"
        }
    )]
    Mixed {
        /// The run directory.
        path: PathBuf,
        /// What differs, then and now.
        differences: Vec<String>,
        /// Whether a stride was made.
        begun: bool,
    },
    /// An episode that was run again came out otherwise.
    #[error("{path}: {problem}")]
    NotTheSame {
        /// The run directory.
        path: PathBuf,
        /// What differs.
        problem: String,
    },
    /// A directory holds a run already, or is not one.
    #[error("{path}: {problem}")]
    RunDirectory {
        /// The directory.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// The user asked to stop.
    #[error("stopped; `stridemap learn --resume {path}` goes on from here")]
    Interrupted {
        /// The run directory.
        path: PathBuf,
    },
}

impl From<MapError> for LabError {
    fn from(error: MapError) -> Self {
        match error {
            MapError::Process(error) => Self::Process(error),
            error => Self::Map(error),
        }
    }
}

impl LabError {
    /// Whether the strides that reached the next section do not determine what is fitted to them.
    pub(crate) const fn is_of_too_few_strides(&self) -> bool {
        matches!(self, Self::TooFewStrides { .. } | Self::Map(MapError::Gp(GpError::MeanNotIdentifiable { .. })))
    }

    /// Whether the request itself was wrong (exit code 2), rather than something that happened while
    /// working (exit code 1).
    #[must_use]
    pub const fn is_request(&self) -> bool {
        if let Self::Record(error) = self {
            return error.is_request();
        }
        matches!(
            self,
            Self::Config(_)
                | Self::Invalid(_)
                | Self::UnknownModulation { .. }
                | Self::Robot(RobotError::NoBody { .. })
                | Self::Gait(_)
                | Self::NotHere
                | Self::Section(_)
                | Self::Mujoco(_)
                | Self::Mixed { .. }
                | Self::RunDirectory { .. }
                | Self::Learn(LearnError::Parameter { .. } | LearnError::Length { .. })
                | Self::Process(ProcessError::Parameter { .. })
        )
    }
}
