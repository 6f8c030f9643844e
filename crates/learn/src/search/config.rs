//! The parameters of the search.

use serde::{Deserialize, Serialize};

use crate::error::{LearnError, check_length, check_number};

/// Parameters of [`SearchLearner`](super::SearchLearner).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchConfig {
    /// Per component of the action, what counts as a small change, in its unit; positive. The search
    /// starts with a standard deviation of half of it.
    pub action_unit: Vec<f64>,
    /// Lowest constants that are searched, per component, in its unit: the corner of the box of
    /// actions tried, or of the trust region about the best proven ones.
    pub lower: Vec<f64>,
    /// Highest constants that are searched; not below `lower`.
    pub upper: Vec<f64>,
    /// Generations of the evolution strategy; at least 1.
    #[serde(default = "default::generations")]
    pub generations: usize,
    /// Candidates of a generation, at least 4; `None`: 4 + 3 ln d.
    #[serde(default)]
    pub population: Option<usize>,
    /// Episodes by which a candidate is judged; at least 1. All candidates of a generation see the
    /// same random numbers.
    #[serde(default = "default::episodes")]
    pub episodes: usize,
    /// Strides of an episode; at least 1. Recipe V: 30.
    #[serde(default = "default::strides_per_episode")]
    pub strides_per_episode: usize,
    /// First strides of an episode that do not count, except if they fall; fewer than
    /// `strides_per_episode`.
    #[serde(default)]
    pub unscored_strides: usize,
    /// k of `mean reward − k · sd of the reward − penalty · P(unsafe)`; not negative. Recipe V: 2.
    #[serde(default = "default::std_weight")]
    pub std_weight: f64,
    /// What a stride that is unsafe costs, in reward; not negative. Recipe V: 0.6.
    #[serde(default = "default::unsafe_penalty")]
    pub unsafe_penalty: f64,
    /// Strides that end here are unsafe; those that fall or stall always are.
    #[serde(default)]
    pub unsafe_below: Option<StateBound>,
    /// Feedback about the constants; `None`: none.
    #[serde(default)]
    pub feedback: Option<FeedbackConfig>,
}

/// A bound on a component of the state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateBound {
    /// Zero-based component of the state.
    pub component: usize,
    /// The bound, in its unit.
    pub value: f64,
}

/// Linear-quadratic feedback on some components of the action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeedbackConfig {
    /// Zero-based components of the action that are fed back; at least one, each once.
    pub components: Vec<usize>,
    /// Q, diagonal, per component of the state; not negative.
    pub state_cost: Vec<f64>,
    /// R, diagonal, per component in `components`; not negative.
    pub action_cost: Vec<f64>,
    /// Largest correction per component in `components`, in its unit; positive. Recipe V: 1.5 deg.
    pub limit: Vec<f64>,
    /// Discount, from 0 to 1.
    #[serde(default = "default::feedback_discount")]
    pub discount: f64,
    /// Standard deviation of the dither by which the process is linearized, in action units;
    /// positive.
    #[serde(default = "default::dither")]
    pub dither: f64,
    /// Strides for the linearization; more than states + actions + 1.
    #[serde(default = "default::linearization_strides")]
    pub linearization_strides: usize,
}

mod default {
    pub(super) const fn generations() -> usize {
        40
    }
    pub(super) const fn episodes() -> usize {
        4
    }
    pub(super) const fn strides_per_episode() -> usize {
        30
    }
    pub(super) const fn std_weight() -> f64 {
        2.0
    }
    pub(super) const fn unsafe_penalty() -> f64 {
        0.6
    }
    pub(super) const fn feedback_discount() -> f64 {
        0.95
    }
    pub(super) const fn dither() -> f64 {
        0.1
    }
    pub(super) const fn linearization_strides() -> usize {
        1000
    }
}

