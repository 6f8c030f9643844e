//! The paper's policy: normal, with mean and standard deviation from one network.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;
use stridemap_process::{Action, ProcessSpec, Situation};

use crate::error::{FORMAT, LearnError, check_format, check_length, check_number, check_spec};
use crate::network::{Activations, NormalizedGaussianNetwork};
use crate::policy::Policy;

/// Outputs of a policy's network on the stack.
pub(crate) type Outputs = SmallVec<[f64; 16]>;

/// A normal policy with diagonal covariance over a normalized Gaussian network.
///
/// ```text
/// oⱼ ~ N(μⱼ(x), σⱼ(x)²),   uⱼ = clip(unitⱼ · oⱼ)                     [MA09, eq. (23)]
/// μⱼ(x) = Σᵢ wᵢ^μⱼ bᵢ(x)                                              [MA09, eq. (24)]
/// σⱼ(x) = σ₀ / (1 + exp(−σⱼ^w(x))),   σⱼ^w(x) = Σᵢ wᵢ^σⱼ bᵢ(x)        [MA09, eq. (25)]
/// ```
///
/// The *output* `o` is what the parameters and `σ₀` are measured in; the *action* `u` is in the
/// units of the process, `action_unit` of them per output 1. `σⱼ` is a standard deviation, as in
/// \[KK98\]; \[MA09\] leaves open whether the diagonal of Σ holds σ or σ². The same bases carry the
/// value function `V̂(x)` that judged the policy \[MA09, eq. (17)\], zero if there was none, so that
/// learning can go on from a file.
///
/// # Sampled and clipped
///
/// Only the action is clipped to its bounds, never the output: `ln π` and its gradient are those of
/// the sampled output, and the clipping belongs to the process. The density then is the one from
/// which the output was drawn, and the gradient estimator stays unbiased; with the clipped action in
/// its place the expected score is not zero (both are tested, `tests/gradient.rs`).
/// [`Policy::mean`] is clipped as well: it is what a deterministic run applies.
///
/// # Example
///
/// ```
/// # use stridemap_learn::{GaussianPolicy, Policy};
/// # use stridemap_process::{ActionDimension, ProcessSpec, StateDimension};
/// let spec = ProcessSpec {
///     state: vec![StateDimension { name: "psi_roll_deg".into() }],
///     action: vec![ActionDimension { name: "step_deg".into(), lower: -1.5, upper: 5.0 }],
///     goal: Vec::new(),
/// };
/// // Output 1 is 2 deg. Without bases, mean 0 and standard deviation 0.5 / (1 + exp(0)) · 2 deg.
/// let policy = GaussianPolicy::new(spec, &[0.5], &[2.0], 0.5)?;
/// assert_eq!(policy.mean(&[3.0].into())[0], 0.0);
/// assert_eq!(policy.std(&[3.0].into())[0], 0.5);
/// # Ok::<(), stridemap_learn::LearnError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "GaussianPolicyFile", into = "GaussianPolicyFile")]
pub struct GaussianPolicy {
    spec: ProcessSpec,
    action_unit: Vec<f64>,
    std_scale: f64,
    /// Outputs: m means, m logits of the standard deviation, one value.
    network: NormalizedGaussianNetwork,
}

/// The gradient of `ln π` with respect to the weights, one row of m numbers per base.
#[derive(Clone, Debug, PartialEq)]
pub struct LogDensityGradient {
    /// ∂ ln π / ∂wᵢ^μⱼ at `[i][j]`.
    pub mean: Vec<Vec<f64>>,
    /// ∂ ln π / ∂wᵢ^σⱼ at `[i][j]`.
    pub std_logit: Vec<Vec<f64>>,
}

