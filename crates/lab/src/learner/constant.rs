//! Control without a map: every component at the bound of the trust region, away from the nominal gait.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{SavedPolicy, TrialSummary};

use super::{Known, LearnerPart};
use crate::error::LabError;
use crate::registry::part;
use crate::task::Task;

pub(super) struct Grown;

part!(Grown, "constant", "without a map: every component at the bound of the trust region");

impl LearnerPart for Grown {
    fn uses_map(&self) -> bool {
        false
    }

    fn fewest_strides(&self, _task: &Task) -> (usize, String) {
        (1, "a first policy".into())
    }

    fn propose(
        &self,
        known: &Known<'_>,
        _rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let ((_, region), tried) = (known.caution()?, known.tried());
        // The corner of the region that is farthest from the nominal gait, in every component.
        let corner = |(i, limits): (usize, &stridemap_process::ActionLimits)| {
            let [below, above] = tried[i].map(|edge| (edge - limits.neutral).abs());
            if above >= below { region.upper[i] } else { region.lower[i] }
        };
        let action: Vec<f64> = known.limits.iter().enumerate().map(corner).collect();
        known.constant(&action)
    }
}
