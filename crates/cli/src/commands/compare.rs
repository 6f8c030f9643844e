//! `compare`: learning in the map against learning on the robot itself.

use std::path::{Path, PathBuf};

use serde::Serialize;
use stridemap_lab::{
    CompareSeed, PairedDifference, STRIDES_PER_POINT, Steered, Task, builtin, can_steer, compare_seed, learning_curves,
    paired_difference, steer,
};
use stridemap_learn::{Policy, SavedPolicy};
use stridemap_record::{ComparePoint, Spread, files};
use stridemap_report::figures::{Fig8, Fig9, PolicyCurve, fig8, fig9};

use super::learners::interval;
use super::on_robot;
use crate::args::Common;
use crate::failure::Failure;
use crate::output;
use crate::parallel;

/// What `compare --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Name of the task.
    pub experiment: String,
    /// Seeds behind every mean and standard deviation.
    pub seeds: u64,
    /// Strides on the robot per seed: for the map, and for learning on it.
    pub robot_strides: RobotStrides,
    /// The two learning curves; the first entry is before any learning.
    pub trials: Vec<ComparePoint>,
    /// What the curves show, in words.
    pub finding: Finding,
}

/// Strides and falls on the robot that each arm needed, summed over seeds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RobotStrides {
    /// Collected for the map.
    pub gp: usize,
    /// Made by learning on the robot.
    pub full: usize,
    /// Falls while collecting for the map.
    pub gp_falls: usize,
    /// Falls while learning on the robot.
    pub full_falls: usize,
}

/// What the curves show of the paper's two observations: the map's varies more early, and is better late.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Finding {
    /// Mean over the first half of the trials of the standard deviation over seeds.
    pub early_sd: Pair,
    /// Mean reward over the last quarter of the trials.
    pub late_mean: Pair,
    /// The same, map less robot, paired by seed, with its 95 % interval.
    pub late_difference: PairedDifference,
    /// Reward after the last trial, map less robot, likewise.
    pub last_difference: PairedDifference,
}

/// One number for each arm.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Pair {
    /// Learned in the map.
    pub gp: f64,
    /// Learned on the robot.
    pub full: f64,
}

fn finding(trials: &[ComparePoint], arms: &[CompareSeed]) -> Finding {
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let half = &trials[1.min(trials.len())..trials.len().div_ceil(2)];
    let late = &trials[trials.len() - trials.len().div_ceil(4)..];
    let difference = |last: usize| {
        let of = |curve: &dyn Fn(&CompareSeed) -> &[f64]| -> Vec<f64> {
            let kept = |a| &curve(a)[trials.len() - last.min(trials.len())..trials.len()];
            arms.iter().map(|a| mean(kept(a).to_vec())).collect()
        };
        paired_difference(&of(&|a| &a.gp), &of(&|a| &a.full))
    };
    let sd = |s: &Spread| s.sd.unwrap_or(0.0);
    let early_sd = Pair {
        gp: mean(half.iter().map(|t| sd(&t.gp)).collect()),
        full: mean(half.iter().map(|t| sd(&t.full)).collect()),
    };
    let late_mean = Pair {
        gp: mean(late.iter().map(|t| t.gp.mean).collect()),
        full: mean(late.iter().map(|t| t.full.mean).collect()),
    };
    Finding { early_sd, late_mean, late_difference: difference(late.len()), last_difference: difference(1) }
}

/// A seed's task: the robot may be another individual of its kind.
fn task_of(name: &str, common: &Common, seed: u64) -> Result<Task, Failure> {
    Ok(on_robot(builtin::load(name, &common.sets)?, &Common { seed, ..common.clone() })?.task)
}

/// Where a comparison goes: as asked for, or `runs/compare-TASK-SEED`.
pub fn compared_in(out: Option<&Path>, task: &Task, common: &Common) -> PathBuf {
    out.map_or_else(|| Path::new("runs").join(format!("compare-{}-{}", task.name, common.seed)), Path::to_path_buf)
}

