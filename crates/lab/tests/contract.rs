//! One contract for every stride process: robots in their plants, the map learned of one, its cautious view, and exact
//! maps.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_lab::{Algorithm, CautiousMap, NoRecorder, PessimismConfig, builtin};
use stridemap_map::LearnedMap;
use stridemap_process::{Action, MeanMap, Next, ProcessError, Situation, Stride, StrideEnd, StrideProcess, walk};
use stridemap_testbed::{
    CompassGait, CompassGaitParameters, LinearGaussianMap, LinearGaussianParameters, RimlessWheel,
    RimlessWheelParameters,
};

/// The map learned of twenty strides, in which a low `psi_roll` is a fall.
fn learned() -> LearnedMap {
    let sets = ["collect.strides=[20]".into(), "record.pose_seconds=0".into(), "failure.psi_roll_below_deg=1.5".into()];
    let task = builtin::load("stepping", &sets).unwrap().task;
    let mut algorithm = Algorithm::new(&task, 1).unwrap().however_often_it_falls();
    algorithm.collect(&mut NoRecorder).unwrap();
    algorithm.fit(&mut NoRecorder).unwrap()
}

fn cautious() -> CautiousMap {
    let map = learned();
    let spec = map.spec().clone();
    let config = PessimismConfig {
        std_weight: 1.0,
        unsafe_penalty: 0.6,
        psi_roll_below_in_place_deg: Some(2.0),
        flip_penalty: 0.1,
        flip_free_deg_s: 1.0,
    };
    CautiousMap::new(map, config, spec, Some((0, 1.0)), None)
}

fn plant(task: &str) -> Box<dyn StrideProcess> {
    Box::new(builtin::load(task, &[]).unwrap().task.plant().unwrap())
}

/// Every kind of process, and within how many strides it ends under its largest action, where it does.
fn processes() -> Vec<(&'static str, Box<dyn StrideProcess>, Option<usize>)> {
    let linear = LinearGaussianParameters { fall_beyond: Some(1.2), ..LinearGaussianParameters::stepping() };
    let wheel = RimlessWheelParameters { slope_std_rad: 0.04, ..Default::default() };
    let compass = CompassGaitParameters { initial_std: 0.02, ..Default::default() };
    vec![
        ("biped", plant("stepping"), None),
        ("walking biped", plant("walking"), Some(60)),
        ("small humanoid", plant("small-stepping"), None),
        ("learned map", Box::new(learned()), Some(200)),
        ("cautious map", Box::new(cautious()), Some(200)),
        ("linear", Box::new(LinearGaussianMap::new(linear).unwrap()), Some(200)),
        ("rimless wheel", Box::new(RimlessWheel::new(wheel).unwrap()), None),
        ("compass gait", Box::new(CompassGait::new(compass).unwrap()), Some(200)),
    ]
}

/// Strides under actions that change, restarted when they end, and where each began.
fn strides(process: &mut dyn StrideProcess, seed: u64, count: usize) -> Vec<(Situation, Stride)> {
    let mut made = Vec::new();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let bounds: Vec<[f64; 2]> = process.spec().action.iter().map(|a| [a.lower, a.upper]).collect();
    let mut k = 0;
    let act = |_: &Situation| {
        k += 1;
        bounds.iter().map(|[l, u]| l + (u - l) * 0.2 * f64::from(k % 4)).collect()
    };
    walk(process, count, &mut rng, act, |_, stride| {
        made.push((stride.at.clone(), stride.stride.clone()));
        Next::Go
    })
    .unwrap();
    made
}

#[test]
fn the_same_seed_gives_the_same_strides_and_another_does_not() {
    for (name, mut process, _) in processes() {
        let first = strides(process.as_mut(), 1, 6);
        assert_eq!(first, strides(process.as_mut(), 1, 6), "{name}");
        // The simulated biped has no noise, and starts where its gait stands.
        assert_eq!(first == strides(process.as_mut(), 2, 6), name.contains("biped"), "{name}");
        let spec = process.spec();
        for (at, stride) in &first {
            for situation in [at, &stride.next] {
                assert_eq!((situation.state.len(), situation.last_action.len()), (spec.state.len(), spec.action.len()));
                assert!(situation.state.iter().all(|x| x.is_finite()), "{name}");
            }
            assert!(stride.reward.is_finite(), "{name}");
        }
    }
}

