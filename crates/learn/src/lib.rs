//! Policies, and learners that improve them inside any [`stridemap_process::StrideProcess`].
//!
//! A [`Learner`] is given a process and answers with a policy; the process may be the robot, the
//! map learned of it, or an exact map with a known answer. [`ActorCritic`] is the paper's;
//! [`SearchLearner`] searches constants.
//! Policies go to files and come back as [`SavedPolicy`].
//!
//! # References
//!
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009,
//!   doi:10.1007/s10514-009-9133-z.
//! - \[KK98\] H. Kimura and S. Kobayashi, *An analysis of actor/critic algorithms using eligibility
//!   traces: reinforcement learning with imperfect value functions*, ICML 1998.
//! - \[Doya00\] K. Doya, *Reinforcement learning in continuous time and space*, Neural Computation
//!   12(1), 2000.
//! - \[MD01\] J. Morimoto and K. Doya, *Acquisition of stand-up behavior by a real robot using
//!   hierarchical reinforcement learning*, Robotics and Autonomous Systems 36, 2001.
//! - \[PJ92\] B. T. Polyak and A. B. Juditsky, *Acceleration of stochastic approximation by
//!   averaging*, SIAM Journal on Control and Optimization 30(4), 1992.
//! - \[Hansen16\] N. Hansen, *The CMA evolution strategy: a tutorial*, arXiv:1604.00772, 2016.

mod actor_critic;
mod error;
mod gaussian_policy;
mod goal;
mod learner;
mod network;
mod policy;
mod saved;
mod search;

pub use actor_critic::{ActorCritic, ActorCriticConfig, ActorCriticRun, Output};
pub use error::LearnError;
pub use gaussian_policy::{GaussianPolicy, LogDensityGradient};
pub use goal::{
    ActionRole, AffinePiece, Correction, GoalAffine, GoalCost, GoalPlanner, LinearTerm, PlanSettings, Quantity,
    SquaredTerm, choose_constants, law_about,
};
pub use learner::{LearnOutcome, Learner, TrialReport, TrialSummary};
pub use network::{Activations, NormalizedGaussianNetwork};
pub use policy::{Acting, Policy, Seen};
pub use saved::{ConstantPolicy, KeptPolicy, LinearPolicy, SavedPolicy};
pub use search::{CmaEs, SearchConfig, SearchLearner};
