//! The paper's actor-critic, in the map.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{ActorCritic, Output, SavedPolicy, TrialSummary};

use super::{Known, LearnerPart};
use crate::error::{LabError, unless};
use crate::registry::part;
use crate::task::{ActionConfig, Task};
use stridemap_record::Proof;

pub(super) struct InMap;

part!(InMap, "actor_critic", "the paper's actor-critic, in the map (MA09, sec. 5)");

impl LearnerPart for InMap {
    fn needs_caution(&self) -> bool {
        false
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        let (config, n) = (&task.learner.actor_critic, task.state.len());
        let found = config.basis_widths.len();
        unless(
            found == n,
            "learner.actor_critic.basis_widths",
            format!("has {found} entries, needs one per component of the state: {n}"),
        )?;
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
        let output = |a: &ActionConfig| Output { unit: a.output_unit, mean_weight_limit: a.mean_weight_limit };
        config.outputs = known.task.action.iter().map(output).collect();
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
