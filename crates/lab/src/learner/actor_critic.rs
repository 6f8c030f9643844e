//! The paper's actor-critic, in the map.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{ActorCritic, ActorCriticConfig, Output, SavedPolicy, TrialSummary};

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
        check_network(task)
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (settings, policies) = (&known.task.learner, &known.progress.policies);
        let mut config = network(known.task);
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

/// Checks `learner.actor_critic`: the shape of a network policy, its limits, and the discount.
pub(super) fn check_network(task: &Task) -> Result<(), LabError> {
    let (config, n) = (&task.learner.actor_critic, task.state.len());
    let found = config.basis_widths.len();
    unless(
        found == n,
        "learner.actor_critic.basis_widths",
        format!("has {found} entries, needs one per component of the state: {n}"),
    )?;
    Ok(config.validate()?)
}

/// `learner.actor_critic`, with what the network's outputs stand for.
pub(crate) fn network(task: &Task) -> ActorCriticConfig {
    let output = |a: &ActionConfig| Output { unit: a.output_unit, mean_weight_limit: a.mean_weight_limit };
    ActorCriticConfig { outputs: task.action.iter().map(output).collect(), ..task.learner.actor_critic.clone() }
}
