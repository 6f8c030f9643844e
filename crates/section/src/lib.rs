//! The Poincaré section: the robot as an inverted pendulum, and the instants at which it is looked at.
//!
//! The pendulum stands on the stance foot and carries the centre of mass ([`Pendulum`]). Once per
//! step its roll rate passes through zero where the mass comes nearest to the outer side
//! \[MA09, sec. 3: the section `ψ̇_roll = 0`\]; [`SectionDetector`] finds that instant between two
//! control ticks.
//!
//! # References
//!
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009,
//!   doi:10.1007/s10514-009-9133-z.

mod config;
mod detector;
mod event;
mod lateral;
mod pendulum;
mod stance;

pub use config::{LateralConfig, SectionConfig, SectionError};
pub use detector::SectionDetector;
pub use event::{Look, Scalar, SectionEvent};
pub use pendulum::{Crossing, Pendulum, PendulumBase, pendulum};
pub use stance::{StanceConfig, StanceDetector};
