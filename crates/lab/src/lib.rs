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
mod analyse;
mod atlas;
mod auto;
pub mod builtin;
mod careful;
mod caution;
mod check;
mod choice;
mod compare;
mod cusum;
mod dither;
mod drift;
mod driven;
mod error;
mod fall;
mod feedback;
mod gaits;
mod goal;
mod guard;
mod guarded;
mod learner;
mod learners;
mod limits;
mod map_multipliers;
mod mean_roll;
mod measure;
mod motion;
mod nominal;
mod numbers;
mod pessimism;
mod plant;
mod poses;
mod preflight;
mod pretrained;
mod proof;
mod provenance;
mod push;
mod recorder;
mod registry;
mod replay;
mod reward;
mod robots;
pub mod run;
mod samples;
pub mod seed;
mod state;
mod steering;
mod stepping;
mod strides;
mod success;
mod suffices;
pub mod sweep;
mod task;
mod trust;
mod truth;
mod tune;
pub mod verbs;
mod verdict;
mod walk;
mod walks;

pub use algorithm::{Algorithm, fit_map};
pub use analyse::{Analysis, Flip, HeldOut, analyse, held_out};
pub use atlas::{AtlasSetting, Unpushed, atlas_cell, for_pushes, push_atlas, unpushed};
pub use caution::{CautionConfig, ProofConfig};
pub use check::{CheckItem, CheckReport, Gain, check, check_on_film};
pub use compare::{CompareSeed, STRIDES_PER_POINT, compare_seed, learning_curves, students_t};
pub use cusum::{Cusum, run_length, shift_found_within, threshold_for};
pub use dither::Dither;
pub use drift::{
    Detectable, DriftAlarm, DriftMonitor, FALSE_ALARMS_PER_1000, SETTLE_STRIDES as DRIFT_SETTLE_STRIDES, drift_monitor,
};
pub use error::{Invalid, LabError};
pub use fall::FailureConfig;
pub use feedback::{FedBack, JacobianFeedbackConfig, StrideModel, stride_model, with_feedback};
pub use gaits::{BuildGait, GaitPart, gaits};
pub use goal::{GoalConfig, Measure, MeasurePart, drawn, measures};
pub use guard::{Guard, GuardConfig, GuardThresholds};
pub use guarded::GuardedExplorer;
pub use learner::{ControlsConfig, IntegralConfig, Known, LearnerKind, LearnerPart, SearchSettings, learners};
pub use learners::{LearnerPoint, LearnerRow, PairedDifference, paired_difference, run_learner};
pub use limits::VerdictConfig;
pub use map_multipliers::{MapMultipliers, map_multipliers};
pub use mean_roll::{MeanRollConfig, MeanRollLimit};
pub use measure::StrideMeter;
pub use motion::Recent;
pub use nominal::{NominalGait, nominal_gait};
pub use pessimism::{CautiousMap, PessimismConfig};
pub use plant::{Batch, Plant, PlantAction, PlantCounters, PlantTask, Push, PushBegins, StrideObserver, TickObserver};
pub use poses::PoseRecorder;
pub use preflight::{Miswired, preflight, refuse_miswired};
pub use proof::{Prover, shrunk};
pub use provenance::{provenance_of, task_differences};
pub use push::{PUSH_VELOCITY_CHANGE_M_S, PushConfig, push};
pub use recorder::{NoRecorder, Progress, Recorder};
pub use registry::{Part, Registry};
pub use replay::{Episode, Replayed, episodes, replay};
pub use reward::{RewardOf, RewardPart, RewardQuantity, RewardTerm, reward, reward_of_state, rewards};
pub use robots::RobotChoice;
pub use samples::{one_step_error, unseen_error};
pub use state::{AtSection, StateComponent, StatePart, states};
pub use steering::{Steered, can_steer, steer};
pub use stepping::{GaitTrace, GaitVerdict, Stepping};
pub use strides::{Act, ActionSource, Exploration, ExploreRange, IntegralAction, drive, make_strides};
pub use task::{
    ActionConfig, AlgorithmConfig, CollectConfig, ExploreConfig, LearnerConfig, RecordConfig, ScaleConfig,
    SuccessConfig, Task,
};
pub use trust::TrustConfig;
pub use tune::{GaitSetting, Scale, Try, TuneOptions, Tuned, VARIANTS, tune};
pub use verdict::{
    difference, fall_difference, judged, judged_falls, judged_push, judged_tracking, judged_worse, mean_of, what,
};
pub use walk::Walker;
pub use walks::{Interval, WALK_S, Walked, disturbed, largest_multiplier, probed, share_of, tracks, walk_once};
