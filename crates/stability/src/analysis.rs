//! From a record to what can be said of it.

use crate::answer::{Analysis, RecordSummary};
use crate::error::StabilityError;
use crate::multipliers::{Found, SensorKnowledge, find};
use crate::record::Record;
use crate::rule::FallRule;

/// What is asked of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// What is known of the sensor's noise.
    pub sensor: SensorKnowledge,
    /// What a fall is; without it nothing is said of falls.
    pub fall: Option<FallRule>,
    /// Root of every random stream.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { sensor: SensorKnowledge::Estimated, fall: None, seed: 1 }
    }
}

/// Multipliers of a record by the number of its components.
pub(crate) fn multipliers(record: &Record, options: &Options) -> Result<Found, StabilityError> {
    record.check()?;
    let (sensor, seed) = (&options.sensor, options.seed);
    match record.state.len() {
        1 => find::<1>(record, sensor, seed),
        2 => find::<2>(record, sensor, seed),
        3 => find::<3>(record, sensor, seed),
        4 => find::<4>(record, sensor, seed),
        _ => find::<5>(record, sensor, seed),
    }
}

/// Analyses a record of strides.
///
/// # Errors
///
/// [`StabilityError`] if the record cannot be read as one: sizes, numbers that are not finite, a component that never
/// changes. What a sound record cannot say is among [`Analysis::refused`].
pub fn analyse(record: &Record, options: &Options) -> Result<Analysis, StabilityError> {
    let found = multipliers(record, options)?;
    Ok(Analysis {
        record: RecordSummary {
            strides: record.strides(),
            bouts: record.bouts.len(),
            stride_s: record.stride_s,
            state: record.state.clone(),
            falls: record.falls(),
        },
        multipliers: found.multipliers,
        checks: found.checks,
        fall: None,
        refused: found.refused,
    })
}
