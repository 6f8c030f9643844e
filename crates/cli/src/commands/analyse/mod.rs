//! `analyse`: will it fall? Multipliers and time to fall from a record of strides.

mod run;
mod strides;
mod table;

use std::path::{Path, PathBuf};

use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};
use stridemap_lab::run::FinishedRun;
use stridemap_lab::{MapMultipliers, builtin, fit_map, map_multipliers};
use stridemap_record::{Run, Transition, files};
use stridemap_stability::{Analysis, Examined, FallRule, Options, Record, SensorKnowledge, StabilityError, examine};

use self::run::BruteForce;
use self::table::Table;
use super::{apply, from_log, say_differences};
use crate::args::AnalyseArgs;
use crate::failure::Failure;
use crate::output;

impl From<StabilityError> for Failure {
    fn from(error: StabilityError) -> Self {
        Self::Request(error.into())
    }
}

/// The 95 % interval of a share, by Jeffreys.
fn beta_interval(of: usize, all: usize) -> [f64; 2] {
    let (a, b) = (of as f64 + 0.5, all.saturating_sub(of) as f64 + 0.5);
    let quantile = |q| Beta::new(a, b).map_or(f64::NAN, |d| d.inverse_cdf(q));
    [if of == 0 { 0.0 } else { quantile(0.025) }, if of == all { 1.0 } else { quantile(0.975) }]
}

/// What is printed with --json: the analysis, and beside it what was counted.
#[derive(Serialize)]
struct Shown<'a> {
    #[serde(flatten)]
    analysis: &'a Analysis,
    #[serde(skip_serializing_if = "Option::is_none")]
    map_multipliers: Option<MapMultipliers>,
    #[serde(skip_serializing_if = "Option::is_none")]
    brute_force: Option<BruteForce>,
}

/// What is known of the sensor, as the command line says it.
fn sensor(text: Option<&str>, state: &[String]) -> Result<SensorKnowledge, Failure> {
    let Some(text) = text else { return Ok(SensorKnowledge::Estimated) };
    if text == "none" {
        return Ok(SensorKnowledge::Exact);
    }
    if strides::two_looks(Some(text)) {
        return Ok(SensorKnowledge::TwoLooks);
    }
    let wrong = |what: &str| {
        let known = state.join(", ");
        Failure::request(format!(
            "--sensor-noise {text:?}: {what}; it is none, two-looks, or a standard deviation for each of {known}: a=0.2,b=0.1"
        ))
    };
    let mut stds = vec![None; state.len()];
    for part in text.split(',') {
        let (name, std) = part.split_once('=').ok_or_else(|| wrong(&format!("{part:?} is no NAME=NUMBER")))?;
        let name = name.trim();
        let alike = |n: &&String| *n == name || n.strip_prefix(name).is_some_and(|rest| rest.starts_with('_'));
        let exact = state.iter().position(|n| n == name);
        let at = exact.or_else(|| state.iter().position(|n| alike(&n)));
        let at = at.ok_or_else(|| wrong(&format!("{name:?} is no component of the state")))?;
        let std = std.trim().parse::<f64>().ok().filter(|s| *s >= 0.0 && s.is_finite());
        stds[at] = Some(std.ok_or_else(|| wrong(&format!("{part:?} is no standard deviation")))?);
    }
    Ok(SensorKnowledge::Given(stds))
}

/// The rule for falls, its component found among those of the state with or without a unit.
fn rule(text: &str, state: &[String]) -> Result<FallRule, Failure> {
    let mut rule: FallRule = text.parse().map_err(|problem: String| Failure::request(format!("--fall {problem}")))?;
    if !state.contains(&rule.component) {
        let prefix = format!("{}_", rule.component);
        if let Some(name) = state.iter().find(|name| name.starts_with(&prefix)) {
            rule.component.clone_from(name);
        }
    }
    Ok(rule)
}

/// Strides of an MCAP log: of a robot that a task describes, or of its IMU alone.
fn of_mcap(args: &AnalyseArgs) -> Result<Record, Failure> {
    match (&args.task, &args.section) {
        (Some(task), _) => {
            let name = task.to_string_lossy();
            let common = &args.common;
            let task = builtin::load(&name, &common.sets)?.on(common.robot.map(Into::into), common.seed)?.task;
            let strides = from_log::strides(&task, &args.record)?;
            let strides: Vec<&Transition> = strides.iter().collect();
            let names: Vec<String> = task.process_spec()?.state.iter().map(|s| s.name.clone()).collect();
            run::of_strides(&strides, &names, &args.state)
        }
        (None, Some(section)) => {
            let readings = stridemap_link::read_imu(&args.record)?;
            let table = Table::of(&args.record, stridemap_link::IMU_COLUMNS, &readings);
            strides::of_series(&table, section, &args.state, strides::two_looks(args.sensor_noise.as_deref()))
        }
        (None, None) => Err(Failure::request(
            "an MCAP log needs the task of its robot (--task TASK), or a section of its IMU (--section roll_rate --state \
             pitch_rate)",
        )),
    }
}

