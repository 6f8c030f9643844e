//! Learners side by side on one task: the task's own and the controls without a map, with the same
//! strides, limits, trust region, guard and proof.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::algorithm::Algorithm;
use crate::error::LabError;
use crate::learner::LearnerKind;
use crate::recorder::NoRecorder;
use crate::task::Task;
use stridemap_record::{Spread, Summary, Verdict, WalkTimes};

/// Runs a task with one learner and keeps nothing but the summary.
///
/// # Errors
///
/// [`LabError`] of the room at fault.
pub fn run_learner(task: &Task, kind: LearnerKind, seed: u64) -> Result<Summary, LabError> {
    let mut task = task.clone();
    task.learner.kind = kind;
    task.validate()?;
    let mut algorithm = Algorithm::new(&task, seed)?.however_often_it_falls();
    algorithm.learn(&mut NoRecorder)?;
    Ok(algorithm.progress.summary(&task, seed))
}

/// A mean difference over seeds with its 95 % confidence interval (Student's t, paired).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairedDifference {
    /// Mean of first less second.
    pub mean: f64,
    /// Lower end of the interval; null for one pair.
    pub low: Option<f64>,
    /// Upper end of the interval; null for one pair.
    pub high: Option<f64>,
    /// Pairs.
    pub pairs: usize,
}

/// The mean of `a − b`, pair by pair, and its confidence interval.
///
/// # Example
///
/// Differences 1, 2, 3: mean 2, standard error 1/√3, t₀.₉₇₅ with 2 degrees of freedom 4.303.
///
/// ```
/// let d = stridemap_lab::paired_difference(&[2.0, 4.0, 6.0], &[1.0, 2.0, 3.0]);
/// assert_eq!(d.mean, 2.0);
/// assert!((d.high.unwrap() - (2.0 + 4.302_65 / 3f64.sqrt())).abs() < 1e-4);
/// ```
#[must_use]
pub fn paired_difference(a: &[f64], b: &[f64]) -> PairedDifference {
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    let n = differences.len();
    let Spread { mean, sd } = Spread::of(&differences);
    let half = sd.and_then(|sd| {
        let t = StudentsT::new(0.0, 1.0, n as f64 - 1.0).ok()?;
        Some(t.inverse_cdf(0.975) * sd / (n as f64).sqrt())
    });
    PairedDifference { mean, low: half.map(|h| mean - h), high: half.map(|h| mean + h), pairs: n }
}

/// Speed and falls after some strides, over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnerPoint {
    /// Training and evaluation strides.
    pub strides: usize,
    /// Median over seeds of the speed on the ground of the policy that would then be final; zero
    /// before there is one.
    pub median_speed_m_s: f64,
    /// Falls a run until then.
    pub falls: f64,
}

/// What one learner came to over seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnerRow {
    /// The learner.
    pub learner: LearnerKind,
    /// Speed of the first policy after its evaluation, one per seed.
    pub first_speed_m_s: Vec<f64>,
    /// First policies that do not walk to the end of the measurement.
    pub first_falls: usize,
    /// Speed of the final policy, one per seed.
    pub final_speed_m_s: Vec<f64>,
    /// Final policies that walk to the end.
    pub final_upright: usize,
    /// Falls a run, one per seed.
    pub falls: Vec<usize>,
    /// Speed and falls against strides.
    pub curve: Vec<LearnerPoint>,
}

/// Median; zero of nothing.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

impl LearnerRow {
    /// Sums up the runs of one learner.
    #[must_use]
    pub fn of(learner: LearnerKind, runs: &[Summary], task: &Task) -> Self {
        const STEP: usize = 20;
        let budget = task.algorithm.strides_at_most.unwrap_or(300);
        let walks = |times: Option<WalkTimes>| times.map_or(0.0, |t| t.walk_s);
        let (first_s, final_s) = (walks(task.record.iteration_walk()), walks(task.record.walk()));
        let firsts = || runs.iter().filter_map(|r| r.iterations.first());
        let finals = || runs.iter().filter_map(|r| r.final_policy);
        let speed_at = |run: &Summary, strides: usize| {
            let done = run.iterations.iter().take_while(|i| i.strides_so_far <= strides);
            let proven = done.filter_map(|i| {
                let proof = i.proof.as_ref()?;
                let proven = proof.verdict == Verdict::Proven;
                proven.then_some((proof.speed_m_s, i.speed_m_s?))
            });
            let best = proven.fold(None, |best: Option<(f64, f64)>, p| match best {
                Some(b) if b.0 >= p.0 => Some(b),
                _ => Some(p),
            });
            best.map_or(0.0, |(_, speed)| speed)
        };
        let falls_at = |run: &Summary, strides: usize| {
            let done = run.iterations.iter().filter(|i| i.strides_so_far <= strides);
            done.map(|i| i.falls).sum::<usize>()
        };
        let curve = (1..=budget / STEP).map(|i| {
            let strides = i * STEP;
            let speeds: Vec<f64> = runs.iter().map(|r| speed_at(r, strides)).collect();
            let falls: usize = runs.iter().map(|r| falls_at(r, strides)).sum();
            LearnerPoint { strides, median_speed_m_s: median(&speeds), falls: falls as f64 / runs.len().max(1) as f64 }
        });
        Self {
            learner,
            first_speed_m_s: firsts().map(|i| i.speed_m_s.unwrap_or(0.0)).collect(),
            first_falls: firsts().filter(|i| i.upright_s.is_some_and(|s| s < first_s)).count(),
            final_speed_m_s: finals().map(|f| f.speed_m_s.unwrap_or(0.0)).collect(),
            final_upright: finals().filter(|f| f.upright_s.is_some_and(|s| s >= final_s)).count(),
            falls: runs.iter().map(|r| r.iterations.iter().map(|i| i.falls).sum()).collect(),
            curve: curve.collect(),
        }
    }

    /// Median speed of the first policy.
    #[must_use]
    pub fn first_median_m_s(&self) -> f64 {
        median(&self.first_speed_m_s)
    }

    /// Median speed of the final policy.
    #[must_use]
    pub fn final_median_m_s(&self) -> f64 {
        median(&self.final_speed_m_s)
    }

    /// Slowest final policy.
    #[must_use]
    pub fn final_worst_m_s(&self) -> f64 {
        let all = self.final_speed_m_s.iter().copied();
        all.fold(f64::INFINITY, f64::min)
    }

    /// Mean number of falls of a run.
    #[must_use]
    pub fn falls_a_run(&self) -> f64 {
        self.falls.iter().sum::<usize>() as f64 / self.falls.len().max(1) as f64
    }
}
