//! Control without a map: the corner of the trust region by regression of the stride's reward on the action.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use stridemap_learn::{SavedPolicy, TrialSummary};

use super::{Known, LearnerPart};
use crate::error::LabError;
use crate::registry::part;
use crate::task::Task;
use stridemap_record::{Region, Transition};

pub(super) struct Corner;

part!(Corner, "linear", "without a map: regression of the stride's reward on the action");

impl LearnerPart for Corner {
    fn uses_map(&self) -> bool {
        false
    }

    fn fewest_strides(&self, task: &Task) -> (usize, String) {
        (task.action.len() + 2, "a regression on the action".into())
    }

    fn finds_slopes(&self, _task: &Task) -> bool {
        true
    }

    fn propose(
        &self,
        known: &Known<'_>,
        _rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (_, region) = known.caution()?;
        known.constant(&corner(region, &known.training())?)
    }
}

/// The corner of the region that the regression of the stride's reward on the action recommends.
fn corner(region: &Region, transitions: &[&Transition]) -> Result<Vec<f64>, LabError> {
    let m = region.lower.len();
    let needed = m + 2;
    let too_few = LabError::TooFewStrides { found: transitions.len(), needed };
    if transitions.len() < needed {
        return Err(too_few);
    }
    let mut rows = Vec::with_capacity(transitions.len() * (m + 1));
    for t in transitions {
        rows.push(1.0);
        rows.extend_from_slice(&t.action);
    }
    let z = DMatrix::from_row_slice(transitions.len(), m + 1, &rows);
    let rewards = transitions.iter().map(|t| t.reward);
    let y = DVector::from_iterator(transitions.len(), rewards);
    let normal = z.transpose() * &z;
    let slopes = normal.cholesky().ok_or(too_few)?.solve(&(z.transpose() * y));
    let corner = |i: usize| {
        if slopes[i + 1] >= 0.0 { region.upper[i] } else { region.lower[i] }
    };
    Ok((0..m).map(corner).collect())
}
