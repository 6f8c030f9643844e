//! What can be wrong with a simulated robot's configuration or model.

/// What can be wrong with a simulated robot's configuration or model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MujocoError {
    /// A number in the configuration is out of its domain.
    #[error("{field} is {value}; it must be {allowed}")]
    BadValue {
        /// The field at fault.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would be accepted.
        allowed: &'static str,
    },
    /// The control period cannot be divided into physics steps.
    #[error(
        "robot.control_period_s = {control_period_s} is not a whole multiple of the physics' step of {time_step_s} s \
         (robot.time_step_s, or the model's own <option timestep>); set robot.time_step_s = {}, or \
         robot.control_period_s = {}",
        dividing(*control_period_s, *time_step_s),
        multiple(*control_period_s, *time_step_s)
    )]
    PeriodNotMultiple {
        /// Time between two commands.
        control_period_s: f64,
        /// Time between two physics steps.
        time_step_s: f64,
    },
    /// MuJoCo cannot load the model.
    #[error("model {model}: {reason}")]
    Load {
        /// The model's name or path.
        model: String,
        /// What MuJoCo or the file system said.
        reason: String,
    },
    /// A name in the configuration is not in the model.
    #[error("{field}: the model has no {what} named {name:?}; {}", listed(near))]
    NoSuchName {
        /// Where the name stands, e.g. `left.knee`.
        field: String,
        /// `joint` or `body`.
        what: &'static str,
        /// The name.
        name: String,
        /// Those that the model has, the nearest first.
        near: Vec<String>,
    },
    /// An angle for each leg, for a joint that is in none.
    #[error("{field}: is no leg joint, so it has one angle: give a number")]
    OneAngle {
        /// Where it stands.
        field: String,
    },
    /// The same joint stands at two places of the joint map.
    #[error("{first} and {second} both name the joint {name:?}")]
    NamedTwice {
        /// One place.
        first: String,
        /// The other.
        second: String,
        /// The joint.
        name: String,
    },
    /// A joint is of a kind that a leg cannot use.
    #[error("{field}: the joint {name:?} is not a hinge")]
    NotAHinge {
        /// Where the name stands.
        field: String,
        /// The joint.
        name: String,
    },
    /// A joint has an actuator that takes neither positions nor torques, or more than can be driven.
    #[error(
        "the joint {joint:?} has the actuator {actuator:?}, which {problem}; accepted are one position servo \
         (<position>, also with timeconst) or one torque motor (<motor>), or no actuator, to have the torque \
         applied directly"
    )]
    Actuator {
        /// The joint.
        joint: String,
        /// Its actuator.
        actuator: String,
        /// What is wrong with it.
        problem: String,
    },
    /// An actuator that drives none of the robot's joints would act on it unasked.
    #[error(
        "the actuator {actuator:?} {problem}; it would act on the robot unasked: remove it, or disable its group \
         with <option actuatorgroupdisable=\"...\"/>"
    )]
    StrayActuator {
        /// The actuator.
        actuator: String,
        /// What it would do.
        problem: String,
    },
    /// A joint without a position servo needs gains.
    #[error(
        "the joint {joint:?} has no position servo that is enabled: give kp_nm_rad and kv_nms_rad, with which it is driven"
    )]
    NoGains {
        /// The joint.
        joint: String,
    },
    /// The model is not a biped that can stand on a floor.
    #[error("model {model}: {reason}")]
    NotABiped {
        /// The model's name or path.
        model: String,
        /// What is missing and what to do.
        reason: String,
    },
    /// A snapshot belongs to another model.
    #[error("the snapshot holds {found} numbers, this model's state has {expected}")]
    ForeignSnapshot {
        /// Size of this model's state.
        expected: usize,
        /// Size of the snapshot's.
        found: usize,
    },
}

impl MujocoError {
    /// The key of the configuration at fault, e.g. `left.knee`; `model` where the model is.
    #[must_use]
    pub fn key(&self) -> &str {
        match self {
            Self::BadValue { field, .. } => field,
            Self::PeriodNotMultiple { .. } => "control_period_s",
            Self::NoSuchName { field, .. } | Self::NotAHinge { field, .. } | Self::OneAngle { field } => field,
            Self::NamedTwice { second, .. } => second,
            _ => "model",
        }
    }
}

/// An error unless a value is in its domain.
pub(crate) fn check(field: &'static str, value: f64, good: bool, allowed: &'static str) -> Result<(), MujocoError> {
    if good {
        return Ok(());
    }
    Err(MujocoError::BadValue { field, value, allowed })
}

/// The largest step up to `step` that divides the period.
fn dividing(period: f64, step: f64) -> f64 {
    rounded(period / (period / step).ceil().max(1.0))
}

/// The multiple of the step that is nearest to the period.
fn multiple(period: f64, step: f64) -> f64 {
    rounded(step * (period / step).round().max(1.0))
}

/// A time as one would write it.
fn rounded(seconds: f64) -> f64 {
    (seconds * 1e9).round() / 1e9
}

/// A message lists so many names.
const LISTED: usize = 12;

/// The names there are, as they come.
fn listed(known: &[String]) -> String {
    let more = match known.len().saturating_sub(LISTED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    match known {
        [] => "it has none".into(),
        known => format!("it has, the nearest first: {}{more}", known[..known.len().min(LISTED)].join(", ")),
    }
}

/// These names, the nearest to `name` first.
pub(crate) fn nearest<'a>(name: &str, among: impl Iterator<Item = &'a str>) -> Vec<String> {
    let wanted = name.to_lowercase();
    let mut scored: Vec<(f64, &str)> = among
        .filter(|candidate| !candidate.is_empty())
        .map(|c| (strsim::jaro_winkler(&wanted, &c.to_lowercase()), c))
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    // A role is there once for each leg.
    scored.dedup_by_key(|(_, name)| *name);
    scored.into_iter().map(|(_, c)| c.into()).collect()
}
