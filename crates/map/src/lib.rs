//! The stride-to-stride map learned of a robot, and how stable it is.
//!
//! # References
//!
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009,
//!   doi:10.1007/s10514-009-9133-z.
//! - \[RW06\] C. E. Rasmussen and C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT
//!   Press, 2006.

mod error;
mod foresight;
mod goal_map;
mod kick;
mod learned;
mod map_config;
mod return_line;
mod saved_map;
mod stability;

pub use error::MapError;
pub use goal_map::{GoalMap, GoalMapConfig, GoalSample, GoalScratch, GoalSlopes, SavedGoalMap};
pub use kick::{Kick, decay_after_kick};
pub use learned::{LearnedMap, MapFailure, MapPoint, MapPrediction, MapSample, MapWorld, StateReward};
pub use map_config::{MapConfig, MapDraw, MapInput, MapStart};
pub use return_line::ReturnLine;
pub use saved_map::{SavedLeaveOneOut, SavedMap, SavedOutput};
pub use stability::{FixedPoint, Linearization, fixed_point, linearize};
