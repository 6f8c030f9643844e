//! Reward terms: lines of a task file.

use serde::{Deserialize, Serialize};

use crate::registry::{Part, Registry, named};
use crate::state::{AtSection, StateComponent};

/// What a quantity is a function of.
#[derive(Clone, Copy)]
pub enum RewardOf {
    /// One component of the state at the section, and the target: the map of the state tells it.
    State(StateComponent, &'static (dyn Fn(f64, f64) -> f64 + Sync)),
    /// The whole stride, so that the reward needs a map of its own \[MA09, sec. 7.2\].
    Stride(&'static (dyn Fn(&AtSection<'_>) -> f64 + Sync)),
}

/// What a reward term looks at.
pub struct RewardPart {
    /// The name used in files.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// Whether it is an error, from a target.
    pub has_target: bool,
    /// Its value.
    pub of: RewardOf,
}

impl Part for RewardPart {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

named! {
    /// What a reward term looks at, by name.
    RewardQuantity, RewardPart, rewards
}

macro_rules! quantity {
    ($constant:ident, $name:literal, $about:literal, $has_target:literal, $of:expr) => {
        #[doc = $about]
        pub const $constant: Self = {
            static PART: RewardPart = RewardPart { name: $name, about: $about, has_target: $has_target, of: $of };
            Self(&PART)
        };
    };
}

impl RewardQuantity {
    quantity!(
        PSI_ROLL_SQUARED_ERROR,
        "psi_roll_squared_error",
        "−(ψ_roll − target_deg)², deg² (MA09, eqs. 27, 30)",
        true,
        RewardOf::State(StateComponent::PSI_ROLL_DEG, &|psi, target| -(psi - target).powi(2))
    );
    quantity!(
        PSI_PITCH_RATE_DEG_S,
        "psi_pitch_rate_deg_s",
        "rate of ψ_pitch at the section, deg/s (MA09, eq. 28)",
        false,
        RewardOf::State(StateComponent::PSI_PITCH_RATE_DEG_S, &|rate, _| rate)
    );
    quantity!(
        MEAN_PSI_PITCH_RATE_DEG_S,
        "mean_psi_pitch_rate_deg_s",
        "mean rate of ψ_pitch over the stride, deg/s (MA09, eq. 31)",
        false,
        RewardOf::Stride(&|at| at.measures.mean_psi_pitch_rate_deg_s)
    );
    quantity!(
        SPEED_M_S,
        "speed_m_s",
        "speed over the stride along the heading with which it began, m/s",
        false,
        RewardOf::Stride(&|at| at.measures.speed_m_s())
    );
    quantity!(
        ENERGY_J,
        "energy_j",
        "Σ ∫ |τ ω| dt over the stride, J; give it a negative weight",
        false,
        RewardOf::Stride(&|at| at.measures.energy_j)
    );
    quantity!(
        COST_OF_TRANSPORT,
        "cost_of_transport",
        "energy over weight and distance, dimensionless; give it a negative weight",
        false,
        RewardOf::Stride(&|at| at.measures.cost_of_transport)
    );
    quantity!(
        PEAK_FOOT_LOAD_N,
        "peak_foot_load_n",
        "largest vertical force on one foot, N; give it a negative weight",
        false,
        RewardOf::Stride(&|at| at.measures.peak_foot_load_n)
    );
    quantity!(
        POSTURE_DEVIATION_DEG,
        "posture_deviation_deg",
        "root-mean-square deviation from the rest posture, deg; give it a negative weight",
        false,
        RewardOf::Stride(&|at| at.measures.posture_deviation_deg)
    );
    quantity!(
        TURN_DEG,
        "turn_deg",
        "|change of heading| over the stride, deg; give it a negative weight",
        false,
        RewardOf::Stride(&|at| at.measures.turn_deg.abs())
    );
    quantity!(
        GOAL_SQUARED_ERROR,
        "goal_squared_error",
        "−Σ ((measure − goal) / unit)² over the components of the goal",
        false,
        RewardOf::Stride(&|at| {
            let errors = at.goals.iter().zip(at.goal).map(|(of, goal)| of.error(at.measures, *goal));
            -errors.map(|e| e * e).sum::<f64>()
        })
    );
    quantity!(
        FORWARD_SPEED_M_S,
        "forward_speed_m_s",
        "speed of the base along its heading, mean over the stride, m/s",
        false,
        RewardOf::Stride(&|at| at.measures.motion.forward_speed_m_s)
    );
    quantity!(
        LATERAL_SPEED_M_S,
        "lateral_speed_m_s",
        "speed of the base to the left of its heading, mean over the stride, m/s",
        false,
        RewardOf::Stride(&|at| at.measures.motion.lateral_speed_m_s)
    );
    quantity!(
        YAW_RATE_RAD_S,
        "yaw_rate_rad_s",
        "change of heading over time, rad/s, + to the left",
        false,
        RewardOf::Stride(&|at| at.measures.motion.yaw_rate_rad_s)
    );
    quantity!(
        MEAN_ROLL_RAD,
        "mean_roll_rad",
        "roll of the base, mean over the stride, rad, + to the right",
        false,
        RewardOf::Stride(&|at| at.measures.motion.mean_roll_rad)
    );
    quantity!(
        MEAN_PITCH_RAD,
        "mean_pitch_rad",
        "pitch of the base, mean over the stride, rad, + forward",
        false,
        RewardOf::Stride(&|at| at.measures.motion.mean_pitch_rad)
    );
    quantity!(
        LEAN_SQUARED,
        "lean_squared",
        "−((roll / 0.1)² + (pitch / 0.1)²) of the base, means over the stride, rad",
        false,
        RewardOf::Stride(&|at| {
            let m = &at.measures.motion;
            -100.0 * (m.mean_roll_rad.powi(2) + m.mean_pitch_rad.powi(2))
        })
    );
    quantity!(
        POWER_W,
        "power_w",
        "Σ |τ ω| of every joint, mean over the stride, W; give it a negative weight",
        false,
        RewardOf::Stride(&|at| at.measures.motion.power_w)
    );
}

/// The registry of quantities that a reward may have.
#[must_use]
pub fn rewards() -> &'static Registry<RewardPart> {
    static REWARDS: Registry<RewardPart> = Registry::new(
        "reward quantity",
        &[
            RewardQuantity::PSI_ROLL_SQUARED_ERROR.0,
            RewardQuantity::PSI_PITCH_RATE_DEG_S.0,
            RewardQuantity::MEAN_PSI_PITCH_RATE_DEG_S.0,
            RewardQuantity::SPEED_M_S.0,
            RewardQuantity::ENERGY_J.0,
            RewardQuantity::COST_OF_TRANSPORT.0,
            RewardQuantity::PEAK_FOOT_LOAD_N.0,
            RewardQuantity::POSTURE_DEVIATION_DEG.0,
            RewardQuantity::TURN_DEG.0,
            RewardQuantity::GOAL_SQUARED_ERROR.0,
            RewardQuantity::FORWARD_SPEED_M_S.0,
            RewardQuantity::LATERAL_SPEED_M_S.0,
            RewardQuantity::YAW_RATE_RAD_S.0,
            RewardQuantity::MEAN_ROLL_RAD.0,
            RewardQuantity::MEAN_PITCH_RAD.0,
            RewardQuantity::LEAN_SQUARED.0,
            RewardQuantity::POWER_W.0,
        ],
    );
    &REWARDS
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
    /// The term for a stride that reached the section.
    #[must_use]
    pub fn of(&self, at: &AtSection<'_>) -> f64 {
        match self.quantity.of {
            RewardOf::State(component, _) => self.of_value((component.of)(at)),
            RewardOf::Stride(of) => self.weight * of(at),
        }
    }

