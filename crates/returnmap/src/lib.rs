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
//! - \[Coleman98\] M. J. Coleman, *A stability study of a three-dimensional passive-dynamic model of
//!   human gait*, PhD thesis, Cornell University, 1998.
//! - \[McGeer90\] T. McGeer, *Passive dynamic walking*, International Journal of Robotics Research
//!   9(2), 1990.
//! - \[Goswami98\] A. Goswami, B. Thuilot and B. Espiau, *A study of the passive gait of a
//!   compass-like biped robot: symmetry and chaos*, International Journal of Robotics Research
//!   17(12), 1998.
//! - \[BT09\] K. Byl and R. Tedrake, *Metastable walking machines*, International Journal of Robotics
//!   Research 28(8), 2009.
//! - \[Bert12\] D. P. Bertsekas, *Dynamic programming and optimal control*, vol. II, 4th ed., 2012.

mod action_law;
mod analysis;
mod compass_gait;
mod kick;
mod learned;
mod linear_gaussian;
mod linear_quadratic;
mod map_config;
mod process;
mod return_line;
mod rimless_wheel;
mod saved_map;
mod stability;

pub use action_law::{ActionLaw, ActionLimits};
pub use analysis::{AnalysisError, MeanMap};
pub use compass_gait::{CompassGait, CompassGaitParameters};
pub use kick::{Kick, decay_after_kick};
pub use learned::{LearnedMap, MapFailure, MapPoint, MapPrediction, MapSample, MapWorld, StateReward};
pub use linear_gaussian::{LinearGaussianMap, LinearGaussianParameters, QuadraticValue};
pub use linear_quadratic::{LinearFeedback, linear_quadratic_feedback};
pub use map_config::{MapConfig, MapDraw, MapInput, MapStart};
pub use process::{
    Action, ActionDimension, ProcessError, ProcessSpec, State, StateDimension, Stride, StrideEnd, StrideProcess,
    clipped_action,
};
pub use return_line::ReturnLine;
pub use rimless_wheel::{RimlessWheel, RimlessWheelParameters};
pub use saved_map::{SavedLeaveOneOut, SavedMap, SavedOutput};
pub use stability::{FixedPoint, Linearization, fixed_point, linearize};
