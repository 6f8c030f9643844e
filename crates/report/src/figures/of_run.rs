//! What several figures ask of a run.

use stridemap_process::StrideEnd;
use stridemap_record::{IterationSummary, Measured, Run, Transition};

/// The strides of a measured policy: `nominal`, `iteration-1`, ..., `final`.
pub(super) fn recorded<'a>(run: &'a Run, what: &str) -> Vec<&'a Transition> {
    run.record.iter().filter(|r| r.0 == what).map(|r| &r.1).collect()
}

/// The desired value of the first component of the state, if the task has one for it.
pub(super) fn target(run: &Run) -> Option<f64> {
    run.target_deg().filter(|_| run.columns.state.first().is_some_and(|name| name.starts_with("psi_roll")))
}

/// The iterations as the summary has them.
pub(super) fn iterations(run: &Run) -> &[IterationSummary] {
    run.summary.as_ref().map_or(&[], |s| s.iterations.as_slice())
}

/// The measured nominal gait and final policy.
pub(crate) fn measured(run: &Run) -> [Option<Measured>; 2] {
    run.summary.as_ref().map_or([None; 2], |s| [s.nominal, s.final_policy])
}

/// Mean reward of a measured policy.
pub(crate) fn mean_reward(measured: Option<Measured>) -> Option<f64> {
    measured.map(|m| m.performance.mean_reward)
}

/// Of what there is one of an iteration: the final policy's, or the last.
pub(super) fn final_or_last<'a, T>(run: &Run, all: &'a [(usize, T)]) -> Option<&'a (usize, T)> {
    let chosen = run.summary.as_ref().and_then(|s| s.final_iteration);
    all.iter().find(|of| Some(of.0) == chosen).or(all.last())
}

/// The strides from which the map of an iteration was learned.
pub(super) fn map_strides(run: &Run, iteration: usize) -> Vec<&Transition> {
    run.map_strides(iteration).filter(|s| s.end != StrideEnd::Aborted).collect()
}