/// The record that the command line names, and the run that it is of.
fn record(args: &AnalyseArgs) -> Result<(Record, Option<FinishedRun>), Failure> {
    if args.record.is_dir() {
        let finished = FinishedRun::open(&args.record, &args.common.sets)?;
        say_differences(&args.record);
        let record = run::of_run(&Run::read(&args.record)?, &args.what, &args.state)?;
        return Ok((record, Some(finished)));
    }
    let is_mcap = args.record.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    if is_mcap {
        return Ok((of_mcap(args)?, None));
    }
    let table = Table::read(&args.record)?;
    let two_looks = strides::two_looks(args.sensor_noise.as_deref());
    let record = match &args.section {
        Some(section) => strides::of_series(&table, section, &args.state, two_looks)?,
        None => strides::of_rows(&table, &args.state, &args.action, two_looks)?,
    };
    Ok((record, None))
}

/// Where figures go.
fn place(args: &AnalyseArgs) -> PathBuf {
    let stem = args.record.file_stem().map_or_else(|| "log".into(), |stem| stem.to_string_lossy().into_owned());
    match &args.out {
        Some(out) => out.clone(),
        None if args.record.is_dir() => args.record.clone(),
        None => Path::new("runs").join(format!("analyse-{stem}")),
    }
}

/// Writes the analysis and its figures.
fn write(examined: &Examined, map: Option<&MapMultipliers>, place: &Path) -> Result<(), Failure> {
    files::create_dir(place)?;
    let shown = Shown { analysis: &examined.analysis, map_multipliers: map.cloned(), brute_force: None };
    files::write_json(&place.join("analysis.json"), &shown)?;
    let figures = stridemap_report::figures::stability(examined)?;
    for figure in &figures {
        figure.write(&place.join("figures"))?;
    }
    output::note(format!("wrote analysis.json and {} figures into {}", figures.len(), place.display()));
    Ok(())
}

/// The multipliers that the last map of a run gives its policy; none of a run without a map.
fn of_map(run: &FinishedRun, what: &str) -> Result<Option<MapMultipliers>, Failure> {
    if what != "final" || run.progress.transitions.len() < 10 {
        return Ok(None);
    }
    let (progress, seed) = (&run.progress, run.provenance.seed);
    let map = fit_map(&run.task, &progress.transitions, &progress.in_place(), seed, 0)?;
    Ok(Some(map_multipliers(&run.task, &map, &run.policy()?, seed)?))
}

/// Analyses a record of strides.
pub fn analyse(args: &AnalyseArgs) -> Result<(), Failure> {
    if args.map {
        return apply::analyse_map(&args.record, &args.common);
    }
    let (mut record, run) = record(args)?;
    record.stride_s = args.stride_s.or(record.stride_s);
    let options = Options {
        sensor: sensor(args.sensor_noise.as_deref(), &record.state)?,
        fall: match (&args.fall, &run) {
            (Some(text), _) => Some(rule(text, &record.state)?),
            (None, Some(run)) => run::rule_of(run, &record),
            (None, None) => None,
        },
        seed: args.common.seed,
    };
    if args.brute.is_some() && run.as_ref().is_none_or(|run| run.task.link.is_some()) {
        return Err(Failure::request(
            "--brute walks the policy of a run on its simulated robot: LOG must be such a run",
        ));
    }
    let examined = examine(&record, &options)?;
    // What somebody else is writing, or may not be written, is looked at all the same.
    let _writing = if args.record.is_dir() { Some(files::lock(&args.record)?) } else { None };
    let map_multipliers = run.as_ref().map(|run| of_map(run, &args.what)).transpose()?.flatten();
    write(&examined, map_multipliers.as_ref(), &place(args))?;
    let brute_force = match (args.brute, &run) {
        (Some(walks), Some(run)) => Some(run::brute_force(run, walks, args.common.seed, args.common.threads)?),
        _ => None,
    };
    if args.common.json {
        return output::json(&Shown { analysis: &examined.analysis, map_multipliers, brute_force });
    }
    output::line(examined.analysis.page().trim_end());
    if let Some(map) = &map_multipliers {
        output::line(said_of_map(map));
    }
    if let Some(counted) = &brute_force {
        output::line(said(counted));
    }
    Ok(())
}

/// What the map says of itself, as a line.
fn said_of_map(map: &MapMultipliers) -> String {
    let words = |e: stridemap_stability::Estimate| format!("{:.2} ({:.2} to {:.2})", e.value, e.low, e.high);
    format!(
        "The map of the run, policy in the loop: largest {}, slow {}, flip {}, from {} strides.",
        words(map.largest),
        words(map.slow),
        words(map.flip),
        map.samples
    )
}

/// What was counted, as a line.
fn said(counted: &BruteForce) -> String {
    let [share, low, high] = counted.probability_60_s.map(|p| 100.0 * p);
    let strides = match counted.strides_to_fall {
        [Some(mean), Some(low), Some(high)] => format!("{mean:.0} strides to a fall ({low:.0} to {high:.0})"),
        [_, Some(low), _] => format!("at least {low:.0} strides to a fall"),
        _ => "no strides".into(),
    };
    format!(
        "By brute force     {} of {} walks of 60 s fell: {share:.1} % ({low:.1} to {high:.1}); {strides}, in {} strides.",
        counted.falls, counted.walks, counted.strides
    )
}
