//! How many strides a map needs \[MA09, sec. 8.1\].

use stridemap_returnmap::LearnedMap;

use crate::algorithm::{Algorithm, Recorder, fit_map};
use crate::error::LabError;
use crate::plant::PlantCounters;
use crate::strides::{Batch, Transition};

/// Strides of a part of a batch that goes on until the map is good enough.
const PART: usize = 20;
/// Such a batch ends here even if it is not, unless the task's budget is smaller.
const AT_MOST: usize = 400;

/// One-step prediction error of a map at the next section: leave one out, root mean square over the
/// spread of the data, the largest over the components of the state.
///
/// # Errors
///
/// [`LabError::Process`] if the leave-one-out residuals cannot be computed.
pub fn one_step_error(map: &LearnedMap) -> Result<f64, LabError> {
    let mut largest: f64 = 0.0;
    for gp in map.outputs() {
        let residuals = gp
            .leave_one_out()
            .map_err(stridemap_returnmap::ProcessError::from)?
            .residuals;
        let targets = gp.targets();
        let n = targets.len() as f64;
        let mean = targets.iter().sum::<f64>() / n;
        let spread = targets.iter().map(|y| (y - mean).powi(2)).sum::<f64>();
        let squares = residuals.iter().map(|r| r * r).sum::<f64>();
        if spread > 0.0 {
            largest = largest.max((squares / spread).sqrt());
        }
    }
    Ok(largest)
}

impl Algorithm<'_> {
    /// Explores, a part at a time, each from a fresh start, until the map is good enough.
    pub(crate) fn collect_until(
        &mut self,
        error: f64,
        batch: Batch,
        recorder: &mut dyn Recorder,
    ) -> Result<(Vec<Transition>, PlantCounters), LabError> {
        let budget = self.task.algorithm.strides_at_most.unwrap_or(AT_MOST);
        let mut all: Vec<Transition> = Vec::new();
        let mut counted = PlantCounters::default();
        let mut part = 0;
        while all.len() + PART <= budget.min(AT_MOST) {
            let next = Batch {
                strides: PART,
                ..batch
            };
            let (made, more) = self.collect_batch(None, next, part, recorder)?;
            all.extend(made);
            counted.warm_up += more.warm_up;
            counted.strides += more.strides;
            counted.falls += more.falls;
            counted.stalls += more.stalls;
            let map = fit_map(self.task, &all, self.seed, batch.iteration)?;
            if one_step_error(&map)? < error {
                break;
            }
            part += 1;
        }
        Ok((all, counted))
    }
}