impl GaussianPolicy {
    /// A policy without bases: mean 0 (clipped), standard deviation `std_scale / 2 · action_unit`.
    ///
    /// # Arguments
    ///
    /// - `spec` – the process's components; bounds finite, lower ≤ upper.
    /// - `basis_widths` – per component of the state, in its unit.
    /// - `action_unit` – per component of the action: that many of its units per output 1.
    /// - `std_scale` – σ₀, dimensionless (in outputs).
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`] naming what does not fit.
    pub fn new(
        spec: ProcessSpec,
        basis_widths: &[f64],
        action_unit: &[f64],
        std_scale: f64,
    ) -> Result<Self, LearnError> {
        let network = NormalizedGaussianNetwork::new(basis_widths, 2 * spec.action.len() + 1)?;
        Self::with_network(spec, action_unit, std_scale, network)
    }

    fn with_network(
        spec: ProcessSpec,
        action_unit: &[f64],
        std_scale: f64,
        network: NormalizedGaussianNetwork,
    ) -> Result<Self, LearnError> {
        check_spec(&spec)?;
        check_length("basis_widths", network.widths().len(), spec.state.len())?;
        check_length("action_unit", action_unit.len(), spec.action.len())?;
        for &unit in action_unit {
            check_number("action_unit", unit, unit > 0.0, "positive and finite")?;
        }
        check_number("std_scale", std_scale, std_scale > 0.0, "positive and finite")?;
        Ok(Self { spec, action_unit: action_unit.to_vec(), std_scale, network })
    }

    /// The process for which the policy was made.
    #[must_use]
    pub const fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    /// Centres of the bases, one row of components of the state each.
    #[must_use]
    pub fn centres(&self) -> Vec<Vec<f64>> {
        let bases = 0..self.network.len();
        bases.map(|i| self.network.centre(i).to_vec()).collect()
    }

    /// Units of the process's action per output 1.
    #[must_use]
    pub fn action_unit(&self) -> &[f64] {
        &self.action_unit
    }

    /// σ₀, in outputs.
    #[must_use]
    pub const fn std_scale(&self) -> f64 {
        self.std_scale
    }

    /// The network: outputs are m means, m logits of the standard deviation and the value.
    #[must_use]
    pub const fn network(&self) -> &NormalizedGaussianNetwork {
        &self.network
    }

    /// The network, to be changed.
    pub const fn network_mut(&mut self) -> &mut NormalizedGaussianNetwork {
        &mut self.network
    }

    /// `V̂(x)` \[MA09, eq. (17)\], in units of reward.
    #[must_use]
    pub fn value(&self, at: &Situation) -> f64 {
        let mut activations = Activations::default();
        self.network.activate(&at.state, &mut activations);
        self.network.output(&activations, self.value_column())
    }

    /// `ln π(x, u)`: log density of an action, in the process's units, before clipping.
    #[must_use]
    pub fn log_density(&self, at: &Situation, action: &[f64]) -> f64 {
        let m = self.spec.action.len();
        let outputs = self.network.evaluate(&at.state);
        (0..m)
            .map(|j| {
                let std = self.std_scale * sigmoid(outputs[m + j]);
                let z = (action[j] / self.action_unit[j] - outputs[j]) / std;
                -0.5 * z * z - (std * self.action_unit[j]).ln() - 0.5 * (2.0 * std::f64::consts::PI).ln()
            })
            .sum()
    }

    /// The gradient of [`log_density`](Self::log_density) with respect to the weights.
    #[must_use]
    pub fn log_density_gradient(&self, at: &Situation, action: &[f64]) -> LogDensityGradient {
        let m = self.spec.action.len();
        let mut activations = Activations::default();
        self.network.activate(&at.state, &mut activations);
        let outputs = self.network.evaluate(&at.state);
        let scores: Vec<Score> = (0..m)
            .map(|j| Score::of(action[j] / self.action_unit[j], outputs[j], outputs[m + j], self.std_scale))
            .collect();
        let rows = |pick: fn(&Score) -> f64| {
            activations.normalized().iter().map(|b| scores.iter().map(|s| pick(s) * b).collect()).collect()
        };
        LogDensityGradient { mean: rows(|s| s.mean), std_logit: rows(|s| s.std_logit) }
    }

    pub(crate) fn value_column(&self) -> usize {
        2 * self.spec.action.len()
    }

    /// An output in the units of the process, within the bounds.
    pub(crate) fn clip(&self, output: f64, component: usize) -> f64 {
        let bounds = &self.spec.action[component];
        (output * self.action_unit[component]).clamp(bounds.lower, bounds.upper)
    }

    pub(crate) fn set_spec(&mut self, spec: ProcessSpec) {
        self.spec = spec;
    }
}

/// The derivatives of `ln N(o; μ, σ²)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Score {
    /// By μ: (o − μ) / σ².
    pub mean: f64,
    /// By the logit: ((o − μ)²/σ² − 1) (1 − σ/σ₀), since dσ/dσ^w = σ (1 − σ/σ₀).
    pub std_logit: f64,
    /// σ.
    pub std: f64,
}

impl Score {
    /// At o.
    pub fn of(output: f64, mean: f64, std_logit: f64, std_scale: f64) -> Self {
        Self::drawn((output - mean) / (std_scale * sigmoid(std_logit)), std_logit, std_scale)
    }

