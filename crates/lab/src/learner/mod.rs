//! Learners: how the next policy is found, in the map or from strides on the robot alone. One file each, and
//! one line in the registry below.

mod actor_critic;
mod bayes_opt;
mod cma_es;
mod constant;
mod goals;
mod in_map;
mod integral;
mod linear;
mod search;

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_gp::Mean;
use stridemap_learn::{ConstantPolicy, Learner, SavedPolicy, TrialSummary};
use stridemap_map::{GoalMap, LearnedMap};
use stridemap_process::{ActionLimits, ProcessSpec, StrideEnd, StrideProcess};

pub(crate) use actor_critic::network;
pub use goals::GoalLearning;
pub(crate) use goals::goal_map;
pub use integral::IntegralConfig;
pub use search::SearchSettings;

use crate::caution::CautionConfig;
use crate::error::{Invalid, LabError};
use crate::pessimism::CautiousMap;
use crate::recorder::Progress;
use crate::registry::{Part, Registry, named};
use crate::state::StateComponent;
use crate::strides::ActionSource;
use crate::task::Task;
use stridemap_record::{InPlace, Proof, Region, StridePhase, StrideRole, Transition, Verdict};

/// With fewer strides than this a Gaussian process has nothing to say.
pub(crate) const FEWEST: usize = 3;

/// A learner, as Algorithm 1 uses it. A learner of one's own in the map is a [`stridemap_learn::Learner`] and
/// this trait's [`propose`](Self::propose), which hands it to [`Known::in_map`].
pub trait LearnerPart: Part {
    /// Whether it learns in a map of the robot.
    fn uses_map(&self) -> bool {
        true
    }

    /// Whether it begins with a batch of exploring strides; searches on the robot try policies from the first
    /// stride on.
    fn explores(&self) -> bool {
        true
    }

    /// Whether it searches within a trust region, so that the task needs a `[caution]` section.
    fn needs_caution(&self) -> bool {
        true
    }

    /// Whether it follows goals: the task needs some then, and its strides are explored about them.
    fn follows_goals(&self) -> bool {
        false
    }

    /// Whether it explores and chooses the constants of the robot, in tasks with goals.
    fn moves_constants(&self) -> bool {
        true
    }

    /// Whether strides are explored about its policy, in tasks with goals.
    fn dithers(&self) -> bool {
        true
    }

    /// The policy of the first batch, in tasks with goals; `None`: it explores about the raw command.
    ///
    /// # Errors
    ///
    /// As [`propose`](Self::propose).
    fn first_policy(&self, _known: &Known<'_>) -> Result<Option<SavedPolicy>, LabError> {
        Ok(None)
    }

    /// Checks the task's keys that are its own.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] with the key at fault.
    fn check(&self, _task: &Task) -> Result<(), LabError> {
        Ok(())
    }

    /// Fewest strides of the first batch, and what for; asked of learners that explore.
    fn fewest_strides(&self, task: &Task) -> (usize, String) {
        let map = task.map_config();
        let inputs = map.dims(task.state.len(), task.action.len());
        match map.mean.coefficients(inputs) {
            // One more, so that the strides that are left when one is left out still determine the mean.
            n if n >= FEWEST => (n + 1, format!("a map whose mean has {n} coefficients (map.mean)")),
            _ => (FEWEST, "a map".into()),
        }
    }

    /// Whether it finds slopes of each component of the action, so that each has to move in the first batch.
    fn finds_slopes(&self, task: &Task) -> bool {
        self.uses_map() && task.map_config().mean == Mean::Linear
    }

    /// How the first batch acts on the robot, where it does not explore as the task says.
    fn first_actions<'a>(&self, _task: &'a Task, _in_place: InPlace) -> Option<ActionSource<'a>> {
        None
    }

    /// Where its next policy may lie: about the best proven one; for a search on the robot, which has no centre of its
    /// own, the actions that the first batch would explore.
    fn region(&self, known: &Known<'_>, caution: &CautionConfig) -> Region {
        let (trust, limits, tried) = (&caution.trust, &known.limits, known.tried());
        let unit = known.task.of_each(|a| a.unit);
        if self.explores() {
            trust.region(limits, &unit, &tried, &known.progress.proofs())
        } else {
            trust.searched(limits, &unit, &tried)
        }
    }

    /// Proposes the next policy.
    ///
    /// # Errors
    ///
    /// [`LabError`] of the room at fault.
    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError>;
}

named! {
    /// A learner, by the name in task files.
    LearnerKind, dyn LearnerPart, learners
}

