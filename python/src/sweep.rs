//! Sweeps over a study.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;
use stridemap_lab::LabError;
use stridemap_lab::sweep::{Shard, Study, merge, run_shard};

use crate::error::{of_lab, request};
use crate::interrupt::interruptible;
use crate::policy::python;

/// Makes the runs of a study that are not made yet, or of a shard `"i/n"` of them, and returns how many that were:
/// `stridemap sweep STUDY --shard i/n --out DIR`.
#[pyfunction]
#[pyo3(signature = (study, out, shard="1/1"))]
pub fn sweep(py: Python<'_>, study: PathBuf, out: PathBuf, shard: &str) -> PyResult<u64> {
    let shard: Shard = shard.parse().map_err(request)?;
    let stop = Arc::new(AtomicBool::new(false));
    interruptible(py, &stop, {
        let stop = Arc::clone(&stop);
        move || Ok(run_shard(&Study::load(&study)?, shard, &out, &stop, &mut |_, _, _| {})?)
    })
}

/// Puts the results of all shards together, each run once: `stridemap sweep merge DIR --json`, without its figures.
#[pyfunction]
pub fn sweep_merge(py: Python<'_>, out: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let merged = py.detach(|| merge(&out).map_err(LabError::from)).map_err(of_lab)?;
    python(py, &merged)
}
