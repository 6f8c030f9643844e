//! Policies that follow a goal: planning in a map of goals, and affine laws about goals for who cannot plan.

mod affine;
mod cost;
mod law;
mod planning;

pub use affine::{AffinePiece, Correction, GoalAffine};
pub use cost::{GoalCost, LinearTerm, Quantity, SquaredTerm};
pub use law::{choose_constants, law_about};
pub use planning::{GoalPlanner, PlanSettings};

use std::borrow::Cow;

use serde::{Deserialize, Serialize};
use stridemap_process::{ProcessSpec, Situation};

/// What one component of the action is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionRole {
    /// It follows the goal, from stride to stride.
    #[default]
    Command,
    /// It belongs to the robot: chosen once per fit.
    Constant,
}

/// A situation with a goal: without one, as pictures of policies have it, the middle of what is asked for.
fn asked<'a>(spec: &ProcessSpec, at: &'a Situation) -> Cow<'a, Situation> {
    if at.goal.len() == spec.goal.len() {
        return Cow::Borrowed(at);
    }
    let goal = spec.goal.iter().map(|d| 0.5 * (d.lower + d.upper)).collect();
    Cow::Owned(Situation { goal, ..at.clone() })
}
