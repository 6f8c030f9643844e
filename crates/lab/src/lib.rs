//! The laboratory: tasks, the robot as a stride process, Algorithm 1, comparisons, and the run
//! directory that keeps what happened.
//!
//! ```text
//! task file ──▶ Task ──▶ Plant (robot + gait + section) ──▶ strides ──▶ map ──▶ policy
//!                          ▲                                                      │
//!                          └────────────────── Algorithm ◀───────────────────────┘
//!                                                 │
//!                                            run directory
//! ```
//!
//! # References
//!
//! - \[MA09\] J. Morimoto and C. G. Atkeson, *Nonparametric representation of an approximated
//!   Poincaré map for learning biped locomotion*, Autonomous Robots 27, 2009,
//!   doi:10.1007/s10514-009-9133-z.

mod algorithm;
pub mod builtin;
mod check;
mod compare;
pub mod config;
mod error;
mod measure;
mod plant;
mod poses;
mod provenance;
mod push;
mod reward;
mod robots;
pub mod run;
pub mod seed;
mod steering;
mod strides;
mod task;

pub use algorithm::{
    Algorithm, Iteration, NoRecorder, Phase, Progress, Recorder, Seconds, fit_map,
};
pub use check::{CheckItem, CheckReport, Gain, check};
pub use compare::{
    ComparePoint, CompareSeed, STRIDES_PER_POINT, Spread, compare_seed, learning_curves, students_t,
};
pub use error::{Invalid, LabError};
pub use measure::{StrideMeasures, StrideMeter};
pub use plant::{
    FailureConfig, Plant, PlantAction, PlantCounters, PlantTask, Push, StrideObserver, TickObserver,
};
pub use poses::{PoseRecorder, Recording};
pub use provenance::Provenance;
pub use push::{PushConfig, PushOutcome, PushPair, push};
pub use reward::{RewardQuantity, RewardTerm, StateComponent, reward, reward_of_state};
pub use robots::RobotChoice;
pub use steering::{Steered, can_steer, steer};
pub use strides::{
    ActionSource, Batch, Performance, StridePhase, StrideRole, Transition, make_strides,
};
pub use task::{
    ActionConfig, AlgorithmConfig, CollectConfig, ExploreConfig, LearnerConfig, LearnerKind,
    RecordConfig, SuccessConfig, Task,
};
