//! Planning and affine laws on an exact linear stride: the goal is reached, with a bias as well, and the closed form is the
//! minimum that it says it is.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::sync::Arc;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_learn::{
    ActionRole, Correction, GoalAffine, GoalCost, GoalPlanner, KeptPolicy, LinearTerm, PlanSettings, Policy, Quantity,
    SavedPolicy, Seen, SquaredTerm, choose_constants, law_about,
};
use stridemap_map::{GoalMap, GoalMapConfig, GoalSample};
use stridemap_process::{ActionDimension, Goal, GoalDimension, ProcessSpec, Situation, StateDimension};

/// One stride: speed and power are measured. The constant costs power on either side of 0.4.
fn stride(x: f64, u: &[f64]) -> ([f64; 2], f64) {
    let speed = 0.3 * x + 0.8 * u[0];
    ([speed, 1.0 + 2.0 * (u[1] - 0.4).powi(2) + 0.2 * u[0]], 0.5 * x + 0.4 * u[0])
}

fn planner() -> GoalPlanner {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut x = 0.0;
    let samples: Vec<GoalSample> = (0..80)
        .map(|_| {
            let u = [rng.random_range(-1.0..1.0), rng.random_range(0.0..1.0)];
            let (measures, next) = stride(x, &u);
            let sample =
                GoalSample { state: vec![x], action: u.to_vec(), measures: measures.to_vec(), next: Some(vec![next]) };
            x = next;
            sample
        })
        .collect();
    let config = GoalMapConfig {
        measures: vec!["speed_m_s".into(), "power_w".into()],
        units: vec![0.5, 0.5],
        invariant: Vec::new(),
        sees_state: true,
        bends: true,
        rows: 80,
    };
    let action = |name: &str, lower| ActionDimension { name: name.into(), lower, upper: 1.0 };
    GoalPlanner {
        format: 1,
        spec: ProcessSpec {
            state: vec![StateDimension { name: "x".into() }],
            action: vec![action("command_m_s", -1.0), action("stiffness", 0.0)],
            goal: vec![GoalDimension { name: "speed_m_s".into(), lower: 0.0, upper: 0.6 }],
        },
        map: Arc::new(GoalMap::fit(config, &samples, None).unwrap()),
        cost: GoalCost {
            squared: vec![SquaredTerm { of: Quantity::Measure(0), goal: Some(0), weight: 100.0 }],
            linear: vec![LinearTerm { measure: 1, weight: 0.1, doubt: 0.5 }],
        },
        roles: vec![ActionRole::Command, ActionRole::Constant],
        values: vec![0.0, 0.9],
        follows: vec![Some(0), None],
        measured: vec![0],
        settings: PlanSettings::default(),
        start: None,
    }
}

fn at(x: f64, goal: f64) -> Situation {
    Situation { goal: Goal::from_slice(&[goal]), ..Situation::of_state(&[x]) }
}

/// Speeds over strides on a robot that is slower than the map by `lack`.
fn walked(policy: &SavedPolicy, goal: f64, lack: f64) -> Vec<f64> {
    let mut acting = policy.acting().unwrap();
    let mut x = 0.0;
    (0..40)
        .map(|_| {
            let action = acting.act(&at(x, goal));
            let (mut measures, next) = stride(x, &action);
            measures[0] -= lack;
            acting.saw(&Seen { state: &[x], action: &action, goal: &[goal], measures: &measures, fell: false });
            x = next;
            measures[0]
        })
        .collect()
}

#[test]
fn a_plan_reaches_its_goal_and_a_bias_is_learned_from_stride_to_stride() {
    let planner = planner();
    planner.check().unwrap();
    let policy = planner.to_saved();
    for (goal, lack) in [(0.2, 0.0), (0.5, 0.0), (0.4, 0.1)] {
        let speeds = walked(&policy, goal, lack);
        let last = speeds[30..].iter().sum::<f64>() / 10.0;
        assert!((last - goal).abs() < 0.02, "asked {goal}, lacks {lack}: {speeds:?}");
    }
    // A file brings the same policy back.
    let text = serde_json::to_string(&policy).unwrap();
    let back: SavedPolicy = serde_json::from_str(&text).unwrap();
    assert_eq!(back, policy);
    assert_eq!(back.mean(&at(0.1, 0.3)), policy.mean(&at(0.1, 0.3)));
    back.check_fits(&planner.spec).unwrap();
}

/// With u held for two strides: V_x = 0.3, V_c = 0.8, A = 0.5, B = 0.4. Later: V_c + V_x B = 0.92, V_x A = 0.15.
/// H = ½ 0.64 + 0.8464 = 1.1664; K_x = −(½ 0.24 + 0.92 · 0.15)/H = −0.2212; K_g = (½ 0.8 + 0.92)/H = 1.1317.
#[test]
fn the_affine_law_is_the_minimum_that_its_formula_says() {
    let planner = planner();
    let law = law_about(&planner, &[0.3], &[0.0]);
    assert!((law.of_state[0][0] + 0.2212).abs() < 0.02, "{:?}", law.of_state);
    assert!((law.of_goal[0][0] - 1.1317).abs() < 0.05, "{:?}", law.of_goal);
    assert!(law.of_state[1][0].abs() < 1e-12 && (law.action[1] - 0.9).abs() < 1e-12);
    let policy = GoalAffine {
        format: 1,
        spec: planner.spec.clone(),
        measures: vec!["speed_m_s".into()],
        correction: Correction::Bias { gain: 0.2, limit: 0.2 },
        pieces: vec![law],
    };
    policy.check().unwrap();
    for (goal, lack) in [(0.3, 0.0), (0.5, 0.0), (0.4, 0.1)] {
        let speeds = walked(&policy.to_saved(), goal, lack);
        let last = speeds[30..].iter().sum::<f64>() / 10.0;
        assert!((last - goal).abs() < 0.02, "asked {goal}, lacks {lack}: {speeds:?}");
    }
}

#[test]
fn the_robots_constants_are_where_settled_strides_cost_least() {
    let planner = planner();
    let pairs: Vec<(Vec<f64>, Goal)> =
        (0..10).map(|i| (vec![0.05 * f64::from(i)], Goal::from_slice(&[0.05 * f64::from(i)]))).collect();
    let values = choose_constants(&planner, &pairs, 60, &mut ChaCha8Rng::seed_from_u64(1));
    assert!((values[1] - 0.4).abs() < 0.15, "{values:?}");
}
