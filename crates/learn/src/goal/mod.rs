//! Policies that follow a goal: planning in a map of goals, and affine laws about goals for who cannot plan.

mod affine;
mod cost;
mod law;
mod planning;

pub use affine::{AffinePiece, Correction, GoalAffine};
pub use cost::{GoalCost, LinearTerm, Quantity, SquaredTerm};
pub use law::{choose_constants, law_about};
pub use planning::{GoalPlanner, PlanSettings};

use serde::{Deserialize, Serialize};

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
