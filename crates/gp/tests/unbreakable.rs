//! Whatever the data: an answer without NaN or negative variance, or a typed error. Never a panic.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]
#![allow(clippy::needless_range_loop, reason = "an index runs over several arrays")]

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_gp::{
    Bounds, Draw, FitOptions, Gp, GpError, Hyperparameters, Kernel, Mean, Points, Range, Scratch, Warning,
};

const KERNELS: [Kernel; 3] = [Kernel::SquaredExponential, Kernel::Matern32, Kernel::Matern52];
const MEANS: [Mean; 3] = [Mean::Zero, Mean::Constant, Mean::Linear];

/// Training data with one or more of the troubles that users report.
#[derive(Clone, Debug)]
struct Trouble {
    dims: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    queries: Vec<f64>,
}

fn trouble() -> impl Strategy<Value = Trouble> {
    let shape = (1..=14_usize, 1..=3_usize);
    shape.prop_flat_map(|(n, dims)| {
        (
            prop::collection::vec(-1.0..1.0_f64, n * dims),
            prop::collection::vec(-1.0..1.0_f64, n),
            prop::collection::vec(-2.0..2.0_f64, 3 * dims),
            // Scales of the inputs, up to 1e5 apart and 1e±8 in all; scale of the outputs.
            prop::collection::vec(prop::sample::select(vec![1.0, 1e5, 1e-5]), dims),
            prop::sample::select(vec![1.0, 1e8, 1e-8]),
            prop::sample::select(vec![1.0, 1e8, 1e-8]),
            // Far origin; constant outputs; repeated inputs; a constant column.
            prop::sample::select(vec![0.0, 1e8]),
            prop::sample::select(vec![0, 0, 0, 1, 2]),
            prop::sample::select(vec![None, Some(0.0), Some(1e-12), Some(1e-7)]),
            prop::bool::weighted(0.2),
        )
            .prop_map(move |(mut x, mut y, mut queries, scales, all, out, origin, constant, twin, still)| {
                if let Some(distance) = twin {
                    // The second half repeats the first, to within `distance`.
                    for i in n.div_ceil(2)..n {
                        for d in 0..dims {
                            x[i * dims + d] = x[(i - n.div_ceil(2)) * dims + d] + distance;
                        }
                    }
                }
                for d in 0..dims {
                    let place = |v: &mut f64| *v = (*v + origin) * scales[d] * all;
                    x.iter_mut().skip(d).step_by(dims).for_each(place);
                    queries.iter_mut().skip(d).step_by(dims).for_each(place);
                }
                if still {
                    x.iter_mut().step_by(dims).for_each(|v| *v = 3.0);
                }
                y.iter_mut().for_each(|v| *v *= out);
                match constant {
                    1 => y.fill(0.0),
                    2 => y.fill(out),
                    _ => {}
                }
                Trouble { dims, x, y, queries }
            })
    })
}

/// Every number that a model can be asked for is finite, every variance at least zero.
fn examine(gp: &Gp, case: &Trouble) -> Result<(), TestCaseError> {
    prop_assert!(gp.log_marginal_likelihood().is_finite());
    let mut scratch = Scratch::new();
    let count = case.queries.len() / case.dims;
    let (mut mean, mut variance) = (vec![0.0; count], vec![0.0; count]);
    let queries = Points::new(&case.queries, case.dims).unwrap();
    gp.predict_batch(queries, &mut mean, &mut variance, &mut scratch).unwrap();
    for (i, x) in queries.rows().chain(Points::new(&case.x, case.dims).unwrap().rows()).enumerate() {
        let at = gp.predict(x).unwrap();
        prop_assert!(at.mean.is_finite() && at.latent_variance >= 0.0, "{at:?}");
        prop_assert!(at.latent_variance.is_finite());
        if i < count {
            let scale = gp.hyperparameters().signal_variance;
            prop_assert!((variance[i] - at.latent_variance).abs() <= 1e-6 * (scale + at.latent_variance));
        }
        let (mut dm, mut dv) = (vec![0.0; case.dims], vec![0.0; case.dims]);
        gp.predict_gradient(x, &mut dm, &mut dv, &mut scratch).unwrap();
        prop_assert!(dm.iter().chain(&dv).all(|g| g.is_finite()));
    }
    let mut draw = vec![0.0; count];
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    gp.sample_joint(queries, Draw::Latent, &mut rng, &mut draw).unwrap();
    prop_assert!(draw.iter().all(|v| v.is_finite()));
    if let Ok(loo) = gp.leave_one_out() {
        prop_assert!(loo.variances.iter().all(|v| v.is_finite() && *v > 0.0));
        prop_assert!(loo.residuals.iter().all(|v| v.is_finite()));
    }
    let card = gp.card();
    prop_assert!(card.condition_number.is_some_and(|c| c >= 0.5), "{card}");
    let again = Gp::from_json(&gp.to_json().unwrap()).unwrap();
    for x in queries.rows() {
        prop_assert_eq!(gp.predict(x).unwrap(), again.predict(x).unwrap());
    }
    Ok(())
}

