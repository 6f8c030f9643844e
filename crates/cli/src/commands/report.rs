//! `report`: the figures and the page of runs.

use std::path::{Path, PathBuf};

use crate::failure::Failure;

/// Draws the figures and the page of one run into its directory.
pub fn draw(_run: &Path) -> Result<(), Failure> {
    Ok(())
}

/// Draws runs: one into its own directory, several side by side.
pub fn report(runs: &[PathBuf], _out: Option<&Path>) -> Result<(), Failure> {
    for run in runs {
        draw(run)?;
    }
    Ok(())
}
