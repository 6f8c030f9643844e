//! The four verbs of Algorithm 1, one at a time: `collect`, `fit`, `improve` (and `evaluate`, in
//! [`apply`](super::apply)).

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use stridemap_lab::run::{FinishedRun, RunDirectory};
use stridemap_lab::verbs::{self, refuse_batch, refuse_misfit, run_path};
use stridemap_lab::{Algorithm, Progress, Task, builtin, fit_map};
use stridemap_map::{LearnedMap, SavedMap};
use stridemap_process::StrideEnd;
use stridemap_record::{
    Columns, InPlace, Performance, Rows, Transition,
    files::{self, lock},
};

use super::beside::Purpose;
use super::{in_network, linked, on_robot, provenance, say_differences};
use crate::args::Common;
use crate::failure::Failure;
use crate::output;
use crate::progress::{RunProgress, duration};
use crate::stop::stop_flag;

/// Makes the next batch of strides: starts a run of a task, or goes on with a run.
pub fn collect(task_or_run: &Path, out: Option<&Path>, common: &Common) -> Result<(), Failure> {
    if task_or_run.join("config.toml").exists() {
        if out.is_some() || !common.sets.is_empty() {
            return Err(Failure::request("a run goes on in its own directory with its own task"));
        }
        let mut run = FinishedRun::open(task_or_run, &[])?;
        in_network(&mut run.task, common)?;
        return next_batch(&run, common);
    }
    let name = text(task_or_run)?;
    let loaded = on_robot(builtin::load(name, &common.sets)?, common)?;
    let task = &loaded.task;
    refuse_misfit(task, common.seed)?;
    let path = run_path(out, task, common.seed);
    let record = provenance("collect", name, &loaded, common)?;
    let watcher = Box::new(RunProgress::new(task));
    let mut directory = RunDirectory::create(&path, task, &record, stop_flag(), watcher)?;
    let mut algorithm =
        linked::algorithm(task, common.seed, Progress::default(), common, &Purpose::Collect, Some(&path))?;
    algorithm.collect(&mut directory)?;
    directory.write_summary(&algorithm.progress)?;
    show_batch(task, &algorithm, &directory, common.json)
}

/// The name of a task; a file of a task is named by text.
pub fn text(name: &Path) -> Result<&str, Failure> {
    name.to_str().ok_or_else(|| {
        Failure::request(format!("{}: holds no run, and a task is named by text (UTF-8)", name.display()))
    })
}

/// Makes the next batch of a run.
fn next_batch(run: &FinishedRun, common: &Common) -> Result<(), Failure> {
    let watcher = Box::new(RunProgress::after(&run.task, &run.progress));
    let (mut directory, progress) = RunDirectory::resume(run, stop_flag(), watcher)?;
    refuse_batch(run, &progress)?;
    let mut algorithm =
        linked::algorithm(&run.task, run.provenance.seed, progress, common, &Purpose::Collect, Some(&run.path))?;
    if !verbs::next_batch(run, &mut algorithm, &mut directory)? {
        return Err(Failure::working(format!(
            "{0}: every batch is made; `stridemap learn --resume {0}` measures the final policy",
            run.path.display()
        )));
    }
    show_batch(&run.task, &algorithm, &directory, common.json)
}

#[derive(Serialize)]
struct BatchShown {
    run: String,
    iteration: usize,
    strides: usize,
    performance: Performance,
}

fn show_batch(task: &Task, algorithm: &Algorithm<'_>, directory: &RunDirectory, json: bool) -> Result<(), Failure> {
    let progress = &algorithm.progress;
    let iteration = progress.iterations.len();
    let first = progress.transitions.partition_point(|t| t.iteration < iteration);
    let batch = &progress.transitions[first..];
    let shown = BatchShown {
        run: directory.path().display().to_string(),
        iteration,
        strides: batch.len(),
        performance: Performance::of(batch, 0),
    };
    if json {
        return output::json(&shown);
    }
    let crossed = || batch.iter().filter(|t| t.end == StrideEnd::Crossing);
    let seconds: f64 = crossed().map(|t| t.measures.duration_s).sum();
    let forward_m: f64 = crossed().map(|t| t.measures.forward_m).sum();
    let gain = match task.record.walk_s {
        Some(_) if seconds > 0.0 => format!("mean {:.3} m/s", forward_m / seconds),
        _ => format!("mean reward {:+.4}", shown.performance.mean_reward),
    };
    output::line(format!(
        "{}: batch {iteration}, {} strides, {} falls, {gain}\n  next: stridemap improve {}",
        shown.run, shown.strides, shown.performance.falls, shown.run
    ));
    Ok(())
}

