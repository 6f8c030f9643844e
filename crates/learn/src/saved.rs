//! Policies as files, and the two simple ones: a constant and a linear feedback.

use serde::{Deserialize, Serialize};
use stridemap_process::{Action, ProcessSpec, Situation};

use rand_chacha::ChaCha8Rng;

use crate::error::{FORMAT, LearnError, check_format, check_length, check_number, check_spec};
use crate::gaussian_policy::GaussianPolicy;
use crate::goal::{GoalAffine, GoalPlanner};
use crate::policy::{Acting, Policy};

/// Any policy of this crate, as it is written to a file: an object tagged by `kind`.
///
/// # Example
///
/// ```
/// # use stridemap_learn::{Policy, SavedPolicy};
/// let policy: SavedPolicy = serde_json::from_str(r#"{
///     "kind": "linear", "format": 1,
///     "spec": { "state": [{ "name": "psi_deg" }],
///               "action": [{ "name": "step_deg", "lower": -1.5, "upper": 5.0 }] },
///     "action": [2.0], "gain": [[2.5]], "state": [2.0]
/// }"#)?;
/// assert_eq!(policy.mean(&[3.0].into())[0], 4.5); // 2 + 2.5 (3 - 2)
/// assert_eq!(policy.mean(&[9.0].into())[0], 5.0); // clipped
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum SavedPolicy {
    /// A normal policy over a normalized Gaussian network.
    GaussianNetwork(GaussianPolicy),
    /// The same action everywhere.
    Constant(ConstantPolicy),
    /// A linear feedback.
    Linear(LinearPolicy),
    /// Affine laws about goals.
    GoalAffine(Box<GoalAffine>),
    /// Planning in a map of goals.
    GoalPlanner(Box<GoalPlanner>),
}

impl SavedPolicy {
    /// The word used in files.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::GaussianNetwork(_) => "gaussian_network",
            Self::Constant(_) => "constant",
            Self::Linear(_) => "linear",
            Self::GoalAffine(_) => "goal_affine",
            Self::GoalPlanner(_) => "goal_planner",
        }
    }

    /// The process for which the policy was made.
    #[must_use]
    pub const fn spec(&self) -> &ProcessSpec {
        match self {
            Self::GaussianNetwork(p) => p.spec(),
            Self::Constant(p) => &p.0.spec,
            Self::Linear(p) => &p.0.spec,
            Self::GoalAffine(p) => &p.spec,
            Self::GoalPlanner(p) => &p.spec,
        }
    }

    /// Whether the policy can act on a process: the same components, by name. Bounds may differ;
    /// the policy keeps its own and the process applies its own.
    ///
    /// # Errors
    ///
    /// [`LearnError::OtherProcess`] with both lists of names; what does not fit within a policy of goals.
    pub fn check_fits(&self, process: &ProcessSpec) -> Result<(), LearnError> {
        match self {
            Self::GoalAffine(p) => p.check()?,
            Self::GoalPlanner(p) => p.check()?,
            _ => {}
        }
        check_same_components(self.spec(), process)
    }

    fn inner(&self) -> &dyn Policy {
        match self {
            Self::GaussianNetwork(p) => p,
            Self::Constant(p) => p,
            Self::Linear(p) => p,
            Self::GoalAffine(p) => p.as_ref(),
            Self::GoalPlanner(p) => p.as_ref(),
        }
    }
}

pub(crate) fn check_same_components(policy: &ProcessSpec, process: &ProcessSpec) -> Result<(), LearnError> {
    let names = |spec: &ProcessSpec| {
        let state: Vec<&str> = spec.state.iter().map(|d| d.name.as_str()).collect();
        let action: Vec<&str> = spec.action.iter().map(|d| d.name.as_str()).collect();
        let goal: Vec<&str> = spec.goal.iter().map(|d| d.name.as_str()).collect();
        let goals = if goal.is_empty() { String::new() } else { format!(" and goals [{}]", goal.join(", ")) };
        format!("states [{}] and actions [{}]{goals}", state.join(", "), action.join(", "))
    };
    let (ours, theirs) = (names(policy), names(process));
    if ours == theirs { Ok(()) } else { Err(LearnError::OtherProcess { policy: ours, process: theirs }) }
}

impl Policy for SavedPolicy {
    fn mean(&self, at: &Situation) -> Action {
        self.inner().mean(at)
    }

    fn std(&self, at: &Situation) -> Action {
        self.inner().std(at)
    }

    fn sample(&self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        self.inner().sample(at, rng)
    }

    fn acting(&self) -> Option<Box<dyn Acting>> {
        self.inner().acting()
    }

