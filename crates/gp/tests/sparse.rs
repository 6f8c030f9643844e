//! What must hold of sparse regression.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_gp::{
    FitOptions, Gp, GpError, Kernel, Mean, Points, SparseGp, SparseMethod, SparseOptions, Sufficient, coverage,
    sufficient_inducing,
};

fn data(n: usize, phase: f64) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|i| 3.0 * (i as f64 * 1.618 + phase).sin()).collect();
    let noise = |i: usize| 0.1 * (2.0_f64.sqrt() * (997.0 * i as f64 + phase).sin());
    let y = x.iter().enumerate().map(|(i, x)| (2.0 * x).sin() + noise(i)).collect();
    (x, y)
}

fn fit(method: SparseMethod, inducing: usize) -> SparseGp {
    let (x, y) = data(200, 0.0);
    let options = SparseOptions { method, inducing, ..SparseOptions::default() };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    SparseGp::fit(Points::new(&x, 1).unwrap(), &y, &options, &mut rng).unwrap()
}

#[test]
fn the_bound_rises_with_inducing_inputs_and_stays_below_the_evidence() {
    let (x, y) = data(200, 0.0);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let exact = Gp::fit(Points::new(&x, 1).unwrap(), &y, &FitOptions::default(), &mut rng).unwrap();
    let bounds = [4, 8, 16].map(|m| fit(SparseMethod::Vfe, m).bound());
    assert!(bounds[0] < bounds[1] && bounds[1] < bounds[2], "{bounds:?}");
    assert!(bounds[2] <= exact.log_marginal_likelihood() + 1e-3);
    assert!(bounds[2] > exact.log_marginal_likelihood() - 0.5, "{bounds:?}");
}

#[test]
fn fresh_data_fall_inside_the_intervals_as_often_as_promised() {
    let (x, y) = data(400, 0.3);
    for method in [SparseMethod::Vfe, SparseMethod::Fitc] {
        let gp = fit(method, 20);
        let noise = gp.hyperparameters().noise_variance;
        let z: Vec<f64> = x
            .iter()
            .zip(&y)
            .map(|(x, y)| {
                let at = gp.predict(&[*x]).unwrap();
                (y - at.mean) / (at.latent_variance + noise).sqrt()
            })
            .collect();
        // A sine of a large phase is not normal: its middle is thinner and it has no tails.
        assert!((0.3..0.6).contains(&coverage(&z, 0.5)), "{method:?} {}", coverage(&z, 0.5));
        assert!(coverage(&z, 0.95) > 0.9, "{method:?}");
    }
}

#[test]
fn a_saved_sparse_model_predicts_the_same_bits() {
    for method in [SparseMethod::Vfe, SparseMethod::Fitc] {
        let gp = fit(method, 9);
        let text = gp.to_json().unwrap();
        let again = SparseGp::from_json(&text).unwrap();
        for x in [-2.0, 0.3, 5.0] {
            let (p, q) = (gp.predict(&[x]).unwrap(), again.predict(&[x]).unwrap());
            assert_eq!(p.mean.to_bits(), q.mean.to_bits());
            assert_eq!(p.latent_variance.to_bits(), q.latent_variance.to_bits());
        }
        assert!(matches!(SparseGp::from_json(&text[..text.len() / 2]), Err(GpError::Parse { .. })));
    }
}

#[test]
fn troubled_data_give_an_answer_or_a_typed_error() {
    let same = vec![1.0; 30];
    let ramp: Vec<f64> = (0..30).map(f64::from).collect();
    let huge: Vec<f64> = ramp.iter().map(|x| 1e8 * x).collect();
    for x in [&same, &ramp, &huge] {
        for y in [&same, &ramp, &huge, &vec![0.0; 30]] {
            for method in [SparseMethod::Vfe, SparseMethod::Fitc] {
                for kernel in [Kernel::SquaredExponential, Kernel::Matern32] {
                    let fit = FitOptions { kernel, max_evaluations: 60, ..FitOptions::default() };
                    let options = SparseOptions { fit, method, inducing: 6, ..SparseOptions::default() };
                    let mut rng = ChaCha8Rng::seed_from_u64(1);
                    let points = Points::new(x, 1).unwrap();
                    let gp = SparseGp::fit(points, y, &options, &mut rng).unwrap();
                    let at = gp.predict(&[x[3]]).unwrap();
                    assert!(at.mean.is_finite() && at.latent_variance >= 0.0, "{at:?}");
                }
            }
        }
    }
}

#[test]
fn what_a_sparse_model_cannot_do_is_said() {
    let (x, y) = data(10, 0.0);
    let points = Points::new(&x, 1).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut error = |options: &SparseOptions| SparseGp::fit(points, &y, options, &mut rng).map(|_| ()).unwrap_err();
    let many = SparseOptions { inducing: 11, ..SparseOptions::default() };
    assert!(matches!(error(&many), GpError::Shape { expected: 10, found: 11, .. }));
    let fit = FitOptions { mean: Mean::Linear, ..FitOptions::default() };
    let linear = SparseOptions { fit, inducing: 5, ..SparseOptions::default() };
    assert!(matches!(error(&linear), GpError::Unsupported { .. }));
}

#[test]
fn inducing_inputs_are_added_until_the_error_is_small_enough() {
    let ((x, y), (queries, targets)) = (data(200, 0.0), data(100, 0.3));
    let held_out = (Points::new(&queries, 1).unwrap(), &targets[..]);
    let points = Points::new(&x, 1).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let options = SparseOptions::default();
    let sizes = [2, 4, 8, 16];
    let found = sufficient_inducing(points, &y, held_out, &sizes, 0.12, &options, &mut rng).unwrap();
    assert!(matches!(found, Sufficient::Met { size: 8 | 16, .. }), "{found:?}");
    let found = sufficient_inducing(points, &y, held_out, &[2, 4], 0.01, &options, &mut rng).unwrap();
    assert!(matches!(found, Sufficient::NotMet { rmse } if rmse.len() == 2));
}