    /// The term for a value of the component of the state that determines it; 0 where none does.
    ///
    /// # Example
    ///
    /// Eq. (27) with K = 0.1 and a target of 2 deg, 3 deg off:
    ///
    /// ```
    /// use stridemap_lab::{RewardQuantity, RewardTerm};
    ///
    /// let term = RewardTerm {
    ///     quantity: RewardQuantity::PSI_ROLL_SQUARED_ERROR,
    ///     weight: 0.1,
    ///     target_deg: Some(2.0),
    /// };
    /// assert!((term.of_value(5.0) + 0.9).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn of_value(&self, value: f64) -> f64 {
        match self.quantity.of {
            RewardOf::State(_, of) => self.weight * of(value, self.target_deg.unwrap_or(0.0)),
            RewardOf::Stride(_) => 0.0,
        }
    }
}

/// The sum of the terms for a stride that reached the next section.
#[must_use]
pub fn reward(terms: &[RewardTerm], at: &AtSection<'_>) -> f64 {
    terms.iter().map(|term| term.of(at)).sum()
}

/// The same sum as a function of the state alone, when every term is determined by it; `None` otherwise: the
/// reward then needs a map of its own \[MA09, sec. 7.2\].
#[must_use]
pub fn reward_of_state(
    terms: &[RewardTerm],
    components: &[StateComponent],
) -> Option<impl Fn(&[f64]) -> f64 + Send + Sync + 'static> {
    let placed = terms.iter().map(|term| match term.quantity.of {
        RewardOf::State(component, _) => {
            let i = components.iter().position(|c| *c == component)?;
            Some((*term, i))
        }
        RewardOf::Stride(_) => None,
    });
    let placed: Vec<(RewardTerm, usize)> = placed.collect::<Option<_>>()?;
    Some(move |state: &[f64]| placed.iter().map(|(term, i)| term.of_value(state[*i])).sum())
}
