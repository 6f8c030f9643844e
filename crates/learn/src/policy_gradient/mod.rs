//! Policy gradients from batches of strides: one loop, and one file for each way to estimate the gradient.

mod batch;
mod bayesian;
mod natural;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_process::StrideProcess;

use crate::actor_critic::{ActorCriticConfig, warm_start};
use crate::error::{LearnError, Place, check_number};
use crate::gaussian_policy::GaussianPolicy;
use crate::learner::{LearnOutcome, Learner, TrialReport};
use crate::saved::{KeptPolicy, SavedPolicy};
use batch::Batch;

/// Parameters of [`NaturalActorCritic`] and [`BayesianPolicyGradient`]. The policy's shape, its limits and the
/// discount are those of an [`ActorCriticConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyGradientConfig {
    /// Updates of the policy, each from a batch of its own; at least 1.
    pub trials: usize,
    /// Strides of a batch; at least 1.
    pub strides_per_trial: usize,
    /// Episodes are cut after this many strides; at least 1.
    pub episode_strides: usize,
    /// How far the policy goes in an update: Kullback–Leibler divergence a stride, in nats; positive. It shrinks to a
    /// hundredth over the trials.
    pub kl_nats: f64,
    /// λ of LSTD-Q(λ), from 0 to 1; the natural actor-critic's.
    pub trace_decay: f64,
    /// Most bases of the policy; at least 1.
    pub max_bases: usize,
}

impl Default for PolicyGradientConfig {
    fn default() -> Self {
        Self {
            trials: 150,
            strides_per_trial: 600,
            episode_strides: 10,
            kl_nats: 0.03,
            trace_decay: 0.5,
            max_bases: 14,
        }
    }
}

impl PolicyGradientConfig {
    /// Checks every field against its domain.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] naming the field.
    pub fn validate(&self) -> Result<(), LearnError> {
        for (field, value) in [
            ("trials", self.trials),
            ("strides_per_trial", self.strides_per_trial),
            ("episode_strides", self.episode_strides),
            ("max_bases", self.max_bases),
        ] {
            if value == 0 {
                return Err(LearnError::parameter(field, value, "at least 1"));
            }
        }
        check_number("kl_nats", self.kl_nats, self.kl_nats > 0.0, "positive and finite")?;
        let lambda = self.trace_decay;
        check_number("trace_decay", lambda, (0.0..=1.0).contains(&lambda), "from 0 to 1")
    }

    /// The factor on the root of `kl_nats` in a trial, from 0: one for the first half, then down to a tenth.
    fn step_factor(&self, trial: usize) -> f64 {
        let half = 0.5 * self.trials as f64;
        1.0 - 0.9 * ((trial as f64 - half) / half).clamp(0.0, 1.0)
    }
}

/// What an estimate of the gradient says: where to go, and what it knows of the value function, if anything.
struct Estimate {
    /// The natural gradient `G⁻¹ ∇J`, one entry per mean and logit weight, base by base.
    natural: Vec<f64>,
    /// Value weights, one per base.
    values: Option<Vec<f64>>,
    /// How sure it is of the direction, from 0 to 1: the step is that much shorter.
    certainty: f64,
}

/// The natural actor-critic: the natural gradient is the weight of the policy's compatible features in a
/// least-squares critic.
///
/// ```text
/// φ(x, u) = ∇ ln π_w(x, u)                                   compatible features [Kakade02; PS08, eq. (17)]
/// φ̂(k) = [b(x(k)); φ(x(k), u(k))],  φ̃(k) = [b(x(k+1)); 0]     [PS08, sec. 3.2]
/// z ← λ z + φ̂,   A ← A + z (φ̂ − γ φ̃)ᵀ,   c ← c + z r          LSTD-Q(λ)
/// [v; g] = A⁻¹ c,   w ← w + α g
/// ```
///
/// with α such that the policy moves by `kl_nats` a stride. A batch in which a base was added teaches nothing: the
/// features of its strides are not all of one policy.
///
/// # References
///
/// \[PS08\], \[Kakade02\]: see the [crate](crate) documentation.
#[derive(Clone, Debug)]
pub struct NaturalActorCritic {
    /// The policy's shape and limits, and the discount.
    pub network: ActorCriticConfig,
    /// The parameters.
    pub config: PolicyGradientConfig,
}

impl Learner for NaturalActorCritic {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let (lambda, gamma) = (self.config.trace_decay, self.network.discount);
        let estimate = |batch: &Batch| natural::estimate(batch, gamma, lambda);
        climb(&self.network, &self.config, &estimate, process, initial, rng, observer)
    }
}

/// Bayesian policy gradient: the integral over paths that is the gradient, by Bayesian quadrature with the Fisher
/// kernel.
///
/// ```text
/// u(ξ) = Σₖ ∇ ln π_w(x(k), u(k)),  R(ξ) = Σₖ γᵏ r(k+1),  G = E[u uᵀ]      [GE07, sec. 3, model 2]
/// R ~ GP(b(x(0))ᵀ β, σ_f² u(ξ)ᵀ G⁻¹ u(ξ′)),   observed with σ²
/// E[∇J] = U (K + λ I)⁻¹ R,   Cov[∇J] = σ_f² (G − U (K + λ I)⁻¹ Uᵀ),   K = Uᵀ G⁻¹ U
/// ```
///
/// with `λ = σ²/σ_f²` where the evidence is largest. A step is as much shorter as the posterior doubts its direction: by
/// the root of the share of `|E[∇J]|²` in `|E[∇J]|² + tr Cov[∇J]`, both in the metric of G⁻¹. The mean function, of which the gradient is zero, takes what the
/// start of a path explains; paths without it are needed to be three times as many as bases, or it is a constant.
///
/// # References
///
/// \[GE07\]: see the [crate](crate) documentation.
#[derive(Clone, Debug)]
pub struct BayesianPolicyGradient {
    /// The policy's shape and limits, and the discount.
    pub network: ActorCriticConfig,
    /// The parameters.
    pub config: PolicyGradientConfig,
}

