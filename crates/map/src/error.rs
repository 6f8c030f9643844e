//! What can go wrong with a map, or with the analysis of its data.

use stridemap_process::ProcessError;

/// What can go wrong with a map, or with the analysis of its data.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// A Gaussian process failed.
    #[error("the learned map failed: {0}")]
    Gp(#[from] stridemap_gp::GpError),
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
    /// The process behind the map failed, or its configuration is wrong.
    #[error(transparent)]
    Process(#[from] ProcessError),
}

impl From<MapError> for ProcessError {
    fn from(error: MapError) -> Self {
        match error {
            MapError::Process(error) => error,
            error => Self::World(Box::new(error)),
        }
    }
}