/// Runs both arms for several seeds in parallel.
pub fn run_arms(name: &str, seeds: u64, common: &Common) -> Result<(Comparison, Vec<CompareSeed>), Failure> {
    let task = task_of(name, common, common.seed)?;
    let list = parallel::seeds(common.seed, seeds)?;
    let arms =
        parallel::over(&list, common.threads, |seed, _| format!("seed {seed}"), |&seed| compare_seed(&task, seed))?;
    let trials = learning_curves(&arms);
    let comparison = Comparison {
        experiment: task.name.clone(),
        seeds,
        robot_strides: RobotStrides {
            gp: arms.iter().map(|a| a.gp_strides).sum(),
            full: arms.iter().map(|a| a.full_strides).sum(),
            gp_falls: arms.iter().map(|a| a.gp_falls).sum(),
            full_falls: arms.iter().map(|a| a.full_falls).sum(),
        },
        finding: finding(&trials, &arms),
        trials,
    };
    Ok((comparison, arms))
}

/// Fig. 8 of a comparison.
pub fn fig8_data(comparison: &Comparison) -> Fig8 {
    Fig8 { trials: comparison.trials.clone(), seeds: comparison.seeds, strides: STRIDES_PER_POINT }
}

/// Fig. 9 of a comparison.
pub fn fig9_data(arms: &[CompareSeed]) -> Fig9 {
    let states: Vec<f64> = (0..=60).map(|i| 0.1 * f64::from(i)).collect();
    let curve = |policies: Vec<&SavedPolicy>, visited: Vec<f64>| {
        let at = |x: &f64| Spread::of(&policies.iter().map(|p| p.mean(&[*x].into())[0]).collect::<Vec<_>>());
        PolicyCurve { spread: states.iter().map(at).collect(), visited }
    };
    let visited = |of: &dyn Fn(&CompareSeed) -> Vec<f64>| arms.iter().flat_map(of).collect();
    Fig9 {
        gp: curve(arms.iter().map(|a| &a.gp_policy).collect(), visited(&|a| a.states.iter().map(|s| s[0]).collect())),
        full: curve(
            arms.iter().map(|a| &a.full_policy).collect(),
            visited(&|a| a.full_states.iter().map(|s| s[0]).collect()),
        ),
        psi_roll_deg: states,
        seeds: arms.len(),
        action_label: "A_{step} (deg)".into(),
    }
}

/// Runs the comparison, writes its figures, prints its table. `without_map` sets the learner beside
/// controls that need no map, instead of beside learning on the robot.
pub fn compare(name: &str, seeds: u64, without_map: bool, out: Option<&Path>, common: &Common) -> Result<(), Failure> {
    let task_of = |seed| task_of(name, common, seed);
    let task = task_of(common.seed)?;
    // On a robot that is known by its sensors alone there is no "full model" to learn on.
    if (without_map || task.robot.estimated) && can_steer(&task) {
        return controls(&task, &task_of, seeds, out, common);
    }
    if !task.goal.is_empty() {
        return super::goals::compare(&task_of, seeds, out, common);
    }
    if task.caution.is_some() {
        return super::learners::compare(&task_of, seeds, out, common);
    }
    let (comparison, arms) = run_arms(name, seeds, common)?;
    let dir = compared_in(out, &task, common);
    files::create_dir(&dir)?;
    files::write_json(&dir.join("compare.json"), &comparison)?;
    fig8(&fig8_data(&comparison))?.write(&dir)?;
    // The paper's figure is of one state and one action.
    let one_by_one = arms.first().is_some_and(|a| {
        let spec = a.gp_policy.spec();
        spec.state.len() == 1 && spec.action.len() == 1
    });
    if one_by_one {
        fig9(&fig9_data(&arms))?.write(&dir)?;
    }
    if common.json {
        return output::json(&comparison);
    }
    output::line("trial   GP map: mean (sd)        full model: mean (sd)      p");
    for t in &comparison.trials {
        let sd = |s: &Spread| s.sd.map_or("   -  ".into(), |sd| format!("{sd:.4}"));
        let p = t.p_value.map_or("-".into(), |p| format!("{p:.3}"));
        output::line(format!(
            "{:>5}   {:+.4} ({})        {:+.4} ({})        {p}",
            t.trial,
            t.gp.mean,
            sd(&t.gp),
            t.full.mean,
            sd(&t.full)
        ));
    }
    let (f, r) = (&comparison.finding, &comparison.robot_strides);
    output::line(format!(
        "strides on the robot: {} for the maps ({} falls), {} for learning on the robot ({} falls)",
        r.gp, r.gp_falls, r.full, r.full_falls
    ));
    output::line(format!(
        "early spread over seeds: map {:.4}, robot {:.4} (paper: the map's is larger)",
        f.early_sd.gp, f.early_sd.full
    ));
    for (when, d) in [("the last trial", &f.last_difference), ("the last quarter of the trials", &f.late_difference)] {
        output::line(format!("map less robot, {when}: {} (paper: slightly above 0)", interval(d, 4)));
    }
    output::line(format!("{}", dir.join("fig8.svg").display()));
    Ok(())
}

