//! A sparse map beside the exact one of the same strides, and of strides that no exact one holds.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use smallvec::smallvec;
use stridemap_gp::{Kernel, Mean, RegressorKind};
use stridemap_map::{
    LearnedMap, MapConfig, MapDraw, MapFailure, MapInput, MapPoint, MapSample, MapStart, MapWorld, SavedMap,
};
use stridemap_process::{ActionDimension, ActionLimits, ProcessSpec, Situation, StateDimension};

/// Standard deviation of the noise.
const NOISE: f64 = 0.05;

/// A law with a bend in each input.
fn law(x: f64, u: f64) -> f64 {
    0.6 * x + (1.5 * u).sin() - 0.2 * x * x
}

fn fitted(regressor: RegressorKind, strides: usize, mean: Mean) -> LearnedMap {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let samples: Vec<MapSample> = (0..strides)
        .map(|_| {
            let mut draw = || 2.0 * rng.random::<f64>() - 1.0;
            let (x, u) = (draw(), draw());
            let noise = NOISE * (draw() + draw() + draw()); // of variance 1
            MapSample {
                at: Situation { last_action: smallvec![0.0], ..[x].into() },
                action: smallvec![u],
                next_state: smallvec![law(x, u) + noise],
                reward: 0.0,
            }
        })
        .collect();
    let config = MapConfig {
        inputs: vec![MapInput::State, MapInput::Action],
        invariant: Vec::new(),
        remembered: None,
        regressor,
        kernel: Kernel::SquaredExponential,
        mean,
        starts: 1,
        min_length_scales: None,
        min_noise_std: None,
        draw: MapDraw::Mean,
        state_range: vec![[-10.0, 10.0]],
        start: MapStart::Data,
        start_range: vec![[-1.0, 1.0]],
        prior: None,
    };
    let world = MapWorld {
        spec: ProcessSpec {
            state: vec![StateDimension { name: "x".into() }],
            action: vec![ActionDimension { name: "u".into(), lower: -1.0, upper: 1.0 }],
            goal: Vec::new(),
        },
        limits: vec![ActionLimits { lower: -1.0, upper: 1.0, rate_per_stride: f64::INFINITY, gain: 1.0, neutral: 0.0 }],
        failure: MapFailure { component: None, below: 0.0, reward: -1.0 },
        reward: Some(std::sync::Arc::new(|_: &[f64]| 0.0)),
    };
    LearnedMap::fit(config, world, &samples, &mut rng).unwrap()
}

fn grid() -> impl Iterator<Item = (f64, f64)> {
    (-4..=4).flat_map(|i| (-4..=4).map(move |j| (0.25 * f64::from(i), 0.25 * f64::from(j))))
}

/// With 80 strides the inducing inputs are as many, and what differs is a search of its own: means and standard
/// deviations agree to a tenth of the noise's, leave-one-out residuals to half of it. About a plane the exact process
/// weighs the plane by its covariance, the sparse one fits it before: they differ by less than two standard deviations
/// of what the exact one says it does not know, leave-one-out residuals by less than the noise.
#[test]
fn a_small_sparse_map_is_the_exact_one() {
    for mean in [Mean::Zero, Mean::Linear] {
        let (exact, sparse) = (fitted(RegressorKind::Exact, 80, mean), fitted(RegressorKind::Sparse, 80, mean));
        for (x, u) in grid() {
            let (a, b) = (exact.predict(&[x].into(), &[u]).unwrap(), sparse.predict(&[x].into(), &[u]).unwrap());
            let (sd_a, sd_b) = (a.latent_variances[0].sqrt(), b.latent_variances[0].sqrt());
            let (off, tolerance) =
                ((a.means[0] - b.means[0]).abs(), if mean == Mean::Zero { 0.1 * NOISE } else { 2.0 * sd_a });
            assert!(off < tolerance, "{mean:?} ({x}, {u}): {off} {tolerance}");
            assert!(mean != Mean::Zero || (sd_a - sd_b).abs() < tolerance, "({x}, {u}): {sd_a} {sd_b}");
        }
        let (a, b) = (exact.outputs()[0].leave_one_out().unwrap(), sparse.outputs()[0].leave_one_out().unwrap());
        let off = a.residuals.iter().zip(&b.residuals).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < if mean == Mean::Zero { 0.5 } else { 1.0 } * NOISE, "{mean:?}: {off}");
        let at = |x: f64| MapPoint { at: [x].into(), action: smallvec![0.0] };
        let slope = |map: &LearnedMap| map.slopes(&[(at(0.1), at(-0.1), 0.1)]).unwrap();
        let ((a, doubt_a), (b, _)) = (slope(&exact), slope(&sparse));
        assert!((a[0] - b[0]).abs() < doubt_a[0][0].sqrt(), "{mean:?}: {a} {b} {}", doubt_a[0]);
    }
}

/// 4,000 strides: the law is found to a quarter of the noise, and the noise to a tenth; a file brings the map back, and
/// tells no more than it holds.
#[test]
fn many_strides_tell_the_law_and_its_noise() {
    let map = fitted(RegressorKind::Sparse, 4000, Mean::Linear);
    for (x, u) in grid() {
        let found = map.predict(&[x].into(), &[u]).unwrap();
        assert!((found.means[0] - law(x, u)).abs() < 0.25 * NOISE, "({x}, {u}): {}", found.means[0] - law(x, u));
    }
    let noise = map.outputs()[0].hyperparameters().noise_variance.sqrt();
    assert!((noise / NOISE - 1.0).abs() < 0.1, "{noise}");
    let scores = map.outputs()[0].leave_one_out().unwrap().scores();
    assert!((scores.rmse / NOISE - 1.0).abs() < 0.1 && (scores.coverage_90 - 0.9).abs() < 0.03, "{scores:?}");

    let text = serde_json::to_string(&map.to_saved(1).unwrap()).unwrap();
    let back: SavedMap = serde_json::from_str(&text).unwrap();
    let (here, there) = (map.outputs()[0].predict(&[0.3, 0.2]), back.outputs[0].gp.predict(&[0.3, 0.2]));
    assert_eq!(here.unwrap().mean.to_bits(), there.unwrap().mean.to_bits());
    assert!(back.outputs[0].gp.leave_one_out().is_err());
}
