//! The paper's actor-critic, in the map.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{ActorCritic, SavedPolicy, TrialSummary};

use super::{Known, LearnerPart};
use crate::error::{LabError, unless};
use crate::registry::part;
use crate::task::{Task, one_per};
use stridemap_record::Proof;

pub(super) struct InMap;

part!(InMap, "actor_critic", "the paper's actor-critic, in the map (MA09, sec. 5)");

impl LearnerPart for InMap {
    fn needs_caution(&self) -> bool {
        false
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        let (config, n, m) = (&task.learner.actor_critic, task.state.len(), task.action.len());
        for (key, found, needed, what) in [
            ("basis_widths", config.basis_widths.len(), n, "state"),
            ("action_unit", config.action_unit.len(), m, "action"),
        ] {
            unless(
                found == needed,
                format!("learner.actor_critic.{key}"),
                one_per(&format!("component of the {what}"), found, needed),
            )?;
        }
        Ok(config.validate()?)
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (settings, policies) = (&known.task.learner, &known.progress.policies);
        let mut config = settings.actor_critic.clone();
        let later = known.iteration() > 1;
        let initial = if known.region.is_some() {
            if let (true, Some(trials)) = (later, settings.later_trials) {
                config.trials = trials;
            }
            let start = Proof::start(&known.progress.proofs()).filter(|_| later);
            start.map(|i| &policies[i])
        } else {
            policies.last()
        };
        let initial = initial.filter(|_| settings.warm_start);
        known.in_map(&mut ActorCritic { config }, initial, true, rng, observer)
    }
}
