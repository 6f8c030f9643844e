//! Nominal controllers that walk, badly, and can be modulated once per stride.
//!
//! A [`Gait`] turns the robot's state into joint targets, and lists the [`Modulation`]s by which a
//! policy may change it. [`OscillatorGait`] is the paper's: four oscillators phase-locked to the
//! centre of pressure \[MA09, eqs. (1)–(6), (26), (29)\]. [`PolicyGait`] is a pretrained network that follows a velocity command.
//!
//! ```text
//! centre of pressure ──▶ phase φ ──▶ four oscillators φ_c¹…φ_c⁴ ──▶ sinusoidal joint targets
//!                                                    ▲ amplitudes, leans, frequency: modulations
//! ```
//!
//! [`ZmpGait`] is of another kind: footsteps, preview control of the centre of mass, inverse kinematics and a stabiliser.
//!
//! # References
//!
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009,
//!   doi:10.1007/s10514-009-9133-z.

mod config;
mod filter;
mod gait;
mod modulations;
mod oscillator;
mod phase;
mod policy;
mod targets;
mod zmp;

pub use config::{AmplitudeConfig, GaitConfig, RampConfig};
pub use filter::LowPass;
pub use gait::{Gait, GaitError, Modulation};
pub use oscillator::OscillatorGait;
pub use phase::{PhaseConfig, PhaseDetector, PhaseSource};
pub use policy::{
    ClockConfig, Each, HeldJoint, HistoryFill, ModelConfig, PolicyConfig, PolicyGait, Source, TermConfig, TermKind,
    joints_of, numbers_of, read_network,
};
pub use targets::{Amplitudes, Phases, joint_offsets};
pub use zmp::{LegLengths, Preview, PreviewAxis, ZmpConfig, ZmpGait};