/// Fits the map to the strides of a run or of a CSV file.
pub fn fit(source: &Path, task: &str, out: Option<&Path>, common: &Common) -> Result<(), Failure> {
    let mut _writing = None;
    let (map, iteration, default_out) = if source.is_dir() {
        let run = FinishedRun::open(source, &common.sets)?;
        // The map of another task is not part of the run.
        let into_run = out.is_none() && common.sets.is_empty();
        if into_run {
            _writing = Some(lock(source)?);
            run.refuse_others()?;
        } else {
            say_differences(source);
        }
        let iteration = run.progress.iterations.len();
        let seed = run.provenance.seed;
        let map = fit_said(&run.task, &run.progress.transitions, seed, iteration)?;
        (map, iteration, into_run.then(|| source.join(format!("map/{iteration}.json"))))
    } else {
        let task = builtin::load(task, &common.sets)?.task;
        let table = Columns::new(&task.process_spec()?);
        let transitions = table.read(source, Rows::All)?;
        (fit_said(&task, &transitions, common.seed, 1)?, 1, None)
    };
    let saved = map.to_saved(iteration).map_err(stridemap_lab::LabError::from)?;
    if let Some(path) = out.map(Path::to_path_buf).or(default_out) {
        files::write_json(&path, &saved)?;
        output::note(format!("wrote {}", path.display()));
    }
    show_map(&map, &saved, common.json)
}

/// Fits a map; says beforehand how long a large one takes, and refuses one for which there is no memory.
fn fit_said(task: &Task, transitions: &[Transition], seed: u64, iteration: usize) -> Result<LearnedMap, Failure> {
    /// Strides beyond which a fit takes longer than one likes to wait without a word.
    const LARGE: usize = 1500;
    /// Strides by which the time is measured.
    const SAMPLE: usize = 500;
    let in_place = InPlace::default(); // A map alone is asked for no falls.
    let strides = transitions.len();
    stridemap_gp::check_memory(strides, task.state.len() + 1).map_err(|error| Failure::request(error.to_string()))?;
    if strides > LARGE {
        let started = Instant::now();
        let sample = fit_map(task, &transitions[..SAMPLE], &in_place, seed, iteration);
        let ratio = strides as f64 / SAMPLE as f64;
        let seconds = started.elapsed().as_secs_f64() * ratio.powi(3);
        if sample.is_ok() {
            output::note(format!(
                "fitting {strides} strides takes about {}: the time grows with the cube of their number",
                duration(seconds)
            ));
        }
    }
    Ok(fit_map(task, transitions, &in_place, seed, iteration)?)
}

fn show_map(map: &LearnedMap, saved: &SavedMap, json: bool) -> Result<(), Failure> {
    if json {
        return output::json(saved);
    }
    output::line(format!("map of {} strides", map.samples().len()));
    for o in &saved.outputs {
        let scales: Vec<String> = o.length_scales.iter().map(|l| format!("{l:.3}")).collect();
        output::line(format!(
            "  next {}: log marginal likelihood {:.3}, length scales [{}], signal std {:.3}, noise std \
             {:.4}",
            o.name,
            o.log_marginal_likelihood,
            scales.join(", "),
            o.signal_variance.sqrt(),
            o.noise_variance.sqrt()
        ));
        if let Some(scores) = &o.card.leave_one_out {
            output::line(format!(
                "    leave-one-out: rmse {:.4}, mean log density {:.3}, 90 % interval holds {:.0} %",
                scores.rmse,
                scores.mean_log_density,
                100.0 * scores.coverage_90
            ));
        }
        for warning in &o.warnings {
            output::line(format!("    warning: {warning}"));
        }
    }
    Ok(())
}

/// Improves the policy of a run in the map of its strides.
pub fn improve(path: &Path, json: bool) -> Result<(), Failure> {
    let run = FinishedRun::open(path, &[])?;
    let watcher = Box::new(RunProgress::after(&run.task, &run.progress));
    let (mut directory, progress) = RunDirectory::resume(&run, stop_flag(), watcher)?;
    let simulated = linked::here(&run.task);
    let mut algorithm = Algorithm::resume(&simulated, run.provenance.seed, progress)?;
    let iterations = algorithm.progress.iterations.len();
    let (summary, strides) = verbs::improve(&mut algorithm, &mut directory)?;
    if json {
        return output::json(&summary);
    }
    output::line(format!(
        "{}: policy {iterations} improved in a map of {} strides\n  next: stridemap evaluate {0}, or \
         stridemap collect {0}",
        path.display(),
        strides
    ));
    Ok(())
}
