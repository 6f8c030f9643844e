//! Algorithm 1 with caution: policies are proposed within a trust region and proven on the robot.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{
    ActorCritic, ConstantPolicy, Learner, SavedPolicy, SearchConfig, SearchLearner, TrialSummary,
};
use stridemap_returnmap::{
    ActionLimits, LearnedMap, ProcessSpec, StateReward, StrideEnd, StrideProcess,
};

use crate::algorithm::{Algorithm, Recorder};
use crate::caution::CautionConfig;
use crate::controls;
use crate::error::LabError;
use crate::feedback::{FedBack, JacobianFeedbackConfig, with_feedback};
use crate::guard::GuardWarning;
use crate::guarded::GuardedExplorer;
use crate::integral::{self, IntegralAction};
use crate::pessimism::{CautiousMap, CautiousWorld};
use crate::plant::{InPlace, PlantCounters};
use crate::proof::{Proof, Prover, Verdict, shrunk};
use crate::reward::{StateComponent, reward_of_state};
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, Batch, Performance, StridePhase, StrideRole, Transition};
use crate::task::{LearnerKind, Task};
use crate::trust::Region;

/// The lowest and highest action tried in strides that reached the section, per component; without
/// strides the range that the first batch would explore.
fn tried(task: &Task, transitions: &[Transition], iteration: usize) -> Vec<[f64; 2]> {
    let first = transitions
        .iter()
        .filter(|t| t.iteration <= iteration && t.end == StrideEnd::Crossing)
        .filter(|t| t.phase == StridePhase::Collect);
    let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; task.action.len()];
    for t in first {
        for (range, u) in ranges.iter_mut().zip(&t.action) {
            *range = [range[0].min(*u), range[1].max(*u)];
        }
    }
    if ranges.iter().any(|[l, h]| l > h) {
        return task.collect.explore.center.clone();
    }
    ranges
}

/// What a cautious map must know of the task.
fn cautious_world(
    task: &Task,
    caution: &CautionConfig,
    in_place: InPlace,
    spec: ProcessSpec,
) -> Result<CautiousWorld, LabError> {
    let (terms, components) = (task.reward.clone(), task.state.clone());
    let zeros = vec![0.0; components.len()];
    let from_state = reward_of_state(&terms, &components, &zeros).is_some();
    let position = |c| task.state.iter().position(|s| *s == c);
    let psi_roll = position(StateComponent::PsiRollDeg);
    let bound = in_place.psi_roll_deg - caution.pessimism.psi_roll_below_in_place_deg;
    Ok(CautiousWorld {
        spec,
        limits: task.action_limits()?,
        failure: task.failure.in_map(&task.state, &in_place),
        reward: from_state.then(|| {
            let f = move |x: &[f64]| reward_of_state(&terms, &components, x).unwrap_or(0.0);
            Arc::new(f) as StateReward
        }),
        psi_roll: psi_roll.map(|c| (c, bound)),
        pitch_rate: position(StateComponent::PsiPitchRateDegS),
    })
}

/// The components of the action that a task feeds back.
fn fed_back(
    task: &Task,
    unit: &[f64],
    limits: &[ActionLimits],
    feedback: &JacobianFeedbackConfig,
) -> Vec<FedBack> {
    let of_state = |c: &StateComponent| task.state.iter().position(|s| s == c);
    let lines = feedback.modulates.iter().zip(&feedback.sees);
    lines
        .zip(&feedback.limit)
        .filter_map(|((name, sees), limit)| {
            let component = task.action.iter().position(|a| a.modulates == *name)?;
            Some(FedBack {
                component,
                unit: unit[component],
                law_gain: limits[component].gain,
                limit: *limit,
                sees: sees.iter().filter_map(of_state).collect(),
            })
        })
        .collect()
}

