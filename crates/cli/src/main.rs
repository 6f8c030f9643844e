//! The `stridemap` command: owns files, configuration, progress and the seed.

mod args;
mod commands;
mod failure;
mod output;
mod parallel;
mod progress;
mod stop;

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;

use crate::args::{Cli, Command};
use crate::failure::Failure;
use stridemap_record::files;

/// The git revision from which this binary was built.
const GIT_REVISION: Option<&str> = option_env!("STRIDEMAP_GIT_REVISION");

fn main() -> ExitCode {
    stridemap_lab::builtin::on_moved(|line| output::note(line));
    commands::process::end_with_parent();
    stop::outlive_full_files();
    let done = match Cli::try_parse() {
        Ok(cli) => run(cli.command),
        Err(said) => {
            output::usage(&said);
            if said.kind() == ErrorKind::InvalidUtf8
                && let Some(bad) = std::env::args_os().find(|word| word.to_str().is_none())
            {
                output::note(format!("{}: is not text (UTF-8)", bad.display()));
            }
            if said.use_stderr() {
                return ExitCode::from(2);
            }
            Ok(ExitCode::SUCCESS)
        }
    };
    match done.and_then(|code| output::written().map(|()| code)) {
        Ok(code) => code,
        Err(failure) => {
            output::json_failure(&failure);
            output::error(&failure);
            failure.exit_code()
        }
    }
}

/// Judges where a command is to write, before it does anything.
fn check_out(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Collect { from: Some(_), out: Some(file), .. }
        | Command::Fit { out: Some(file), .. }
        | Command::Run { out: Some(file), .. }
        | Command::Report { out: Some(file), .. }
        | Command::View { out: Some(file), .. }
        | Command::Check { film: Some(file), .. }
        | Command::Init { file: Some(file), .. }
        | Command::Tune { file, .. } => files::check_file(file)?,
        Command::Verdict(args::VerdictArgs { junit, markdown, .. })
        | Command::CompareRuns(args::CompareRunsArgs { junit, markdown, .. }) => {
            for file in [junit, markdown].into_iter().flatten() {
                files::check_file(file)?;
            }
        }
        Command::Learn { out: Some(dir), .. }
        | Command::Collect { out: Some(dir), .. }
        | Command::Push(args::PushArgs { out: Some(dir), .. })
        | Command::Replay { out: Some(dir), .. }
        | Command::Compare { out: Some(dir), .. }
        | Command::Reproduce { out: Some(dir), .. } => files::check_dir(dir)?,
        _ => {}
    }
    Ok(())
}

/// What was asked for, and how the process ends.
fn run(command: Command) -> Result<ExitCode, Failure> {
    check_out(&command)?;
    match command {
        Command::Verdict(args) => commands::verdict::verdict(&args),
        Command::CompareRuns(args) => commands::verdict::compare_runs(&args),
        other => run_other(other).map(|()| ExitCode::SUCCESS),
    }
}