/// The registry of learners.
#[must_use]
pub fn learners() -> &'static Registry<dyn LearnerPart> {
    static LEARNERS: Registry<dyn LearnerPart> = Registry::new(
        "learner",
        &[
            &actor_critic::InMap,
            &search::InMap,
            &constant::Grown,
            &integral::Held,
            &linear::Corner,
            &bayes_opt::OnRobot,
            &cma_es::OnRobot,
            &in_map::NATURAL_ACTOR_CRITIC,
            &in_map::GP_DP,
            &in_map::BAYES_POLICY_GRADIENT,
            &in_map::PATHWISE,
            &in_map::CEM,
            &goals::Planning::MAP,
            &goals::Affine,
            &goals::Planning::COMMANDS,
            &goals::Planning::LINEAR,
            &goals::Planning::STATELESS,
            &goals::Raw,
            &goals::Integral,
            &goals::Inverse,
            &goals::Constants,
        ],
    );
    &LEARNERS
}

impl LearnerKind {
    /// The paper's actor-critic, in the map.
    pub const ACTOR_CRITIC: Self = Self(&actor_critic::InMap);
    /// A search in the map over constants, with feedback from the map's Jacobian.
    pub const SEARCH: Self = Self(&search::InMap);
    /// Without a map: integral action.
    pub const INTEGRAL: Self = Self(&integral::Held);
    /// Planning in the map of goals, and what stands beside it: affine laws from the same map, then the controls.
    pub const GOALS: [Self; 9] = [
        Self(&goals::Planning::MAP),
        Self(&goals::Affine),
        Self(&goals::Planning::COMMANDS),
        Self(&goals::Raw),
        Self(&goals::Integral),
        Self(&goals::Inverse),
        Self(&goals::Planning::LINEAR),
        Self(&goals::Planning::STATELESS),
        Self(&goals::Constants),
    ];
    /// The controls, which use no map of the robot's state.
    pub const CONTROLS: [Self; 4] =
        [Self(&constant::Grown), Self(&linear::Corner), Self(&bayes_opt::OnRobot), Self(&cma_es::OnRobot)];
}

/// Parameters of the controls that search on the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlsConfig {
    /// Bayesian optimisation: standard deviations added to the mean of the speed (UCB).
    pub ucb_stds: f64,
    /// Bayesian optimisation: policies drawn at random in the region before the first fit.
    pub random_policies: usize,
    /// CMA-ES: candidates of a generation, at least 4.
    pub population: usize,
    /// CMA-ES: first standard deviation, in units of the trust region.
    pub first_std_units: f64,
}

impl ControlsConfig {
    fn check(task: &Task) -> Result<(), LabError> {
        let controls = task.controls()?;
        if controls.population < 4 {
            return invalid("learner.controls.population", "must be at least 4");
        }
        if controls.first_std_units <= 0.0 || controls.ucb_stds < 0.0 {
            return invalid("learner.controls", "needs a positive first_std_units and a ucb_stds that is not negative");
        }
        Ok(())
    }
}

fn invalid<T>(key: &str, requirement: impl Into<String>) -> Result<T, LabError> {
    Err(LabError::Invalid(Invalid { key: key.into(), requirement: requirement.into() }))
}

/// What a search on the robot is told of a policy: its speed; half of it after a warning, nothing after
/// a fall.
fn value(proof: &Proof) -> f64 {
    match proof.verdict {
        Verdict::Fell => 0.0,
        Verdict::Warned => 0.5 * proof.speed_m_s,
        Verdict::Proven | Verdict::Slower | Verdict::Unfinished => proof.speed_m_s,
    }
}

/// What is known when the next policy is proposed.
pub struct Known<'a> {
    /// The task.
    pub task: &'a Task,
    /// The run's seed.
    pub seed: u64,
    /// What the run has come to.
    pub progress: &'a Progress,
    /// The map of the strides so far, for learners that use one.
    pub map: Option<&'a LearnedMap>,
    /// The action law's limits, per component of the action.
    pub limits: Vec<ActionLimits>,
    /// Where the policy may lie; without caution anywhere within the limits.
    pub region: Option<Region>,
}

impl<'a> Known<'a> {
    /// What a run knows, with the region that the task's learner has.
    pub(crate) fn of(
        task: &'a Task,
        seed: u64,
        progress: &'a Progress,
        map: Option<&'a LearnedMap>,
    ) -> Result<Self, LabError> {
        let mut known = Self { task, seed, progress, map, limits: task.action_limits()?, region: None };
        let caution = task.caution.as_ref();
        known.region = caution.map(|c| task.learner.kind.region(&known, c));
        Ok(known)
    }

    /// The iteration whose policy this will be, from 1.
    #[must_use]
    pub fn iteration(&self) -> usize {
        self.progress.policies.len() + 1
    }