/// One way of choosing actions, over seeds.
#[derive(Clone, Debug, Serialize)]
struct ControlOverSeeds {
    name: String,
    /// Strides on the robot before it was measured.
    strides: usize,
    /// Median over seeds of the mean reward.
    median_mean_reward: f64,
    /// |mean psi_roll - target|, as the robot estimates it.
    error_deg: Quantiles,
    /// The same, as the simulator knows it.
    true_error_deg: Option<Quantiles>,
    /// Signed mean psi_roll of each seed.
    mean_psi_roll_deg: Vec<Option<f64>>,
    falls: usize,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Quantiles {
    median: f64,
    p90: f64,
    worst: f64,
}

impl Quantiles {
    fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let index = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(index.saturating_sub(1)).copied().unwrap_or(f64::NAN)
        };
        Self { median: super::learn::median(values), p90: at(0.9), worst: at(1.0) }
    }
}

/// What `compare` prints for a task that steers psi_roll on a robot known by its sensors.
#[derive(Clone, Debug, Serialize)]
struct Controls {
    experiment: String,
    seeds: u64,
    target_deg: f64,
    controls: Vec<ControlOverSeeds>,
}

/// The learner beside the controls that need no map.
fn controls(
    task: &Task,
    task_of: &(dyn Fn(u64) -> Result<Task, Failure> + Sync),
    seeds: u64,
    out: Option<&Path>,
    common: &Common,
) -> Result<(), Failure> {
    let list = parallel::seeds(common.seed, seeds)?;
    let rows = parallel::over(
        &list,
        common.threads,
        |seed, _| format!("seed {seed}"),
        |&seed| task_of(seed).and_then(|task| Ok(steer(&task, seed)?)),
    )?;
    let mut names: Vec<&str> = Vec::new();
    for row in rows.iter().flatten() {
        if !names.contains(&row.name.as_str()) {
            names.push(&row.name);
        }
    }
    let over_seeds = names.iter().map(|name| {
        let of: Vec<&Steered> = rows.iter().flatten().filter(|r| r.name == *name).collect();
        let errors: Vec<f64> = of.iter().map(|r| r.error_deg).collect();
        let truths: Option<Vec<f64>> = of.iter().map(|r| r.true_error_deg).collect();
        ControlOverSeeds {
            name: (*name).to_owned(),
            strides: of.iter().map(|r| r.strides).max().unwrap_or(0),
            median_mean_reward: super::learn::median(&of.iter().map(|r| r.performance.mean_reward).collect::<Vec<_>>()),
            error_deg: Quantiles::of(&errors),
            true_error_deg: truths.map(|t| Quantiles::of(&t)),
            mean_psi_roll_deg: of.iter().map(|r| r.performance.mean_psi_roll_deg).collect(),
            falls: of.iter().map(|r| r.falls + r.performance.falls).sum(),
        }
    });
    let shown = Controls {
        experiment: task.name.clone(),
        seeds,
        target_deg: task.target_deg().unwrap_or(0.0),
        controls: over_seeds.collect(),
    };
    if let Some(dir) = out {
        files::create_dir(dir)?;
        files::write_json(&dir.join("controls.json"), &shown)?;
    }
    if common.json {
        return output::json(&shown);
    }
    output::line(format!(
        "{}: |mean psi_roll - {}| over {} strides, deg, {seeds} seeds: median / 90 % / worst (true)",
        shown.experiment, shown.target_deg, task.record.strides
    ));
    for c in &shown.controls {
        let (e, t) = (c.error_deg, c.true_error_deg);
        let truth = t.map_or(String::new(), |t| format!("   ({:.2} / {:.2} / {:.2})", t.median, t.p90, t.worst));
        output::line(format!(
            "  {:<36} {:>3} strides   {:.2} / {:.2} / {:.2}{truth}   reward {:+.5}   {} falls",
            c.name, c.strides, e.median, e.p90, e.worst, c.median_mean_reward, c.falls
        ));
    }
    Ok(())
}