/// What comes after a stride begins where it ended; a reset gives the section, with the action of before.
#[test]
fn an_episode_is_one_piece() {
    for (name, mut process, _) in processes() {
        let made = strides(process.as_mut(), 3, 6);
        for pair in made.windows(2) {
            if pair[0].1.end == StrideEnd::Crossing {
                assert_eq!(pair[0].1.next, pair[1].0, "{name}");
            }
        }
    }
}

#[test]
fn actions_are_checked_and_bounded_and_a_refused_one_changes_nothing() {
    for (name, mut process, _) in processes() {
        let bounds = process.spec().action.clone();
        let middle: Action = bounds.iter().map(|b| 0.5 * (b.lower + b.upper)).collect();
        let fresh = |process: &mut dyn StrideProcess| {
            let mut rng = ChaCha8Rng::seed_from_u64(4);
            process.reset(&mut rng).unwrap();
            rng
        };
        let mut rng = fresh(process.as_mut());
        let expected = process.stride(&middle, &mut rng).unwrap();
        let mut rng = fresh(process.as_mut());
        for bad in
            [vec![f64::NAN; middle.len()], vec![f64::INFINITY; middle.len()], vec![0.0; middle.len() + 1], vec![]]
        {
            let error = process.stride(&bad, &mut rng).unwrap_err();
            let told = matches!(error, ProcessError::ActionNotFinite { .. } | ProcessError::ActionLength { .. });
            assert!(told, "{name}: {bad:?}: {error}");
        }
        assert_eq!(process.stride(&middle, &mut rng).unwrap(), expected, "{name}");
        for far in [1e9, -1e9] {
            let mut rng = fresh(process.as_mut());
            let applied = process.stride(&vec![far; middle.len()], &mut rng).unwrap().action().clone();
            let within = applied.iter().zip(&bounds).all(|(u, b)| (b.lower..=b.upper).contains(u));
            assert!(within, "{name}: {applied:?}");
        }
    }
}

#[test]
fn an_end_is_terminal() {
    for (name, mut process, ends_within) in processes() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let action: Action = process.spec().action.iter().map(|a| a.upper).collect();
        assert!(matches!(process.stride(&action, &mut rng), Err(ProcessError::NotReset)), "{name}");
        let Some(most) = ends_within else { continue };
        let mut end = StrideEnd::Crossing;
        walk(
            process.as_mut(),
            most,
            &mut rng,
            |_| action.clone(),
            |_, made| {
                end = made.stride.end;
                if end == StrideEnd::Crossing { Next::Go } else { Next::Stop }
            },
        )
        .unwrap();
        assert!(end.is_terminal(), "{name}: {end:?}");
        assert!(matches!(process.stride(&action, &mut rng), Err(ProcessError::NotReset)), "{name}");
        process.reset(&mut rng).unwrap();
        process.stride(&action, &mut rng).unwrap();
    }
}

/// Without noise a stride is the mean map, of the learned one as well.
#[test]
fn strides_without_noise_follow_the_mean_map() {
    fn check(name: &str, process: &mut (impl StrideProcess + MeanMap)) {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let at = process.reset(&mut rng).unwrap();
        let mean = process.mean_next_state(&at, &[0.2]).unwrap();
        assert_eq!(process.stride(&[0.2], &mut rng).unwrap().next.state, mean, "{name}");
    }
    let linear = LinearGaussianParameters { noise_std: vec![0.0], ..LinearGaussianParameters::stepping() };
    check("linear", &mut LinearGaussianMap::new(linear).unwrap());
    check("wheel", &mut RimlessWheel::new(RimlessWheelParameters::default()).unwrap());
    check("compass", &mut CompassGait::new(CompassGaitParameters::default()).unwrap());
}
