//! What a run has come to, and who writes it down.

use std::sync::Arc;

use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_map::{GoalMap, LearnedMap};
use stridemap_record::{InPlace, Iteration, Pace, Performance, Phase, Recording, RobotFall, Seconds, Transition};

use crate::error::LabError;

/// What a run has come to.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    /// Every fall and stall on the robot, in starts and record strides as well.
    pub falls: Vec<RobotFall>,
    /// Every training and evaluation stride, in the order in which they were made.
    pub transitions: Vec<Transition>,
    /// Strides of a batch that was broken off, aborted ones as well, on a robot that cannot repeat them.
    pub unfinished: Vec<Transition>,
    /// Iterations begun.
    pub iterations: Vec<Iteration>,
    /// The policy of each improved iteration.
    pub policies: Vec<SavedPolicy>,
    /// The nominal gait, measured.
    pub nominal: Option<Performance>,
    /// The final policy, measured.
    pub final_performance: Option<Performance>,
    /// Strides run only to report.
    pub record_strides: usize,
    /// Time spent, by kind of work.
    pub seconds: Seconds,
    /// Time spent in all, files and figures' data included.
    pub total_seconds: f64,
    /// A map of goals from elsewhere, where the task names a prior.
    pub prior: Option<Arc<GoalMap>>,
}

impl Progress {
    /// How the robot steps in place, from its first batch in this run.
    #[must_use]
    pub fn in_place(&self) -> InPlace {
        let first = self.iterations.first();
        first.and_then(|i| i.in_place).unwrap_or_default()
    }
}

/// Observes a run as it happens: writes files, shows progress.
pub trait Recorder {
    /// A stride was made on the robot. `what` names the measured policy of a record stride
    /// (`"nominal"`, `"iteration-1"`, `"final"`).
    ///
    /// # Errors
    ///
    /// [`LabError`] if it cannot be kept, or the user asked to stop; the run then stops.
    fn stride(&mut self, transition: &Transition, what: Option<&str>) -> Result<(), LabError>;

    /// An episode begins with the next stride, from a generator of this stream that has given so many words.
    ///
    /// # Errors
    ///
    /// As [`Self::stride`].
    fn episode(&mut self, _began_at: (u64, u64), _what: Option<&str>) -> Result<(), LabError> {
        Ok(())
    }

    /// A map was fitted.
    ///
    /// # Errors
    ///
    /// As [`Self::stride`].
    fn map(&mut self, iteration: usize, map: &LearnedMap) -> Result<(), LabError>;

    /// A learning trial in the map ended.
    ///
    /// # Errors
    ///
    /// As [`Self::stride`].
    fn trial(&mut self, iteration: usize, trial: &TrialSummary) -> Result<(), LabError>;

    /// A policy was improved.
    ///
    /// # Errors
    ///
    /// As [`Self::stride`].
    fn policy(&mut self, iteration: usize, policy: &SavedPolicy) -> Result<(), LabError>;

    /// Motion was recorded, to be looked at: of a measured policy, or of the first exploration
    /// (`what` is `"exploration"`).
    ///
    /// # Errors
    ///
    /// As [`Self::stride`].
    fn poses(&mut self, what: &str, pace: Pace, recording: &Recording) -> Result<(), LabError>;

    /// A phase is complete: what was recorded up to here is final.
    ///
    /// # Errors
    ///
    /// As [`Self::stride`].
    fn checkpoint(&mut self, phase: Phase, progress: &Progress) -> Result<(), LabError>;
}

/// A recorder that keeps nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoRecorder;

impl Recorder for NoRecorder {
    fn stride(&mut self, _: &Transition, _: Option<&str>) -> Result<(), LabError> {
        Ok(())
    }
    fn map(&mut self, _: usize, _: &LearnedMap) -> Result<(), LabError> {
        Ok(())
    }
    fn trial(&mut self, _: usize, _: &TrialSummary) -> Result<(), LabError> {
        Ok(())
    }
    fn policy(&mut self, _: usize, _: &SavedPolicy) -> Result<(), LabError> {
        Ok(())
    }
    fn poses(&mut self, _: &str, _: Pace, _: &Recording) -> Result<(), LabError> {
        Ok(())
    }
    fn checkpoint(&mut self, _: Phase, _: &Progress) -> Result<(), LabError> {
        Ok(())
    }
}
