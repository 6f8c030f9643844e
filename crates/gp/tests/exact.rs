//! What must hold of exact regression whatever the kernel and mean.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]
#![allow(clippy::needless_range_loop, reason = "an index runs over several arrays")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_gp::{
    Bounds, Draw, FitOptions, Gp, Hyperparameters, Kernel, Mean, Points, Prior, Priors, Range, Scratch,
};

const KERNELS: [Kernel; 3] = [Kernel::SquaredExponential, Kernel::Matern32, Kernel::Matern52];
const MEANS: [Mean; 3] = [Mean::Zero, Mean::Constant, Mean::Linear];
const DIMS: usize = 2;

fn data(n: usize) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n * DIMS).map(|i| 1.5 * ((i * i * 5 + i) as f64).sin()).collect();
    let y = x.chunks_exact(DIMS).enumerate();
    let y = y.map(|(i, x)| (2.0 * x[0]).sin() + 0.5 * x[1] + 0.1 * (37.0 * i as f64).sin() + 1.0);
    (x.clone(), y.collect())
}

fn condition(x: &[f64], y: &[f64], kernel: Kernel, mean: Mean) -> Gp {
    let hyperparameters = Hyperparameters { length_scales: vec![0.7, 1.3], signal_variance: 1.5, noise_variance: 0.02 };
    Gp::condition(Points::new(x, DIMS).unwrap(), y, kernel, mean, hyperparameters).unwrap()
}

fn each(mut check: impl FnMut(Kernel, Mean)) {
    for kernel in KERNELS {
        for mean in MEANS {
            check(kernel, mean);
        }
    }
}

fn assert_same(a: &Gp, b: &Gp, tolerance: f64) {
    let evidence = (a.log_marginal_likelihood() - b.log_marginal_likelihood()).abs();
    assert!(evidence < tolerance * (1.0 + a.log_marginal_likelihood().abs()), "{evidence}");
    for x in [[0.1, -0.4], [1.2, 0.9], [3.0, -3.0]] {
        let (p, q) = (a.predict(&x).unwrap(), b.predict(&x).unwrap());
        assert!((p.mean - q.mean).abs() < tolerance, "{p:?} {q:?}");
        assert!((p.latent_variance - q.latent_variance).abs() < tolerance, "{p:?} {q:?}");
    }
}

#[test]
fn adding_and_dropping_points_equals_conditioning_anew() {
    let (x, y) = data(50);
    each(|kernel, mean| {
        let mut gp = condition(&x[..20 * DIMS], &y[..20], kernel, mean);
        for i in 20..50 {
            gp.add_point(&x[i * DIMS..(i + 1) * DIMS], y[i]).unwrap();
        }
        assert_same(&gp, &condition(&x, &y, kernel, mean), 1e-9);

        let (mut xs, mut ys) = (x.clone(), y.clone());
        for index in [0, 48, 17, 30, 3, 15, 16, 40, 0, 7] {
            gp.drop_point(index).unwrap();
            xs.drain(index * DIMS..(index + 1) * DIMS);
            ys.remove(index);
        }
        assert_same(&gp, &condition(&xs, &ys, kernel, mean), 1e-9);
        assert_eq!(gp.card().updates, 40);

        let again = Gp::from_json(&gp.to_json().unwrap()).unwrap();
        assert_same(&gp, &again, f64::MIN_POSITIVE);
    });
}

#[test]
fn leaving_one_out_equals_conditioning_on_the_others() {
    let (x, y) = data(25);
    each(|kernel, mean| {
        let gp = condition(&x, &y, kernel, mean);
        let loo = gp.leave_one_out().unwrap();
        for i in 0..25 {
            let mut others = gp.clone();
            others.drop_point(i).unwrap();
            let at = others.predict(&x[i * DIMS..(i + 1) * DIMS]).unwrap();
            assert!((loo.residuals[i] - (y[i] - at.mean)).abs() < 1e-9);
            assert!((loo.variances[i] - (at.latent_variance + 0.02)).abs() < 1e-9);
        }
    });
}

#[test]
fn gradients_of_a_prediction_agree_with_central_differences() {
    let (x, y) = data(30);
    each(|kernel, mean| {
        let gp = condition(&x, &y, kernel, mean);
        let mut scratch = Scratch::new();
        let at = [0.37, -0.81];
        let (mut dm, mut dv) = ([0.0; DIMS], [0.0; DIMS]);
        gp.predict_gradient(&at, &mut dm, &mut dv, &mut scratch).unwrap();
        for d in 0..DIMS {
            let step = 1e-5;
            let mut moved = at;
            moved[d] += step;
            let above = gp.predict(&moved).unwrap();
            moved[d] -= 2.0 * step;
            let below = gp.predict(&moved).unwrap();
            let mean = (above.mean - below.mean) / (2.0 * step);
            let variance = (above.latent_variance - below.latent_variance) / (2.0 * step);
            assert!((dm[d] - mean).abs() < 1e-8, "{kernel:?} {mean:?} {} {mean}", dm[d]);
            assert!((dv[d] - variance).abs() < 1e-8, "{kernel:?} {} {variance}", dv[d]);
        }
    });
}

