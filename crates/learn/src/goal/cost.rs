//! What a stride costs, as a function of what the map says of it.

use serde::{Deserialize, Serialize};

/// A number that the map foretells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// A measure of the stride, by its place in the map's list.
    Measure(usize),
    /// A component of the state where it ends.
    State(usize),
}

/// `weight (q − target)²`, and the variance of `q` charged as much, where the map says it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SquaredTerm {
    /// q.
    pub of: Quantity,
    /// The component of the goal that is the target; left out: zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<usize>,
    /// Per unit squared.
    pub weight: f64,
}

/// `weight (q + doubt · sd)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinearTerm {
    /// q, a measure.
    pub measure: usize,
    /// Per unit.
    pub weight: f64,
    /// Standard deviations of what the map does not know that are charged.
    pub doubt: f64,
}

/// The cost of a stride.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalCost {
    /// Squared ones.
    pub squared: Vec<SquaredTerm>,
    /// Linear ones.
    pub linear: Vec<LinearTerm>,
}

impl GoalCost {
    /// Whether the variance of each of so many measures is charged: of those with a goal, and of linear terms.
    #[must_use]
    pub fn charged(&self, measures: usize) -> Vec<bool> {
        let mut charged = vec![false; measures];
        for term in &self.squared {
            if let (Quantity::Measure(i), Some(_)) = (term.of, term.goal) {
                charged[i] = true;
            }
        }
        self.linear.iter().filter(|t| t.doubt > 0.0).for_each(|t| charged[t.measure] = true);
        charged
    }

    /// The cost of one stride.
    ///
    /// # Arguments
    ///
    /// - `means`, `variances` – of the measures.
    /// - `next` – where the stride ends.
    ///
    /// # Example
    ///
    /// 0.1 m/s too slow, with a variance of 0.01, at 100 a unit squared: 1 + 1.
    ///
    /// ```
    /// use stridemap_learn::{GoalCost, Quantity, SquaredTerm};
    ///
    /// let term = SquaredTerm { of: Quantity::Measure(0), goal: Some(0), weight: 100.0 };
    /// let cost = GoalCost { squared: vec![term], linear: Vec::new() };
    /// assert!((cost.of(&[0.4], &[0.01], &[], &[0.5]) - 2.0).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn of(&self, means: &[f64], variances: &[f64], next: &[f64], goal: &[f64]) -> f64 {
        let squared = self.squared.iter().map(|term| {
            let target = term.goal.map_or(0.0, |g| goal[g]);
            let (value, variance) = match term.of {
                Quantity::Measure(i) => (means[i], variances[i]),
                Quantity::State(i) => (next[i], 0.0),
            };
            term.weight * ((value - target).powi(2) + variance)
        });
        let linear = self
            .linear
            .iter()
            .map(|term| term.weight * (means[term.measure] + term.doubt * variances[term.measure].max(0.0).sqrt()));
        squared.sum::<f64>() + linear.sum::<f64>()
    }

    /// Whether the next state matters to it.
    #[must_use]
    pub fn looks_at_state(&self) -> bool {
        self.squared.iter().any(|t| matches!(t.of, Quantity::State(_)))
    }
}