impl Learner for BayesianPolicyGradient {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let gamma = self.network.discount;
        let estimate = |batch: &Batch| {
            let posterior = bayesian::posterior(batch, gamma)?;
            let natural = posterior.natural.as_slice().to_vec();
            Some(Estimate { natural, values: None, certainty: posterior.certainty() })
        };
        climb(&self.network, &self.config, &estimate, process, initial, rng, observer)
    }
}

/// Least weight of the logit of σ: a quarter of σ₀. The divergence of a step is measured in σ, so that a policy which has
/// stopped exploring cannot move any more; what is kept of the policy is its mean.
const LEAST_LOGIT: f64 = -1.0;

/// A policy to begin with: the initial one with the process's bounds, or one without bases.
pub(crate) fn beginning(
    network: &ActorCriticConfig,
    process: &dyn StrideProcess,
    initial: Option<&SavedPolicy>,
) -> Result<GaussianPolicy, LearnError> {
    network.validate()?;
    let scratch =
        GaussianPolicy::new(process.spec().clone(), &network.basis_widths, &network.units(), network.std_scale)?;
    match initial {
        None => Ok(scratch),
        Some(SavedPolicy::GaussianNetwork(policy)) => warm_start(policy, &scratch, network),
        Some(other) => Err(LearnError::InitialPolicy { expected: "gaussian_network", found: other.kind() }),
    }
}

/// Climbs along estimated gradients; the answer is the mean of the policies of the second half of the trials.
fn climb(
    network: &ActorCriticConfig,
    config: &PolicyGradientConfig,
    estimate: &dyn Fn(&Batch) -> Option<Estimate>,
    process: &mut dyn StrideProcess,
    initial: Option<&SavedPolicy>,
    rng: &mut ChaCha8Rng,
    observer: &mut dyn FnMut(&TrialReport<'_>),
) -> Result<LearnOutcome, LearnError> {
    config.validate()?;
    let mut policy = beginning(network, process, initial)?;
    let mut average: Option<(GaussianPolicy, f64)> = None;
    let (mut trials, mut strides) = (Vec::with_capacity(config.trials), 0);
    for trial in 0..config.trials {
        let batch = batch::collect(network, config, &mut policy, process, trial + 1, rng)?;
        strides += batch.strides_made;
        if !batch.has_new_bases
            && let Some(found) = estimate(&batch)
        {
            take(&mut policy, network, &batch, &found, config.kl_nats.sqrt() * config.step_factor(trial));
        }
        let weights = policy.network().all_weights();
        if weights.iter().any(|w| !w.is_finite()) {
            return Err(Place { trial: trial + 1, stride: config.strides_per_trial }.diverged());
        }
        average = match average {
            Some((mean, n)) if !batch.has_new_bases => Some((mixed(mean, &policy, 1.0 / (n + 1.0)), n + 1.0)),
            _ if 2 * trial >= config.trials || trial + 1 == config.trials => Some((policy.clone(), 1.0)),
            kept => kept,
        };
        let summary = batch.tally.summary(trial + 1, policy.network().len());
        observer(&TrialReport { summary: &summary, policy: &policy });
        trials.push(summary);
    }
    let policy = average.map_or(policy, |(mean, _)| mean);
    Ok(LearnOutcome { policy: policy.to_saved(), trials, strides })
}

/// The mean moved by a share towards the policy as it is now.
fn mixed(mut mean: GaussianPolicy, now: &GaussianPolicy, share: f64) -> GaussianPolicy {
    for (m, w) in mean.network_mut().all_weights_mut().iter_mut().zip(now.network().all_weights()) {
        *m += share * (w - *m);
    }
    mean
}

/// Takes a step along an estimate by which the policy changes by half the square of `reach` in nats a stride.
fn take(policy: &mut GaussianPolicy, network: &ActorCriticConfig, batch: &Batch, found: &Estimate, reach: f64) {
    let square = batch.mean_square_along(&found.natural);
    if !(square.is_finite() && square > 0.0) {
        return;
    }
    let step = found.certainty * reach * (2.0 / square).sqrt();
    let m = policy.spec().action.len();
    let bounds = network.mean_weight_bounds(policy.spec());
    let rows = policy.network_mut().all_weights_mut().chunks_exact_mut(2 * m + 1);
    for (i, (row, along)) in rows.zip(found.natural.chunks_exact(2 * m)).enumerate() {
        for (w, g) in row.iter_mut().zip(along) {
            *w += step * g;
        }
        for (w, [low, high]) in row.iter_mut().zip(&bounds) {
            *w = w.clamp(*low, *high);
        }
        let [low, high] = network.std_logit_bounds.unwrap_or([f64::MIN, f64::MAX]);
        for w in &mut row[m..2 * m] {
            *w = w.clamp(low.max(LEAST_LOGIT.min(high)), high);
        }
        if let Some(values) = &found.values {
            row[2 * m] = values[i];
        }
    }
}

#[cfg(test)]
mod tests;
