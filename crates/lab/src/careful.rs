//! Algorithm 1 with caution: policies are proposed within a trust region and proven on the robot.

use stridemap_process::StrideProcess;

use crate::algorithm::Algorithm;
use crate::caution::CautionConfig;
use crate::error::LabError;
use crate::guarded::GuardedExplorer;
use crate::plant::Batch;
use crate::plant::PlantCounters;
use crate::proof::{Prover, shrunk};
use crate::recorder::Recorder;
use crate::seed::{Role, stream};
use stridemap_record::{GuardWarning, Performance, Proof, StridePhase, StrideRole, Transition, Verdict};

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
        let source = self
            .task
            .learner
            .kind
            .first_actions(self.task, self.plant.in_place())
            .unwrap_or_else(|| self.task.first_exploration());
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
            .map(|(stride, warning)| GuardWarning { stride: before_these + stride, warning: *warning });
        self.explored.1.extend(warnings);
        self.explored.0 += made.len();
        Ok((made, self.plant.counters().since(before)))
    }

    /// Proves the newest policy on the robot; a first policy that warns is shrunk and tried again.
    pub(crate) fn prove(&mut self, caution: &CautionConfig, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let Some(mut policy) = self.progress.policies.last().cloned() else {
            return Ok(());
        };
        let index = self.progress.policies.len() - 1;
        if self.progress.iterations[index].proof.is_some() {
            return Ok(());
        }
        let config = &caution.proof;
        let residual = self.progress.iterations[index].pitch_rate_residual_deg_s.unwrap_or(0.0);
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
                None => shrunk(&policy, &neutral, config.shrink_on_warning)?.unwrap_or_else(|| policy.clone()),
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
            let dither = if self.task.learner.kind.uses_map() { self.task.dither_std() } else { Vec::new() };
            let back_off = self.task.of_each(|a| a.back_off);
            let mut prover = Prover::new(config, guard, &dither, &policy, (&fallback, back_off), beat_m_s);
            let (made, counted) = self.make(&mut prover, batch, None, &mut rng, recorder)?;
            proof = prover.proof();
            let warned =
                proof.warning.map(|warning| GuardWarning { stride: made_before + all.len() + proof.strides, warning });
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
