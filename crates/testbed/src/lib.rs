//! Stride-to-stride maps with known answers, for the tests of the other rooms; nothing that is shipped needs them.
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

mod cliff_walk;
mod compass_gait;
mod linear_gaussian;
mod linear_quadratic;
mod rimless_wheel;

pub use cliff_walk::{CliffWalk, CliffWalkParameters, GridValues};
pub use compass_gait::{CompassGait, CompassGaitParameters};
pub use linear_gaussian::{LinearGaussianMap, LinearGaussianParameters, QuadraticValue};
pub use linear_quadratic::{LinearFeedback, NoFeedback, linear_quadratic_feedback};
pub use rimless_wheel::{RimlessWheel, RimlessWheelParameters};
