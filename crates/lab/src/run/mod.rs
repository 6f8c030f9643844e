//! The run directory: files, tables, summary.

mod beginning;
mod directory;
pub mod files;
mod finished;
mod grid;
mod summary;
mod table;

pub use beginning::{has_begun, refuse_occupied};
pub use directory::{FELL_IN_START, NoWatcher, RunDirectory, Watcher, append_event, lock};
pub use finished::FinishedRun;
pub use summary::{IterationSummary, Measured, SecondsSummary, StrideCounts, Summary};
pub use table::TransitionTable;
