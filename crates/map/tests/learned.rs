//! Maps learned of strides whose law is known.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use smallvec::smallvec;
use stridemap_gp::{Kernel, Mean, RegressorKind};
use stridemap_map::{
    LearnedMap, MapConfig, MapDraw, MapError, MapFailure, MapInput, MapPoint, MapPrediction, MapSample, MapStart,
    MapWorld,
};
use stridemap_process::{
    ActionDimension, ActionLimits, ProcessSpec, Situation, StateDimension, StrideEnd, StrideProcess,
};

/// Slopes of the first component on itself and on the action, and of the turn likewise.
const F: f64 = -0.5;
const G: f64 = 0.4;
const TURN_OF_STATE: f64 = 2.0;
const TURN_OF_ACTION: f64 = 3.0;

fn turn(x: f64, u: f64) -> f64 {
    TURN_OF_STATE * x + TURN_OF_ACTION * u
}

/// In a state, after no action.
fn at(state: &[f64]) -> Situation {
    Situation { last_action: smallvec![0.0], ..Situation::of_state(state) }
}

/// A robot with one inner component and a heading, mirrored from stride to stride:
/// `x' = F x + G u`, `h' = −(h + turn(x, u))`. Headings in the data lie within 5 deg of `heading`.
fn map(heading: f64) -> Result<LearnedMap, MapError> {
    map_of(heading, Mean::Linear, 1.0)
}

/// The same with another mean, and with actions as much smaller as `actions` says.
fn map_of(heading: f64, mean: Mean, actions: f64) -> Result<LearnedMap, MapError> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let samples: Vec<MapSample> = (0..60)
        .map(|_| {
            let mut draw = || 2.0 * rng.random::<f64>() - 1.0;
            let (x, u, h) = (draw(), actions * draw(), heading + 5.0 * draw());
            MapSample {
                at: at(&[x, h]),
                action: smallvec![u],
                next_state: smallvec![F * x + G * u, -(h + turn(x, u))],
                reward: 0.0,
            }
        })
        .collect();
    let config = MapConfig {
        inputs: vec![MapInput::State, MapInput::Action],
        invariant: vec![1],
        remembered: None,
        regressor: RegressorKind::Exact,
        kernel: Kernel::SquaredExponential,
        mean,
        starts: 1,
        min_length_scales: None,
        min_noise_std: None,
        draw: MapDraw::Mean,
        state_range: vec![[-10.0, 10.0], [-1e4, 1e4]],
        start: MapStart::Data,
        start_range: vec![[-1.0, 1.0], [-5.0, 5.0]],
        prior: None,
    };
    let world = MapWorld {
        spec: ProcessSpec {
            state: ["x", "heading_deg"].map(|name| StateDimension { name: name.into() }).into(),
            action: vec![ActionDimension { name: "u".into(), lower: -2.0, upper: 2.0 }],
            goal: Vec::new(),
        },
        limits: vec![ActionLimits { lower: -2.0, upper: 2.0, rate_per_stride: f64::INFINITY, gain: 1.0, neutral: 0.0 }],
        failure: MapFailure { component: None, below: 0.0, reward: -1.0 },
        reward: Some(std::sync::Arc::new(|_: &[f64]| 0.0)),
    };
    LearnedMap::fit(config, world, &samples, &mut rng)
}

/// No direction on the floor is special: what was learned walking north holds walking south, exactly
/// shifted and mirrored, however far from the data's headings.
#[test]
fn a_heading_is_carried_not_learned() {
    let map = map(0.0).unwrap();
    for h in [0.0, 170.0, -3000.0] {
        let MapPrediction { means, latent_variances: variances, .. } = map.predict(&at(&[0.3, h]), &[-0.2]).unwrap();
        assert!((means[0] - (F * 0.3 - G * 0.2)).abs() < 1e-3, "{means:?}");
        assert!((means[1] + h + turn(0.3, -0.2)).abs() < 1e-3, "{means:?}");
        assert!(variances[1] < 1e-4, "{variances:?}");
    }
}

/// Zeros of either sign are one value, and what never changes is told by its name, not by its number.
#[test]
fn an_input_that_never_changes_is_named() {
    let saved = map_of(0.0, Mean::Constant, 0.0).unwrap().to_saved(1).unwrap();
    for output in &saved.outputs[..2] {
        let warnings = &output.warnings;
        assert!(warnings.contains(&"u never changes".into()), "{warnings:?}");
    }
}

/// The stride process goes where the prediction says.
#[test]
fn strides_carry_the_heading() {
    let mut map = map(90.0).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let from = map.reset(&mut rng).unwrap();
    let stride = map.stride(&[0.5], &mut rng).unwrap();
    assert_eq!(stride.end, StrideEnd::Crossing);
    assert!((stride.next.state[1] + from.state[1] + turn(from.state[0], 0.5)).abs() < 1e-3);
}

/// Slopes of a linear law are its coefficients, with −1 of a heading on itself; the map is sure of them
/// where it has data, and not sure of the slopes of a map that has seen the action do nothing.
#[test]
fn slopes_are_those_of_the_law_and_come_with_their_covariance() {
    let at = |x: f64, h: f64, u: f64| MapPoint { at: at(&[x, h]), action: smallvec![u] };
    let half = 0.1;
    let moves = [
        (at(half, 0.0, 0.0), at(-half, 0.0, 0.0), half),
        (at(0.0, half, 0.0), at(0.0, -half, 0.0), half),
        (at(0.0, 0.0, half), at(0.0, 0.0, -half), half),
    ];
    let (slopes, covariances) = map(0.0).unwrap().slopes(&moves).unwrap();
    let expected = [[F, 0.0, G], [-TURN_OF_STATE, -1.0, -TURN_OF_ACTION]];
    for (i, row) in expected.iter().enumerate() {
        for (j, slope) in row.iter().enumerate() {
            assert!((slopes[(i, j)] - slope).abs() < 1e-2, "{slopes}");
            assert!(covariances[i][(j, j)] < 1e-3, "{}", covariances[i]);
        }
        // Nothing depends on a heading, and the map knows it: there is nothing to learn.
        assert!(covariances[i][(1, 1)].abs() < 1e-12);
    }
}
