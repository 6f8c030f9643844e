use super::*;

fn samples(n: usize, offset: f64) -> Vec<GoalSample> {
    (0..n)
        .map(|k| {
            let wave = |f: f64| (k as f64 * f).sin();
            let (x, h, u) = (wave(1.3), 5.0 * wave(0.7), 0.5 * wave(2.1));
            GoalSample {
                state: vec![x, h],
                action: vec![u],
                measures: vec![0.4 + 0.3 * x + 0.8 * u + 0.2 * u * u + offset],
                next: Some(vec![0.5 * x + u, -(h + 2.0 * u)]),
            }
        })
        .collect()
}

fn config() -> GoalMapConfig {
    GoalMapConfig {
        measures: vec!["forward_speed_m_s".into()],
        units: vec![0.5],
        invariant: vec![1],
        sees_state: true,
        bends: true,
        rows: 40,
    }
}

#[test]
fn strides_are_foretold_slopes_are_right_and_a_mirrored_heading_is_carried() {
    let map = GoalMap::fit(config(), &samples(60, 0.0), None).unwrap();
    assert_eq!(map.strides(), 40);
    let mut scratch = GoalScratch::default();
    let (x, u) = ([0.3, 30.0], [0.2]);
    map.look(&x, &mut scratch);
    let (means, variances) = map.measures(&u, &[true], &mut scratch);
    assert!((means[0] - (0.4 + 0.09 + 0.16 + 0.008)).abs() < 0.02 && variances[0] < 0.01, "{means:?}");
    let next = map.next_state(&x, &u, &mut scratch);
    assert!((next[0] - 0.35).abs() < 0.02 && (next[1] + 30.4).abs() < 0.1, "{next:?}");
    let slopes = map.slopes(&x, &u, &mut scratch);
    assert!((slopes.measures_by_state[(0, 0)] - 0.3).abs() < 0.03);
    assert!((slopes.measures_by_action[(0, 0)] - 0.88).abs() < 0.05);
    assert!((slopes.next_by_state[(1, 1)] + 1.0).abs() < 1e-9);
    let text = serde_json::to_string(&map).unwrap();
    assert_eq!(serde_json::from_str::<GoalMap>(&text).unwrap(), map);
}

/// A prior that is off by a constant: three strides of the real robot correct it where it was never asked.
#[test]
fn a_prior_is_corrected_by_few_strides() {
    let prior = Arc::new(GoalMap::fit(config(), &samples(60, 0.0), None).unwrap());
    let alone = GoalMap::fit(config(), &[], Some(prior.clone())).unwrap();
    let corrected = GoalMap::fit(config(), &samples(3, 0.5), Some(prior.clone())).unwrap();
    let mut scratch = GoalScratch::default();
    let ask = |map: &GoalMap, scratch: &mut GoalScratch| {
        map.look(&[-0.8, 0.0], scratch);
        map.measures(&[-0.4], &[], scratch).0[0]
    };
    let of_prior = ask(&prior, &mut scratch);
    assert!((ask(&alone, &mut GoalScratch::default()) - of_prior).abs() < 1e-12);
    assert!((ask(&corrected, &mut GoalScratch::default()) - of_prior - 0.5).abs() < 0.1);
}
