//! The contract of `StrideProcess`, over every exact map.

#![allow(clippy::unwrap_used)]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_process::{MeanMap, ProcessError, Stride, StrideEnd, StrideProcess};
use stridemap_testbed::{
    CompassGait, CompassGaitParameters, LinearGaussianMap, LinearGaussianParameters, RimlessWheel,
    RimlessWheelParameters,
};

fn linear() -> LinearGaussianMap {
    let parameters = LinearGaussianParameters { fall_beyond: Some(1.2), ..LinearGaussianParameters::stepping() };
    LinearGaussianMap::new(parameters).unwrap()
}

fn wheel() -> RimlessWheel {
    let rough = RimlessWheelParameters { slope_std_rad: 0.04, ..Default::default() };
    RimlessWheel::new(rough).unwrap()
}

fn compass() -> CompassGait {
    let shaken = CompassGaitParameters { initial_std: 0.02, ..Default::default() };
    CompassGait::new(shaken).unwrap()
}

fn processes() -> Vec<(&'static str, Box<dyn StrideProcess>)> {
    vec![("linear", Box::new(linear())), ("rimless wheel", Box::new(wheel())), ("compass gait", Box::new(compass()))]
}

/// Strides under changing actions, restarted when they end.
fn walk(process: &mut dyn StrideProcess, seed: u64) -> Vec<Stride> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut running = false;
    (0..100)
        .map(|k| {
            if !running {
                process.reset(&mut rng).unwrap();
            }
            let stride = process.stride(&[0.1 * f64::from(k % 5)], &mut rng).unwrap();
            running = stride.end == StrideEnd::Crossing;
            stride
        })
        .collect()
}

#[test]
fn the_same_seed_gives_the_same_strides_and_another_does_not() {
    for (name, mut process) in processes() {
        let first = walk(process.as_mut(), 1);
        assert_eq!(first, walk(process.as_mut(), 1), "{name}");
        assert_ne!(first, walk(process.as_mut(), 2), "{name}");
        let states = process.spec().state.len();
        for stride in &first {
            assert_eq!(stride.next.state.len(), states, "{name}");
            assert!(stride.next.state.iter().all(|x| x.is_finite()) && stride.reward.is_finite());
        }
    }
}

#[test]
fn actions_are_checked_and_clipped() {
    for (name, mut process) in processes() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        assert!(matches!(process.stride(&[0.0], &mut rng), Err(ProcessError::NotReset)), "{name}");
        process.reset(&mut rng).unwrap();
        for bad in [&[f64::NAN][..], &[f64::INFINITY], &[], &[0.0, 0.0]] {
            assert!(process.stride(bad, &mut rng).is_err(), "{name}: {bad:?}");
        }
        let bounds = process.spec().action[0].clone();
        // A refused action does not use up the state.
        let applied = process.stride(&[1e9], &mut rng).unwrap().action()[0];
        assert_eq!(applied.to_bits(), bounds.upper.to_bits(), "{name}");
    }
}

/// Without noise a stride is the mean map.
#[test]
fn strides_without_noise_follow_the_mean_map() {
    let linear = LinearGaussianParameters { noise_std: vec![0.0], ..LinearGaussianParameters::stepping() };
    let mut linear = LinearGaussianMap::new(linear).unwrap();
    let mut wheel = RimlessWheel::new(RimlessWheelParameters::default()).unwrap();
    let mut compass = compass();
    fn check<P: StrideProcess + MeanMap>(process: &mut P) {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let at = process.reset(&mut rng).unwrap();
        let mean = process.mean_next_state(&at, &[0.2]).unwrap();
        assert_eq!(process.stride(&[0.2], &mut rng).unwrap().next.state, mean);
    }
    check(&mut linear);
    check(&mut wheel);
    check(&mut compass);
}
