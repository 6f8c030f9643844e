//! How many strides a map needs \[MA09, sec. 8.1\].

use stridemap_map::{LearnedMap, MapError};
use stridemap_process::StrideEnd;
use stridemap_record::Transition;

use crate::algorithm::{Algorithm, fit_map};
use crate::error::LabError;
use crate::plant::Batch;
use crate::plant::PlantCounters;
use crate::recorder::Recorder;

/// Strides of a part of a batch that goes on until the map is good enough.
pub(crate) const PART: usize = 20;
/// Such a batch ends here even if it is not, unless the task's budget is smaller.
const AT_MOST: usize = 400;

/// One-step prediction error of a map at the next section: leave one out, root mean square over the
/// spread of the data, the largest over the components of the state.
///
/// # Errors
///
/// [`LabError::Map`] if the leave-one-out residuals cannot be computed.
pub fn one_step_error(map: &LearnedMap) -> Result<f64, LabError> {
    let mut largest: f64 = 0.0;
    for gp in map.outputs() {
        let residuals = gp.leave_one_out().map_err(MapError::from)?.residuals;
        let targets = gp.targets();
        let n = targets.len() as f64;
        let mean = targets.iter().sum::<f64>() / n;
        let spread = targets.iter().map(|y| (y - mean).powi(2)).sum::<f64>();
        let squares = residuals.iter().map(|r| r * r).sum::<f64>();
        if stridemap_gp::spread(targets) > 0.0 {
            largest = largest.max((squares / spread).sqrt());
        }
    }
    Ok(largest)
}

/// One-step prediction error of a map on strides that it has not seen: root mean square over the
/// spread of those strides, the largest over the components of the state. 1 is what their mean would
/// do.
///
/// # Errors
///
/// [`LabError::TooFewStrides`] if fewer than two strides reached the next section;
/// [`LabError::Map`] if the map cannot predict them.
pub fn unseen_error(map: &LearnedMap, strides: &[Transition]) -> Result<f64, LabError> {
    let reached: Vec<&Transition> = strides.iter().filter(|t| t.end == StrideEnd::Crossing).collect();
    if reached.len() < 2 {
        return Err(LabError::TooFewStrides { found: reached.len(), needed: 2 });
    }
    let n = reached.len() as f64;
    let components = map.outputs().len();
    let mut squares = vec![0.0; components];
    let mut means = vec![0.0; components];
    for t in &reached {
        let predicted = map.predict(&t.situation(), &t.action)?.means;
        for (i, next) in t.next_state.iter().enumerate().take(components) {
            squares[i] += (next - predicted[i]).powi(2);
            means[i] += next / n;
        }
    }
    let mut largest: f64 = 0.0;
    for i in 0..components {
        let values: Vec<f64> = reached.iter().map(|t| t.next_state[i]).collect();
        let spread: f64 = values.iter().map(|x| (x - means[i]).powi(2)).sum();
        if stridemap_gp::spread(&values) > 0.0 {
            largest = largest.max((squares[i] / spread).sqrt());
        }
    }
    Ok(largest)
}

impl Algorithm<'_> {
    /// Explores, a part at a time, each from a fresh start, until the map of the parts before predicts
    /// the newest part well enough: strides that it has not seen. (Leaving one stride out says less:
    /// strides in a row are alike, and the map has the neighbours of the one left out.)
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
            let next = Batch { strides: PART, ..batch };
            let (made, more) = self.collect_batch(None, next, part, recorder)?;
            let good = if all.is_empty() {
                false
            } else {
                let in_place = self.plant.in_place();
                let map = fit_map(self.task, &all, &in_place, self.seed, batch.iteration);
                match map.and_then(|map| unseen_error(&map, &made)) {
                    // Falls are no data: more is needed.
                    Err(few) if few.is_of_too_few_strides() => false,
                    unseen => unseen? < error,
                }
            };
            all.extend(made);
            counted.warm_up += more.warm_up;
            counted.strides += more.strides;
            counted.falls += more.falls;
            counted.stalls += more.stalls;
            if good {
                break;
            }
            part += 1;
        }
        Ok((all, counted))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use crate::recorder::NoRecorder;
    use stridemap_record::InPlace;

    /// A map knows the strides that it was learned from; when every other one is told the next one's
    /// outcome, it errs by about as much as the data are spread.
    #[test]
    fn a_map_errs_more_on_strides_that_are_wrong() {
        let sets = ["collect.strides=[20]".into(), "record.pose_seconds=0".into()];
        let task = builtin::load("stepping", &sets).unwrap().task;
        let mut algorithm = Algorithm::new(&task, 1).unwrap();
        algorithm.collect(&mut NoRecorder).unwrap();
        let strides = algorithm.progress.transitions.clone();
        let map = fit_map(&task, &strides, &InPlace::default(), 1, 1).unwrap();
        let right = unseen_error(&map, &strides).unwrap();
        let mut wrong = strides.clone();
        for pair in wrong.chunks_exact_mut(2) {
            let (a, b) = pair.split_at_mut(1);
            std::mem::swap(&mut a[0].next_state, &mut b[0].next_state);
        }
        let swapped = unseen_error(&map, &wrong).unwrap();
        assert!(right < 0.6 && swapped > 2.0 * right, "{right} {swapped}");
        // Seen strides are predicted at least as well as left-out ones.
        assert!(right <= one_step_error(&map).unwrap() + 1e-12);
        assert!(unseen_error(&map, &strides[..1]).is_err());
    }

    /// A map of 20 strides of stepping predicts the next 20 better than their own mean; the simulator's
    /// hidden state keeps a ten-thousandth out of reach.
    #[test]
    fn collecting_goes_on_until_the_newest_part_is_predicted() {
        let collected = |error: &str| {
            let sets = [
                "record.pose_seconds=0".into(),
                "algorithm.strides_at_most=60".into(),
                format!("collect.until_error={error}"),
            ];
            let task = builtin::load("stepping", &sets).unwrap().task;
            let mut algorithm = Algorithm::new(&task, 1).unwrap();
            algorithm.collect(&mut NoRecorder).unwrap();
            algorithm.progress.transitions.len()
        };
        assert_eq!(collected("0.99"), 40, "the second part is the first that is unseen");
        assert_eq!(collected("0.0001"), 60, "the task's budget ends it");
    }
}
