//! What is said of a record: the keys of `stridemap analyse --json`.

use serde::{Deserialize, Serialize};

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The median.
    pub value: f64,
    /// 2.5 %.
    pub low: f64,
    /// 97.5 %.
    pub high: f64,
}

impl Estimate {
    /// Median and 2.5 and 97.5 % of draws.
    #[must_use]
    pub fn of(mut draws: Vec<f64>) -> Self {
        draws.sort_by(f64::total_cmp);
        let at = |q: f64| quantile(&draws, q);
        Self { value: at(0.5), low: at(0.025), high: at(0.975) }
    }

    /// The same of a function that grows.
    pub(crate) fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self { value: f(self.value), low: f(self.low), high: f(self.high) }
    }
}

/// A quantile of sorted numbers, by the straight line between two of them.
pub(crate) fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = q * last as f64;
    let below = at.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
}

/// Both ends of an interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// What a record says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Analysis {
    /// What was looked at.
    pub record: RecordSummary,
    /// Multipliers of the gait; null where they cannot be known.
    pub multipliers: Option<Multipliers>,
    /// Does the record look like the model?
    pub checks: Checks,
    /// Time to fall; null without a rule for falls.
    pub fall: Option<FallBounds>,
    /// What is not said, why, and what to do.
    pub refused: Vec<Refusal>,
}

/// What was looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordSummary {
    /// Sections at which the robot was seen.
    pub strides: usize,
    /// Unbroken stretches.
    pub bouts: usize,
    /// Mean duration of a stride; null if it is not known.
    pub stride_s: Option<f64>,
    /// Components of the state.
    pub state: Vec<String>,
    /// Falls in the record.
    pub falls: usize,
}

/// Floquet multipliers of the stride map: by how much a deviation shrinks in a stride.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Multipliers {
    /// Of the intervals: 0.95.
    pub level: f64,
    /// What is taken for granted: `below_one`, `one_linear_map`, `white_noise`; of pieces `below_one` alone.
    pub assumes: Vec<String>,
    /// Largest modulus: the slowest recovery.
    pub largest: Estimate,
    /// Largest real part: what decays without changing sign.
    pub slow: Estimate,
    /// Smallest real part: what alternates from leg to leg.
    pub flip: Estimate,
    /// Strides until half of a deviation is left, ln 2 / -ln ρ.
    pub half_life_strides: Estimate,
    /// The largest modulus by least squares, which noise of the sensor makes too small, and a short record as well.
    pub least_squares: f64,
    /// What is known of the sensor.
    pub sensor_noise: SensorNoise,
    /// `posterior` of the whole record, or of four `pieces` where it is not of one piece.
    pub method: Method,
    /// Strides over components.
    pub strides_per_state: usize,
}

/// Where the intervals come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// One map for the whole record.
    Posterior,
    /// Random effects over four pieces.
    Pieces,
}

/// What is known of the sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorNoise {
    /// Where that comes from.
    pub source: NoiseSource,
    /// Share of the noise in the variance of each component.
    pub share_of_variance: Vec<f64>,
}

/// Where the sensor's noise is known from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseSource {
    /// Named by the user.
    Given,
    /// From two looks at each section.
    TwoLooks,
    /// From the record itself.
    Estimated,
    /// There is none.
    None,
}

/// Five checks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checks {
    /// Whether strides remember one another: p of their not doing so, which must be small.
    pub excited: Check,
    /// Whether prediction errors are white: p of their being so.
    pub white_residuals: Check,
    /// Whether the mean is the same in both halves: p of its being so.
    pub steady_mean: Check,
    /// Whether the gait may be growing.
    pub unstable: Unstable,
    /// Whether there are ten strides for each parameter of a component.
    pub long_enough: LongEnough,
}

/// A test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// Its p-value.
    pub p: f64,
    /// Whether the record passes.
    pub pass: bool,
}

/// Whether the gait may be growing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unstable {
    /// The probability of a multiplier above one under a flat prior.
    pub probability_flat: f64,
    /// Whether it is at most one half.
    pub pass: bool,
}

/// Whether the record is long enough.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LongEnough {
    /// There.
    pub strides: usize,
    /// 10 (d + 1).
    pub needed: usize,
    /// Whether there are as many.
    pub pass: bool,
}

/// Bounds on falls: never a point, because a record without falls knows the mean time to one to two to four decades.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FallBounds {
    /// What a fall is.
    pub rule: String,
    /// The probability of a fall within 60 s of walking from where the gait usually is; null where it is refused.
    pub probability_60_s: Option<Bounds>,
    /// Mean number of strides to a fall; null where it is refused.
    pub strides_to_fall: Option<StridesToFall>,
    /// What the number of falls alone says, with no model at all.
    pub counts_only: CountsOnly,
    /// How far the lowest stride was from the boundary, in standard deviations of the component.
    pub boundary_sd: f64,
}

/// Mean number of strides to a fall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StridesToFall {
    /// At least.
    pub low: f64,
    /// At most; null where the interval spans more than two decades.
    pub high: Option<f64>,
}

/// What the number of falls alone says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CountsOnly {
    /// Upper end of the probability of a fall within 60 s; null where strides have no duration.
    pub probability_60_s_high: Option<f64>,
}

/// Something that is not said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refusal {
    /// The key of the answer.
    pub key: String,
    /// Why, in one word.
    pub because: String,
    /// What would help.
    pub remedy: String,
}

impl Refusal {
    pub(crate) fn new(key: &str, because: &str, remedy: impl Into<String>) -> Self {
        Self { key: key.into(), because: because.into(), remedy: remedy.into() }
    }
}
