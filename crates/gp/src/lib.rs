#![doc = include_str!("../README.md")]
//!
//! # References
//!
//! - \[RW06\] C. E. Rasmussen and C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT
//!   Press, 2006.
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009.

#![allow(clippy::needless_range_loop, reason = "formulas run over several arrays by one index, as on paper")]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(a < b)` is true of NaN, and that is meant")]

mod aligned;
mod batch;
mod card;
mod dense;
mod error;
mod evidence;
mod fit;
mod gp;
mod grouped;
mod hyper;
mod kernel;
mod likelihood;
mod mean;
mod memory;
mod online;
mod optimize;
mod options;
mod panels;
mod points;
mod predict;
mod regressor;
mod sample;
mod saved;
mod scores;
mod sparse;
mod sufficient;
mod vector;

pub use card::{Card, Warning};
pub use error::{GpError, Result};
pub use gp::Gp;
pub use grouped::{Grouped, GroupedOptions, GroupedScratch, SavedGrouped};
pub use hyper::Hyperparameters;
pub use kernel::Kernel;
pub use likelihood::LogMarginalLikelihood;
pub use mean::{Mean, spread};
pub use memory::check_memory;
pub use optimize::{FitReport, StartReport, Stop};
pub use options::{Bounds, FitOptions, Prior, Priors, Range};
pub use points::Points;
pub use predict::{Prediction, Scratch};
pub use regressor::{Fitted, Regressor, RegressorKind, SparseFit};
pub use sample::{Draw, JointPrediction};
pub use scores::{LeaveOneOut, LeaveOneOutScores, coverage};
pub use sparse::{SparseGp, SparseMethod, SparseOptions};
pub use sufficient::{Sufficient, sufficient_inducing, sufficient_points};
