//! `learn`: Algorithm 1, once or over seeds, from the start or resumed.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::Serialize;
use stridemap_lab::run::{FinishedRun, NoWatcher, RunDirectory, Watcher, has_begun, refuse_occupied};
use stridemap_lab::verbs::{finish, refuse_misfit, run_path};
use stridemap_lab::{LabError, LearnerKind, Progress, Task, builtin, task_differences};
use stridemap_record::{
    IterationSummary, Performance, Summary,
    files::{self, lock},
};
use stridemap_report::figures::quartiles;

use super::beside::Purpose;
use super::linked::algorithm;
use super::{in_network, on_robot, provenance, say_edited, tell};
use crate::args::{Common, RobotName};
use crate::failure::Failure;
use crate::output;
use crate::parallel;
use crate::progress::RunProgress;
use crate::stop::stop_flag;

/// Runs a task, once or for several seeds.
pub fn learn(
    name: &str,
    out: Option<&Path>,
    seeds: Option<u64>,
    learner: Option<LearnerKind>,
    common: &Common,
) -> Result<(), Failure> {
    let (mut sets, mut words) = (common.sets.clone(), name.to_owned());
    if let Some(learner) = learner {
        sets.push(format!("learner.kind={}", learner.name()));
        words += &format!(" --learner {}", learner.name().replace('_', "-"));
    }
    let mut loaded = builtin::load(name, &sets)?;
    tell(&mut loaded)?;
    // What repeats the run, in its record.
    let name = words.as_str();
    let linked = loaded.task.link.is_some() || common.robot == Some(RobotName::Ros2);
    if linked && seeds.is_some() {
        return Err(Failure::request(
            "one robot cannot learn several seeds at once: leave out --seeds, or use --robot op3",
        ));
    }
    let robot = common.robot.map(Into::into);
    refuse_misfit(&loaded.clone().on(robot, common.seed)?.task, common.seed)?;
    match seeds {
        None => {
            let path = run_path(out, &loaded.task, common.seed);
            let watcher = Box::new(RunProgress::new(&loaded.task));
            let result = start(name, &loaded, &path, common, &stop_flag(), watcher);
            finished(&loaded.task, result, &path, common.json)
        }
        Some(count) => over_seeds(name, &loaded, out, count, common),
    }
}

/// Learns anew around the policy of a run, on a robot that has changed.
pub fn adapt(run: &Path, out: Option<&Path>, common: &Common) -> Result<(), Failure> {
    let old = FinishedRun::open(run, &common.sets)?;
    let (mut task, policy) = (old.task.clone(), old.policy()?);
    policy.check_fits(&task.process_spec()?).map_err(LabError::from)?;
    task.proven = Some(policy);
    let name = format!("--adapt {}", run.display());
    let loaded = builtin::LoadedTask { task, resolved: String::new(), file: None };
    let path = out.map_or_else(|| PathBuf::from(format!("{}-adapted", run.display())), Path::to_path_buf);
    let watcher = Box::new(RunProgress::new(&loaded.task));
    let result = start(&name, &loaded, &path, common, &stop_flag(), watcher);
    finished(&loaded.task, result, &path, common.json)
}

/// Runs one seed from the start to the end.
pub fn start(
    name: &str,
    loaded: &builtin::LoadedTask,
    path: &Path,
    common: &Common,
    stop: &Arc<AtomicBool>,
    watcher: Box<dyn Watcher>,
) -> Result<Summary, Failure> {
    let loaded = &on_robot(loaded.clone(), common)?;
    let record = provenance("learn", name, loaded, common)?;
    let mut directory = RunDirectory::create(path, &loaded.task, &record, Arc::clone(stop), watcher)?;
    let mut algorithm = algorithm(&loaded.task, common.seed, Progress::default(), common, &Purpose::Learn, Some(path))?;
    Ok(finish(&mut algorithm, &mut directory)?)
}

/// Goes on with a run.
pub fn resume(path: &Path, common: &Common) -> Result<(), Failure> {
    let mut run = with_budget(path, &common.sets)?;
    in_network(&mut run.task, common)?;
    say_edited(&run);
    let watcher = Box::new(RunProgress::after(&run.task, &run.progress));
    let result = go_on(&run, common, &stop_flag(), watcher);
    finished(&run.task, result, path, common.json)
}

