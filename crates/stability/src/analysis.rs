//! From a record to what can be said of it.

use crate::answer::{Analysis, RecordSummary, Refusal};
use crate::error::StabilityError;
use crate::fall;
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

/// An analysis, and what figures of it need.
#[derive(Clone, Debug, PartialEq)]
pub struct Examined {
    /// What is said.
    pub analysis: Analysis,
    /// The record as it was taken: states beyond the rule are falls.
    pub record: Record,
    /// Multipliers of draws from the posterior of the whole record, real and imaginary parts.
    pub eigenvalues: Vec<[f64; 2]>,
    /// One-step prediction errors by stretch, in standard deviations of the state's components.
    pub errors: Vec<Vec<Vec<f64>>>,
    /// Probability of no fall up to each stride, from 0 on: 2.5 %, median, 97.5 %. Empty where it is refused.
    pub survival: Vec<[f64; 3]>,
}

/// Multipliers of a record that was checked, by the number of its components.
fn multipliers(record: &Record, options: &Options) -> Result<Found, StabilityError> {
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
/// changes, a rule about none of its components. What a sound record cannot say is among [`Analysis::refused`].
///
/// # Cost
///
/// 200 strides of three components, sensor unknown: about 0.1 s; bounds on falls about 1 s more.
pub fn analyse(record: &Record, options: &Options) -> Result<Analysis, StabilityError> {
    Ok(examine(record, options)?.analysis)
}

/// [`analyse`], with what figures need.
///
/// # Errors
///
/// As [`analyse`].
pub fn examine(record: &Record, options: &Options) -> Result<Examined, StabilityError> {
    record.check()?;
    if let SensorKnowledge::Given(stds) = &options.sensor
        && let Some(value) = stds.iter().flatten().find(|s| !(**s >= 0.0 && s.is_finite()))
    {
        let requirement = "a standard deviation is a number from 0";
        return Err(StabilityError::Number { key: "sensor noise".into(), value: *value, requirement });
    }
    let known = || record.state.join(", ");
    let rule = options.fall.as_ref().map(|rule| match record.state.iter().position(|name| *name == rule.component) {
        Some(at) => Ok((at, rule)),
        None => Err(StabilityError::Unknown { name: rule.component.clone(), known: known() }),
    });
    let rule = rule.transpose()?;
    let record = match rule {
        Some((at, rule)) => record.clone().fallen(at, rule),
        None => record.clone(),
    };
    record.check()?;
    let mut found = multipliers(&record, options)?;
    let (mut fall, mut survival) = (None, Vec::new());
    if let Some((at, rule)) = rule {
        let (bounds, refused, interval) = fall::bounds(&record, at, rule, found.one_map, options.seed);
        found.refused.extend(refused);
        survival = interval.map(|found| found.survival).unwrap_or_default();
        fall = Some(bounds);
    } else {
        found.refused.push(Refusal::new("fall", "no_rule", "say what a fall is: --fall \"NAME < VALUE\""));
    }
    let summary = RecordSummary {
        strides: record.strides(),
        bouts: record.bouts.len(),
        stride_s: record.stride_s,
        state: record.state.clone(),
        falls: record.falls(),
    };
    let Found { multipliers, checks, refused, eigenvalues, errors, .. } = found;
    let analysis = Analysis { record: summary, multipliers, checks, fall, refused };
    Ok(Examined { analysis, record, eigenvalues, errors, survival })
}
