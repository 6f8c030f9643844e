//! Which policy is final: the best of those proven on the robot, the nominal gait among them.
//!
//! Learned policies are compared with one another by evaluation strides and proofs alone, which are in the
//! budget. The nominal gait's measurement is the mark that each of them has to beat, twice: by its evaluation,
//! and by its own measurement as the final policy. Who does not is not handed out.

use stridemap_learn::SavedPolicy;

use crate::error::LabError;
use crate::recorder::Progress;
use crate::task::Task;
use stridemap_record::{Performance, Proof, StrideRole};

/// By how many standard errors the reward of a final policy must exceed that of the nominal gait.
const STANDARD_ERRORS: f64 = 2.0;

impl Progress {
    /// What became of each policy, in their order; empty without caution.
    #[must_use]
    pub fn proofs(&self) -> Vec<&Proof> {
        let proofs = self.iterations.iter().map_while(|i| i.proof.as_ref());
        proofs.take(self.policies.len()).collect()
    }

    /// Index of the best policy proven on the robot, the earlier of equals: with proofs the fastest proven one;
    /// without, the one whose evaluation has fewest falls and then most reward, and beats the nominal gait.
    /// `None`: the nominal gait.
    #[must_use]
    pub fn best(&self) -> Option<usize> {
        let mut best: Option<usize> = None;
        for (i, iteration) in self.iterations.iter().enumerate().take(self.policies.len()) {
            let candidate = iteration.rejected.is_none() && self.is_proven(i);
            if candidate && best.is_none_or(|b| self.is_better(i, b)) {
                best = Some(i);
            }
        }
        best
    }

    fn is_proven(&self, i: usize) -> bool {
        let iteration = &self.iterations[i];
        match (&iteration.proof, &iteration.evaluation) {
            (Some(proof), _) => proof.is_proven(),
            (None, Some(evaluation)) => self.nominal.is_none_or(|n| evaluation.beats(&n, 0.0)),
            // What follows goals is measured and not tried: the newest is the best.
            (None, None) => iteration.record.is_some_and(|r| r.random_goals.is_some()),
        }
    }

    fn is_better(&self, i: usize, than: usize) -> bool {
        let (a, b) = (&self.iterations[i], &self.iterations[than]);
        match (&a.proof, &b.proof, &a.evaluation, &b.evaluation) {
            (Some(a), Some(b), _, _) => a.speed_m_s > b.speed_m_s,
            (_, _, Some(a), Some(b)) => a.beats(b, 0.0),
            _ => i > than,
        }
    }

    /// The best policy proven on the robot; `None`: the nominal gait.
    #[must_use]
    pub fn best_policy(&self) -> Option<&SavedPolicy> {
        self.best().map(|i| &self.policies[i])
    }

    /// The final policy: the best one, or that of the nominal gait.
    ///
    /// # Errors
    ///
    /// [`LabError::Learn`] if the nominal policy cannot be built.
    pub fn final_policy(&self, task: &Task) -> Result<SavedPolicy, LabError> {
        self.best_policy().map_or_else(|| task.nominal_policy(), |policy| Ok(policy.clone()))
    }

    /// Whether the final policy is a learned one; `None` until it was measured.
    #[must_use]
    pub fn improved(&self) -> Option<bool> {
        self.final_performance.map(|_| self.best().is_some())
    }

    /// Takes the measurement of the best policy as final, unless that does not beat the nominal gait: then the
    /// policy is rejected, and the next has to be measured.
    pub(crate) fn accept(&mut self, measured: Performance) {
        let beaten = self.best().filter(|_| self.nominal.is_some_and(|n| !measured.beats(&n, STANDARD_ERRORS)));
        match beaten {
            Some(i) => self.iterations[i].rejected = Some(measured),
            None => self.final_performance = Some(measured),
        }
    }

    /// Strides with this role.
    #[must_use]
    pub fn strides(&self, role: StrideRole) -> usize {
        self.transitions.iter().filter(|t| t.role == role).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use stridemap_record::{Iteration, Verdict};

    fn measured(mean_reward: f64, falls: usize) -> Performance {
        Performance { strides: 10, mean_reward, reward_sd: Some(0.01), falls, ..Performance::default() }
    }

    /// A run whose policies were evaluated as these rewards and falls; the nominal gait has -0.1 and no falls.
    fn run(evaluations: &[(f64, usize)]) -> Progress {
        let task = builtin::load("stepping", &[]).unwrap().task;
        let iteration = |&(reward, falls): &(f64, usize)| Iteration {
            evaluation: Some(measured(reward, falls)),
            ..Iteration::default()
        };
        Progress {
            nominal: Some(measured(-0.1, 0)),
            iterations: evaluations.iter().map(iteration).collect(),
            policies: vec![task.nominal_policy().unwrap(); evaluations.len()],
            ..Progress::default()
        }
    }

    #[test]
    fn falls_count_before_reward_and_the_nominal_gait_before_what_is_worse() {
        assert_eq!(run(&[(-0.05, 0), (-0.02, 0), (-0.02, 0)]).best(), Some(1));
        assert_eq!(run(&[(-0.05, 0), (-0.01, 1)]).best(), Some(0));
        assert_eq!(run(&[(-0.2, 0), (-0.01, 1)]).best(), None);
        // An improved policy that was not tried yet is no candidate.
        let mut untried = run(&[(-0.05, 0), (-0.02, 0)]);
        untried.iterations[1].evaluation = None;
        assert_eq!(untried.best(), Some(0));
    }

    #[test]
    fn a_final_policy_must_beat_the_nominal_gait_beyond_what_its_strides_can_tell() {
        // Standard errors of 0.01 / √10 each: two of the difference are 0.0089.
        let mut progress = run(&[(-0.02, 0), (-0.05, 0)]);
        progress.accept(measured(-0.095, 0));
        assert_eq!((progress.best(), progress.improved()), (Some(1), None));
        progress.accept(measured(-0.01, 1));
        assert_eq!((progress.best(), progress.improved()), (None, None));
        progress.accept(measured(-0.1, 0)); // the nominal gait, measured once more
        assert_eq!(progress.improved(), Some(false));

        let mut progress = run(&[(-0.02, 0)]);
        progress.accept(measured(-0.09, 0));
        assert_eq!((progress.best(), progress.improved()), (Some(0), Some(true)));
    }

    #[test]
    fn with_proofs_the_fastest_proven_policy_is_final_and_none_is_no_candidate() {
        let mut progress = run(&[(0.0, 0), (0.0, 0)]);
        let proof = |verdict, speed_m_s| {
            Some(Proof { verdict, warning: None, speed_m_s, strides: 30, attempts: 1, action: vec![0.0] })
        };
        progress.iterations[0].proof = proof(Verdict::Warned, 0.5);
        progress.iterations[1].proof = proof(Verdict::Slower, 0.6);
        assert_eq!(progress.best(), None);
        progress.iterations[0].proof = proof(Verdict::Proven, 0.5);
        progress.iterations[1].proof = proof(Verdict::Proven, 0.6);
        assert_eq!(progress.best(), Some(1));
    }
}
