//! What a learner is.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_process::StrideProcess;

use crate::error::LearnError;
use crate::saved::{KeptPolicy, SavedPolicy};

/// Improves a policy inside a process: the robot, the learned map or an exact map.
///
/// # Contract
///
/// - `process` is only reset and strided; the learner cannot tell what is behind it.
/// - With no `initial` policy the learner starts from scratch. A policy of a kind from which it
///   cannot start, or for other components, is an error.
/// - `observer` sees every trial when it ends, with the policy as it then stands.
/// - Equal generators, processes and initial policies give equal outcomes, to the bit.
/// - Whatever the process answers, there is no panic: NaN is a [`LearnError`].
pub trait Learner {
    /// Improves a policy.
    ///
    /// # Errors
    ///
    /// [`LearnError`] if the configuration does not fit the process, the process fails, or the
    /// parameters diverge.
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError>;
}

/// What an observer sees at the end of a trial.
pub struct TrialReport<'a> {
    /// The trial's numbers.
    pub summary: &'a TrialSummary,
    /// The policy as it stands after the trial; [`KeptPolicy::to_saved`] keeps a copy.
    pub policy: &'a dyn KeptPolicy,
}

/// One point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialSummary {
    /// Trial, from 1.
    pub trial: usize,
    /// Strides made, aborted ones not counted.
    pub strides: usize,
    /// Mean reward over these strides.
    pub mean_reward: f64,
    /// Strides that ended in a fall.
    pub falls: usize,
    /// Strides that did not reach the next section.
    pub stalls: usize,
    /// Strides aborted by the equipment, from which nothing was learned.
    pub aborted: usize,
    /// Mean TD error δ \[MA09, eq. (18)\]; zero for learners without a critic.
    pub mean_td_error: f64,
    /// Root mean square of δ; zero for learners without a critic.
    pub rms_td_error: f64,
    /// Basis functions of the policy at the end of the trial.
    pub bases: usize,
}

/// What a learner found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnOutcome {
    /// The improved policy.
    pub policy: SavedPolicy,
    /// The learning curve.
    pub trials: Vec<TrialSummary>,
    /// Strides made in the process, aborted ones included.
    pub strides: usize,
}
