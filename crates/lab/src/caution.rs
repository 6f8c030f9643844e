//! What keeps a walking robot off its cliff: the part `[caution]` of a task. Without it the loop is the
//! paper's.

use serde::{Deserialize, Serialize};

use crate::error::{Invalid, LabError};
use crate::guard::GuardConfig;
use crate::pessimism::PessimismConfig;
use crate::trust::TrustConfig;

/// Guard, pessimism, trust region and proof, each with its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CautionConfig {
    /// What is watched on the robot.
    pub guard: GuardConfig,
    /// What the learner is told of a stride in the map that is uncertain or unsafe.
    pub pessimism: PessimismConfig,
    /// How far from what was tried or proven a policy may go.
    pub trust: TrustConfig,
    /// When a policy counts as proven.
    pub proof: ProofConfig,
}

/// When a policy counts as proven.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProofConfig {
    /// Strides after which a policy that is no faster than the best proven one is given up.
    pub trial_strides: usize,
    /// Strides, the trial's included, without a warning that prove a policy.
    pub proof_strides: usize,
    /// First strides whose speed does not count: the way up to the policy.
    pub settle_strides: usize,
    /// A first policy that warned is shrunk by this factor towards stepping in place.
    pub shrink_on_warning: f64,
    /// How often a first policy is tried, the first time included.
    pub attempts: usize,
    /// Strides of backing off after a warning.
    pub back_off_strides: usize,
}

impl CautionConfig {
    /// Checks every parameter.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] with the key at fault.
    pub fn validate(&self) -> Result<(), LabError> {
        let invalid = |key: &str, requirement: String| {
            Err(LabError::Invalid(Invalid { key: format!("caution.{key}"), requirement }))
        };
        let (g, p, t, f) = (&self.guard, &self.pessimism, &self.trust, &self.proof);
        for (key, value, positive) in [
            ("guard.pitch_rate_change_deg_s", g.pitch_rate_change_deg_s.unwrap_or(1.0), true),
            ("guard.turn_deg", g.turn_deg.unwrap_or(1.0), true),
            ("guard.heading_deg", g.heading_deg.unwrap_or(1.0), true),
            ("guard.exploring_factor", g.exploring_factor, true),
            ("guard.residual_stds", g.residual_stds, false),
            ("pessimism.std_weight", p.std_weight, false),
            ("pessimism.unsafe_penalty", p.unsafe_penalty, false),
            ("pessimism.flip_penalty", p.flip_penalty, false),
            ("pessimism.flip_free_deg_s", p.flip_free_deg_s, false),
            ("trust.first_margin", t.first_margin, false),
            ("trust.radius", t.radius, true),
            ("trust.grow", t.grow, true),
            ("trust.shrink", t.shrink, true),
            ("proof.shrink_on_warning", f.shrink_on_warning, true),
        ] {
            let fits = value.is_finite() && (value > 0.0 || (!positive && value >= 0.0));
            if !fits {
                let word = if positive { "positive" } else { "not negative" };
                return invalid(key, format!("is {value}, must be finite and {word}"));
            }
        }
        if let Some(m) = &g.mean_psi_roll
            && m.strides == 0
        {
            return invalid("guard.mean_psi_roll", "needs at least 1 stride".into());
        }
        if f.shrink_on_warning >= 1.0 || t.shrink > 1.0 || t.grow < 1.0 {
            return invalid("trust", "growing factors are at least 1, shrinking ones below 1".into());
        }
        if f.trial_strides == 0 || f.proof_strides < f.trial_strides || f.settle_strides >= f.trial_strides {
            return invalid("proof", "needs settle_strides < trial_strides <= proof_strides".into());
        }
        Ok(())
    }
}