/// Draws the page of a run, of one that failed as well, and shows what it achieved.
fn finished(task: &Task, result: Result<Summary, Failure>, path: &Path, json: bool) -> Result<(), Failure> {
    let working = matches!(result, Err(Failure::Working(_)));
    if working && path.join("transitions.csv").exists() {
        // The failure is the one to tell, whatever becomes of its page.
        if let Ok(page) = super::report::draw(path) {
            let counted = files::read_json::<Summary>(&path.join("summary.json"));
            let counted = counted.map_or_else(|_| String::new(), |s| gathered(&s) + ": ");
            output::note(format!("what was gathered: {counted}{}", page.display()));
        }
    }
    let summary = result?;
    super::report::draw(path)?;
    show(task, &summary, path, json)
}

/// What a run that did not reach its end made on the robot.
fn gathered(summary: &Summary) -> String {
    let (s, falls) = (&summary.strides, summary.falls.len());
    format!(
        "{} strides in the budget, {} only to report, {falls} falls and stalls in all",
        s.training + s.evaluation,
        s.record
    )
}

/// A run to go on with. The one value of its task that may be another is how often the robot may fall.
fn with_budget(path: &Path, sets: &[String]) -> Result<FinishedRun, Failure> {
    const BUDGET: &str = "algorithm.falls_at_most";
    let key = |set: &String| set.split('=').next().map(|key| key.trim().to_owned());
    if sets.iter().any(|set| key(set).as_deref() != Some(BUDGET)) {
        return Err(Failure::request(format!(
            "--resume goes on with the run's own task; leave out --set ({BUDGET} alone may be raised)"
        )));
    }
    let run = FinishedRun::open(path, sets)?;
    if !sets.is_empty() {
        let _lock = lock(path)?;
        let config = path.join("config.toml");
        files::write_whole(&config, builtin::load_file(&config, sets)?.resolved.as_bytes())?;
    }
    Ok(run)
}

/// Runs what is missing of a run.
pub fn go_on(
    run: &FinishedRun,
    common: &Common,
    stop: &Arc<AtomicBool>,
    watcher: Box<dyn Watcher>,
) -> Result<Summary, Failure> {
    let (mut directory, progress) = RunDirectory::resume(run, Arc::clone(stop), watcher)?;
    if run.is_complete() {
        directory.mend()?;
        return Ok(files::read_json(&run.path.join("summary.json"))?);
    }
    let mut algorithm = algorithm(&run.task, run.provenance.seed, progress, common, &Purpose::Learn, Some(&run.path))?;
    directory.goes_on()?;
    Ok(finish(&mut algorithm, &mut directory)?)
}

/// A run that holds strides, if it is one of this task and seed by this program and model.
fn begun(path: &Path, task: &Task, seed: u64) -> Result<Option<FinishedRun>, Failure> {
    if !has_begun(path)? {
        refuse_occupied(path, task)?;
        return Ok(None);
    }
    let run = FinishedRun::open(path, &[])?;
    let mut differences = task_differences(&run.task, task)?;
    if run.provenance.seed != seed {
        differences.push(format!("the seed was {}, is {seed} now", run.provenance.seed));
    }
    if !differences.is_empty() {
        let (path, begun) = (path.into(), true);
        return Err(LabError::Mixed { path, differences, begun }.into());
    }
    run.refuse_others()?;
    Ok(Some(run))
}

/// The run of a task and a seed: made, or finished where it was cut off, or taken where it is whole; and which.
pub fn start_or_go_on(
    name: &str,
    loaded: &builtin::LoadedTask,
    path: &Path,
    common: &Common,
    stop: &Arc<AtomicBool>,
) -> Result<(Summary, &'static str), Failure> {
    let asked = on_robot(loaded.clone(), common)?.task;
    let watcher = Box::new(NoWatcher);
    match begun(path, &asked, common.seed)? {
        None => Ok((start(name, loaded, path, common, stop, watcher)?, "made")),
        Some(run) => {
            let how = if run.is_complete() {
                output::note(format!(
                    "{}: taken as it is, begun {} by version {}",
                    path.display(),
                    run.provenance.start,
                    run.provenance.version
                ));
                "taken"
            } else {
                "finished"
            };
            Ok((go_on(&run, common, stop, watcher)?, how))
        }
    }
}