    /// The map.
    ///
    /// # Errors
    ///
    /// [`LabError::TooFewStrides`] if there is none.
    pub fn map(&self) -> Result<&'a LearnedMap, LabError> {
        let found = self.training().len();
        self.map.ok_or(LabError::TooFewStrides { found, needed: 1 })
    }

    /// Caution and the region that it leaves.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] if the task has none.
    pub fn caution(&self) -> Result<(&'a CautionConfig, &Region), LabError> {
        match (&self.task.caution, &self.region) {
            (Some(caution), Some(region)) => Ok((caution, region)),
            _ => invalid("caution", "is needed by this learner"),
        }
    }

    /// The map that was learned before the robot's first stride, where the task names one.
    ///
    /// # Errors
    ///
    /// [`LabError::RunDirectory`] if the run that it names has none.
    pub fn prior_map(&self) -> Result<Option<Arc<GoalMap>>, LabError> {
        Ok(self.progress.prior.clone())
    }

    /// Training strides that reached the section.
    #[must_use]
    pub fn training(&self) -> Vec<&'a Transition> {
        let all = self.progress.transitions.iter();
        all.filter(|t| t.role == StrideRole::Training && t.end == StrideEnd::Crossing).collect()
    }

    /// The lowest and highest action tried in strides that reached the section, per component; without
    /// strides the range that the first batch would explore.
    #[must_use]
    pub fn tried(&self) -> Vec<[f64; 2]> {
        let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; self.task.action.len()];
        let strides = self.progress.transitions.iter();
        let explored = strides
            .filter(|t| t.iteration <= self.iteration() && t.end == StrideEnd::Crossing)
            .filter(|t| t.phase == StridePhase::Collect);
        for t in explored {
            for (range, u) in ranges.iter_mut().zip(&t.action) {
                *range = [range[0].min(*u), range[1].max(*u)];
            }
        }
        if ranges.iter().any(|[l, h]| l > h) {
            return self.task.action.iter().map(|a| a.explore.center).collect();
        }
        ranges
    }

    /// The policy that always takes this action.
    ///
    /// # Errors
    ///
    /// [`LabError::Learn`] if it has another number of components.
    pub fn constant(&self, action: &[f64]) -> Result<SavedPolicy, LabError> {
        let policy = ConstantPolicy::new(self.task.process_spec()?, action)?;
        Ok(SavedPolicy::Constant(policy))
    }

    /// The map as a cautious learner should see it, with the bounds of `spec`.
    fn cautious(&self, map: &LearnedMap, caution: &CautionConfig, spec: ProcessSpec) -> CautiousMap {
        let position = |c| self.task.state.iter().position(|s| *s == c);
        let bound = caution.pessimism.psi_roll_below_in_place_deg.map(|b| self.progress.in_place().psi_roll_deg - b);
        let psi_roll = position(StateComponent::PSI_ROLL_DEG).zip(bound);
        let pitch_rate = position(StateComponent::PSI_PITCH_RATE_DEG_S);
        CautiousMap::new(map.clone(), caution.pessimism, spec, psi_roll, pitch_rate)
    }

    /// Improves a policy in the map: as it was fitted, or, with caution, charged for what the map does not know. The components'
    /// bounds are those of the region where `within_region`.
    ///
    /// # Errors
    ///
    /// [`LabError::Learn`] of the learner; [`LabError::TooFewStrides`] without a map.
    pub fn in_map(
        &self,
        learner: &mut dyn Learner,
        initial: Option<&SavedPolicy>,
        within_region: bool,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let map = self.map()?;
        let (mut as_fitted, mut cautious);
        let process: &mut dyn StrideProcess = match (&self.task.caution, &self.region) {
            (Some(caution), Some(region)) => {
                let mut spec = self.task.process_spec()?;
                for (d, component) in spec.action.iter_mut().enumerate().filter(|_| within_region) {
                    (component.lower, component.upper) = (region.lower[d], region.upper[d]);
                }
                cautious = self.cautious(map, caution, spec);
                &mut cautious
            }
            _ => {
                as_fitted = map.clone();
                &mut as_fitted
            }
        };
        let outcome = learner.improve(process, initial, rng, &mut |r| observer(r.summary))?;
        Ok(outcome.policy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Role, stream};

    fn speed(action: &[f64]) -> f64 {
        0.4 - 0.02 * (action[0] - 3.0).powi(2) - 0.5 * (action[1] - 0.5).powi(2)
    }

    fn proof(action: Vec<f64>) -> Proof {
        Proof { verdict: Verdict::Slower, warning: None, speed_m_s: speed(&action), strides: 30, attempts: 1, action }
    }

    /// Both searches come near the top of a bowl on which they are tried 40 times.
    #[test]
    fn searches_on_the_robot_climb() {
        let config = ControlsConfig { ucb_stds: 1.5, random_policies: 4, population: 5, first_std_units: 0.5 };
        let region = Region { lower: vec![0.0, 0.0], upper: vec![6.0, 1.5] };
        let unit = [2.0, 0.5];
        for bayes in [true, false] {
            let mut proofs: Vec<Proof> = Vec::new();
            for i in 0..40 {
                let list: Vec<&Proof> = proofs.iter().collect();
                let action = if bayes {
                    let mut rng = stream(1, Role::Improve, i);
                    bayes_opt::next(&config, &region, &unit, &list, &mut rng)
                } else {
                    let of = |g: usize| stream(1, Role::Improve, g as u64);
                    cma_es::next(&config, &region, &unit, &list, &of)
                };
                proofs.push(proof(action.unwrap()));
            }
            let best = proofs.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
            assert!(best > 0.39, "{bayes}: {best}");
        }
    }
}
