//! Control without a map: integral action on `ψ_roll` on the robot, and then its mean action held.

use serde::{Deserialize, Serialize};
use stridemap_returnmap::{ActionLimits, StrideEnd};

use crate::error::LabError;
use crate::strides::{StridePhase, Transition};

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
    /// use stridemap_returnmap::ActionLimits;
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

/// The mean action over the last three quarters of the strides of the first batch.
///
/// # Errors
///
/// [`LabError::TooFewStrides`] if there are none.
pub fn held(transitions: &[Transition]) -> Result<Vec<f64>, LabError> {
    let settled: Vec<&Transition> = transitions
        .iter()
        .filter(|t| t.iteration == 1 && t.phase == StridePhase::Collect)
        .filter(|t| t.end == StrideEnd::Crossing)
        .collect();
    let count = (HELD_SHARE * settled.len() as f64).ceil() as usize;
    let last = &settled[settled.len() - count..];
    let Some(first) = last.first() else {
        return Err(LabError::TooFewStrides {
            found: 0,
            needed: 1,
        });
    };
    let mean = |i: usize| last.iter().map(|t| t.action[i]).sum::<f64>() / count as f64;
    Ok((0..first.action.len()).map(mean).collect())
}