/// Shows what a run achieved.
fn show(task: &Task, summary: &Summary, path: &Path, json: bool) -> Result<(), Failure> {
    if json {
        return output::json(summary);
    }
    let strides = summary.strides.training + summary.strides.evaluation;
    let falls: usize = summary.iterations.iter().map(|i| i.falls).sum();
    output::line(format!("{} (seed {})", task.name, summary.seed));
    let row = |name: &str, p: &Performance| {
        let gain = match (p.random_goals, p.walk) {
            (Some(goals), _) => format!("J {:.2} on random goals", goals.cost),
            (None, Some(walk)) => format!("{:.3} m/s   upright {:.0} s", walk.speed_m_s, walk.upright_s),
            (None, None) => format!("reward {:+.4}", p.mean_reward),
        };
        output::line(format!(
            "  {name:<8} {gain}   {}   {} falls in {} strides made to report",
            p.psi_roll(),
            p.falls,
            p.strides
        ));
    };
    if let Some(nominal) = &summary.nominal {
        row("nominal", &nominal.performance);
    }
    if let Some(policy) = &summary.final_policy {
        row("final", &policy.performance);
        let lacks = task.shortfalls(&policy.performance, strides, falls);
        let verdict = if lacks.is_empty() {
            "success".into()
        } else {
            format!("below what the task calls a success: {}", lacks.join("; "))
        };
        output::line(format!(
            "  learned from {strides} strides on the robot with {falls} falls while learning: {verdict}"
        ));
        if summary.improved == Some(false) {
            let no_map = |i: &IterationSummary| i.log_marginal_likelihood.is_empty();
            let tried = if task.learner.kind.uses_map() && summary.iterations.iter().all(no_map) {
                "too few strides reached the next section for a map"
            } else if task.caution.is_none() && task.algorithm.evaluation_strides == 0 {
                "no policy was tried on the robot (algorithm.evaluation_strides = 0)"
            } else {
                "no policy that was tried on the robot beats the nominal gait"
            };
            output::line(format!("  {tried}: the nominal gait is the final policy"));
        }
    }
    const SHOWN: usize = 8;
    for fall in summary.falls.iter().take(SHOWN) {
        output::line(format!("  fell: {fall}"));
    }
    if let more @ 1.. = summary.falls.len().saturating_sub(SHOWN) {
        output::line(format!("  and {more} falls more, in summary.json"));
    }
    let s = summary.seconds.by_work;
    output::line(format!(
        "  {:.1} s: robot {:.2}, fit {:.3}, improve {:.3}",
        summary.seconds.total, s.simulation, s.fit, s.improve
    ));
    output::line(format!("  {}", path.join("report.html").display()));
    Ok(())
}

/// Success over seeds after some strides on the robot.
#[derive(Clone, Copy, Debug, Serialize)]
struct SuccessAt {
    strides: usize,
    successes: usize,
    seeds: usize,
    median_mean_reward: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    median_speed_m_s: Option<f64>,
}

/// `learn --seeds`: the summary over seeds.
#[derive(Clone, Debug, Serialize)]
struct SeedsSummary {
    experiment: String,
    seeds: usize,
    successes: usize,
    failed_seeds: Vec<u64>,
    median_mean_reward: f64,
    worst_mean_reward: f64,
    median_psi_roll_deg: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    median_speed_m_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    worst_speed_m_s: Option<f64>,
    falls_while_learning: usize,
    falls_in_final: usize,
    /// Runs whose final policy is a learned one, and not the nominal gait.
    improved: usize,
    strides_per_run: usize,
    success_against_strides: Vec<SuccessAt>,
    runs: Vec<Summary>,
}

/// Median; NaN of nothing.
pub fn median(values: &[f64]) -> f64 {
    quartiles(values).map_or(f64::NAN, |quartiles| quartiles[1])
}

/// A directory of a batch over seeds.
fn path_of_all(out: Option<&Path>, name: String) -> PathBuf {
    out.unwrap_or(Path::new("runs")).join(name)
}

