//! The parameters of the search.

use crate::error::{LearnError, check_length, check_number};

/// Parameters of [`SearchLearner`](super::SearchLearner).
#[derive(Clone, Debug, PartialEq)]
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
    pub generations: usize,
    /// Episodes by which a candidate is judged; at least 1. All candidates of a generation see the
    /// same random numbers.
    pub episodes: usize,
    /// Strides of an episode; at least 1.
    pub strides_per_episode: usize,
    /// First strides of an episode that do not count, except if they fall; fewer than
    /// `strides_per_episode`.
    pub unscored_strides: usize,
}

impl SearchConfig {
    /// Checks every field against its domain, and against the process's number of actions.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] or [`LearnError::Length`] naming the field.
    pub fn validate(&self, actions: usize) -> Result<(), LearnError> {
        for (field, values) in [("action_unit", &self.action_unit), ("lower", &self.lower), ("upper", &self.upper)] {
            check_length(field, values.len(), actions)?;
        }
        for &u in &self.action_unit {
            check_number("action_unit", u, u > 0.0, "positive and finite")?;
        }
        for (&l, &u) in self.lower.iter().zip(&self.upper) {
            check_number("lower", l, true, "finite")?;
            check_number("upper", u, u >= l, "finite and not below `lower`")?;
        }
        for (field, value) in [
            ("generations", self.generations),
            ("episodes", self.episodes),
            ("strides_per_episode", self.strides_per_episode),
        ] {
            if value == 0 {
                return Err(LearnError::parameter(field, value, "at least 1"));
            }
        }
        if self.unscored_strides >= self.strides_per_episode {
            let domain = "below strides_per_episode";
            return Err(LearnError::parameter("unscored_strides", self.unscored_strides, domain));
        }
        Ok(())
    }
}
