//! One mechanism, two worlds: a walking robot seen once per stride is a noisy map
//! `x(k+1) = f(x(k), u(k)) + n(k)` \[MA09, eq. (7)\], and so is what was learned of it.
//!
//! [`StrideProcess`] is that mechanism. The robot in its plant, the Gaussian-process map fitted to
//! its strides, and exact maps with known answers all implement it, so that a learner cannot tell
//! them apart.
//!
//! # References
//!
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009,
//!   doi:10.1007/s10514-009-9133-z.

mod action_law;
mod process;
mod roll_out;

pub use action_law::{ActionLaw, ActionLimits};
pub use process::{
    Action, ActionDimension, Foreseen, Foresight, Goal, GoalDimension, MeanMap, ProcessError, ProcessSpec, Situation,
    State, StateDimension, Stride, StrideEnd, StrideProcess, clipped_action,
};
pub use roll_out::{Actor, Made, Next, roll_out, walk};
