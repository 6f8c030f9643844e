//! `summary.json`: the numbers that a script wants.

use stridemap_record::{FORMAT, IterationSummary, Measured, SecondsSummary, StrideCounts, StrideRole, Summary};

use crate::recorder::Progress;
use crate::task::Task;

impl Progress {
    /// The summary of what a run achieved so far.
    #[must_use]
    pub fn summary(&self, task: &Task, seed: u64) -> Summary {
        let (mut strides_so_far, mut falls_so_far) = (0, 0);
        let iterations = self
            .iterations
            .iter()
            .map(|i| {
                strides_so_far += i.strides;
                falls_so_far += i.falls;
                IterationSummary {
                    iteration: i.iteration,
                    strides: i.strides,
                    falls: i.falls,
                    strides_so_far,
                    falls_so_far,
                    log_marginal_likelihood: i.log_marginal_likelihood.clone(),
                    mean_reward: i.record.map(|p| p.mean_reward),
                    mean_psi_roll_deg: i.record.and_then(|p| p.mean_psi_roll_deg),
                    success: i.record.is_some_and(|p| task.is_success(&p, strides_so_far, falls_so_far)),
                    evaluated_mean_reward: i.evaluation.map(|p| p.mean_reward),
                    rejected: i.rejected.map(Measured::from),
                    random_goals: i.record.and_then(|p| p.random_goals),
                    speed_m_s: i.record.and_then(|p| p.walk).map(|w| w.speed_m_s),
                    upright_s: i.record.and_then(|p| p.walk).map(|w| w.upright_s),
                    proof: i.proof.clone(),
                    trust_region: i.trust_region.clone(),
                    warnings: i.warnings.clone(),
                }
            })
            .collect();
        Summary {
            format: FORMAT,
            experiment: task.name.clone(),
            seed,
            strides: StrideCounts {
                training: self.strides(StrideRole::Training),
                evaluation: self.strides(StrideRole::Evaluation),
                warm_up: self.iterations.iter().map(|i| i.warm_up).sum(),
                record: self.record_strides,
            },
            iterations,
            final_iteration: self.best().map(|i| i + 1),
            improved: self.improved(),
            nominal: self.nominal.map(Measured::from),
            final_policy: self.final_performance.map(Measured::from),
            falls: self.falls.clone(),
            seconds: SecondsSummary { by_work: self.seconds, total: self.total_seconds },
        }
    }
}
