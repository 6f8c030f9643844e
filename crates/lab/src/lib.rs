//! Tasks, the plant, Algorithm 1 and the run directory.

pub mod config;
