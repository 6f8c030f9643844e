//! `reproduce samples`: speed and prediction error against the number of samples (sec. 8.1).

use std::path::Path;

use serde::Serialize;
use stridemap_lab::{Algorithm, LabError, NoRecorder, builtin, fit_map, one_step_error, unseen_error};
use stridemap_record::{InPlace, Transition, files};
use stridemap_report::figures::{SamplesPoint, samples as draw};

use crate::args::Common;
use crate::commands::learn::median;
use crate::failure::Failure;
use crate::output;
use crate::parallel;

/// Numbers of samples.
const SAMPLES: [usize; 5] = [20, 40, 70, 100, 200];
/// Strides left for proving the policy learned from them.
const PROOF: usize = 130;
/// Strides of the exploration that no map has seen, and how far its seed is from the run's.
const UNSEEN: usize = 100;
const UNSEEN_SEED: u64 = 1_000_000;

/// What came of one number of samples.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    samples: usize,
    median_error: f64,
    smallest_error: f64,
    largest_error: f64,
    median_unseen_error: f64,
    median_speed_m_s: f64,
    worst_speed_m_s: f64,
    best_speed_m_s: f64,
    falls: usize,
    seeds: usize,
}

/// Learns one policy from each number of samples and each seed; draws and returns the table.
pub fn samples(out: &Path, seeds: u64, common: &Common) -> Result<Vec<Row>, Failure> {
    let task = builtin::load("walking", &common.sets)?.task;
    let list = parallel::seeds(common.seed, seeds)?;
    let explore = |&seed: &u64| -> Result<Vec<Transition>, LabError> {
        let mut task = task.clone();
        task.collect.strides = vec![UNSEEN];
        task.record.pose_seconds = 0.0;
        let algorithm = Algorithm::new(&task, seed.wrapping_add(UNSEEN_SEED))?;
        let mut algorithm = algorithm.however_often_it_falls();
        algorithm.collect(&mut NoRecorder)?;
        Ok(algorithm.progress.transitions)
    };
    let unseen = parallel::over(&list, common.threads, |seed, _| format!("exploration of seed {seed}"), explore)?;
    let jobs: Vec<(usize, u64, &[Transition])> = SAMPLES
        .iter()
        .flat_map(|n| {
            let seeds = list.iter().zip(&unseen);
            seeds.map(move |(seed, unseen)| (*n, *seed, unseen.as_slice()))
        })
        .collect();
    let learn = |&(n, seed, unseen): &(usize, u64, &[Transition])| -> Result<SamplesPoint, LabError> {
        let mut task = task.clone();
        task.collect.strides = vec![n, 0];
        task.algorithm.iterations = 1;
        task.algorithm.strides_at_most = Some(n + PROOF);
        task.record.pose_seconds = 0.0;
        let mut algorithm = Algorithm::new(&task, seed)?.however_often_it_falls();
        algorithm.learn(&mut NoRecorder)?;
        let strides = &algorithm.progress.transitions;
        let map = fit_map(&task, &strides[..n.min(strides.len())], &InPlace::default(), seed, 1)?;
        let summary = algorithm.progress.summary(&task, seed);
        Ok(SamplesPoint {
            samples: n,
            seed,
            error: one_step_error(&map)?,
            unseen_error: unseen_error(&map, unseen)?,
            speed_m_s: summary.final_policy.and_then(|p| p.speed_m_s),
            falls: summary.iterations.iter().map(|i| i.falls).sum(),
        })
    };
    let told = |(n, seed, _): &(usize, u64, &[Transition]), _: &_| format!("{n} samples, seed {seed}");
    let points = parallel::over(&jobs, common.threads, told, learn)?;
    files::create_dir(out)?;
    draw(&points)?.write(out)?;
    let extent = |values: &[f64]| {
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
    };
    Ok(SAMPLES
        .iter()
        .map(|n| {
            let own: Vec<_> = points.iter().filter(|p| p.samples == *n).collect();
            let errors: Vec<f64> = own.iter().map(|p| p.error).collect();
            let unseen: Vec<f64> = own.iter().map(|p| p.unseen_error).collect();
            let speeds: Vec<f64> = own.iter().filter_map(|p| p.speed_m_s).collect();
            let (smallest_error, largest_error) = extent(&errors);
            let (worst_speed_m_s, best_speed_m_s) = extent(&speeds);
            Row {
                samples: *n,
                median_error: median(&errors),
                smallest_error,
                largest_error,
                median_unseen_error: median(&unseen),
                median_speed_m_s: median(&speeds),
                worst_speed_m_s,
                best_speed_m_s,
                falls: own.iter().map(|p| p.falls).sum(),
                seeds: own.len(),
            }
        })
        .collect())
}

/// Prints the table.
pub fn show(rows: &[Row]) {
    if rows.is_empty() {
        return;
    }
    output::line(
        "samples   one-step error: median (range)   on unseen strides   first policy m/s: median (range)   \
         falls   seeds",
    );
    for r in rows {
        let error = format!("{:.3} ({:.3} to {:.3})", r.median_error, r.smallest_error, r.largest_error);
        let speed = format!("{:.3} ({:.3} to {:.3})", r.median_speed_m_s, r.worst_speed_m_s, r.best_speed_m_s);
        output::line(format!(
            "{:>7}   {error:>30}   {:>17.3}   {speed:>32}   {:>5}   {:>5}",
            r.samples, r.median_unseen_error, r.falls, r.seeds
        ));
    }
}
