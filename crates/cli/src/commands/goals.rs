//! `compare` on a task with goals: planning in the map, affine laws from it, and the controls, on the same strides and
//! measured on the same goals.

use std::path::Path;

use serde::Serialize;
use stridemap_lab::{LearnerKind, Task, paired_difference, run_learner};
use stridemap_record::{RandomGoals, Summary, files};

use crate::args::Common;
use crate::failure::Failure;
use crate::output;
use crate::parallel;

/// What one learner came to after so many strides, over seeds.
#[derive(Clone, Debug, Serialize)]
struct Point {
    learner: LearnerKind,
    strides: usize,
    /// Mean over seeds, and each seed's.
    #[serde(rename = "J")]
    cost: f64,
    #[serde(rename = "J_of_seeds")]
    costs: Vec<f64>,
    rms_vx_m_s: Option<f64>,
    rms_vy_m_s: Option<f64>,
    rms_wz_rad_s: Option<f64>,
    cost_of_transport: f64,
    /// Falls and strides of the measurement.
    falls: usize,
    measured_strides: usize,
    /// Falls while learning, to here.
    learning_falls: usize,
    /// The task's own learner over this one, of the same seeds: geometric mean of J over J, with its 95 % interval.
    ratio: Ratio,
}

/// A ratio and its 95 % interval, paired by seed.
#[derive(Clone, Copy, Debug, Serialize)]
struct Ratio {
    mean: f64,
    low: Option<f64>,
    high: Option<f64>,
}

/// What `compare --json` prints for a task with goals.
#[derive(Clone, Debug, Serialize)]
struct GoalLearners {
    experiment: String,
    seeds: u64,
    sets: Vec<String>,
    points: Vec<Point>,
}

/// What a run had come to after so many strides: of the last iteration that made no more.
fn after(run: &Summary, strides: usize) -> Option<(RandomGoals, usize)> {
    let iteration = run.iterations.iter().rfind(|i| i.strides_so_far <= strides)?;
    Some((iteration.random_goals?, iteration.falls_so_far))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn ratio(own: &[f64], other: &[f64]) -> Ratio {
    let log = |values: &[f64]| values.iter().map(|v| v.max(1e-9).ln()).collect::<Vec<f64>>();
    let d = paired_difference(&log(own), &log(other));
    Ratio { mean: d.mean.exp(), low: d.low.map(f64::exp), high: d.high.map(f64::exp) }
}

fn point(learner: LearnerKind, strides: usize, runs: &[Summary], own: &[Summary]) -> Option<Point> {
    let of = |runs: &[Summary]| runs.iter().map(|run| after(run, strides)).collect::<Option<Vec<_>>>();
    let (made, own) = (of(runs)?, of(own)?);
    let costs: Vec<f64> = made.iter().map(|(goals, _)| goals.cost).collect();
    let of_own: Vec<f64> = own.iter().map(|(goals, _)| goals.cost).collect();
    let rms = |of: fn(&RandomGoals) -> Option<f64>| {
        let all: Option<Vec<f64>> = made.iter().map(|(goals, _)| of(goals)).collect();
        all.map(|all| mean(all.into_iter()))
    };
    Some(Point {
        learner,
        strides,
        cost: mean(costs.iter().copied()),
        ratio: ratio(&of_own, &costs),
        costs,
        rms_vx_m_s: rms(|g| g.rms_vx_m_s),
        rms_vy_m_s: rms(|g| g.rms_vy_m_s),
        rms_wz_rad_s: rms(|g| g.rms_wz_rad_s),
        cost_of_transport: mean(made.iter().map(|(goals, _)| goals.cost_of_transport)),
        falls: made.iter().map(|(goals, _)| goals.falls).sum(),
        measured_strides: made.iter().map(|(goals, _)| goals.strides).sum(),
        learning_falls: made.iter().map(|(_, falls)| falls).sum(),
    })
}

/// Runs the task's learner and what stands beside it for several seeds, writes and prints the table.
///
/// `task_of` gives a seed's task: the robot may be another individual of its kind.
pub fn compare(
    task_of: &(dyn Fn(u64) -> Result<Task, Failure> + Sync),
    seeds: u64,
    out: Option<&Path>,
    common: &Common,
) -> Result<(), Failure> {
    let without_sweep = |seed| {
        let mut task = task_of(seed)?;
        task.record.sweep = false;
        task.record.pose_seconds = 0.0;
        Ok::<Task, Failure>(task)
    };
    let task = &without_sweep(common.seed)?;
    let own = task.learner.kind;
    let mut kinds = vec![own];
    kinds.extend(LearnerKind::GOALS.iter().filter(|k| **k != own));
    let list = parallel::seeds(common.seed, seeds)?;
    let jobs: Vec<(LearnerKind, u64)> =
        list.iter().flat_map(|seed| kinds.iter().map(move |kind| (*kind, *seed))).collect();
    let runs = parallel::over(
        &jobs,
        common.threads,
        |(kind, seed), _| format!("{} seed {seed}", kind.name()),
        |&(kind, seed)| without_sweep(seed).and_then(|task| Ok(run_learner(&task, kind, seed)?)),
    )?;
    let of_kind = |kind: LearnerKind| -> Vec<Summary> {
        let own = jobs.iter().zip(&runs).filter(|((k, _), _)| *k == kind);
        own.map(|(_, run)| run.clone()).collect()
    };
    let ours = of_kind(own);
    let mut marks: Vec<usize> = vec![80, task.algorithm.strides_at_most.unwrap_or(200)];
    marks.retain(|mark| ours.iter().all(|run| after(run, *mark).is_some()));
    marks.dedup();
    let mut points = Vec::new();
    for kind in kinds {
        let runs = of_kind(kind);
        points.extend(marks.iter().filter_map(|mark| point(kind, *mark, &runs, &ours)));
    }
    let shown = GoalLearners { experiment: task.name.clone(), seeds, sets: common.sets.clone(), points };
    let dir = super::compare::compared_in(out, task, common);
    files::create_dir(&dir)?;
    files::write_json(&dir.join("compare.json"), &shown)?;
    if common.json {
        return output::json(&shown);
    }
    print(&shown);
    output::line(format!("{}", dir.join("compare.json").display()));
    Ok(())
}

fn print(shown: &GoalLearners) {
    output::line(format!(
        "{}, {} seeds {}\n\nlearner              strides      J    rms vx / vy / wz     CoT   falls   while learning   ratio \
         of J to it [95 %]",
        shown.experiment,
        shown.seeds,
        shown.sets.join(" ")
    ));
    for p in &shown.points {
        let rms = |v: Option<f64>| v.map_or("  -  ".into(), |v| format!("{v:.3}"));
        let interval = match (p.ratio.low, p.ratio.high) {
            (Some(low), Some(high)) => format!("{:.2} [{low:.2}, {high:.2}]", p.ratio.mean),
            _ => format!("{:.2}", p.ratio.mean),
        };
        output::line(format!(
            "{:<20} {:>7} {:>6.2}   {} / {} / {}   {:>5.3}   {:>5}   {:>14}   {interval}",
            p.learner.name(),
            p.strides,
            p.cost,
            rms(p.rms_vx_m_s),
            rms(p.rms_vy_m_s),
            rms(p.rms_wz_rad_s),
            p.cost_of_transport,
            p.falls,
            p.learning_falls,
        ));
    }
}
