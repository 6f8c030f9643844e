//! What analysis asks of a map, and what can go wrong with it.

use crate::{ProcessError, State, StrideEnd};

/// A map whose mean can be asked for at any state: the learned map, the exact maps; not a robot.
pub trait MeanMap {
    /// The next state without noise, `f(x, u)` of \[MA09, eq. (7)\]; the action is clipped to the
    /// process's bounds.
    ///
    /// # Errors
    ///
    /// [`AnalysisError::NoReturn`] if the stride does not reach the next section;
    /// [`AnalysisError::Process`] for a bad state or action.
    fn mean_next_state(&self, state: &[f64], action: &[f64]) -> Result<State, AnalysisError>;
}

/// What can go wrong in the analysis of a map or of its data.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnalysisError {
    /// Too few pairs for a line with standard errors.
    #[error("{found} pairs; a return map needs at least {needed}")]
    TooFewPairs {
        /// Pairs given.
        found: usize,
        /// Pairs needed.
        needed: usize,
    },
    /// All pairs start at the same state: no slope can be told.
    #[error("all pairs start at {value}: no slope can be fitted")]
    NoSpread {
        /// Where all of them start.
        value: f64,
    },
    /// NaN or an infinity among the data, or from the map.
    #[error("{quantity}[{index}] = {value}: must be finite")]
    NotFinite {
        /// What it belongs to.
        quantity: &'static str,
        /// Where.
        index: usize,
        /// The value.
        value: f64,
    },
    /// Sizes do not agree.
    #[error("{quantity} has {found} components, {expected} are needed")]
    Length {
        /// What it belongs to.
        quantity: &'static str,
        /// Components needed.
        expected: usize,
        /// Components found.
        found: usize,
    },
    /// A stride from a state of interest does not reach the next section.
    #[error("the stride does not return to the section: {}", end.name())]
    NoReturn {
        /// How it ended.
        end: StrideEnd,
    },
    /// Newton's iteration did not find a fixed point.
    #[error("no fixed point after {iterations} Newton steps; the last residual was {residual}")]
    NoFixedPoint {
        /// Steps made.
        iterations: usize,
        /// Largest component of `f(x) − x`, in steps of the finite differences.
        residual: f64,
    },
    /// The map has a multiplier of one, or a line slope one: fixed points are not isolated.
    #[error("the map has no isolated fixed point: a multiplier is one")]
    NotIsolated,
    /// The Riccati iteration did not converge, or the feedback is not determined.
    #[error("the Riccati iteration found no feedback: {reason}")]
    Riccati {
        /// Why.
        reason: &'static str,
    },
    /// The process behind the map failed.
    #[error(transparent)]
    Process(#[from] ProcessError),
}