impl SearchConfig {
    /// A search in a box with the default strengths and no feedback.
    #[must_use]
    pub fn within(action_unit: &[f64], lower: &[f64], upper: &[f64]) -> Self {
        Self {
            action_unit: action_unit.to_vec(),
            lower: lower.to_vec(),
            upper: upper.to_vec(),
            generations: default::generations(),
            population: None,
            episodes: default::episodes(),
            strides_per_episode: default::strides_per_episode(),
            unscored_strides: 0,
            std_weight: default::std_weight(),
            unsafe_penalty: default::unsafe_penalty(),
            unsafe_below: None,
            feedback: None,
        }
    }

    /// Checks every field against its domain, and against the process's numbers of components.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] or [`LearnError::Length`] naming the field.
    pub fn validate(&self, states: usize, actions: usize) -> Result<(), LearnError> {
        const NOT_NEGATIVE: &str = "finite and not negative";
        const POSITIVE: &str = "positive and finite";
        check_length("action_unit", self.action_unit.len(), actions)?;
        check_length("lower", self.lower.len(), actions)?;
        check_length("upper", self.upper.len(), actions)?;
        for &u in &self.action_unit {
            check_number("action_unit", u, u > 0.0, POSITIVE)?;
        }
        for (&l, &u) in self.lower.iter().zip(&self.upper) {
            check_number("lower", l, true, "finite")?;
            check_number("upper", u, u >= l, "finite and not below `lower`")?;
        }
        for (field, value, least) in [
            ("generations", self.generations, 1),
            ("episodes", self.episodes, 1),
            ("strides_per_episode", self.strides_per_episode, 1),
            ("population", self.population.unwrap_or(4), 4),
        ] {
            if value < least {
                let domain = if least == 1 { "at least 1" } else { "at least 4" };
                return Err(LearnError::parameter(field, value, domain));
            }
        }
        if self.unscored_strides >= self.strides_per_episode {
            let domain = "below strides_per_episode";
            return Err(LearnError::parameter("unscored_strides", self.unscored_strides, domain));
        }
        check_number("std_weight", self.std_weight, self.std_weight >= 0.0, NOT_NEGATIVE)?;
        let penalty = self.unsafe_penalty;
        check_number("unsafe_penalty", penalty, penalty >= 0.0, NOT_NEGATIVE)?;
        if let Some(bound) = self.unsafe_below {
            if bound.component >= states {
                let domain = "a component of the state";
                return Err(LearnError::parameter("unsafe_below", bound.component, domain));
            }
            check_number("unsafe_below", bound.value, true, "finite")?;
        }
        let Some(feedback) = &self.feedback else {
            return Ok(());
        };
        let chosen = feedback.components.len();
        let once = |c: &usize| feedback.components.iter().filter(|o| *o == c).count() == 1;
        if chosen == 0 || !feedback.components.iter().all(|c| *c < actions && once(c)) {
            let value = format!("{:?}", feedback.components);
            let domain = "components of the action, each once";
            return Err(LearnError::parameter("feedback.components", value, domain));
        }
        check_length("feedback.state_cost", feedback.state_cost.len(), states)?;
        check_length("feedback.action_cost", feedback.action_cost.len(), chosen)?;
        check_length("feedback.limit", feedback.limit.len(), chosen)?;
        for &q in &feedback.state_cost {
            check_number("feedback.state_cost", q, q >= 0.0, NOT_NEGATIVE)?;
        }
        for &r in &feedback.action_cost {
            check_number("feedback.action_cost", r, r >= 0.0, NOT_NEGATIVE)?;
        }
        for &l in &feedback.limit {
            check_number("feedback.limit", l, l > 0.0, POSITIVE)?;
        }
        let g = feedback.discount;
        check_number("feedback.discount", g, (0.0..=1.0).contains(&g), "from 0 to 1")?;
        check_number("feedback.dither", feedback.dither, feedback.dither > 0.0, POSITIVE)?;
        if feedback.linearization_strides <= states + actions + 1 {
            let value = feedback.linearization_strides;
            let domain = "more than states + actions + 1";
            return Err(LearnError::parameter("feedback.linearization_strides", value, domain));
        }
        Ok(())
    }
}
