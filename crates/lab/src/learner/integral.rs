//! Control without a map: integral action on `ψ_roll` on the robot, and then its mean action held.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_process::StrideEnd;

use super::{Known, LearnerPart, invalid};
use crate::error::LabError;
use crate::registry::part;
use crate::state::StateComponent;
use crate::strides::{ActionSource, IntegralAction};
use crate::task::Task;
use stridemap_record::{InPlace, StridePhase, Transition};

/// Share of the strides whose mean action is held afterwards: the last ones.
const HELD_SHARE: f64 = 0.75;

/// Integral action on `ψ_roll` by a task's one component of the action, which lowers `ψ_roll` as it
/// grows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IntegralConfig {
    /// Change of the action per stride and degree of `ψ_roll` above the target, in its unit.
    pub gain_per_deg: f64,
    /// The target, this far below the mean of the robot's own stepping in place, deg.
    pub below_in_place_deg: f64,
}

/// Component of the state that is `ψ_roll`.
fn psi_roll(task: &Task) -> Option<usize> {
    task.state.iter().position(|c| *c == StateComponent::PSI_ROLL_DEG)
}

pub(super) struct Held;

part!(Held, "integral", "without a map: integral action on psi_roll, then its mean held");

impl LearnerPart for Held {
    fn uses_map(&self) -> bool {
        false
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        let finite =
            task.learner.integral.is_some_and(|c| c.gain_per_deg.is_finite() && c.below_in_place_deg.is_finite());
        if !finite || task.action.len() != 1 || psi_roll(task).is_none() {
            return invalid(
                "learner.integral",
                "is needed by integral action, finite, with one action and psi_roll_deg in the state",
            );
        }
        Ok(())
    }

    fn fewest_strides(&self, _task: &Task) -> (usize, String) {
        (1, "a first policy".into())
    }

    fn first_actions<'a>(&self, task: &'a Task, in_place: InPlace) -> Option<ActionSource<'a>> {
        let (config, limits) = (task.learner.integral?, task.action_limits().ok()?);
        Some(ActionSource::Integral(IntegralAction {
            component: psi_roll(task)?,
            target_deg: in_place.psi_roll_deg - config.below_in_place_deg,
            gain_per_deg: config.gain_per_deg,
            limits: *limits.first()?,
        }))
    }

    fn propose(
        &self,
        known: &Known<'_>,
        _rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        known.constant(&held(&known.progress.transitions)?)
    }
}

/// The mean action over the last three quarters of the strides of the first batch.
fn held(transitions: &[Transition]) -> Result<Vec<f64>, LabError> {
    let settled: Vec<&Transition> = transitions
        .iter()
        .filter(|t| t.iteration == 1 && t.phase == StridePhase::Collect)
        .filter(|t| t.end == StrideEnd::Crossing)
        .collect();
    let count = (HELD_SHARE * settled.len() as f64).ceil() as usize;
    let last = &settled[settled.len() - count..];
    let Some(first) = last.first() else {
        return Err(LabError::TooFewStrides { found: 0, needed: 1 });
    };
    let mean = |i: usize| last.iter().map(|t| t.action[i]).sum::<f64>() / count as f64;
    Ok((0..first.action.len()).map(mean).collect())
}
