//! `summary.json`: the numbers that a script wants.

use serde::{Deserialize, Serialize};
use stridemap_process::StrideEnd;

use crate::goals::RandomGoals;
use crate::iteration::{GuardWarning, Proof, Region, Seconds};
use crate::measured::Measured;
use crate::stride::{RobotFall, StridePhase, StrideRole, Transition};

/// Strides made on the robot, by what they were for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StrideCounts {
    /// Offered to the map.
    pub training: usize,
    /// Run to choose, prove or stop, and not offered to the map.
    pub evaluation: usize,
    /// Of the nominal gait, before the training and evaluation strides.
    pub warm_up: usize,
    /// Run only to report.
    pub record: usize,
}

/// One iteration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IterationSummary {
    /// From 1.
    pub iteration: usize,
    /// This iteration's own strides on the robot, training and evaluation.
    pub strides: usize,
    /// This iteration's own falls on the robot.
    pub falls: usize,
    /// Training and evaluation strides up to here.
    pub strides_so_far: usize,
    /// Falls up to here.
    pub falls_so_far: usize,
    /// One per output of the map.
    pub log_marginal_likelihood: Vec<f64>,
    /// Of the policy measured to report.
    pub mean_reward: Option<f64>,
    /// Of the policy measured to report.
    pub mean_psi_roll_deg: Option<f64>,
    /// Whether this policy, measured to report, is what the task calls a success.
    pub success: bool,
    /// Of the evaluation strides, which choose; null without them.
    pub evaluated_mean_reward: Option<f64>,
    /// The policy as measured to be final, if that did not beat the nominal gait; left out otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejected: Option<Measured>,
    /// How goals drawn at random were followed by the policy measured to report; left out where a task has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub random_goals: Option<RandomGoals>,
    /// Forward speed of the policy measured to report; null where the task does not measure it.
    pub speed_m_s: Option<f64>,
    /// Time upright of the policy measured to report; left out where the task does not measure it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upright_s: Option<f64>,
    /// What became of the policy on the robot before; left out without caution.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proof: Option<Proof>,
    /// Where the policy was allowed to lie; left out without caution.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trust_region: Option<Region>,
    /// Every warning of the guard; left out without one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<GuardWarning>,
}

/// Wall-clock seconds; the only numbers here that differ from run to run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SecondsSummary {
    /// By kind of work.
    #[serde(flatten)]
    pub by_work: Seconds,
    /// All of it.
    pub total: f64,
}

const fn first() -> u32 {
    1
}

/// `summary.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Version of this format; left out by earlier versions, which wrote the same.
    #[serde(default = "first")]
    pub format: u32,
    /// Name of the task.
    pub experiment: String,
    /// Root of every random stream.
    pub seed: u64,
    /// Strides made on the robot.
    pub strides: StrideCounts,
    /// Iterations of Algorithm 1.
    pub iterations: Vec<IterationSummary>,
    /// The iteration whose policy is the final one, or the best so far; null where that is the nominal gait.
    pub final_iteration: Option<usize>,
    /// Whether the final policy is a learned one: false where none beat the nominal gait, which is final then;
    /// null until the final policy was measured.
    #[serde(default)]
    pub improved: Option<bool>,
    /// The nominal gait, measured; null until it was.
    pub nominal: Option<Measured>,
    /// The final policy, measured; null until it was.
    #[serde(rename = "final")]
    pub final_policy: Option<Measured>,
    /// Every fall and stall on the robot with its cause, those of starts and record strides as well.
    #[serde(default)]
    pub falls: Vec<RobotFall>,
    /// Time spent.
    pub seconds: SecondsSummary,
}

impl Summary {
    /// Counts the strides of a phase that was broken off, and the falls in its iteration, as if they were of a
    /// finished one; aborted ones are none.
    pub fn count(&mut self, unfinished: &[Transition]) {
        for t in unfinished.iter().filter(|t| t.end != StrideEnd::Aborted) {
            *match t.role {
                StrideRole::Training => &mut self.strides.training,
                StrideRole::Evaluation => &mut self.strides.evaluation,
                StrideRole::Record => &mut self.strides.record,
            } += 1;
            if t.phase == StridePhase::Record {
                continue;
            }
            if self.iterations.len() < t.iteration {
                let before = self.iterations.last();
                self.iterations.push(IterationSummary {
                    iteration: t.iteration,
                    strides_so_far: before.map_or(0, |i| i.strides_so_far),
                    falls_so_far: before.map_or(0, |i| i.falls_so_far),
                    ..IterationSummary::default()
                });
            }
            let fell = |f: &&RobotFall| {
                (f.iteration, f.fall.criterion.end()) == (t.iteration, StrideEnd::Fell)
                    && f.phase != StridePhase::Record
            };
            let falls = self.falls.iter().filter(fell).count();
            if let Some(i) = self.iterations.last_mut() {
                i.strides += 1;
                i.strides_so_far += 1;
                i.falls_so_far += falls.saturating_sub(i.falls);
                i.falls = i.falls.max(falls);
            }
        }
    }
}
