//! The actor-critic's parameters.

use serde::{Deserialize, Serialize};
use smallvec::SmallVec;
use stridemap_process::{ActionDimension, ProcessSpec};

use crate::error::{LearnError, check_number};

/// Parameters of [`ActorCritic`](super::ActorCritic).
///
/// The defaults are the paper's (Table 2, all extras off); `basis_widths` and `outputs` have
/// none, because they depend on the process. In a file, every other key may be left out; `outputs` is not in a
/// file, but where the components of the action are.
///
/// # Example
///
/// ```
/// # use stridemap_learn::ActorCriticConfig;
/// let paper = ActorCriticConfig::paper(&[0.5], &[1.0]);
/// assert_eq!((paper.trials, paper.strides_per_trial, paper.std_scale), (15, 20, 0.5));
/// let error = ActorCriticConfig { discount: 1.0, ..paper }.validate().unwrap_err();
/// assert_eq!(error.to_string(), "discount = 1: must be at least 0 and below 1");
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActorCriticConfig {
    /// Width of the bases per component of the state, in its unit; positive.
    pub basis_widths: Vec<f64>,
    /// What the network's outputs stand for, per component of the action. All step sizes, `std_scale` and σ are in
    /// outputs.
    #[serde(skip)]
    pub outputs: Vec<Output>,
    /// γ, from 0 to below 1. Table 2: 0.95.
    #[serde(default = "default::discount")]
    pub discount: f64,
    /// α, the critic's step size, from 0 (the critic is frozen) to 2 (beyond that TD(0) diverges).
    /// Table 2: 0.3.
    #[serde(default = "default::step")]
    pub critic_step: f64,
    /// β, the actor's step size; not negative. Table 2: 0.3.
    #[serde(default = "default::step")]
    pub actor_step: f64,
    /// η, decay of the eligibility traces per stride, from 0 to 1. Table 2: 0.3.
    #[serde(default = "default::step")]
    pub trace_decay: f64,
    /// σ₀, largest standard deviation of the policy, in outputs; positive. Table 2: 0.5.
    #[serde(default = "default::std_scale")]
    pub std_scale: f64,
    /// A base is added at a state where the largest activation (before normalization) is below
    /// this; from 0 to 1. The paper does not give it. At recipe A's 0.4 neighbours are 1.35 widths
    /// apart or a little more.
    #[serde(default = "default::activation_threshold")]
    pub activation_threshold: f64,
    /// Most bases; at least 1. The paper sets no limit; recipe A 14.
    #[serde(default = "default::max_bases")]
    pub max_bases: usize,
    /// Number of trials; at least 1. Ours for the paper: 15.
    #[serde(default = "default::trials")]
    pub trials: usize,
    /// Strides of a trial, through any falls; at least 1. Ours for the paper: 20.
    #[serde(default = "default::strides_per_trial")]
    pub strides_per_trial: usize,
    /// Episodes are cut after this many strides: the process is reset and the traces are zeroed;
    /// at least 1. `None`: only at the start of each trial. Recipe A: 6.
    #[serde(default)]
    pub restart_every: Option<usize>,
    /// Multiplies the gradients of component j by σⱼ², which keeps steps bounded as exploration
    /// shrinks \[KK98\]; the actor's step may then be larger, near 1. Without it the gradient grows
    /// like 1/σ, and with long runs or vector actions a seed may run away. The paper does not scale;
    /// recipe W does.
    #[serde(default)]
    pub scale_gradient_by_variance: bool,
    /// Keeps every mean weight within the bounds of its action, so that the mean cannot wander to
    /// where all samples are clipped to the same action and there is no gradient to bring it back.
    /// Neither the paper nor the recipes do. On a linear map of stepping, recipe A leaves a policy
    /// stuck there in 28 of 1000 seeds, with this in 1, and with η = 0.9 as well in none.
    #[serde(default)]
    pub mean_weights_within_bounds: bool,
    /// Lowest and highest weight of the logit of σ. Recipe A: −4 and 5.
    #[serde(default)]
    pub std_logit_bounds: Option<[f64; 2]>,
    /// Step sizes are full for this fraction of the trials, from 0 to 1, and then go linearly ...
    /// Recipe A: 0.3.
    #[serde(default = "default::one")]
    pub full_step_fraction: f64,
    /// ... to this fraction of themselves in the last trial, from 0 to 1. Recipe A: 0.02.
    #[serde(default = "default::one")]
    pub final_step_fraction: f64,
    /// The policy is the mean of those after each of the last trials, this fraction of all, from 0
    /// (the last policy) to 1 \[PJ92\]. Recipe A: 0.5.
    #[serde(default)]
    pub average_fraction: f64,
    /// Whether a warm start keeps the value function that is saved with the policy. Turn off if the
    /// reward has changed since.
    #[serde(default = "default::yes")]
    pub keep_value: bool,
}

