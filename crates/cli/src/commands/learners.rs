//! `compare` on a task with a trust region: the task's learner beside the controls without a map.

use std::path::Path;

use serde::Serialize;
use stridemap_lab::{LearnerKind, LearnerRow, PairedDifference, Task, paired_difference, run_learner};

use crate::args::Common;
use crate::failure::Failure;
use crate::output;
use crate::parallel;
use stridemap_record::files;

/// The task's learner less one control, paired by seed.
#[derive(Clone, Debug, Serialize)]
struct Against {
    control: LearnerKind,
    final_ratio: f64,
    first_speed_m_s: PairedDifference,
    final_speed_m_s: PairedDifference,
}

/// What `compare --json` prints for learners.
#[derive(Clone, Debug, Serialize)]
struct Learners {
    experiment: String,
    seeds: u64,
    rows: Vec<LearnerRow>,
    differences: Vec<Against>,
}

/// Runs the task's learner and the controls for several seeds, writes and prints the table.
///
/// `task_of` gives a seed's task: the robot may be another individual of its kind.
pub fn compare(
    task_of: &(dyn Fn(u64) -> Result<Task, Failure> + Sync),
    seeds: u64,
    out: Option<&Path>,
    common: &Common,
) -> Result<(), Failure> {
    let task = &task_of(common.seed)?;
    let own = task.learner.kind;
    let mut kinds = vec![own];
    kinds.extend(LearnerKind::CONTROLS.iter().filter(|k| **k != own));
    if task.learner.integral.is_some() {
        kinds.push(LearnerKind::INTEGRAL);
    }
    let jobs: Vec<(LearnerKind, u64)> = parallel::seeds(common.seed, seeds)?
        .into_iter()
        .flat_map(|seed| kinds.iter().map(move |k| (*k, seed)))
        .collect();
    let runs = parallel::over(
        &jobs,
        common.threads,
        |(kind, seed), _| format!("{} seed {seed}", kind.name()),
        |&(kind, seed)| task_of(seed).and_then(|task| Ok(run_learner(&task, kind, seed)?)),
    )?;
    let rows: Vec<LearnerRow> = kinds
        .iter()
        .map(|kind| {
            let of_kind = jobs.iter().zip(&runs).filter(|((k, _), _)| k == kind);
            let own: Vec<_> = of_kind.map(|(_, run)| run.clone()).collect();
            LearnerRow::of(*kind, &own, task)
        })
        .collect();
    let ours = &rows[0];
    let differences = rows[1..]
        .iter()
        .map(|row| Against {
            control: row.learner,
            final_ratio: ours.final_median_m_s() / row.final_median_m_s(),
            first_speed_m_s: paired_difference(&ours.first_speed_m_s, &row.first_speed_m_s),
            final_speed_m_s: paired_difference(&ours.final_speed_m_s, &row.final_speed_m_s),
        })
        .collect();
    let shown = Learners { experiment: task.name.clone(), seeds, rows: rows.clone(), differences };
    let dir = super::compare::compared_in(out, task, common);
    files::create_dir(&dir)?;
    files::write_json(&dir.join("compare.json"), &shown)?;
    files::write_whole(&dir.join("learners.csv"), curves(&rows).as_bytes())?;
    if common.json {
        return output::json(&shown);
    }
    print(&shown);
    output::line(format!("{}", dir.join("learners.csv").display()));
    Ok(())
}

/// Speed and falls against strides, one line per learner and count of strides.
fn curves(rows: &[LearnerRow]) -> String {
    let mut text = String::from("learner,strides,median_speed_m_s,falls\n");
    for row in rows {
        for p in &row.curve {
            text += &format!("{},{},{},{}\n", row.learner.name(), p.strides, p.median_speed_m_s, p.falls);
        }
    }
    text
}

/// A difference and its 95 % interval, to so many decimals.
pub fn interval(d: &PairedDifference, decimals: usize) -> String {
    match (d.low, d.high) {
        (Some(low), Some(high)) => format!("{:+.decimals$} [{low:+.decimals$}, {high:+.decimals$}]", d.mean),
        _ => format!("{:+.decimals$}", d.mean),
    }
}

fn print(shown: &Learners) {
    output::line(format!(
        "{}, {} seeds: speed over the walk in m/s\n\nlearner       first median / that fall   final \
         median / worst / upright   falls a run",
        shown.experiment, shown.seeds
    ));
    for row in &shown.rows {
        output::line(format!(
            "{:<13} {:>7.3} / {:<17} {:>8.3} / {:.3} / {:<11} {:>6.2}",
            row.learner.name(),
            row.first_median_m_s(),
            row.first_falls,
            row.final_median_m_s(),
            row.final_worst_m_s(),
            row.final_upright,
            row.falls_a_run(),
        ));
    }
    output::line("\nstrides      speed of the policy that would be final / falls so far, per learner");
    let points = shown.rows.first().map_or(0, |r| r.curve.len());
    for i in (0..points).filter(|i| i % 2 == 1) {
        let cells: Vec<String> = shown
            .rows
            .iter()
            .map(|r| {
                let p = &r.curve[i];
                format!("{} {:.3} / {:.2}", r.learner.name(), p.median_speed_m_s, p.falls)
            })
            .collect();
        output::line(format!("{:>7}      {}", shown.rows[0].curve[i].strides, cells.join("   ")));
    }
    output::line("\npaired differences over seeds, 95 % confidence");
    for d in &shown.differences {
        output::line(format!(
            "  against {:<10} first {}   final {}   ratio of final medians {:.2}",
            d.control.name(),
            interval(&d.first_speed_m_s, 3),
            interval(&d.final_speed_m_s, 3),
            d.final_ratio
        ));
    }
}
