//! A search in the map over constant actions, with feedback from the map's Jacobian about them.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::{SavedPolicy, SearchConfig, SearchLearner, TrialSummary};

use super::{Known, LearnerPart, invalid};
use crate::error::LabError;
use crate::feedback::{FedBack, JacobianFeedbackConfig, with_feedback};
use crate::registry::part;
use crate::state::StateComponent;
use crate::task::Task;
use stridemap_record::Proof;

/// The search in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchSettings {
    /// Generations of the evolution strategy.
    pub generations: usize,
    /// Episodes by which a candidate is judged.
    pub episodes: usize,
    /// Strides of an episode.
    pub strides_per_episode: usize,
    /// First strides of an episode that do not count: the way to the candidate.
    pub unscored_strides: usize,
    /// Feedback about the constants found; left out: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub feedback: Option<JacobianFeedbackConfig>,
}

pub(super) struct InMap;

part!(InMap, "search", "a search in the map over constants (CMA-ES), with feedback from the map's Jacobian");

impl LearnerPart for InMap {
    fn check(&self, task: &Task) -> Result<(), LabError> {
        let search = task.search()?;
        if let Some(feedback) = &search.feedback {
            check_feedback(task, feedback)?;
        }
        let scored = search.unscored_strides < search.strides_per_episode;
        if !scored || search.generations == 0 || search.episodes == 0 {
            return invalid(
                "learner.search",
                "needs generations, episodes, and unscored_strides < strides_per_episode",
            );
        }
        Ok(())
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (_, region) = known.caution()?;
        let unit = known.task.of_each(|a| a.unit);
        let settings = known.task.search()?;
        let config = SearchConfig {
            action_unit: unit.clone(),
            lower: region.lower.clone(),
            upper: region.upper.clone(),
            generations: settings.generations,
            episodes: settings.episodes,
            strides_per_episode: settings.strides_per_episode,
            unscored_strides: settings.unscored_strides,
        };
        let proofs = known.progress.proofs();
        let start = Proof::best(&proofs).map(|b| &proofs[b].action);
        let initial = start.map(|u| known.constant(u)).transpose()?;
        let mut learner = SearchLearner { config };
        let policy = known.in_map(&mut learner, initial.as_ref(), false, rng, observer)?;
        let (Some(feedback), SavedPolicy::Constant(found)) = (&settings.feedback, &policy) else {
            return Ok(policy);
        };
        let (fed, spec) = (fed_back(known, &unit, feedback), known.task.process_spec()?);
        let cost = feedback.action_cost;
        with_feedback(known.map()?, &spec, found.action(), &fed, cost, rng)
    }
}

/// The components of the action that a task feeds back.
fn fed_back(known: &Known<'_>, unit: &[f64], feedback: &JacobianFeedbackConfig) -> Vec<FedBack> {
    let task = known.task;
    let of_state = |c: &StateComponent| task.state.iter().position(|s| s == c);
    let lines = feedback.modulates.iter().zip(&feedback.sees);
    lines
        .zip(&feedback.limit)
        .filter_map(|((name, sees), limit)| {
            let component = task.action.iter().position(|a| a.modulates == *name)?;
            Some(FedBack {
                component,
                unit: unit[component],
                law_gain: known.limits[component].gain,
                limit: *limit,
                sees: sees.iter().filter_map(of_state).collect(),
            })
        })
        .collect()
}

fn check_feedback(task: &Task, feedback: &JacobianFeedbackConfig) -> Result<(), LabError> {
    let known = |name: &String| task.action.iter().any(|a| a.modulates == *name);
    if let Some(name) = feedback.modulates.iter().find(|name| !known(name)) {
        return invalid("learner.search.feedback.modulates", format!("{name:?} is not a component of the action"));
    }
    let mut sees = feedback.sees.iter().flatten();
    if let Some(c) = sees.find(|c| !task.state.contains(c)) {
        return invalid("learner.search.feedback.sees", format!("{:?} is not a component of the state", c.name()));
    }
    if feedback.sees.len() != feedback.modulates.len() {
        return invalid("learner.search.feedback.sees", "needs a list for each modulation that is fed back");
    }
    let positive = feedback.limit.iter().all(|l| l.is_finite() && *l > 0.0);
    if feedback.limit.len() != feedback.modulates.len() || !positive {
        return invalid(
            "learner.search.feedback.limit",
            "needs a positive number for each modulation that is fed back",
        );
    }
    Ok(())
}