    fn measures(&self) -> &[String] {
        self.inner().measures()
    }
}

/// A policy that can be kept: copied out of a running learner, written to a file, read again.
pub trait KeptPolicy: Policy {
    /// A copy, as it goes into a file.
    fn to_saved(&self) -> SavedPolicy;
}

impl KeptPolicy for GaussianPolicy {
    fn to_saved(&self) -> SavedPolicy {
        SavedPolicy::GaussianNetwork(self.clone())
    }
}

impl KeptPolicy for GoalAffine {
    fn to_saved(&self) -> SavedPolicy {
        SavedPolicy::GoalAffine(Box::new(self.clone()))
    }
}

impl KeptPolicy for GoalPlanner {
    fn to_saved(&self) -> SavedPolicy {
        SavedPolicy::GoalPlanner(Box::new(self.clone()))
    }
}

impl KeptPolicy for SavedPolicy {
    fn to_saved(&self) -> SavedPolicy {
        self.clone()
    }
}

/// `u = clip(u₀ + limit(K (x − x₀)))`, with normal exploration about it if asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "LinearFile", into = "LinearFile")]
pub struct LinearPolicy(Linear);

/// `u = clip(u₀)`, with normal exploration about it if asked for: the control that any learner must
/// beat, and with u₀ = 0 the nominal gait.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ConstantFile", into = "ConstantFile")]
pub struct ConstantPolicy(Linear);

/// What both share. A constant has no rows in `gain`.
#[derive(Clone, Debug, PartialEq)]
struct Linear {
    spec: ProcessSpec,
    action: Vec<f64>,
    gain: Vec<Vec<f64>>,
    state: Vec<f64>,
    /// Largest magnitude of the feedback per component; `f64::MAX` where it is not limited.
    limit: Vec<f64>,
    std: Vec<f64>,
}

impl Linear {
    fn check(self) -> Result<Self, LearnError> {
        check_spec(&self.spec)?;
        let (n, m) = (self.spec.state.len(), self.spec.action.len());
        check_length("action", self.action.len(), m)?;
        check_length("std", self.std.len(), m)?;
        check_length("feedback_limit", self.limit.len(), m)?;
        for &l in &self.limit {
            // Any size: the largest number of all says that there is no limit.
            if !(l.is_finite() && l >= 0.0) {
                return Err(LearnError::parameter("feedback_limit", l, "finite and not negative"));
            }
        }
        if !self.gain.is_empty() {
            check_length("gain", self.gain.len(), m)?;
            check_length("state", self.state.len(), n)?;
        }
        for row in &self.gain {
            check_length("gain rows", row.len(), n)?;
        }
        for &v in self.action.iter().chain(&self.state).chain(self.gain.iter().flatten()) {
            check_number("action, gain and state", v, true, "finite")?;
        }
        for &s in &self.std {
            check_number("std", s, s >= 0.0, "finite and not negative")?;
        }
        Ok(self)
    }

    fn clip(&self, component: usize, action: f64) -> f64 {
        let bounds = &self.spec.action[component];
        action.clamp(bounds.lower, bounds.upper)
    }

    fn unclipped(&self, state: &[f64]) -> Action {
        (0..self.action.len())
            .map(|j| {
                let feedback: f64 = self
                    .gain
                    .get(j)
                    .map_or(0.0, |row| row.iter().zip(state).zip(&self.state).map(|((k, x), x0)| k * (x - x0)).sum());
                self.action[j] + feedback.clamp(-self.limit[j], self.limit[j])
            })
            .collect()
    }

    fn mean(&self, state: &[f64]) -> Action {
        self.unclipped(state).iter().enumerate().map(|(j, u)| self.clip(j, *u)).collect()
    }

    fn sample(&self, state: &[f64], rng: &mut ChaCha8Rng) -> Action {
        use rand_distr::{Distribution, StandardNormal};
        self.unclipped(state)
            .iter()
            .zip(&self.std)
            .enumerate()
            .map(|(j, (u, s))| {
                let z: f64 = StandardNormal.sample(rng);
                self.clip(j, u + s * z)
            })
            .collect()
    }
}

impl LinearPolicy {
    /// A linear feedback: `gain` holds one row per component of the action.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`] naming what does not fit.
    pub fn new(spec: ProcessSpec, action: &[f64], gain: &[Vec<f64>], state: &[f64]) -> Result<Self, LearnError> {
        check_length("gain", gain.len(), spec.action.len())?;
        let std = vec![0.0; spec.action.len()];
        let limit = vec![f64::MAX; spec.action.len()];
        let linear = Linear { limit, spec, action: action.to_vec(), gain: gain.to_vec(), state: state.to_vec(), std };
        linear.check().map(Self)
    }