fn over_seeds(
    name: &str,
    loaded: &builtin::LoadedTask,
    out: Option<&Path>,
    count: u64,
    common: &Common,
) -> Result<(), Failure> {
    let task = &loaded.task;
    let seeds = parallel::seeds(common.seed, count)?;
    let path_of = |seed: u64| -> PathBuf { path_of_all(out, format!("{}-{seed}", task.name)) };
    let last = seeds.last().copied().unwrap_or(common.seed);
    let dir = path_of_all(out, format!("{}-seeds-{}-to-{last}", task.name, common.seed));
    // All or nothing: a directory that is taken is found before the first stride. Runs of this very command
    // that were cut off go on.
    files::check_dir(&dir)?;
    for &seed in &seeds {
        let common = Common { seed, ..common.clone() };
        let asked = on_robot(loaded.clone(), &common)?;
        if let Some(run) = begun(&path_of(seed), &asked.task, seed)? {
            drop(lock(&run.path)?);
        }
    }
    let stop = stop_flag();
    let told = |seed: &u64, made: &Result<Summary, Failure>| {
        let came = match made.as_ref().map(|s| s.final_policy) {
            Ok(Some(policy)) => RunProgress::measured(&policy.performance),
            Ok(None) => "no policy".into(),
            Err(failure) => failure.error().to_string(),
        };
        format!("seed {seed}: {came}")
    };
    let runs = parallel::over(&seeds, common.threads, told, |&seed| {
        let path = path_of(seed);
        let (summary, _) = start_or_go_on(name, loaded, &path, &Common { seed, ..common.clone() }, &stop)?;
        super::report::draw(&path).map(|_| summary)
    })?;
    let summary = sum_up(task, runs);
    let paths: Vec<PathBuf> = seeds.iter().map(|&seed| path_of(seed)).collect();
    let page = super::report::draw_seeds(&paths, &dir)?;
    if common.json {
        return output::json(&summary);
    }
    let gain = match (summary.median_speed_m_s, summary.worst_speed_m_s) {
        (Some(median), Some(worst)) => format!("median {median:.3} m/s, worst {worst:.3}"),
        _ => format!("reward median {:+.5}, worst {:+.5}", summary.median_mean_reward, summary.worst_mean_reward),
    };
    output::line(format!(
        "{}: {} of {} seeds succeed; {gain}; psi_roll median {:.3} deg; {} falls while learning, {} in final; \
         {} strides a run; {} better than the nominal gait",
        summary.experiment,
        summary.successes,
        summary.seeds,
        summary.median_psi_roll_deg,
        summary.falls_while_learning,
        summary.falls_in_final,
        summary.strides_per_run,
        summary.improved,
    ));
    if !summary.failed_seeds.is_empty() {
        output::line(format!("  seeds that do not: {:?}", summary.failed_seeds));
    }
    for at in &summary.success_against_strides {
        output::line(format!(
            "  after {:>3} strides: {:>3} of {} ({:.0} %), median {}",
            at.strides,
            at.successes,
            at.seeds,
            100.0 * at.successes as f64 / at.seeds as f64,
            match at.median_speed_m_s {
                Some(speed) => format!("{speed:.3} m/s"),
                None => format!("reward {:+.5}", at.median_mean_reward),
            }
        ));
    }
    output::line(format!("  {}", page.display()));
    Ok(())
}

fn sum_up(task: &Task, runs: Vec<Summary>) -> SeedsSummary {
    let falls = |s: &Summary| s.iterations.iter().map(|i| i.falls).sum::<usize>();
    let strides = |s: &Summary| s.strides.training + s.strides.evaluation;
    let finals: Vec<Performance> = runs.iter().filter_map(|s| s.final_policy.map(|f| f.performance)).collect();
    let succeeded =
        |s: &&Summary| s.final_policy.is_some_and(|f| task.is_success(&f.performance, strides(s), falls(s)));
    let rewards: Vec<f64> = finals.iter().map(|p| p.mean_reward).collect();
    let psis: Vec<f64> = finals.iter().filter_map(|p| p.mean_psi_roll_deg).collect();
    let speeds: Vec<f64> = finals.iter().filter_map(|p| Some(p.walk?.speed_m_s)).collect();
    let iterations = runs.iter().map(|s| s.iterations.len()).max().unwrap_or(0);
    let success_against_strides = (0..iterations)
        .map(|i| {
            let at: Vec<_> = runs.iter().filter_map(|s| s.iterations.get(i)).collect();
            let measured: Vec<f64> = at.iter().filter_map(|i| i.mean_reward).collect();
            let speeds: Vec<f64> = at.iter().filter_map(|i| i.speed_m_s).collect();
            SuccessAt {
                strides: at.iter().map(|i| i.strides_so_far).max().unwrap_or(0),
                successes: at.iter().filter(|i| i.success).count(),
                seeds: at.len(),
                median_mean_reward: median(&measured),
                median_speed_m_s: (!speeds.is_empty()).then(|| median(&speeds)),
            }
        })
        .collect();
    SeedsSummary {
        experiment: task.name.clone(),
        seeds: runs.len(),
        successes: runs.iter().filter(succeeded).count(),
        failed_seeds: runs.iter().filter(|s| !succeeded(s)).map(|s| s.seed).collect(),
        median_mean_reward: median(&rewards),
        worst_mean_reward: rewards.iter().copied().fold(f64::INFINITY, f64::min),
        median_psi_roll_deg: median(&psis),
        median_speed_m_s: (!speeds.is_empty()).then(|| median(&speeds)),
        worst_speed_m_s: speeds.iter().copied().reduce(f64::min),
        falls_while_learning: runs.iter().map(falls).sum(),
        falls_in_final: finals.iter().map(|p| p.falls).sum(),
        improved: runs.iter().filter(|s| s.improved == Some(true)).count(),
        strides_per_run: runs.iter().map(strides).max().unwrap_or(0),
        success_against_strides,
        runs,
    }
}
