//! The run directory: files, tables, summary.

mod directory;
pub mod files;
mod grid;
mod summary;
mod table;

pub use directory::{FinishedRun, NoWatcher, RunDirectory, Watcher, append_event};
pub use summary::{IterationSummary, Measured, SecondsSummary, StrideCounts, Summary};
pub use table::TransitionTable;
