//! What keeps a walking robot off its cliff: the part `[caution]` of a task. Without it the loop is the
//! paper's.

use serde::{Deserialize, Serialize};

use crate::error::{Invalid, LabError};
use crate::guard::GuardConfig;
use crate::pessimism::PessimismConfig;
use crate::proof::ProofConfig;
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

impl CautionConfig {
    /// Checks every parameter for a task of this many components of the action.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] with the key at fault.
    pub fn validate(&self, actions: usize) -> Result<(), LabError> {
        let invalid = |key: &str, requirement: String| {
            Err(LabError::Invalid(Invalid { key: format!("caution.{key}"), requirement }))
        };
        let (g, p, t, f) = (&self.guard, &self.pessimism, &self.trust, &self.proof);
        for (key, value, positive) in [
            ("guard.pitch_rate_change_deg_s", g.pitch_rate_change_deg_s, true),
            ("guard.turn_deg", g.turn_deg, true),
            ("guard.heading_deg", g.heading_deg, true),
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
        for (key, value) in [
            ("guard.psi_roll_below_in_place_deg", g.psi_roll_below_in_place_deg),
            ("pessimism.psi_roll_below_in_place_deg", p.psi_roll_below_in_place_deg),
        ] {
            if !value.is_finite() {
                return invalid(key, format!("is {value}, must be finite"));
            }
        }
        let dither = &f.dither_std;
        if !dither.is_empty() && (dither.len() != actions || dither.iter().any(|s| !(s.is_finite() && *s >= 0.0))) {
            return invalid(
                "proof.dither_std",
                format!("needs {actions} numbers that are not negative, one per component of the action"),
            );
        }
        if let Some(m) = &g.mean_psi_roll
            && !(m.strides > 0 && m.above_in_place_deg.is_finite())
        {
            return invalid("guard.mean_psi_roll", "needs at least 1 stride and a finite above_in_place_deg".into());
        }
        for (key, list, positive) in [("trust.unit", &t.unit, true), ("proof.back_off", &f.back_off, false)] {
            if list.len() != actions {
                return invalid(
                    key,
                    format!("has {} entries, needs one per component of the action: {actions}", list.len()),
                );
            }
            if let Some(v) = list.iter().find(|v| !(v.is_finite() && (!positive || **v > 0.0))) {
                return invalid(key, format!("{v} is outside its domain"));
            }
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
