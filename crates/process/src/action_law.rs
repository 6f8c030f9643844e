//! From the action that a policy asks for to the action that is applied.

use serde::{Deserialize, Serialize};

use crate::process::{Action, ProcessError};

/// Limits of one component of the action.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionLimits {
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Largest change from one stride to the next; infinite for no limit.
    pub rate_per_stride: f64,
    /// Share of the way to the wanted value that is gone in one stride, in (0, 1]; 1 goes at once.
    pub gain: f64,
    /// The value before the first stride, that of the nominal gait.
    pub neutral: f64,
}

/// The action law: part of the process, the same on the robot and in the map.
///
/// With the wanted value `t = clip(u, lower, upper)`,
///
/// ```text
/// u(k) = u(k−1) + clip(gain (t − u(k−1)), ±rate_per_stride)
/// ```
///
/// # Example
///
/// ```
/// use stridemap_process::{ActionLaw, ActionLimits};
///
/// let limits =
///     ActionLimits { lower: 0.0, upper: 6.0, rate_per_stride: 2.0, gain: 0.5, neutral: 0.0 };
/// let mut law = ActionLaw::new(vec![limits])?;
/// assert_eq!(law.apply(&[10.0])?.as_slice(), [2.0]); // clipped to 6, half way is 3, rate 2
/// assert_eq!(law.apply(&[4.0])?.as_slice(), [3.0]); // half way
/// assert_eq!(law.last().as_slice(), [3.0]);
/// # Ok::<(), stridemap_process::ProcessError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ActionLaw {
    limits: Vec<ActionLimits>,
    last: Action,
}

impl ActionLaw {
    /// A law that starts from the neutral action.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] if bounds are not finite or in the wrong order, the neutral value
    /// lies outside of them, a rate is not positive, or a gain is outside (0, 1].
    pub fn new(limits: Vec<ActionLimits>) -> Result<Self, ProcessError> {
        for l in &limits {
            let parameter = |name, value, requirement| ProcessError::Parameter { name, value, requirement };
            if !(l.lower.is_finite() && l.upper.is_finite() && l.lower <= l.upper) {
                return Err(parameter("upper", l.upper, "must be finite and at least the lower"));
            }
            if !(l.lower..=l.upper).contains(&l.neutral) {
                return Err(parameter("neutral", l.neutral, "must lie within the bounds"));
            }
            if l.rate_per_stride.is_nan() || l.rate_per_stride <= 0.0 {
                return Err(parameter("rate_per_stride", l.rate_per_stride, "must be positive"));
            }
            if !(l.gain > 0.0 && l.gain <= 1.0) {
                return Err(parameter("gain", l.gain, "must lie in (0, 1]"));
            }
        }
        let last = limits.iter().map(|l| l.neutral).collect();
        Ok(Self { limits, last })
    }

    /// The limits of each component.
    #[must_use]
    pub fn limits(&self) -> &[ActionLimits] {
        &self.limits
    }

    /// The action applied last; neutral before the first.
    #[must_use]
    pub const fn last(&self) -> &Action {
        &self.last
    }

    /// Goes back to the neutral action.
    pub fn reset(&mut self) {
        self.last = self.limits.iter().map(|l| l.neutral).collect();
    }

    /// Starts from a given last action.
    pub fn reset_to(&mut self, last: Action) {
        self.last = last;
    }

    /// The action that is applied when `wanted` is asked for.
    ///
    /// # Errors
    ///
    /// [`ProcessError::ActionLength`] or [`ProcessError::ActionNotFinite`]; the last action is then
    /// unchanged.
    pub fn apply(&mut self, wanted: &[f64]) -> Result<Action, ProcessError> {
        if wanted.len() != self.limits.len() {
            return Err(ProcessError::ActionLength { expected: self.limits.len(), found: wanted.len() });
        }
        if let Some(component) = wanted.iter().position(|a| !a.is_finite()) {
            return Err(ProcessError::ActionNotFinite { component, value: wanted[component] });
        }
        for ((last, want), l) in self.last.iter_mut().zip(wanted).zip(&self.limits) {
            let target = want.clamp(l.lower, l.upper);
            let way = l.gain * (target - *last);
            *last = if l.gain >= 1.0 && way.abs() <= l.rate_per_stride {
                target // to the bit, where `last + (target − last)` would round
            } else {
                *last + way.clamp(-l.rate_per_stride, l.rate_per_stride)
            };
        }
        Ok(Action::from_slice(&self.last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_action_is_refused_and_changes_nothing() {
        let limits = ActionLimits { lower: -1.0, upper: 1.0, rate_per_stride: f64::INFINITY, gain: 1.0, neutral: 0.0 };
        let mut law = ActionLaw::new(vec![limits]).unwrap();
        law.apply(&[0.5]).unwrap();
        assert!(matches!(law.apply(&[]), Err(ProcessError::ActionLength { .. })));
        assert!(matches!(law.apply(&[f64::NAN]), Err(ProcessError::ActionNotFinite { .. })));
        assert!((law.last()[0] - 0.5).abs() < 1e-15);
        law.reset();
        assert!(law.last()[0].abs() < 1e-15);
    }

    /// At the flip frequency (the wanted value alternates by ±1) the law's gain is
    /// `gain / (2 − gain)`: with 0.4 it is 0.25, so that feedback cannot feed the flip.
    #[test]
    fn gain_at_the_flip_frequency() {
        let limits = ActionLimits { lower: -5.0, upper: 5.0, rate_per_stride: 2.0, gain: 0.4, neutral: 0.0 };
        let mut law = ActionLaw::new(vec![limits]).unwrap();
        let mut applied = 0.0;
        for k in 0..100 {
            applied = law.apply(&[if k % 2 == 0 { 1.0 } else { -1.0 }]).unwrap()[0];
        }
        assert!((applied.abs() - 0.25).abs() < 1e-12);
    }
}