/// Errors that say that the request cannot be met, as against that the code could not cope.
fn is_honest(error: &GpError) -> bool {
    matches!(error, GpError::MeanNotIdentifiable { .. } | GpError::NotPositiveDefinite { .. })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn fitting_gives_an_answer_or_a_typed_error(
        case in trouble(),
        kernel in prop::sample::select(KERNELS.to_vec()),
        mean in prop::sample::select(MEANS.to_vec()),
        standardize in any::<bool>(),
    ) {
        let points = Points::new(&case.x, case.dims).unwrap();
        let options = FitOptions {
            kernel,
            mean,
            standardize_inputs: standardize,
            standardize_outputs: standardize,
            max_evaluations: 60,
            ..FitOptions::default()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        match Gp::fit(points, &case.y, &options, &mut rng) {
            Ok(gp) => examine(&gp, &case)?,
            // Only a mean may be impossible: the noise is bounded away from zero.
            Err(GpError::MeanNotIdentifiable { .. }) => prop_assert!(mean != Mean::Zero),
            Err(error) => prop_assert!(false, "{error}"),
        }
    }

    #[test]
    fn conditioning_gives_an_answer_or_a_typed_error(
        case in trouble(),
        kernel in prop::sample::select(KERNELS.to_vec()),
        mean in prop::sample::select(MEANS.to_vec()),
        noise in prop::sample::select(vec![1e-300, 1e-16, 1e-14, 1e-12, 1e-8, 1e-2]),
        scale in prop::sample::select(vec![1e-8, 1.0, 1e8]),
    ) {
        let points = Points::new(&case.x, case.dims).unwrap();
        let hyperparameters = Hyperparameters {
            length_scales: vec![scale; case.dims],
            signal_variance: 1.0,
            noise_variance: noise,
        };
        match Gp::condition(points, &case.y, kernel, mean, hyperparameters) {
            Ok(gp) => match gp.predict(&case.x[..case.dims]) {
                Ok(at) => prop_assert!(at.mean.is_finite() && at.latent_variance >= 0.0),
                Err(error) => prop_assert!(matches!(error, GpError::Variance { .. }), "{error}"),
            },
            Err(error) => prop_assert!(is_honest(&error), "{error}"),
        }
    }
}

#[test]
fn an_entry_that_is_not_finite_is_named() {
    let values = [0.0, 1.0, 2.0, f64::NAN];
    assert!(matches!(Points::new(&values, 2), Err(GpError::NotFinite { array: "points", row: 1, column: 1, .. })));
    let points = Points::new(&[0.0, 1.0], 1).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let fit = Gp::fit(points, &[1.0, f64::INFINITY], &FitOptions::default(), &mut rng);
    assert!(matches!(fit, Err(GpError::NotFinite { array: "y", row: 1, .. })));
}

#[test]
fn impossible_requests_are_named() {
    let points = Points::new(&[0.0, 1.0], 1).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut fit = |options: &FitOptions| Gp::fit(points, &[1.0, 2.0], options, &mut rng).unwrap_err();
    let bounds = Bounds { noise_variance: Some(Range::new(2.0, 1.0)), ..Bounds::default() };
    let error = fit(&FitOptions { bounds, ..FitOptions::default() });
    assert!(matches!(error, GpError::Range { name: "noise_variance", .. }));
    let bounds = Bounds { length_scales: Some(vec![]), ..Bounds::default() };
    let error = fit(&FitOptions { bounds, ..FitOptions::default() });
    assert!(matches!(error, GpError::Shape { expected: 1, found: 0, .. }));
    let error = fit(&FitOptions { starts: 0, ..FitOptions::default() });
    assert!(matches!(error, GpError::Empty { what: "starts" }));
    let empty = Points::new(&[], 3).unwrap();
    let error = Gp::fit(empty, &[], &FitOptions::default(), &mut rng).unwrap_err();
    assert!(matches!(error, GpError::Empty { what: "points" }));
    assert!(matches!(Points::new(&[1.0; 5], 2), Err(GpError::Shape { expected: 6, found: 5, .. })));
}

#[test]
fn a_cut_or_changed_file_is_a_clear_error() {
    let points = Points::new(&[0.0, 1.0, 2.5], 1).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let gp = Gp::fit(points, &[0.1, 0.9, 0.4], &FitOptions::default(), &mut rng).unwrap();
    let text = gp.to_json().unwrap();
    for cut in 0..text.len() {
        let error = Gp::from_json(&text[..cut]).unwrap_err();
        assert!(matches!(error, GpError::Parse { .. }), "cut at {cut}: {error}");
    }
    let newer = text.replace("\"version\":1", "\"version\":2");
    assert!(matches!(Gp::from_json(&newer), Err(GpError::Format { .. })));
    let changed = text.replace("2.5", "2.25");
    assert!(matches!(Gp::from_json(&changed), Err(GpError::Corrupt { what: "checksum", .. })));
}

/// However far a query is, and in whatever direction: the prior, or, where a linear mean has no value, an error.
#[test]
fn very_far_from_the_data_is_the_prior() {
    let (x, y) = ([0.0, 1.0, 2.5, 4.0], [1.0, 0.5, -0.5, 0.25]);
    let points = Points::new(&x, 1).unwrap();
    for kernel in KERNELS {
        for mean in MEANS {
            let hyperparameters =
                Hyperparameters { length_scales: vec![0.5], signal_variance: 2.0, noise_variance: 0.1 };
            let gp = Gp::condition(points, &y, kernel, mean, hyperparameters).unwrap();
            let level = gp.mean_coefficients().first().copied().unwrap_or(0.0);
            for far in [1e10, 1e153, 1e154, 1e155, 1e200, 1e300, f64::MAX, -f64::MAX] {
                let (mut m, mut v) = ([0.0], [0.0]);
                let (mut dm, mut dv) = ([0.0], [0.0]);
                let mut scratch = Scratch::new();
                let query = [far];
                let batch = gp.predict_batch(Points::new(&query, 1).unwrap(), &mut m, &mut v, &mut scratch);
                let gradient = gp.predict_gradient(&[far], &mut dm, &mut dv, &mut scratch);
                match gp.predict(&[far]) {
                    Ok(at) => {
                        batch.unwrap();
                        gradient.unwrap();
                        for value in [at.mean, at.latent_variance, m[0], v[0], dm[0], dv[0]] {
                            assert!(value.is_finite(), "{kernel:?} {mean:?} at {far}");
                        }
                        if mean != Mean::Linear {
                            assert!((at.mean - level).abs() < 1e-12 && (m[0] - level).abs() < 1e-12);
                            assert!(at.latent_variance >= 2.0 - 1e-12 && v[0] >= 2.0 - 1e-12);
                        }
                    }
                    Err(_) => assert!(mean == Mean::Linear && far.abs() > 1e100),
                }
            }
        }
        assert_eq!(kernel.covariance(f64::INFINITY, 2.0).to_bits(), 0);
        assert_eq!(kernel.slope(f64::INFINITY, 2.0).to_bits(), 0);
    }
}

/// `0.3` and `0.1 + 0.2` are one number to the robot: such an input is one that never changes.
#[test]
fn an_input_constant_to_rounding_is_constant() {
    let x: Vec<f64> = (0..40).flat_map(|i| [0.1 * f64::from(i), if i % 3 == 0 { 0.3 } else { 0.1 + 0.2 }]).collect();
    let y: Vec<f64> = x.chunks_exact(2).map(|x| x[0].sin()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let gp = Gp::fit(Points::new(&x, 2).unwrap(), &y, &FitOptions::default(), &mut rng).unwrap();
    let warnings = gp.card().warnings;
    assert!(warnings.contains(&Warning::ConstantInput { dimension: 1 }), "{warnings:?}");
    assert!(gp.hyperparameters().length_scales[1] > 1e-2);
    // At 1e-10 beside the column the map is what it is on it.
    let (on, beside) = (gp.predict(&[2.0, 0.3]).unwrap(), gp.predict(&[2.0, 0.3 + 1e-10]).unwrap());
    assert!((on.mean - beside.mean).abs() < 1e-6 && (on.mean - 2.0_f64.sin()).abs() < 1e-2);
    // A slope along it is not determined, as along one that is constant to the bit.
    let linear = FitOptions { mean: Mean::Linear, ..FitOptions::default() };
    let error = Gp::fit(Points::new(&x, 2).unwrap(), &y, &linear, &mut rng).unwrap_err();
    assert!(matches!(error, GpError::MeanNotIdentifiable { .. }), "{error}");
    // Targets that differ by rounding are equal.
    let level: Vec<f64> = (0..40).map(|i| if i % 2 == 0 { 0.3 } else { 0.1 + 0.2 }).collect();
    let options = FitOptions { mean: Mean::Constant, ..FitOptions::default() };
    let gp = Gp::fit(Points::new(&x, 2).unwrap(), &level, &options, &mut rng).unwrap();
    assert!(gp.card().warnings.contains(&Warning::ConstantOutputs));
    assert!((gp.predict(&[1.0, 0.3]).unwrap().mean - 0.3).abs() < 1e-12);
}

/// One search may end where everything is noise; the default makes more, and the card says it of one that did.
#[test]
fn a_wave_is_not_fitted_as_noise() {
    for seed in 1..=5 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let x: Vec<f64> = (0..100).map(|i| 5.0 * f64::from(i) / 99.0).collect();
        let noise = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
        let y: Vec<f64> = x.iter().map(|x| (5.0 * x).sin() + 0.05 * noise(&mut rng)).collect();
        let points = Points::new(&x, 1).unwrap();
        let gp = Gp::fit(points, &y, &FitOptions::default(), &mut rng).unwrap();
        assert!(gp.log_marginal_likelihood() > 80.0, "seed {seed}: {}", gp.log_marginal_likelihood());
        assert!(!gp.card().warnings.contains(&Warning::AllNoise));
        let one = FitOptions { starts: 1, ..FitOptions::default() };
        let flat = Gp::fit(points, &y, &one, &mut rng).unwrap();
        if flat.log_marginal_likelihood() < 0.0 {
            assert!(flat.card().warnings.contains(&Warning::AllNoise));
        }
    }
}

/// A fit that this machine cannot hold is refused before its memory is asked for.
#[test]
fn a_fit_beyond_the_memory_is_refused_with_the_numbers() {
    if !cfg!(target_os = "linux") {
        return;
    }
    let n = 3_000_000;
    let x: Vec<f64> = (0..n).map(f64::from).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let error = Gp::fit(Points::new(&x, 1).unwrap(), &x, &FitOptions::default(), &mut rng).unwrap_err();
    assert!(matches!(error, GpError::Memory { points: 3_000_000, needed_gb, .. } if needed_gb > 200_000.0));
    assert!(error.to_string().contains("room for an exact model of about"), "{error}");
}