/// What an output of the network stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// How much of the component of the action output 1 is; positive.
    pub unit: f64,
    /// Bound on the magnitude of every mean weight, in units of the action; positive. Recipe A: 8 deg.
    pub mean_weight_limit: Option<f64>,
}

mod default {
    pub(super) const fn discount() -> f64 {
        0.95
    }
    pub(super) const fn step() -> f64 {
        0.3
    }
    pub(super) const fn std_scale() -> f64 {
        0.5
    }
    pub(super) const fn activation_threshold() -> f64 {
        0.4
    }
    pub(super) const fn max_bases() -> usize {
        100
    }
    pub(super) const fn trials() -> usize {
        15
    }
    pub(super) const fn strides_per_trial() -> usize {
        20
    }
    pub(super) const fn one() -> f64 {
        1.0
    }
    pub(super) const fn yes() -> bool {
        true
    }
}

impl ActorCriticConfig {
    /// \[MA09, Table 2\] literally: 15 trials of 20 strides, every extra off.
    #[must_use]
    pub fn paper(basis_widths: &[f64], action_unit: &[f64]) -> Self {
        Self {
            basis_widths: basis_widths.to_vec(),
            outputs: action_unit.iter().map(|&unit| Output { unit, mean_weight_limit: None }).collect(),
            discount: default::discount(),
            critic_step: default::step(),
            actor_step: default::step(),
            trace_decay: default::step(),
            std_scale: default::std_scale(),
            activation_threshold: default::activation_threshold(),
            max_bases: default::max_bases(),
            trials: default::trials(),
            strides_per_trial: default::strides_per_trial(),
            restart_every: None,
            scale_gradient_by_variance: false,
            mean_weights_within_bounds: false,
            std_logit_bounds: None,
            full_step_fraction: 1.0,
            final_step_fraction: 1.0,
            average_fraction: 0.0,
            keep_value: true,
        }
    }

    /// Recipe A, for stepping on the large biped: state and action in degrees.
    #[must_use]
    pub fn stepping() -> Self {
        Self {
            max_bases: 14,
            trials: 200,
            strides_per_trial: 24,
            restart_every: Some(6),
            outputs: vec![Output { unit: 2.0, mean_weight_limit: Some(8.0) }],
            std_logit_bounds: Some([-4.0, 5.0]),
            full_step_fraction: 0.3,
            final_step_fraction: 0.02,
            average_fraction: 0.5,
            ..Self::paper(&[0.5], &[])
        }
    }

    /// Checks every field against its domain.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] naming the first field outside its domain, the value and the
    /// domain; [`LearnError::Length`] if lists do not agree.
    pub fn validate(&self) -> Result<(), LearnError> {
        const FRACTION: &str = "from 0 to 1";
        const POSITIVE: &str = "positive and finite";
        let fraction = |field, v: f64| check_number(field, v, (0.0..=1.0).contains(&v), FRACTION);
        let positive = |field, v: f64| check_number(field, v, v > 0.0, POSITIVE);
        let count = |field, v: usize| match v {
            0 => Err(LearnError::parameter(field, v, "at least 1")),
            _ => Ok(()),
        };
        for &w in &self.basis_widths {
            positive("basis_widths", w)?;
        }
        for output in &self.outputs {
            positive("action_unit", output.unit)?;
            positive("mean_weight_limit", output.mean_weight_limit.unwrap_or(1.0))?;
        }
        let g = self.discount;
        check_number("discount", g, (0.0..1.0).contains(&g), "at least 0 and below 1")?;
        let a = self.critic_step;
        check_number("critic_step", a, (0.0..=2.0).contains(&a), "from 0 to 2")?;
        let b = self.actor_step;
        check_number("actor_step", b, b >= 0.0, "finite and not negative")?;
        fraction("trace_decay", self.trace_decay)?;
        positive("std_scale", self.std_scale)?;
        fraction("activation_threshold", self.activation_threshold)?;
        count("max_bases", self.max_bases)?;
        count("trials", self.trials)?;
        count("strides_per_trial", self.strides_per_trial)?;
        count("restart_every", self.restart_every.unwrap_or(1))?;
        if let Some([low, high]) = self.std_logit_bounds {
            check_number("std_logit_bounds", low, low <= high, "finite, the lower one first")?;
            check_number("std_logit_bounds", high, true, "finite, the lower one first")?;
        }
        fraction("full_step_fraction", self.full_step_fraction)?;
        fraction("final_step_fraction", self.final_step_fraction)?;
        fraction("average_fraction", self.average_fraction)
    }

