//! Control without a map: integral action on `ψ_roll` on the robot, and then its mean action held.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_process::{ActionLimits, StrideEnd};

use super::{Known, LearnerPart, invalid};
use crate::error::LabError;
use crate::registry::part;
use crate::state::StateComponent;
use crate::strides::ActionSource;
use crate::task::Task;
use stridemap_record::{InPlace, StridePhase, Transition};

/// Share of the strides whose mean action is held afterwards: the last ones.
const HELD_SHARE: f64 = 0.75;

/// Integral action on `ψ_roll` by a task's one component of the action, which lowers `ψ_roll` as it
/// grows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntegralConfig {
    /// Change of the action per stride and degree of `ψ_roll` above the target, in its unit.
    pub gain_per_deg: f64,
    /// The target, this far below the mean of the robot's own stepping in place, deg.
    pub below_in_place_deg: f64,
}

/// The law while it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegralAction {
    /// Component of the state that is `ψ_roll`.
    pub component: usize,
    /// The wanted `ψ_roll`, deg.
    pub target_deg: f64,
    /// Change of the action per stride and degree.
    pub gain_per_deg: f64,
    /// Bounds of the action, and where it starts.
    pub limits: ActionLimits,
}

impl IntegralAction {
    /// The action after one more section; `last` is the one before, `None` at the beginning.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::IntegralAction;
    /// use stridemap_process::ActionLimits;
    ///
    /// let limits =
    ///     ActionLimits { lower: 0.0, upper: 6.0, rate_per_stride: 2.0, gain: 1.0, neutral: 0.0 };
    /// let law = IntegralAction { component: 0, target_deg: 4.0, gain_per_deg: 0.5, limits };
    /// assert_eq!(law.next(None, &[5.0]), 0.5); // one degree too high
    /// assert_eq!(law.next(Some(0.5), &[3.0]), 0.0); // one too low
    /// assert_eq!(law.next(Some(0.0), &[3.0]), 0.0); // at its bound
    /// ```
    #[must_use]
    pub fn next(&self, last: Option<f64>, state: &[f64]) -> f64 {
        let from = last.unwrap_or(self.limits.neutral);
        let moved = from + self.gain_per_deg * (state[self.component] - self.target_deg);
        moved.clamp(self.limits.lower, self.limits.upper)
    }
}

/// Component of the state that is `ψ_roll`.
fn psi_roll(task: &Task) -> Option<usize> {
    task.state.iter().position(|c| *c == StateComponent::PSI_ROLL_DEG)
}

pub(super) struct Held;

part!(Held, "integral", "without a map: integral action on psi_roll, then its mean held");

impl LearnerPart for Held {
    fn uses_map(&self) -> bool {
        false
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        let finite =
            task.learner.integral.is_some_and(|c| c.gain_per_deg.is_finite() && c.below_in_place_deg.is_finite());
        if !finite || task.action.len() != 1 || psi_roll(task).is_none() {
            return invalid(
                "learner.integral",
                "is needed by integral action, finite, with one action and psi_roll_deg in the state",
            );
        }
        Ok(())
    }

    fn fewest_strides(&self, _task: &Task) -> (usize, String) {
        (1, "a first policy".into())
    }

    fn first_actions<'a>(&self, task: &'a Task, in_place: InPlace) -> Option<ActionSource<'a>> {
        let (config, limits) = (task.learner.integral?, task.action_limits().ok()?);
        Some(ActionSource::Integral(IntegralAction {
            component: psi_roll(task)?,
            target_deg: in_place.psi_roll_deg - config.below_in_place_deg,
            gain_per_deg: config.gain_per_deg,
            limits: *limits.first()?,
        }))
    }

    fn propose(
        &self,
        known: &Known<'_>,
        _rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        known.constant(&held(&known.progress.transitions)?)
    }
}

/// The mean action over the last three quarters of the strides of the first batch.
fn held(transitions: &[Transition]) -> Result<Vec<f64>, LabError> {
    let settled: Vec<&Transition> = transitions
        .iter()
        .filter(|t| t.iteration == 1 && t.phase == StridePhase::Collect)
        .filter(|t| t.end == StrideEnd::Crossing)
        .collect();
    let count = (HELD_SHARE * settled.len() as f64).ceil() as usize;
    let last = &settled[settled.len() - count..];
    let Some(first) = last.first() else {
        return Err(LabError::TooFewStrides { found: 0, needed: 1 });
    };
    let mean = |i: usize| last.iter().map(|t| t.action[i]).sum::<f64>() / count as f64;
    Ok((0..first.action.len()).map(mean).collect())
}
