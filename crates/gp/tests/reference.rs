//! Agreement with scikit-learn and GPflow; `reference/make.py` made the numbers.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points, Prediction, SparseGp, SparseMethod};

/// Largest relative error of a log marginal likelihood or bound.
const EVIDENCE_TOLERANCE: f64 = 1e-8;
/// Largest relative error of a mean or variance, relative to the prior's.
const PREDICTION_TOLERANCE: f64 = 1e-7;

const DIMS: usize = 2;

fn rows(text: &str) -> Vec<Vec<f64>> {
    text.lines().map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
}

fn train() -> (Vec<f64>, Vec<f64>) {
    let rows = rows(include_str!("reference/train.csv"));
    let x = rows.iter().flat_map(|row| row[..DIMS].to_vec()).collect();
    (x, rows.iter().map(|row| row[DIMS]).collect())
}

fn hyperparameters() -> Hyperparameters {
    Hyperparameters { length_scales: vec![0.7, 1.3], signal_variance: 1.0, noise_variance: 0.02 }
}

fn kernel(name: &str) -> Kernel {
    match name {
        "squared_exponential" => Kernel::SquaredExponential,
        "matern32" => Kernel::Matern32,
        "matern52" => Kernel::Matern52,
        _ => unreachable!("{name}"),
    }
}

/// Compares one line of a file with an evidence and predictions at the queries.
fn compare(line: &str, evidence: f64, predict: impl Fn(&[f64]) -> Prediction) {
    let cells: Vec<&str> = line.split(',').collect();
    let numbers: Vec<f64> = cells[2..].iter().map(|cell| cell.parse().unwrap()).collect();
    let error = (evidence - numbers[0]).abs() / numbers[0].abs();
    assert!(error < EVIDENCE_TOLERANCE, "{}, {}: evidence off by {error:e}", cells[0], cells[1]);
    let queries = rows(include_str!("reference/queries.csv"));
    assert_eq!(numbers.len(), 1 + 2 * queries.len());
    for (i, x) in queries.iter().enumerate() {
        let at = predict(x);
        let (mean, variance) = (numbers[1 + i], numbers[1 + queries.len() + i]);
        let errors = ((at.mean - mean).abs(), (at.latent_variance - variance).abs());
        assert!(errors.0 < PREDICTION_TOLERANCE, "{}, {}: mean {errors:?}", cells[0], cells[1]);
        assert!(errors.1 < PREDICTION_TOLERANCE, "{}, {}: variance {errors:?}", cells[0], cells[1]);
    }
}

#[test]
fn exact_regression_agrees_with_scikit_learn_and_gpflow() {
    let (x, y) = train();
    let points = Points::new(&x, DIMS).unwrap();
    for line in include_str!("reference/exact.csv").lines() {
        let kernel = kernel(line.split(',').nth(1).unwrap());
        let gp = Gp::condition(points, &y, kernel, Mean::Zero, hyperparameters()).unwrap();
        compare(line, gp.log_marginal_likelihood(), |x| gp.predict(x).unwrap());
    }
}

#[test]
fn sparse_regression_agrees_with_gpflow() {
    let (x, y) = train();
    let points = Points::new(&x, DIMS).unwrap();
    let inducing = rows(include_str!("reference/inducing.csv")).concat();
    let inducing = Points::new(&inducing, DIMS).unwrap();
    for line in include_str!("reference/sparse.csv").lines() {
        let kernel = kernel(line.split(',').nth(1).unwrap());
        let method = if line.starts_with("vfe") { SparseMethod::Vfe } else { SparseMethod::Fitc };
        let gp = SparseGp::condition(points, &y, kernel, method, hyperparameters(), inducing).unwrap();
        compare(line, gp.bound(), |x| gp.predict(x).unwrap());
    }
}
