//! Speaks the protocol of `benches/peers/`: fit one GP to a file, predict another, print one line
//! of JSON with times and numbers.
//!
//! ```text
//! cargo run --release -p stridemap-gp --example peer -- TRAIN.csv TEST.csv [--inducing M]
//! ```
//!
//! Both files have columns `x0, x1, …, y` and no header. Zero mean, squared-exponential kernel with
//! one length scale an input, one start (length scales 1, signal variance 1, noise variance 0.1).

#![allow(clippy::print_stdout, reason = "an example's answer goes to standard output")]

use std::error::Error;
use std::hint::black_box;

use cpu_time::ProcessTime;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde_json::json;
use stridemap_gp::{Bounds, FitOptions, Gp, Hyperparameters, Points, Range, Scratch, SparseGp, SparseOptions};

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = "usage: peer TRAIN.csv TEST.csv [--inducing M]";
    // `--inducing M` may stand anywhere.
    let (mut files, mut inducing, mut rest) = (Vec::new(), None, arguments.iter());
    while let Some(argument) = rest.next() {
        match argument.as_str() {
            "--inducing" => inducing = Some(rest.next().ok_or(usage)?.parse::<usize>()?),
            _ => files.push(argument),
        }
    }
    let [train, test] = files.as_slice() else {
        return Err(usage.into());
    };
    let (x, y, dims) = read(train)?;
    let (queries, _, _) = read(test)?;
    let answer = match inducing {
        None => exact(&x, &y, dims, &queries)?,
        Some(m) => sparse(&x, &y, dims, &queries, m)?,
    };
    println!("{answer}");
    Ok(())
}

/// Inputs (row-major), targets and number of inputs of a file.
fn read(path: &str) -> Result<(Vec<f64>, Vec<f64>, usize), Failure> {
    let (mut x, mut y, mut dims) = (Vec::new(), Vec::new(), 0);
    for line in std::fs::read_to_string(path)?.lines() {
        let row: Result<Vec<f64>, _> = line.split(',').map(|cell| cell.trim().parse()).collect();
        let row = row?;
        let (target, inputs) = row.split_last().ok_or("empty line")?;
        dims = inputs.len();
        x.extend_from_slice(inputs);
        y.push(*target);
    }
    Ok((x, y, dims))
}

/// The start and the bounds that all peers have.
fn options(dims: usize) -> FitOptions {
    FitOptions {
        start: Some(Hyperparameters { length_scales: vec![1.0; dims], signal_variance: 1.0, noise_variance: 0.1 }),
        bounds: Bounds {
            length_scales: Some(vec![Range::new(1e-2, 1e3); dims]),
            signal_variance: Some(Range::new(6.2e-6, 8e3)),
            noise_variance: Some(Range::new(1e-6, 1e2)),
        },
        starts: 1,
        ..FitOptions::default()
    }
}

fn exact(x: &[f64], y: &[f64], dims: usize, queries: &[f64]) -> Result<serde_json::Value, Failure> {
    let points = Points::new(x, dims)?;
    let queries = Points::new(queries, dims)?;
    let options = options(dims);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let fit = |rng: &mut ChaCha8Rng| Gp::fit(points, y, &options, rng);

    let begin = ProcessTime::now();
    let gp = fit(&mut rng)?;
    let first = begin.elapsed().as_secs_f64();
    // At least five fits, and a fifth of a second.
    let mut times = Vec::new();
    while times.len() < 5 || times.iter().sum::<f64>() < 0.2 {
        let begin = ProcessTime::now();
        black_box(fit(&mut rng)?);
        times.push(begin.elapsed().as_secs_f64());
    }

    let mut scratch = Scratch::new();
    let calls = 20_000.max(queries.len());
    let begin = ProcessTime::now();
    for i in 0..calls {
        black_box(gp.predict_with(black_box(queries.row(i % queries.len())), &mut scratch)?);
    }
    let one = begin.elapsed().as_secs_f64() / calls as f64;

    let (mut mean, mut variance) = (vec![0.0; queries.len()], vec![0.0; queries.len()]);
    let mut batches = Vec::new();
    while batches.len() < 20 {
        let begin = ProcessTime::now();
        gp.predict_batch(black_box(queries), &mut mean, &mut variance, &mut scratch)?;
        batches.push(begin.elapsed().as_secs_f64());
    }
    let h = gp.hyperparameters();
    Ok(json!({
        "fit_s": median(&mut times),
        "fit_first_s": first,
        "pred1_us": 1e6 * one,
        "pred1000_us": 1e6 * median(&mut batches),
        "s2": h.signal_variance,
        "ell": h.length_scales,
        "noise": h.noise_variance,
        "mean": 0.0,
        "nev": gp.report().map(|report| report.best_start().evaluations),
        "lml": gp.log_marginal_likelihood(),
        "mu": mean,
        "var": variance,
    }))
}

fn sparse(x: &[f64], y: &[f64], dims: usize, queries: &[f64], inducing: usize) -> Result<serde_json::Value, Failure> {
    let points = Points::new(x, dims)?;
    let queries = Points::new(queries, dims)?;
    let options = SparseOptions { fit: options(dims), inducing, ..SparseOptions::default() };
    let options =
        SparseOptions { fit: FitOptions { tolerance_nats: 1e-2, max_evaluations: 250, ..options.fit }, ..options };
    let mut times = Vec::new();
    let mut fitted = None;
    // Five fits; fewer where one takes more than ten seconds.
    while times.len() < 5 && times.iter().sum::<f64>() < 50.0 {
        let begin = ProcessTime::now();
        fitted = Some(SparseGp::fit(points, y, &options, &mut ChaCha8Rng::seed_from_u64(1))?);
        times.push(begin.elapsed().as_secs_f64());
    }
    let gp = fitted.ok_or("no fit")?;
    let first = times[0];
    let calls = 20_000.max(queries.len());
    let begin = ProcessTime::now();
    for i in 0..calls {
        black_box(gp.predict(black_box(queries.row(i % queries.len())))?);
    }
    let one = begin.elapsed().as_secs_f64() / calls as f64;
    let (mut mean, mut variance) = (vec![0.0; queries.len()], vec![0.0; queries.len()]);
    let begin = ProcessTime::now();
    gp.predict_batch(queries, &mut mean, &mut variance, &mut Scratch::new())?;
    let batch = begin.elapsed().as_secs_f64();
    let h = gp.hyperparameters();
    let z: Vec<&[f64]> = gp.inducing().chunks_exact(dims).collect();
    Ok(json!({
        "fit_s": median(&mut times),
        "fit_first_s": first,
        "pred1_us": 1e6 * one,
        "pred1000_us": 1e6 * batch,
        "s2": h.signal_variance,
        "ell": h.length_scales,
        "noise": h.noise_variance,
        "mean": 0.0,
        "nev": gp.report().map(|report| report.best_start().evaluations),
        "bound": gp.bound(),
        "fit_bytes": gp.fit_bytes(),
        "Z": z,
        "mu": mean,
        "var": variance,
    }))
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
