//! The run directory: what is written into it and when, and how a run goes on from it.

mod beginning;
mod directory;
mod finished;
mod summary;

pub use beginning::refuse_occupied;
pub use directory::{NoWatcher, RunDirectory, Watcher};
pub use finished::{FinishedRun, has_begun};
