//! Learners in the map beside the paper's own: a line each.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{
    ActorCriticConfig, BayesianPolicyGradient, CrossEntropy, GpDp, LearnError, Learner, NaturalActorCritic, Pathwise,
    SavedPolicy, TrialSummary,
};

use super::actor_critic::{check_network, network};
use super::{Known, LearnerPart};
use crate::error::{Invalid, LabError};
use crate::registry::Part;
use crate::task::{LearnerConfig, Task};
use stridemap_record::Proof;

/// A learner that is given the map and answers with a policy.
pub(super) struct InMap {
    name: &'static str,
    about: &'static str,
    /// Where its parameters are: `learner.SECTION`.
    section: &'static str,
    check: fn(&LearnerConfig) -> Result<(), LearnError>,
    build: fn(&LearnerConfig, ActorCriticConfig) -> Box<dyn Learner>,
}

pub(super) static NATURAL_ACTOR_CRITIC: InMap = InMap {
    name: "natural_actor_critic",
    section: "policy_gradient",
    about: "natural actor-critic with compatible features, in the map (Peters & Schaal 2008)",
    check: |c| c.policy_gradient.validate(),
    build: |c, network| Box::new(NaturalActorCritic { network, config: c.policy_gradient }),
};

pub(super) static GP_DP: InMap = InMap {
    name: "gp_dp",
    section: "gp_dp",
    about: "dynamic programming in the map, the value a Gaussian process (Rasmussen & Kuss 2004)",
    check: |c| c.gp_dp.validate(),
    build: |c, network| Box::new(GpDp { network, config: c.gp_dp }),
};

pub(super) static BAYES_POLICY_GRADIENT: InMap = InMap {
    name: "bayes_policy_gradient",
    section: "policy_gradient",
    about: "Bayesian policy gradient, in the map (Ghavamzadeh & Engel 2007)",
    check: |c| c.policy_gradient.validate(),
    build: |c, network| Box::new(BayesianPolicyGradient { network, config: c.policy_gradient }),
};

pub(super) static PATHWISE: InMap = InMap {
    name: "pathwise",
    section: "pathwise",
    about: "the gradient along sampled paths of the map (as PILCO and MC-PILCO, per stride)",
    check: |c| c.pathwise.validate(),
    build: |c, network| Box::new(Pathwise { network, config: c.pathwise }),
};

pub(super) static CEM: InMap = InMap {
    name: "cem",
    section: "cem",
    about: "the cross-entropy method over linear policies, in the map",
    check: |c| c.cem.validate(),
    build: |c, network| {
        let action_unit = network.units();
        let (discount, state_unit) = (network.discount, network.basis_widths);
        Box::new(CrossEntropy { config: c.cem, discount, state_unit, action_unit })
    },
};

impl Part for InMap {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

impl LearnerPart for InMap {
    fn needs_caution(&self) -> bool {
        false
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        check_network(task)?;
        (self.check)(&task.learner).map_err(|error| match error {
            LearnError::Parameter { field, value, domain } => LabError::Invalid(Invalid {
                key: format!("learner.{}.{field}", self.section),
                requirement: format!("is {value}, must be {domain}"),
            }),
            other => other.into(),
        })
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (settings, policies) = (&known.task.learner, &known.progress.policies);
        let best = Proof::start(&known.progress.proofs()).map(|i| &policies[i]);
        let initial = if known.region.is_some() { best } else { policies.last() };
        let initial = initial.filter(|_| settings.warm_start);
        known.in_map(&mut *(self.build)(settings, network(known.task)), initial, true, rng, observer)
    }
}
