//! The iterations of Algorithm 1: what a killed run goes on from.

use serde::{Deserialize, Serialize};

use crate::measured::Performance;
use crate::stride::RobotFall;

/// Wall-clock seconds spent, by kind of work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// On the robot: simulation, sections, gait.
    pub simulation: f64,
    /// Fitting maps.
    pub fit: f64,
    /// Learning in maps.
    pub improve: f64,
}

/// One iteration of Algorithm 1, as far as it has come.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// From 1.
    pub iteration: usize,
    /// Strides on the robot that this iteration made, training and evaluation.
    pub strides: usize,
    /// Falls on the robot in this iteration, in warm-up as well.
    pub falls: usize,
    /// Stalls on the robot in this iteration, in warm-up as well.
    pub stalls: usize,
    /// Warm-up strides of this iteration.
    pub warm_up: usize,
    /// Log marginal likelihood of each output of the map.
    pub log_marginal_likelihood: Vec<f64>,
    /// The policy as evaluated on the robot to choose; `None` without evaluation strides.
    pub evaluation: Option<Performance>,
    /// How the robot stepped in place at the start of this iteration's batch; where a threshold is
    /// relative to it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_place: Option<InPlace>,
    /// Spread of what the map of this iteration cannot predict of the pitch rate (leave one out; by
    /// the median, because strides before a fall are not what is usual); with caution only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_rate_residual_deg_s: Option<f64>,
    /// What became of the policy on the robot; with caution only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proof: Option<Proof>,
    /// Where the policy was allowed to lie; with caution only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trust_region: Option<Region>,
    /// Every warning of the guard, in exploration and proof; with caution only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<GuardWarning>,
    /// The policy as measured on the robot to report.
    pub record: Option<Performance>,
    /// The policy as measured to be final, if that did not beat the nominal gait: it is not handed out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejected: Option<Performance>,
}

/// A phase of a run, in the order in which they come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// The nominal gait was measured.
    Nominal,
    /// The strides of this iteration were collected.
    Collect,
    /// The policy of this iteration was improved (the map is fitted anew from the strides).
    Improve,
    /// The policy was evaluated on the robot.
    Evaluate,
    /// The policy was measured to report.
    Record,
    /// The final policy was measured.
    Final,
}

/// How the robot steps in place, from the warm-up strides of its last start: what thresholds are
/// relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InPlace {
    /// Sections seen after the gait's start-up.
    pub sections: usize,
    /// Mean `ψ_roll` over them.
    pub psi_roll_deg: f64,
    /// Mean change of `ψ̇_pitch` from one of them to the next, in magnitude.
    pub pitch_rate_change_deg_s: f64,
}

impl InPlace {
    /// The mean over sections with these `(ψ_roll, ψ̇_pitch)`, in degrees and degrees per second.
    #[must_use]
    pub fn of(sections: &[(f64, f64)]) -> Self {
        let n = sections.len();
        let psi_roll_deg = sections.iter().map(|(psi, _)| psi).sum::<f64>() / n.max(1) as f64;
        let changes = sections.windows(2).map(|w| (w[1].1 - w[0].1).abs());
        Self {
            sections: n,
            psi_roll_deg,
            pitch_rate_change_deg_s: changes.sum::<f64>() / n.saturating_sub(1).max(1) as f64,
        }
    }
}

/// What became of a policy on the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It walked the full proof without a warning.
    Proven,
    /// It walked the trial and was no faster than the best proven policy.
    Slower,
    /// The guard warned.
    Warned,
    /// It fell.
    Fell,
    /// The budget of strides ended before the proof.
    Unfinished,
}

/// A policy's trial or proof on the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proof {
    /// What became of it.
    pub verdict: Verdict,
    /// What the guard warned of, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warning: Option<Warning>,
    /// Speed along the first heading after the policy had settled.
    pub speed_m_s: f64,
    /// Strides without a warning.
    pub strides: usize,
    /// How often the policy was tried, shrunk in between.
    pub attempts: usize,
    /// The mean action applied after the policy had settled.
    pub action: Vec<f64>,
}

impl Proof {
    /// Whether the policy walked the full proof.
    #[must_use]
    pub fn is_proven(&self) -> bool {
        self.verdict == Verdict::Proven
    }

    /// Index of the fastest proven one, the earlier of equals.
    #[must_use]
    pub fn best(proofs: &[&Self]) -> Option<usize> {
        let proven = proofs.iter().enumerate().filter(|(_, p)| p.is_proven());
        proven
            .fold(None, |best: Option<(usize, f64)>, (i, p)| match best {
                Some((_, most)) if most >= p.speed_m_s => best,
                _ => Some((i, p.speed_m_s)),
            })
            .map(|(i, _)| i)
    }

    /// Index of the policy to learn on from: the fastest proven one; without one, the one that walked longest
    /// before its warning, the later of equals.
    #[must_use]
    pub fn start(proofs: &[&Self]) -> Option<usize> {
        Self::best(proofs).or_else(|| {
            let by_strides = proofs.iter().enumerate().max_by_key(|(_, p)| p.strides);
            by_strides.map(|(i, _)| i)
        })
    }
}

/// A warning, and the stride that gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GuardWarning {
    /// Among this iteration's strides on the robot, from 1.
    pub stride: usize,
    /// What the guard saw.
    pub warning: Warning,
}

/// What the guard saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Warning {
    /// The pitch rate alternates.
    Flip,
    /// The robot turns.
    Turn,
    /// The mass is near the outer edge of the foot.
    LowRoll,
    /// The mass sways less and less far over the foot.
    HighMeanRoll,
}

impl Warning {
    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Flip => "flip",
            Self::Turn => "turn",
            Self::LowRoll => "low_roll",
            Self::HighMeanRoll => "high_mean_roll",
        }
    }
}

/// A box of actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Lowest, per component.
    pub lower: Vec<f64>,
    /// Highest, per component.
    pub upper: Vec<f64>,
}

impl Region {
    /// The point of the region nearest to another.
    #[must_use]
    pub fn nearest(&self, point: &[f64]) -> Vec<f64> {
        let bounds = self.lower.iter().zip(&self.upper);
        point.iter().zip(bounds).map(|(p, (l, u))| p.clamp(*l, *u)).collect()
    }
}

/// `checkpoint.json`: what a killed run goes on from.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// Version of this format.
    pub format: u32,
    /// Root of every random stream; left out by earlier versions.
    #[serde(default)]
    pub seed: Option<u64>,
    /// The phase that ended.
    pub phase: Phase,
    /// Rows of `transitions.csv` that belong to finished phases.
    pub transition_rows: usize,
    /// Rows of `record.csv` likewise.
    pub record_rows: usize,
    /// Rows of `learning.csv` likewise.
    pub learning_rows: usize,
    /// Policies improved.
    pub policies: usize,
    /// Iterations begun.
    pub iterations: Vec<Iteration>,
    /// The nominal gait, measured.
    pub nominal: Option<Performance>,
    /// The final policy, measured.
    pub final_performance: Option<Performance>,
    /// Strides run only to report.
    pub record_strides: usize,
    /// Time spent, by kind of work.
    pub seconds: Seconds,
    /// Every fall and stall on the robot; left out by earlier versions.
    #[serde(default)]
    pub falls: Vec<RobotFall>,
}
