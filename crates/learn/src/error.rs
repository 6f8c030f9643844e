use stridemap_process::{ProcessError, ProcessSpec, State};

/// What can go wrong when a policy is loaded or improved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// A parameter of a learner or a policy lies outside its domain.
    #[error("{field} = {value}: must be {domain}")]
    Parameter {
        /// The field of the configuration or of the policy file.
        field: &'static str,
        /// The value given.
        value: String,
        /// What it must satisfy.
        domain: &'static str,
    },
    /// A list of a configuration or policy does not have one entry per component.
    #[error("{field} has {found} entries, the process has {expected} components")]
    Length {
        /// The field.
        field: &'static str,
        /// Components of the process.
        expected: usize,
        /// Entries given.
        found: usize,
    },
    /// A policy was made for a process with other components.
    #[error("the policy is for {policy}, the process has {process}")]
    OtherProcess {
        /// Names of the policy's components.
        policy: String,
        /// Names of the process's components.
        process: String,
    },
    /// A learner cannot start from this kind of policy.
    #[error("cannot start from a {found} policy; {expected} is needed")]
    InitialPolicy {
        /// The kind needed.
        expected: &'static str,
        /// The kind given.
        found: &'static str,
    },
    /// A policy file of a format that this version does not read.
    #[error("policy format {found}; this version reads format {expected}")]
    Format {
        /// The format that is read.
        expected: u32,
        /// The format found.
        found: u32,
    },
    /// The process answered with NaN or an infinity.
    #[error("trial {trial}, stride {stride}: the process gave {quantity} = {value}")]
    NotFinite {
        /// `"state"` or `"reward"`.
        quantity: &'static str,
        /// The value.
        value: f64,
        /// Trial, from 1.
        trial: usize,
        /// Stride of that trial, from 1.
        stride: usize,
    },
    /// The process answered with a state of another length than its specification says.
    #[error("the process gave a state of {found} components, its specification says {expected}")]
    StateLength {
        /// Components of the specification.
        expected: usize,
        /// Components found.
        found: usize,
    },
    /// The parameters grew beyond all bounds: smaller steps are needed.
    #[error("trial {trial}, stride {stride}: the parameters diverged; use smaller step sizes")]
    Diverged {
        /// Trial, from 1.
        trial: usize,
        /// Stride of that trial, from 1.
        stride: usize,
    },
    /// Not one stride of a trial came to an end that can be learned from.
    #[error("trial {trial}: every stride was aborted")]
    AllAborted {
        /// Trial, from 1.
        trial: usize,
    },
    /// The learner takes expectations or slopes of strides, and the process, a robot, can only make them.
    #[error("{learner} learns in a map; this process makes strides and foresees none")]
    NoForesight {
        /// The learner.
        learner: &'static str,
    },
    /// A Gaussian process of the learner's own could not be fitted.
    #[error(transparent)]
    Gp(#[from] stridemap_gp::GpError),
    /// The process failed.
    #[error(transparent)]
    Process(#[from] ProcessError),
}

impl LearnError {
    pub(crate) fn parameter(field: &'static str, value: impl std::fmt::Display, domain: &'static str) -> Self {
        Self::Parameter { field, value: value.to_string(), domain }
    }
}

/// Refuses a list that does not have one entry per component.
pub(crate) fn check_length(field: &'static str, found: usize, expected: usize) -> Result<(), LearnError> {
    if found == expected { Ok(()) } else { Err(LearnError::Length { field, expected, found }) }
}

/// Refuses a number that does not satisfy a predicate. NaN satisfies none.
pub(crate) fn check_number(
    field: &'static str,
    value: f64,
    holds: bool,
    domain: &'static str,
) -> Result<(), LearnError> {
    if !(value.is_finite() && holds) {
        return Err(LearnError::parameter(field, value, domain));
    }
    // Sums and products of larger ones may not be finite.
    if value.abs() > 1e12 {
        return Err(LearnError::parameter(field, value, "at most 1e12 in size"));
    }
    Ok(())
}

/// Where in a run something is looked at: trial and stride, from 1.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub trial: usize,
    pub stride: usize,
}

impl Place {
    pub const fn diverged(self) -> LearnError {
        LearnError::Diverged { trial: self.trial, stride: self.stride }
    }

    pub fn check_finite(self, quantity: &'static str, value: f64) -> Result<(), LearnError> {
        if value.is_finite() {
            return Ok(());
        }
        Err(LearnError::NotFinite { quantity, value, trial: self.trial, stride: self.stride })
    }

    /// Refuses a state that is not what the process says it gives.
    pub fn check_state(self, state: &State, spec: &ProcessSpec) -> Result<(), LearnError> {
        let expected = spec.state.len();
        if state.len() != expected {
            return Err(LearnError::StateLength { expected, found: state.len() });
        }
        state.iter().try_for_each(|x| self.check_finite("state", *x))
    }
}

/// The version of the policy files that this crate writes and reads.
pub(crate) const FORMAT: u32 = 1;

pub(crate) fn check_format(found: u32) -> Result<(), LearnError> {
    if found == FORMAT { Ok(()) } else { Err(LearnError::Format { expected: FORMAT, found }) }
}

/// Refuses a process without states or actions, or with bounds that no action can meet.
pub(crate) fn check_spec(spec: &ProcessSpec) -> Result<(), LearnError> {
    if spec.state.is_empty() || spec.action.is_empty() {
        return Err(LearnError::parameter("spec", "{}", "at least one state and one action"));
    }
    for bounds in &spec.action {
        check_number("spec.action.lower", bounds.lower, true, "finite")?;
        check_number(
            "spec.action.upper",
            bounds.upper,
            bounds.upper >= bounds.lower,
            "finite and not below the lower bound",
        )?;
    }
    Ok(())
}
