//! `bench learners`: learners and controls side by side on several tasks; what was run is kept, a line of JSON each, and
//! not run again.

use std::path::Path;

use serde::{Deserialize, Serialize};
use stridemap_lab::{LearnerKind, PairedDifference, Task, builtin, learners, paired_difference, run_learner};
use stridemap_record::{Measured, Summary, files};

use super::learners::interval;
use crate::failure::Failure;
use crate::output;
use crate::parallel;

/// The tasks.
const TASKS: [&str; 3] = ["stepping", "walking", "zmp-walking"];
/// The first seed: none on which a setting was chosen.
const FIRST_SEED: u64 = 4201;
/// Where the lines are.
const LINES: &str = "learners.jsonl";

/// A run.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Line {
    task: String,
    learner: String,
    seed: u64,
    success: bool,
    /// Speed of the final policy, m/s, where walks are measured; otherwise its mean reward.
    value: f64,
    /// The same of the nominal gait.
    nominal: f64,
    strides: usize,
    falls: usize,
    /// Of computing for fit and improvement.
    seconds: f64,
}

/// What a learner came to on a task.
#[derive(Clone, Debug, Serialize)]
struct Row {
    task: String,
    learner: String,
    seeds: usize,
    successes: usize,
    value: PairedDifference,
    /// Over the nominal gait, for a hundred strides on the robot.
    gain_per_100_strides: PairedDifference,
    falls_a_run: f64,
    seconds_a_run: f64,
}

/// Runs what is missing, keeps it, and prints the table of all that is there.
pub fn bench(out: &Path, seeds: u64, only: Option<&str>, json: bool) -> Result<(), Failure> {
    let path = out.join(LINES);
    let mut lines = if path.exists() { read(&path)? } else { Vec::new() };
    let mut jobs: Vec<(Task, LearnerKind, u64)> = Vec::new();
    for name in TASKS {
        let task = builtin::load(name, &[])?.task;
        for part in learners().all() {
            let kind = LearnerKind(part);
            if only.is_some_and(|only| {
                !format!("{name}/{}", kind.name()).contains(&only.replace('-', "_")) && !name.contains(only)
            }) {
                continue;
            }
            let mut of_kind = task.clone();
            of_kind.learner.kind = kind;
            if of_kind.validate().is_err() {
                output::note(format!("{name}: not a task for {}", kind.name()));
                continue;
            }
            let there = |seed: u64| {
                lines.iter().any(|l| (l.task.as_str(), l.learner.as_str(), l.seed) == (name, kind.name(), seed))
            };
            let missing = parallel::seeds(FIRST_SEED, seeds)?.into_iter().filter(|seed| !there(*seed));
            jobs.extend(missing.map(|seed| (task.clone(), kind, seed)));
        }
    }
    files::create_dir(out)?;
    // A batch at a time, so that little is lost where it is cut off.
    const BATCH: usize = 8;
    for batch in jobs.chunks(BATCH) {
        let told = |(task, kind, seed): &(Task, LearnerKind, u64), _: &Result<Line, Failure>| {
            format!("{} by {}, seed {seed}", task.name, kind.name())
        };
        lines.extend(parallel::over(batch, None, told, |(task, kind, seed)| run(task, *kind, *seed))?);
        let text: Result<Vec<String>, _> = lines.iter().map(serde_json::to_string).collect();
        let text = text.map_err(|error| Failure::working(error.to_string()))?;
        files::write_whole(&path, (text.join("\n") + "\n").as_bytes())?;
    }
    let rows = table(&lines);
    if json {
        return output::json(&rows);
    }
    output::line(
        "task         learner                seeds  success  final, mean [95 %]           falls a run   computing",
    );
    for row in rows {
        output::line(format!(
            "{:<12} {:<22} {:>5}  {:>7}  {:<28} {:>11.2}  {:>8.1} s",
            row.task,
            row.learner,
            row.seeds,
            row.successes,
            interval(&row.value, 4),
            row.falls_a_run,
            row.seconds_a_run
        ));
    }
    output::line(path.display().to_string());
    Ok(())
}

fn read(path: &Path) -> Result<Vec<Line>, Failure> {
    let text =
        std::fs::read_to_string(path).map_err(|error| Failure::request(format!("{}: {error}", path.display())))?;
    let line = |(i, line): (usize, &str)| {
        serde_json::from_str(line).map_err(|error| {
            Failure::request(format!("{}, line {}: {error}; delete the line to run it again", path.display(), i + 1))
        })
    };
    text.lines().enumerate().map(line).collect()
}

fn run(task: &Task, kind: LearnerKind, seed: u64) -> Result<Line, Failure> {
    let summary: Summary = run_learner(task, kind, seed)?;
    let value = |measured: Option<&Measured>| {
        measured.map_or(0.0, |m| m.performance.walk.map_or(m.performance.mean_reward, |walk| walk.speed_m_s))
    };
    let strides = summary.strides.training + summary.strides.evaluation;
    let falls: usize = summary.iterations.iter().map(|i| i.falls).sum();
    let last = summary.final_policy.as_ref();
    Ok(Line {
        task: task.name.clone(),
        learner: kind.name().into(),
        seed,
        success: last.is_some_and(|m| task.is_success(&m.performance, strides, falls)),
        value: value(last),
        nominal: value(summary.nominal.as_ref()),
        strides,
        falls,
        seconds: summary.seconds.by_work.fit + summary.seconds.by_work.improve,
    })
}

/// A row for each task and learner, in the order in which they were run.
fn table(lines: &[Line]) -> Vec<Row> {
    let mut order: Vec<(&str, &str)> = Vec::new();
    for line in lines {
        let key = (line.task.as_str(), line.learner.as_str());
        if !order.contains(&key) {
            order.push(key);
        }
    }
    let row = |(task, learner): &(&str, &str)| {
        let own: Vec<&Line> =
            lines.iter().filter(|l| (l.task.as_str(), l.learner.as_str()) == (*task, *learner)).collect();
        let n = own.len();
        let mean_of = |of: &dyn Fn(&Line) -> f64| {
            let values: Vec<f64> = own.iter().map(|l| of(l)).collect();
            paired_difference(&values, &vec![0.0; n])
        };
        Row {
            task: (*task).into(),
            learner: (*learner).into(),
            seeds: n,
            successes: own.iter().filter(|l| l.success).count(),
            value: mean_of(&|l| l.value),
            gain_per_100_strides: mean_of(&|l| 100.0 * (l.value - l.nominal) / l.strides.max(1) as f64),
            falls_a_run: mean_of(&|l| l.falls as f64).mean,
            seconds_a_run: mean_of(&|l| l.seconds).mean,
        }
    };
    order.iter().map(row).collect()
}
