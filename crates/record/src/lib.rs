//! The files of a run directory: what each holds, read and written in one place, without a simulator.
//!
//! The laboratory writes them and goes on from them, reports read them. [`Run`] is a run directory read as far
//! as it goes. `docs/files.md` names every file, column and key.
//!
//! # Example
//!
//! Tables of strides are CSV; every number comes back to the bit.
//!
//! ```
//! use stridemap_record::Columns;
//!
//! let columns = Columns {
//!     state: vec!["psi_roll_deg".into()],
//!     action: vec!["step_amplitude_deg".into()],
//!     ..Columns::default()
//! };
//! assert!(columns.header().starts_with(
//!     "iteration,phase,role,episode,k,time_s,stance,\
//!      psi_roll_deg,last_step_amplitude_deg,step_amplitude_deg,next_psi_roll_deg,reward,end,"
//! ));
//! ```

mod atlas;
mod columns;
mod error;
mod events;
pub mod files;
mod goals;
pub mod grid;
mod iteration;
mod learning;
mod measured;
mod poses;
mod provenance;
mod push;
mod return_line;
mod run;
mod stride;
mod summary;
mod table;
mod verdict;

pub use atlas::{AtlasCell, AtlasHeadline, PushAtlas, direction_words};
pub use columns::Columns;
pub use error::RecordError;
pub use events::{
    EPISODE_BEGUN, EVENTS, EVENTS_HEADER, EpisodeStart, FELL_IN_START, Stop, append_event, episode_starts, event_line,
    falls_in_starts,
};
pub use goals::{RandomGoals, Straightness, Sweep, SweepAxis};
pub use iteration::{Checkpoint, GuardWarning, InPlace, Iteration, Phase, Proof, Region, Seconds, Verdict, Warning};
pub use learning::{LearningRow, World};
pub use measured::{ComparePoint, Measured, Performance, Spread, Walk, WalkTimes};
pub use poses::{Frame, Pace, Recording};
pub use provenance::{Asked, Provenance, key_differences};
pub use push::{PushOutcome, PushPair};
pub use return_line::ReturnMapLine;
pub use run::Run;
pub use stride::{Fall, FallCriterion, Motion, RobotFall, StrideMeasures, StridePhase, StrideRole, Transition};
pub use summary::{IterationSummary, SecondsSummary, StrideCounts, Summary};
pub use table::{LARGEST, Rows};
pub use verdict::{Judged, Ruling, RunVerdict};

/// The version of the files that this crate writes and reads; a file of another version is refused by it.
pub const FORMAT: u32 = 1;