    /// The same policy exploring with these standard deviations, in the units of the action.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`].
    pub fn exploring(mut self, std: &[f64]) -> Result<Self, LearnError> {
        self.0.std = std.to_vec();
        self.0.check().map(Self)
    }

    /// The same policy with the feedback `K (x − x₀)` limited in magnitude, per component of the
    /// action, in its unit; `f64::MAX` for no limit.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`].
    pub fn limited(mut self, limit: &[f64]) -> Result<Self, LearnError> {
        self.0.limit = limit.to_vec();
        self.0.check().map(Self)
    }

    /// Largest magnitude of the feedback, per component of the action; `f64::MAX` for no limit.
    #[must_use]
    pub fn limit(&self) -> &[f64] {
        &self.0.limit
    }

    /// K, one row per component of the action.
    #[must_use]
    pub fn gain(&self) -> &[Vec<f64>] {
        &self.0.gain
    }

    /// u₀.
    #[must_use]
    pub fn action(&self) -> &[f64] {
        &self.0.action
    }

    /// x₀.
    #[must_use]
    pub fn state(&self) -> &[f64] {
        &self.0.state
    }
}

impl ConstantPolicy {
    /// The same action everywhere.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`] naming what does not fit.
    pub fn new(spec: ProcessSpec, action: &[f64]) -> Result<Self, LearnError> {
        let std = vec![0.0; spec.action.len()];
        let limit = vec![f64::MAX; spec.action.len()];
        let action = action.to_vec();
        let linear = Linear { spec, action, limit, gain: Vec::new(), state: Vec::new(), std };
        linear.check().map(Self)
    }

    /// The same policy exploring with these standard deviations, in the units of the action.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`].
    pub fn exploring(mut self, std: &[f64]) -> Result<Self, LearnError> {
        self.0.std = std.to_vec();
        self.0.check().map(Self)
    }

    /// u₀.
    #[must_use]
    pub fn action(&self) -> &[f64] {
        &self.0.action
    }
}

macro_rules! policy_of_linear {
    ($policy:ty, $variant:ident) => {
        impl Policy for $policy {
            fn mean(&self, at: &Situation) -> Action {
                self.0.mean(&at.state)
            }

            fn std(&self, _at: &Situation) -> Action {
                self.0.std.iter().copied().collect()
            }

            fn sample(&self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
                self.0.sample(&at.state, rng)
            }
        }

        impl KeptPolicy for $policy {
            fn to_saved(&self) -> SavedPolicy {
                SavedPolicy::$variant(self.clone())
            }
        }
    };
}

policy_of_linear!(LinearPolicy, Linear);
policy_of_linear!(ConstantPolicy, Constant);

#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LinearFile {
    format: u32,
    spec: ProcessSpec,
    action: Vec<f64>,
    gain: Vec<Vec<f64>>,
    state: Vec<f64>,
    #[serde(default)]
    feedback_limit: Option<Vec<f64>>,
    #[serde(default)]
    std: Option<Vec<f64>>,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ConstantFile {
    format: u32,
    spec: ProcessSpec,
    action: Vec<f64>,
    #[serde(default)]
    std: Option<Vec<f64>>,
}

impl From<LinearPolicy> for LinearFile {
    fn from(LinearPolicy(p): LinearPolicy) -> Self {
        let Linear { spec, action, gain, state, limit, std } = p;
        Self { format: FORMAT, spec, action, gain, state, feedback_limit: Some(limit), std: Some(std) }
    }
}

impl TryFrom<LinearFile> for LinearPolicy {
    type Error = LearnError;

    fn try_from(file: LinearFile) -> Result<Self, LearnError> {
        check_format(file.format)?;
        let mut policy = Self::new(file.spec, &file.action, &file.gain, &file.state)?;
        if let Some(limit) = file.feedback_limit {
            policy = policy.limited(&limit)?;
        }
        file.std.map_or(Ok(policy.clone()), |std| policy.exploring(&std))
    }
}

impl From<ConstantPolicy> for ConstantFile {
    fn from(ConstantPolicy(p): ConstantPolicy) -> Self {
        Self { format: FORMAT, spec: p.spec, action: p.action, std: Some(p.std) }
    }
}

impl TryFrom<ConstantFile> for ConstantPolicy {
    type Error = LearnError;

    fn try_from(file: ConstantFile) -> Result<Self, LearnError> {
        check_format(file.format)?;
        let policy = Self::new(file.spec, &file.action)?;
        file.std.map_or(Ok(policy.clone()), |std| policy.exploring(&std))
    }
}