    /// The factor on both step sizes in a trial, counted from 0.
    pub(super) fn step_factor(&self, trial: usize) -> f64 {
        let last = self.trials as f64 - 1.0;
        let full = self.full_step_fraction * self.trials as f64;
        let beyond = trial as f64 - full;
        if beyond <= 0.0 || last <= full {
            return 1.0;
        }
        1.0 - (1.0 - self.final_step_fraction) * (beyond / (last - full)).min(1.0)
    }

    /// Units of the action per output 1, per component.
    #[must_use]
    pub fn units(&self) -> Vec<f64> {
        self.outputs.iter().map(|output| output.unit).collect()
    }

    /// Bounds of the mean weights per component, in outputs; empty if there are none.
    pub(crate) fn mean_weight_bounds(&self, spec: &ProcessSpec) -> SmallVec<[[f64; 2]; 8]> {
        let (within, outputs) = (self.mean_weights_within_bounds, &self.outputs);
        if !within && outputs.iter().all(|output| output.mean_weight_limit.is_none()) {
            return SmallVec::new();
        }
        let bounds = |(bounds, Output { unit, mean_weight_limit }): (&ActionDimension, &Output)| {
            let limit = mean_weight_limit.map_or(f64::INFINITY, |limit| limit / unit);
            if within {
                let (low, high) = (bounds.lower / unit, bounds.upper / unit);
                [low.clamp(-limit, limit), high.clamp(-limit, limit)]
            } else {
                [-limit, limit]
            }
        };
        spec.action.iter().zip(outputs).map(bounds).collect()
    }

    /// How many of the last trials are averaged.
    pub(super) fn averaged_trials(&self) -> usize {
        (self.average_fraction * self.trials as f64).round() as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_sizes_are_full_and_then_go_linearly_to_the_final_fraction() {
        let config = ActorCriticConfig {
            trials: 11,
            full_step_fraction: 0.5,
            final_step_fraction: 0.1,
            ..ActorCriticConfig::paper(&[1.0], &[1.0])
        };
        // Full to trial 5.5, then down to trial 10: at 8 it is 2.5 / 4.5 of the way.
        assert!((config.step_factor(5) - 1.0).abs() < 1e-15);
        assert!((config.step_factor(8) - (1.0 - 0.9 * 2.5 / 4.5)).abs() < 1e-15);
        assert!((config.step_factor(10) - 0.1).abs() < 1e-15);
        let constant = ActorCriticConfig::paper(&[1.0], &[1.0]);
        assert!((constant.step_factor(14) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn every_recipe_is_valid_and_survives_a_file() {
        for config in [ActorCriticConfig::paper(&[0.5], &[1.0]), ActorCriticConfig::stepping()] {
            config.validate().unwrap();
            let text = serde_json::to_string(&config).unwrap();
            let read = serde_json::from_str::<ActorCriticConfig>(&text).unwrap();
            assert_eq!(ActorCriticConfig { outputs: config.outputs.clone(), ..read }, config);
        }
        let sparse = r#"{ "basis_widths": [0.5] }"#;
        let config: ActorCriticConfig = serde_json::from_str(sparse).unwrap();
        assert_eq!(config, ActorCriticConfig::paper(&[0.5], &[]));
        let wrong = r#"{ "basis_widths": [0.5], "discuont": 0.9 }"#;
        assert!(serde_json::from_str::<ActorCriticConfig>(wrong).is_err());
    }

    #[test]
    fn bad_values_are_named() {
        let good = ActorCriticConfig::stepping();
        let unlimited = Output { unit: 1.0, mean_weight_limit: Some(0.0) };
        let cases: [(&str, ActorCriticConfig); 6] = [
            ("critic_step", ActorCriticConfig { critic_step: f64::NAN, ..good.clone() }),
            ("trials", ActorCriticConfig { trials: 0, ..good.clone() }),
            ("restart_every", ActorCriticConfig { restart_every: Some(0), ..good.clone() }),
            ("mean_weight_limit", ActorCriticConfig { outputs: vec![unlimited], ..good.clone() }),
            ("std_logit_bounds", ActorCriticConfig { std_logit_bounds: Some([1.0, 0.0]), ..good.clone() }),
            ("basis_widths", ActorCriticConfig { basis_widths: vec![-1.0], ..good }),
        ];
        for (field, config) in cases {
            assert!(config.validate().unwrap_err().to_string().starts_with(field), "{field}");
        }
    }
}