impl Algorithm<'_> {
    /// Strides of the budget that are left; without a budget there is no end.
    pub(crate) fn strides_left(&self) -> usize {
        let made: usize = self.progress.iterations.iter().map(|i| i.strides).sum();
        let budget = self.task.algorithm.strides_at_most.unwrap_or(usize::MAX);
        budget.saturating_sub(made)
    }

    /// Step 2 without a policy: explores, and goes back towards the nominal gait after a warning.
    pub(crate) fn explore_under_guard(
        &mut self,
        caution: &CautionConfig,
        batch: Batch,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<(Vec<Transition>, PlantCounters), LabError> {
        let before = self.plant.counters();
        let mut rng = stream(self.seed, Role::Collect, stream_index);
        let limits = self.task.action_limits()?;
        // A start of its own tells how the robot steps in place; the batch starts afresh.
        self.plant.reset(&mut rng.clone())?;
        let psi_roll = self
            .task
            .state
            .iter()
            .position(|c| *c == StateComponent::PsiRollDeg);
        let source = match (self.task.learner.kind, self.task.learner.integral, psi_roll) {
            (LearnerKind::Integral, Some(config), Some(component)) => {
                ActionSource::Integral(IntegralAction {
                    component,
                    target_deg: self.plant.in_place().psi_roll_deg - config.below_in_place_deg,
                    gain_per_deg: config.gain_per_deg,
                    limits: limits[0],
                })
            }
            _ => ActionSource::Explore(&self.task.collect.explore),
        };
        let guard = &caution.guard;
        let thresholds = guard.thresholds(self.plant.in_place(), 0.0);
        let mut explorer = GuardedExplorer::new(
            &source,
            &caution.guard,
            Some(thresholds.exploring(guard.exploring_factor)),
            limits.iter().map(|l| l.neutral).collect(),
            caution.proof.back_off_strides,
        );
        let (made, _) = self.make(&mut explorer, batch, None, &mut rng, recorder)?;
        let before_these = self.explored.0;
        let warnings = explorer
            .warnings()
            .iter()
            .map(|(stride, warning)| GuardWarning {
                stride: before_these + stride,
                warning: *warning,
            });
        self.explored.1.extend(warnings);
        self.explored.0 += made.len();
        Ok((made, self.plant.counters().since(before)))
    }

    /// Where the next policy may lie.
    pub(crate) fn trust_region(&self, caution: &CautionConfig) -> Result<Region, LabError> {
        let iteration = self.progress.policies.len() + 1;
        let limits = self.task.action_limits()?;
        let explored = tried(self.task, &self.progress.transitions, iteration);
        Ok(match self.task.learner.kind {
            LearnerKind::BayesOpt | LearnerKind::CmaEs => {
                Region::searched(&caution.trust, &limits, &explored)
            }
            _ => Region::next(&caution.trust, &limits, &explored, &self.progress.proofs()),
        })
    }

    /// Proposes the next policy within the trust region: found in the map, or by a control without one.
    pub(crate) fn propose(
        &self,
        caution: &CautionConfig,
        map: Option<&LearnedMap>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (task, progress) = (self.task, &self.progress);
        let iteration = progress.policies.len() + 1;
        let limits = task.action_limits()?;
        let spec = task.process_spec()?;
        let proofs = progress.proofs();
        let explored = tried(task, &progress.transitions, iteration);
        let region = self.trust_region(caution)?;
        let training: Vec<&Transition> = progress
            .transitions
            .iter()
            .filter(|t| t.role == StrideRole::Training && t.end == StrideEnd::Crossing)
            .collect();
        let constant = |action: &[f64]| -> Result<SavedPolicy, LabError> {
            let policy = ConstantPolicy::new(spec.clone(), action)?;
            Ok(SavedPolicy::Constant(policy))
        };
        match (task.learner.kind, map) {
            (LearnerKind::Constant, _) => constant(&controls::grown(&region, &limits, &explored)),
            (LearnerKind::Integral, _) => constant(&integral::held(&progress.transitions)?),
            (LearnerKind::Linear, _) => constant(&controls::linear(&region, &training)?),
            (LearnerKind::BayesOpt, _) => {
                let config = task.controls()?;
                let unit = &caution.trust.unit;
                constant(&controls::bayes_opt(config, &region, unit, &proofs, rng)?)
            }
            (LearnerKind::CmaEs, _) => {
                let config = task.controls()?;
                let unit = &caution.trust.unit;
                let of = |g: usize| stream(self.seed, Role::RobotSearch, g as u64);
                constant(&controls::cma_es(config, &region, unit, &proofs, &of)?)
            }
            (LearnerKind::ActorCritic | LearnerKind::Search, None) => {
                Err(LabError::TooFewStrides {
                    found: training.len(),
                    needed: 1,
                })
            }
            (LearnerKind::ActorCritic, Some(map)) => {
                let mut within = spec;
                for (d, component) in within.action.iter_mut().enumerate() {
                    (component.lower, component.upper) = (region.lower[d], region.upper[d]);
                }
                let world = cautious_world(task, caution, self.progress.in_place(), within)?;
                let mut process = CautiousMap::new(map, caution.pessimism, world)?;
                let mut config = task.learner.actor_critic.clone();
                if let (true, Some(trials)) = (iteration > 1, task.learner.later_trials) {
                    config.trials = trials;
                }
                let initial = Proof::start(&proofs)
                    .filter(|_| task.learner.warm_start && iteration > 1)
                    .map(|i| &progress.policies[i]);
                let outcome =
                    ActorCritic { config }
                        .improve(&mut process, initial, rng, &mut |r| observer(r.summary))?;
                Ok(outcome.policy)
            }
            (LearnerKind::Search, Some(map)) => {
                let settings = task.search()?;
                let world = cautious_world(task, caution, self.progress.in_place(), spec.clone())?;
                let mut process = CautiousMap::new(map, caution.pessimism, world)?;
                let config = SearchConfig {
                    generations: settings.generations,
                    episodes: settings.episodes,
                    strides_per_episode: settings.strides_per_episode,
                    unscored_strides: settings.unscored_strides,
                    std_weight: 0.0,
                    unsafe_penalty: 0.0,
                    ..SearchConfig::within(&caution.trust.unit, &region.lower, &region.upper)
                };
                let start = Proof::best(&proofs).map(|b| &proofs[b].action);
                let initial = start.map(|u| constant(u)).transpose()?;
                let outcome = SearchLearner { config }.improve(
                    &mut process,
                    initial.as_ref(),
                    rng,
                    &mut |r| observer(r.summary),
                )?;
                let (Some(feedback), SavedPolicy::Constant(found)) =
                    (&settings.feedback, &outcome.policy)
                else {
                    return Ok(outcome.policy);
                };
                let fed: Vec<FedBack> = fed_back(task, &caution.trust.unit, &limits, feedback);
                let cost = feedback.action_cost;
                with_feedback(map, &spec, found.action(), &fed, cost, rng)
            }
        }
    }

    /// Proves the newest policy on the robot; a first policy that warns is shrunk and tried again.
    pub(crate) fn prove(
        &mut self,
        caution: &CautionConfig,
        recorder: &mut dyn Recorder,
    ) -> Result<(), LabError> {
        let Some(mut policy) = self.progress.policies.last().cloned() else {
            return Ok(());
        };
        let index = self.progress.policies.len() - 1;
        if self.progress.iterations[index].proof.is_some() {
            return Ok(());
        }
        let config = &caution.proof;
        let residual = self.progress.iterations[index]
            .pitch_rate_residual_deg_s
            .unwrap_or(0.0);
        let thresholds = caution.guard.thresholds(self.progress.in_place(), residual);
        let limits = self.task.action_limits()?;
        let neutral: Vec<f64> = limits.iter().map(|l| l.neutral).collect();
        let proofs: Vec<Proof> = self.progress.proofs().into_iter().cloned().collect();
        let best = Proof::best(&proofs.iter().collect::<Vec<_>>());
        let beat_m_s = best.map(|b| proofs[b].speed_m_s);
        let mut rng = stream(self.seed, Role::Evaluate, index as u64);
        let mut all: Vec<Transition> = Vec::new();
        let mut attempts = 0;
        let made_before = self.progress.iterations[index].strides;
        let mut proof;
        loop {
            attempts += 1;
            let fallback = match best {
                Some(b) => self.progress.policies[b].clone(),
                None => shrunk(&policy, &neutral, config.shrink_on_warning)?
                    .unwrap_or_else(|| policy.clone()),
            };
            let left = self.strides_left() - all.len();
            let most = config.proof_strides + config.back_off_strides;
            let batch = Batch {
                iteration: index + 1,
                phase: StridePhase::Evaluate,
                role: StrideRole::Training,
                strides: left.min(most),
            };
            let guard = (&caution.guard, thresholds);
            // Who has no map learns nothing from dither.
            let dither: &[f64] = if self.task.learner.kind.uses_map() {
                &config.dither_std
            } else {
                &[]
            };
            let mut prover = Prover::new(config, guard, dither, &policy, &fallback, beat_m_s);
            let (made, counted) = self.make(&mut prover, batch, None, &mut rng, recorder)?;
            proof = prover.proof();
            let warned = proof.warning.map(|warning| GuardWarning {
                stride: made_before + all.len() + proof.strides,
                warning,
            });
            let iteration = &mut self.progress.iterations[index];
            iteration.falls += counted.falls;
            iteration.stalls += counted.stalls;
            iteration.warm_up += counted.warm_up;
            iteration.warnings.extend(warned);
            all.extend(made);
            let bad = matches!(proof.verdict, Verdict::Warned | Verdict::Fell);
            let enough = self.strides_left() > all.len() + config.trial_strides;
            if best.is_none() && bad && attempts < config.attempts && enough {
                let smaller = shrunk(&policy, &neutral, config.shrink_on_warning)?;
                if let Some(smaller) = smaller {
                    policy = smaller;
                    continue;
                }
            }
            break;
        }
        proof.attempts = attempts;
        let iteration = &mut self.progress.iterations[index];
        iteration.strides += all.len();
        iteration.evaluation = Some(Performance::of(&all, 0));
        iteration.proof = Some(proof);
        self.progress.transitions.extend(all);
        if attempts > 1 {
            recorder.policy(index + 1, &policy)?;
            self.progress.policies[index] = policy;
        }
        Ok(())
    }
}