#[test]
fn a_batch_agrees_with_single_predictions_and_the_joint_with_both() {
    let (x, y) = data(45);
    let queries: Vec<f64> = (0..19 * DIMS).map(|i| (i as f64 * 0.77).cos() * 2.0).collect();
    let queries = Points::new(&queries, DIMS).unwrap();
    each(|kernel, mean| {
        let gp = condition(&x, &y, kernel, mean);
        let (mut means, mut variances) = ([0.0; 19], [0.0; 19]);
        gp.predict_batch(queries, &mut means, &mut variances, &mut Scratch::new()).unwrap();
        let joint = gp.predict_joint(queries).unwrap();
        for (i, x) in queries.rows().enumerate() {
            let at = gp.predict(x).unwrap();
            assert!((means[i] - at.mean).abs() < 1e-12);
            assert!((variances[i] - at.latent_variance).abs() < 1e-12);
            assert!((joint.mean[i] - at.mean).abs() < 1e-12);
            assert!((joint.covariance[i * 19 + i] - at.latent_variance).abs() < 1e-12);
        }
    });
}

#[test]
fn draws_have_the_joint_covariance() {
    let (x, y) = data(10);
    let gp = condition(&x, &y, Kernel::Matern52, Mean::Constant);
    let queries = Points::new(&[2.0, 1.0, 2.3, 1.0, -1.0, 0.4], DIMS).unwrap();
    let joint = gp.predict_joint(queries).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let draws = 20_000;
    let mut sums = [0.0; 9];
    for _ in 0..draws {
        let mut out = [0.0; 3];
        gp.sample_joint(queries, Draw::Latent, &mut rng, &mut out).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                sums[i * 3 + j] += (out[i] - joint.mean[i]) * (out[j] - joint.mean[j]);
            }
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            let expected = joint.covariance[i * 3 + j];
            let (a, b) = (joint.covariance[i * 4], joint.covariance[j * 4]);
            // Standard error of a sample covariance of normal numbers, four times.
            let error = 4.0 * ((a * b + expected * expected) / f64::from(draws)).sqrt();
            assert!((sums[i * 3 + j] / f64::from(draws) - expected).abs() < error);
        }
    }
}

#[test]
fn standardizing_changes_the_units_of_bounds_not_the_model() {
    let (x, y) = data(40);
    let points = Points::new(&x, DIMS).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let plain = FitOptions {
        mean: Mean::Constant,
        starts: 1, // others begin at random places, in units of their own
        ..FitOptions::default()
    };
    let standard = FitOptions { standardize_inputs: true, standardize_outputs: true, ..plain.clone() };
    let a = Gp::fit(points, &y, &plain, &mut rng).unwrap();
    let b = Gp::fit(points, &y, &standard, &mut rng).unwrap();
    assert_same(&a, &b, 1e-6);
    assert!((a.mean_coefficients()[0] - b.mean_coefficients()[0]).abs() < 1e-5);
}

#[test]
fn a_rescaled_unit_rescales_the_answer() {
    let (x, y) = data(30);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let options = FitOptions::default();
    let a = Gp::fit(Points::new(&x, DIMS).unwrap(), &y, &options, &mut rng).unwrap();
    let far: Vec<f64> = x.iter().map(|x| 1e6 * x).collect();
    let tall: Vec<f64> = y.iter().map(|y| 1e-3 * y).collect();
    let b = Gp::fit(Points::new(&far, DIMS).unwrap(), &tall, &options, &mut rng).unwrap();
    let (p, q) = (a.predict(&[0.3, 0.2]).unwrap(), b.predict(&[3e5, 2e5]).unwrap());
    assert!((p.mean - 1e3 * q.mean).abs() < 1e-5, "{p:?} {q:?}");
    assert!((p.latent_variance - 1e6 * q.latent_variance).abs() < 1e-5, "{p:?} {q:?}");
}

#[test]
fn bounds_hold_and_priors_pull() {
    let (x, y) = data(30);
    let points = Points::new(&x, DIMS).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let bounds = Bounds { length_scales: Some(vec![Range::fixed(0.9), Range::new(0.1, 0.5)]), ..Bounds::default() };
    let gp = Gp::fit(points, &y, &FitOptions { bounds, ..FitOptions::default() }, &mut rng).unwrap();
    let scales = &gp.hyperparameters().length_scales;
    assert!((scales[0] - 0.9).abs() < 1e-12 && scales[1] <= 0.5 + 1e-12, "{scales:?}");
    let text = gp.card().to_string();
    assert!(text.contains("length_scales[1] = 5.000e-1 is at its upper bound"), "{text}");

    let tight = Prior::LogNormal { median: 0.3, log_std: 1e-3 };
    let priors = Priors { noise_variance: Some(tight), ..Priors::default() };
    let gp = Gp::fit(points, &y, &FitOptions { priors, ..FitOptions::default() }, &mut rng).unwrap();
    assert!((gp.hyperparameters().noise_variance - 0.3).abs() < 1e-3);
}

#[test]
fn more_starts_are_never_worse_and_repeat_with_the_seed() {
    let (x, y) = data(12);
    let points = Points::new(&x, DIMS).unwrap();
    let fit = |starts: usize| {
        let options = FitOptions { starts, ..FitOptions::default() };
        Gp::fit(points, &y, &options, &mut ChaCha8Rng::seed_from_u64(9)).unwrap()
    };
    let (one, six) = (fit(1), fit(6));
    assert!(six.log_marginal_likelihood() >= one.log_marginal_likelihood() - 1e-9);
    assert_eq!(six.report().unwrap().starts.len(), 6);
    assert_same(&six, &fit(6), f64::MIN_POSITIVE);
}
