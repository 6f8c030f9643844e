//! Robots that differ from their model, and robots that are held.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{ChangesConfig, MujocoConfig, MujocoRobot, PerJoint};
use stridemap_robot::{Hold, JointTargets, LegJoint, Robot as _, Side};

fn robot(changes: ChangesConfig) -> MujocoRobot {
    let config = MujocoConfig {
        control_period_s: 0.02,
        time_step_s: Some(0.001),
        actuators: false,
        kp_nm_rad: Some(PerJoint::All(3000.0)),
        kv_nms_rad: Some(PerJoint::All(100.0)),
        changes: Some(changes),
        ..MujocoConfig::default()
    };
    MujocoRobot::new(config).unwrap()
}

fn late(action_delay_s: f64) -> ChangesConfig {
    ChangesConfig { action_delay_s: Some(action_delay_s), ..ChangesConfig::default() }
}

/// Angle of the left knee after so many periods, bent from the first on by a radian's tenth, or not.
fn knee(delay_s: f64, bent: bool, periods: usize) -> f64 {
    let mut robot = robot(late(delay_s));
    let rest = robot.description().rest();
    let at = robot.description().legs[(Side::Left, LegJoint::Knee)].unwrap().joint;
    robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
    let mut targets: JointTargets = rest;
    targets.joints[at].position_rad += if bent { 0.1 } else { 0.0 };
    for _ in 0..periods {
        robot.step(&targets).unwrap();
    }
    robot.state().joints[at].position_rad
}

#[test]
fn late_commands_act_when_they_arrive() {
    let moved = |delay_s, periods| (knee(delay_s, true, periods) - knee(delay_s, false, periods)).abs();
    assert_eq!(moved(0.02, 1).to_bits(), 0, "a whole period late");
    assert!(moved(0.02, 2) > 1e-3);
    let (at_once, half) = (moved(0.0, 1), moved(0.01, 1));
    assert!(half > 1e-4 && half < 0.6 * at_once, "{half} {at_once}");
    // Three periods and a half.
    assert_eq!(moved(0.07, 3).to_bits(), 0);
    assert!(moved(0.07, 4) > 1e-4);
}

/// Half the gain sags twice as far under the same load, as long as that is little.
#[test]
fn weak_joints_sag_further() {
    let sag = |gain: f64| {
        let mut robot =
            robot(ChangesConfig { gain_left: Some(gain), gain_right: Some(gain), ..ChangesConfig::default() });
        let rest = robot.description().rest();
        let at = robot.description().legs[(Side::Left, LegJoint::Knee)].unwrap().joint;
        robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
        robot.hold(Some(Hold::default())).unwrap();
        for _ in 0..100 {
            robot.step(&rest).unwrap();
        }
        robot.state().joints[at].position_rad - rest.joints[at].position_rad
    };
    let ratio = sag(0.5) / sag(1.0);
    assert!((1.6..2.6).contains(&ratio), "{ratio}");
}

/// A robot that hangs feels no floor, and follows the strap's tilt.
#[test]
fn a_held_robot_hangs_and_is_turned() {
    let mut robot = robot(ChangesConfig::default());
    let rest = robot.description().rest();
    robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1)).unwrap();
    let height = robot.state().base.position_m[2];
    let hold = Hold { turned_rad: [0.0, 0.2, 0.0], raised_m: 0.2, weight_share: 1.0 };
    for _ in 0..250 {
        robot.hold(Some(hold)).unwrap();
        robot.step(&rest).unwrap();
    }
    let state = robot.state();
    assert!(state.feet.iter().all(|foot| foot.load_n.abs() < 1e-9));
    assert!((state.base.position_m[2] - height - 0.2).abs() < 0.05, "{:?}", state.base);
    assert!((state.base.tilt_rad() - 0.2).abs() < 0.1, "{}", state.base.tilt_rad());
}
