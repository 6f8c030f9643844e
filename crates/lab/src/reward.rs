//! Reward terms: lines of a task file.

use serde::{Deserialize, Serialize};

use crate::measure::StrideMeasures;

/// A component of the state at the section.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StateComponent {
    /// `ψ_roll`, degrees, + when the mass is inside its foot.
    PsiRollDeg,
    /// `ψ_pitch`, degrees, + when the mass is ahead of its foot.
    PsiPitchDeg,
    /// `ψ̇_pitch`, degrees per second.
    PsiPitchRateDegS,
    /// Yaw rate of the pelvis, degrees per second, + towards the side of the stance leg.
    YawRateDegS,
    /// Heading relative to the episode's first, degrees, + towards the side of the stance leg.
    HeadingDeg,
    /// Phase of the gait as the swing leg sees it, degrees.
    GaitPhaseDeg,
}

impl StateComponent {
    /// The name used in files, with its unit.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PsiRollDeg => "psi_roll_deg",
            Self::PsiPitchDeg => "psi_pitch_deg",
            Self::PsiPitchRateDegS => "psi_pitch_rate_deg_s",
            Self::YawRateDegS => "yaw_rate_deg_s",
            Self::HeadingDeg => "heading_deg",
            Self::GaitPhaseDeg => "gait_phase_deg",
        }
    }

    /// Whether the robot walks alike whatever its value is: the map then learns its change alone.
    #[must_use]
    pub const fn is_invariant(self) -> bool {
        matches!(self, Self::HeadingDeg)
    }

    /// Its value in what was measured of a stride.
    #[must_use]
    pub const fn of(self, measures: &StrideMeasures) -> f64 {
        match self {
            Self::PsiRollDeg => measures.psi_roll_deg,
            Self::PsiPitchDeg => measures.psi_pitch_deg,
            Self::PsiPitchRateDegS => measures.psi_pitch_rate_deg_s,
            Self::YawRateDegS => measures.yaw_rate_deg_s,
            Self::HeadingDeg => measures.heading_deg,
            Self::GaitPhaseDeg => measures.gait_phase_deg,
        }
    }
}

/// What a reward term looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RewardQuantity {
    /// `−(ψ_roll − target)²`, deg² \[MA09, eqs. (27), (30)\].
    PsiRollSquaredError,
    /// `ψ̇_pitch` at the section, deg/s \[MA09, eq. (28)\].
    PsiPitchRateDegS,
    /// `(1/T) ∫ ψ̇_pitch dt` over the stride, deg/s \[MA09, eq. (31)\].
    MeanPsiPitchRateDegS,
    /// Speed over the stride along the heading with which it began, m/s.
    SpeedMS,
    /// `Σ ∫ |τ ω| dt` over the stride, J; give it a negative weight.
    EnergyJ,
    /// Energy over weight and way, dimensionless; give it a negative weight.
    CostOfTransport,
    /// Largest vertical force on one foot, N; give it a negative weight.
    PeakFootLoadN,
    /// Root-mean-square deviation from the rest posture, deg; give it a negative weight.
    PostureDeviationDeg,
    /// `|change of heading|` over the stride, deg; give it a negative weight.
    TurnDeg,
}

/// One line of a reward: `weight × quantity`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardTerm {
    /// What it looks at.
    pub quantity: RewardQuantity,
    /// `K`, per unit of the quantity.
    pub weight: f64,
    /// The wanted value, for quantities that are errors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_deg: Option<f64>,
}

impl RewardTerm {
    /// The term for what was measured of a stride.
    ///
    /// # Example
    ///
    /// Eq. (27) with K = 0.1 and a target of 2 deg, 3 deg off:
    ///
    /// ```
    /// use stridemap_lab::{RewardQuantity, RewardTerm, StrideMeasures};
    ///
    /// let term = RewardTerm {
    ///     quantity: RewardQuantity::PsiRollSquaredError,
    ///     weight: 0.1,
    ///     target_deg: Some(2.0),
    /// };
    /// let stride = StrideMeasures { psi_roll_deg: 5.0, ..Default::default() };
    /// assert!((term.of(&stride) + 0.9).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn of(&self, measures: &StrideMeasures) -> f64 {
        let quantity = match self.quantity {
            RewardQuantity::PsiRollSquaredError => {
                -(measures.psi_roll_deg - self.target_deg.unwrap_or(0.0)).powi(2)
            }
            RewardQuantity::PsiPitchRateDegS => measures.psi_pitch_rate_deg_s,
            RewardQuantity::MeanPsiPitchRateDegS => measures.mean_psi_pitch_rate_deg_s,
            RewardQuantity::SpeedMS => measures.speed_m_s(),
            RewardQuantity::EnergyJ => measures.energy_j,
            RewardQuantity::CostOfTransport => measures.cost_of_transport,
            RewardQuantity::PeakFootLoadN => measures.peak_foot_load_n,
            RewardQuantity::PostureDeviationDeg => measures.posture_deviation_deg,
            RewardQuantity::TurnDeg => measures.turn_deg.abs(),
        };
        self.weight * quantity
    }

    /// The component of the state that determines this term; `None` if the state at the section does
    /// not, so that the reward needs a map of its own \[MA09, sec. 7.2\].
    #[must_use]
    pub const fn determined_by(&self) -> Option<StateComponent> {
        match self.quantity {
            RewardQuantity::PsiRollSquaredError => Some(StateComponent::PsiRollDeg),
            RewardQuantity::PsiPitchRateDegS => Some(StateComponent::PsiPitchRateDegS),
            _ => None,
        }
    }
}

/// The sum of the terms for what was measured of a stride that reached the next section.
#[must_use]
pub fn reward(terms: &[RewardTerm], measures: &StrideMeasures) -> f64 {
    terms.iter().map(|term| term.of(measures)).sum()
}

/// The same sum from a state alone, when every term is determined by it; `None` otherwise.
///
/// States and strides share one definition of the reward: the state is put back into the measures
/// that it came from.
#[must_use]
pub fn reward_of_state(
    terms: &[RewardTerm],
    components: &[StateComponent],
    state: &[f64],
) -> Option<f64> {
    let mut measures = StrideMeasures::default();
    for (component, value) in components.iter().zip(state) {
        match component {
            StateComponent::PsiRollDeg => measures.psi_roll_deg = *value,
            StateComponent::PsiPitchDeg => measures.psi_pitch_deg = *value,
            StateComponent::PsiPitchRateDegS => measures.psi_pitch_rate_deg_s = *value,
            StateComponent::YawRateDegS => measures.yaw_rate_deg_s = *value,
            StateComponent::HeadingDeg => measures.heading_deg = *value,
            StateComponent::GaitPhaseDeg => measures.gait_phase_deg = *value,
        }
    }
    terms
        .iter()
        .all(|term| {
            term.determined_by()
                .is_some_and(|c| components.contains(&c))
        })
        .then(|| reward(terms, &measures))
}