fn run_other(command: Command) -> Result<(), Failure> {
    match command {
        Command::Learn { adapt: Some(run), out, common, .. } => commands::learn::adapt(&run, out.as_deref(), &common),
        Command::Learn { task, out, resume, learner, until_error, seeds, mut common, .. } => match (resume, task) {
            (Some(run), _) => commands::learn::resume(&run, &common),
            (None, Some(task)) => {
                // A value of the task, so that the run keeps it.
                if let Some(error) = until_error {
                    common.sets.push(format!("collect.until_error={error}"));
                }
                commands::learn::learn(&task, out.as_deref(), seeds, learner, &common)
            }
            (None, None) => Err(Failure::request("learn needs a task or --resume RUN")),
        },
        Command::Collect { task, from, out, common } => match from {
            Some(log) => commands::from_log::collect_from(&task, &log, out.as_deref(), &common),
            None => commands::verbs::collect(&task, out.as_deref(), &common),
        },
        Command::Fit { source, task, out, common } => commands::verbs::fit(&source, &task, out.as_deref(), &common),
        Command::Improve { run, json } => commands::verbs::improve(&run, json),
        Command::Evaluate { run, strides, nominal, common } => {
            commands::apply::evaluate(&run, strides, nominal, &common)
        }
        Command::Run { run, nominal, seconds, out, change, common } => {
            commands::apply::run(run.as_deref(), nominal.as_deref(), (seconds, &change), out.as_deref(), &common)
        }
        Command::Push(args) if args.atlas => {
            let args::PushArgs { phases, directions, body, .. } = args;
            let setting = stridemap_lab::AtlasSetting { phases, directions, body, ..Default::default() };
            commands::atlas::push_atlas_of_run(&args.run, setting, args.nominal, args.out.as_deref(), &args.common)
        }
        Command::Push(args::PushArgs { run, force, duration, strides, body, nominal, out, common, .. }) => {
            let of = |mass_kg| stridemap_lab::PushConfig::of(force, mass_kg, duration, strides);
            commands::apply::push(&run, &of, (body.as_deref(), nominal), out.as_deref(), &common)
        }
        Command::Replay { run, episode, out, json } => commands::replay::replay(&run, episode, out.as_deref(), json),
        Command::Analyse(args) => commands::analyse::analyse(&args),
        Command::Compare { task, seeds, controls, out, common } => {
            commands::compare::compare(&task, seeds, controls, out.as_deref(), &common)
        }
        Command::Reproduce { figures, out, seeds, common } => {
            commands::reproduce::reproduce(&figures, out.as_deref(), seeds, &common)
        }
        Command::Sweep { what: Some(args::SweepWhat::Merge { dir, json }), .. } => commands::sweep::merge(&dir, json),
        Command::Sweep { study, shard, out, json, .. } => {
            let study = study.unwrap_or_default();
            let named = || format!("sweep-{}", study.file_stem().unwrap_or_default().to_string_lossy());
            let out = out.unwrap_or_else(|| std::path::Path::new("runs").join(named()));
            commands::sweep::sweep(&study, shard, &out, json)
        }
        Command::Verdict(_) | Command::CompareRuns(_) => Ok(()),
        Command::Report { runs, out } => commands::report::report(&runs, out.as_deref()),
        Command::View { run, out, no_open } => commands::report::view(&run, out.as_deref(), no_open),
        Command::Check { task, film, common } => commands::task::check(&task, film.as_deref(), &common),
        Command::Fetch { robot, yes, json } => commands::fetch::fetch(robot, yes, json),
        Command::List { kind, json } => commands::list::list(kind, json),
        Command::Init { file, model: Some(model), json } => {
            commands::bring_up::init_model(&model, file.as_deref(), json)
        }
        Command::Init { file, .. } => commands::task::init(file.as_deref()),
        Command::Tune { file, tries, walk, common } => commands::bring_up::tune(&file, tries, walk, &common),
        Command::Robot { robot: args::ServedRobot::Op3, ideal, rate, seed, realtime_factor, seconds, network } => {
            commands::robot::robot(ideal, rate, seed, realtime_factor, seconds, &network)
        }
        Command::Stop { rearm, reason, network } => commands::robot::stop(rearm, &reason, &network),
        Command::BenchLink { seconds, json, domain } => commands::robot::bench_link(seconds, json, domain),
        Command::Bench { what: Some(args::BenchOf::Walk), only, sets, seeds, json, .. } => {
            commands::velocity::walk(seeds.unwrap_or(5), only.as_deref(), &sets, json)
        }
        Command::Bench { what: Some(args::BenchOf::Preflight), only, sets, seeds, json, .. } => {
            let task = only.as_deref().unwrap_or("g1-velocity");
            commands::preflight::bench(task, seeds.unwrap_or(5), &sets, json)
        }
        Command::Bench { what: Some(args::BenchOf::Drift), only, seeds, study, threads, json, .. } => {
            commands::bench_drift::drift(study.seed, seeds.unwrap_or(20), only.as_deref(), threads, json)
        }
        Command::Bench { what: Some(args::BenchOf::Coverage), study, json, .. } => {
            commands::bench_stability::multipliers(study.systems, study.seed, json)
        }
        Command::Bench { what: Some(args::BenchOf::TimeToFall), study, json, .. } => {
            commands::bench_stability::time_to_fall(study.records, study.seed, json)
        }
        Command::Bench { what: Some(args::BenchOf::Robots), out, only, seeds, walk, .. } => {
            commands::robots::robots(&out, seeds.unwrap_or(5), only.as_deref(), walk)
        }
        Command::Bench { what: Some(args::BenchOf::Learners), out, only, seeds, json, .. } => {
            commands::bench_learners::bench(&out, seeds.unwrap_or(5), only.as_deref(), json)
        }
        Command::Bench { json, .. } => commands::bench::bench(json),
    }
}
