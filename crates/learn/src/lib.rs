//! Policies, and learners that improve them inside any [`stridemap_process::StrideProcess`].
//!
//! A [`Learner`] is given a process and answers with a policy; the process may be the robot, the
//! map learned of it, or an exact map with a known answer. [`ActorCritic`] is the paper's;
//! [`SearchLearner`] searches constants. [`NaturalActorCritic`], [`BayesianPolicyGradient`], [`Pathwise`], [`GpDp`] and
//! [`CrossEntropy`] are those that the paper names or that have come since.
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
//! - \[PS08\] J. Peters and S. Schaal, *Natural actor-critic*, Neurocomputing 71, 2008.
//! - \[Kakade02\] S. Kakade, *A natural policy gradient*, NIPS 14, 2002.
//! - \[GE07\] M. Ghavamzadeh and Y. Engel, *Bayesian policy gradient algorithms*, NIPS 19, 2007.
//! - \[RK04\] C. E. Rasmussen and M. Kuss, *Gaussian processes in reinforcement learning*, NIPS 16, 2004.
//! - \[NJ00\] A. Y. Ng and M. Jordan, *PEGASUS: a policy search method for large MDPs and POMDPs*, UAI 2000.
//! - \[DR11\] M. P. Deisenroth and C. E. Rasmussen, *PILCO: a model-based and data-efficient approach to policy
//!   search*, ICML 2011.
//! - \[MC-PILCO\] F. Amadio et al., *Model-based policy search using Monte Carlo gradient estimation with real systems
//!   application*, IEEE Transactions on Robotics 38(6), 2022.
//! - \[KB15\] D. P. Kingma and J. Ba, *Adam: a method for stochastic optimization*, ICLR 2015.
//! - \[dB05\] P.-T. de Boer, D. P. Kroese, S. Mannor and R. Y. Rubinstein, *A tutorial on the cross-entropy method*,
//!   Annals of Operations Research 134, 2005.
//! - \[SL06\] I. Szita and A. Lőrincz, *Learning Tetris using the noisy cross-entropy method*, Neural Computation
//!   18(12), 2006.
//! - \[Hansen16\] N. Hansen, *The CMA evolution strategy: a tutorial*, arXiv:1604.00772, 2016.

mod actor_critic;
mod error;
mod gaussian_policy;
mod goal;
mod gp_dp;
mod learner;
mod network;
mod pathwise;
mod policy;
mod policy_gradient;
mod saved;
mod search;

pub use actor_critic::{ActorCritic, ActorCriticConfig, ActorCriticRun, Output};
pub use error::LearnError;
pub use gaussian_policy::{GaussianPolicy, LogDensityGradient};
pub use goal::{
    ActionRole, AffinePiece, Correction, GoalAffine, GoalCost, GoalPlanner, LinearTerm, PlanSettings, Quantity,
    SquaredTerm, choose_constants, law_about,
};
pub use gp_dp::{GpDp, GpDpConfig};
pub use learner::{LearnOutcome, Learner, TrialReport, TrialSummary};
pub use network::{Activations, NormalizedGaussianNetwork};
pub use pathwise::{Pathwise, PathwiseConfig};
pub use policy::{Acting, Policy, Seen};
pub use policy_gradient::{BayesianPolicyGradient, NaturalActorCritic, PolicyGradientConfig};
pub use saved::{ConstantPolicy, KeptPolicy, LinearPolicy, SavedPolicy};
pub use search::{CmaEs, CrossEntropy, CrossEntropyConfig, SearchConfig, SearchLearner};
