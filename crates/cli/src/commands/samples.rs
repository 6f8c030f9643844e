//! `reproduce samples`: speed and prediction error against the number of samples (sec. 8.1).

use std::path::Path;

use serde::Serialize;
use stridemap_lab::run::{Summary, files};
use stridemap_lab::{Algorithm, LabError, NoRecorder, builtin, fit_map, one_step_error};

use crate::args::Common;
use crate::commands::learn::median;
use crate::failure::Failure;
use crate::output;
use crate::parallel;
use crate::progress::SeedProgress;

/// Numbers of samples.
const SAMPLES: [usize; 5] = [20, 40, 70, 100, 200];
/// Strides left for proving the policy learned from them.
const PROOF: usize = 130;

/// What came of one number of samples.
#[derive(Clone, Debug, Serialize)]
struct Row {
    samples: usize,
    median_error: f64,
    median_speed_m_s: f64,
    worst_speed_m_s: f64,
    falls: usize,
    seeds: usize,
}

/// Learns one policy from each number of samples and each seed; writes and prints the table.
pub fn samples(out: &Path, seeds: u64, common: &Common) -> Result<(), Failure> {
    let task = builtin::load("walking", &common.sets)?.task;
    let jobs: Vec<(usize, u64)> = SAMPLES
        .iter()
        .flat_map(|n| (common.seed..common.seed + seeds).map(move |seed| (*n, seed)))
        .collect();
    let progress = SeedProgress::new(jobs.len());
    let results = parallel::over(&jobs, common.threads, |&(n, seed)| {
        let mut task = task.clone();
        task.collect.strides = vec![n, 0];
        task.algorithm.iterations = 1;
        task.algorithm.strides_at_most = Some(n + PROOF);
        let run = || -> Result<(f64, Summary), LabError> {
            let mut algorithm = Algorithm::new(&task, seed)?;
            algorithm.learn(&mut NoRecorder)?;
            let strides = &algorithm.progress.transitions;
            let collected = &strides[..n.min(strides.len())];
            let map = fit_map(&task, collected, seed, 1)?;
            let summary = Summary::of(&task, seed, &algorithm.progress);
            Ok((one_step_error(&map)?, summary))
        };
        let result = run();
        progress.done(&format!("{n} samples, seed {seed}"));
        result
    })?;
    let all = results.into_iter().collect::<Result<Vec<_>, LabError>>()?;
    let rows: Vec<Row> = SAMPLES
        .iter()
        .map(|n| {
            let own: Vec<_> = jobs.iter().zip(&all).filter(|((m, _), _)| m == n).collect();
            let errors: Vec<f64> = own.iter().map(|(_, (error, _))| *error).collect();
            let speeds: Vec<f64> = own
                .iter()
                .filter_map(|(_, (_, s))| s.final_policy?.speed_m_s)
                .collect();
            Row {
                samples: *n,
                median_error: median(&errors),
                median_speed_m_s: median(&speeds),
                worst_speed_m_s: speeds.iter().copied().fold(f64::INFINITY, f64::min),
                falls: own
                    .iter()
                    .flat_map(|(_, (_, s))| s.iterations.iter().map(|i| i.falls))
                    .sum(),
                seeds: own.len(),
            }
        })
        .collect();
    let mut text =
        String::from("samples,median_error,median_speed_m_s,worst_speed_m_s,falls,seeds\n");
    for r in &rows {
        text += &format!(
            "{},{},{},{},{},{}\n",
            r.samples, r.median_error, r.median_speed_m_s, r.worst_speed_m_s, r.falls, r.seeds
        );
    }
    files::create_dir(out)?;
    files::write_whole(&out.join("samples.csv"), text.as_bytes())?;
    if common.json {
        return output::json(&rows);
    }
    output::line("samples   one-step error   first policy m/s: median / worst   falls");
    for r in &rows {
        output::line(format!(
            "{:>7}   {:>14.3}   {:>24.3} / {:.3}   {:>5}",
            r.samples, r.median_error, r.median_speed_m_s, r.worst_speed_m_s, r.falls
        ));
    }
    Ok(())
}