    /// At o = μ + σ z.
    pub fn drawn(z: f64, std_logit: f64, std_scale: f64) -> Self {
        let s = sigmoid(std_logit);
        let std = std_scale * s;
        Self { mean: z / std, std_logit: (z * z - 1.0) * (1.0 - s), std }
    }
}

pub(crate) fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

impl Policy for GaussianPolicy {
    fn mean(&self, at: &Situation) -> Action {
        let outputs = self.network.evaluate(&at.state);
        (0..self.spec.action.len()).map(|j| self.clip(outputs[j], j)).collect()
    }

    fn std(&self, at: &Situation) -> Action {
        let outputs = self.network.evaluate(&at.state);
        let m = self.spec.action.len();
        (0..m).map(|j| self.std_scale * sigmoid(outputs[m + j]) * self.action_unit[j]).collect()
    }

    /// Draws about the mean before clipping, then clips: near a bound this differs from drawing
    /// about [`mean`](Policy::mean).
    fn sample(&self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        let outputs = self.network.evaluate(&at.state);
        let m = self.spec.action.len();
        (0..m)
            .map(|j| {
                let z: f64 = StandardNormal.sample(rng);
                self.clip(outputs[j] + self.std_scale * sigmoid(outputs[m + j]) * z, j)
            })
            .collect()
    }
}

/// A base in the file.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BaseFile {
    centre: Vec<f64>,
    mean: Vec<f64>,
    std_logit: Vec<f64>,
    value: f64,
}

/// The file: every number by name, one object per base.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GaussianPolicyFile {
    format: u32,
    spec: ProcessSpec,
    action_unit: Vec<f64>,
    std_scale: f64,
    basis_widths: Vec<f64>,
    bases: Vec<BaseFile>,
}

impl From<GaussianPolicy> for GaussianPolicyFile {
    fn from(policy: GaussianPolicy) -> Self {
        let m = policy.spec.action.len();
        let bases = (0..policy.network.len())
            .map(|i| {
                let weights = policy.network.weights(i);
                BaseFile {
                    centre: policy.network.centre(i).to_vec(),
                    mean: weights[..m].to_vec(),
                    std_logit: weights[m..2 * m].to_vec(),
                    value: weights[2 * m],
                }
            })
            .collect();
        Self {
            format: FORMAT,
            basis_widths: policy.network.widths().to_vec(),
            bases,
            spec: policy.spec,
            action_unit: policy.action_unit,
            std_scale: policy.std_scale,
        }
    }
}

impl TryFrom<GaussianPolicyFile> for GaussianPolicy {
    type Error = LearnError;

    fn try_from(file: GaussianPolicyFile) -> Result<Self, LearnError> {
        check_format(file.format)?;
        let m = file.spec.action.len();
        let (mut centres, mut weights) = (Vec::new(), Vec::new());
        for base in &file.bases {
            check_length("bases.centre", base.centre.len(), file.spec.state.len())?;
            check_length("bases.mean", base.mean.len(), m)?;
            check_length("bases.std_logit", base.std_logit.len(), m)?;
            centres.extend_from_slice(&base.centre);
            weights.extend_from_slice(&base.mean);
            weights.extend_from_slice(&base.std_logit);
            weights.push(base.value);
        }
        check_length("basis_widths", file.basis_widths.len(), file.spec.state.len())?;
        let network = NormalizedGaussianNetwork::from_rows(&file.basis_widths, 2 * m + 1, centres, weights)?;
        Self::with_network(file.spec, &file.action_unit, file.std_scale, network)
    }
}
