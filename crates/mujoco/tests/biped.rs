//! The built-in biped against physics that does not come from the simulator.

use std::error::Error;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{MujocoConfig, MujocoRobot};
use stridemap_robot::contract::{Start, check};
use stridemap_robot::{JointTargets, LegJoint, Robot, RobotError, RobotState, Side};

type Outcome = Result<(), Box<dyn Error>>;

/// The biped at rest, reset with seed 1.
fn standing(config: MujocoConfig) -> Result<(MujocoRobot, JointTargets), Box<dyn Error>> {
    let mut robot = MujocoRobot::new(config)?;
    let rest = robot.description().rest();
    robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    Ok((robot, rest))
}

/// Where a leg joint is among the robot's.
fn at(robot: &MujocoRobot, side: Side, joint: LegJoint) -> usize {
    let mut roles = robot.description().legs.roles();
    let role = roles.find(|(s, j, _)| (*s, *j) == (side, joint));
    role.map_or(usize::MAX, |(.., role)| role.joint)
}

#[test]
fn weighs_95_kg_with_its_mass_0_812_m_high() -> Outcome {
    let (robot, rest) = standing(MujocoConfig::default())?;
    assert!((robot.description().mass_kg - 95.0).abs() < 1e-9);
    let state = robot.state();
    assert!((state.com.position_m[2] - 0.8124).abs() < 5e-4, "{state:?}");
    assert!(state.base.tilt_rad() < 1e-9);
    for (joint, rest) in state.joints.iter().zip(&rest.joints) {
        assert!((joint.position_rad - rest.position_rad).abs() < 1e-12);
    }
    for side in Side::BOTH {
        let [x, y, z] = state.foot(side).centre_m;
        assert!((y - 0.09 * side.lateral_sign()).abs() < 1e-9);
        assert!(z.abs() < 1e-9, "the soles touch the floor: {z}");
        // Thigh and shank lean alike, so the ankle lies below the hip; the sole's centre 15 mm before it.
        assert!((x - 0.015).abs() < 1e-9);
    }
    Ok(())
}

#[test]
fn floor_carries_the_weight_at_rest() -> Outcome {
    let (mut robot, rest) = standing(MujocoConfig::default())?;
    for _ in 0..5000 {
        robot.step(&rest)?;
    }
    let state = robot.state();
    let weight_n = 95.0 * 9.81;
    let load_n: f64 = state.feet.iter().map(|f| f.load_n).sum();
    assert!((load_n - weight_n).abs() < 1e-3 * weight_n, "{load_n}");
    // At rest the centre of pressure lies below the centre of mass.
    let cop = state.cop_m.ok_or("no load")?;
    assert!((cop[0] - state.com.position_m[0]).abs() < 1e-3);
    assert!(cop[1].abs() < 1e-3);
    assert!(state.joints[at(&robot, Side::Left, LegJoint::Knee)].torque_nm > 0.0, "the knee is held up");
    Ok(())
}

#[test]
fn in_flight_it_falls_with_g_and_gains_the_impulse_of_a_push() -> Outcome {
    let (mut robot, rest) = standing(MujocoConfig::default())?;
    // Thrown up: four times its weight for 0.2 s.
    robot.set_push([0.0, 0.0, 4.0 * 932.0])?;
    for _ in 0..100 {
        robot.step(&rest)?;
    }
    robot.set_push([0.0; 3])?;
    robot.step(&rest)?;
    let before = robot.state().clone();
    assert_eq!(before.cop_m, None);
    assert!(before.feet.iter().all(|f| f.load_n.abs() <= 0.0));
    let force_n = [120.0, -75.0, 30.0];
    robot.set_push(force_n)?;
    for _ in 0..100 {
        robot.step(&rest)?;
    }
    let after = robot.state();
    assert_eq!(after.cop_m, None, "still in flight");
    let elapsed_s = after.time_s - before.time_s;
    let gained = after.com.velocity_m_s.iter().zip(before.com.velocity_m_s);
    for ((axis, force), (after, before)) in force_n.iter().enumerate().zip(gained) {
        let gravity = if axis == 2 { -9.81 } else { 0.0 };
        let gained = after - before;
        let expected = (force / 95.0 + gravity) * elapsed_s;
        // The integrator keeps momentum to its own order, the first, in the step of 1 ms.
        assert!((gained - expected).abs() < 2e-3, "axis {axis}: {gained} {expected}");
    }
    Ok(())
}

#[test]
fn overrides_reach_the_physics() -> Outcome {
    let config = MujocoConfig {
        mass_scale: 1.07,
        torso_offset_m: [0.02, -0.01, 0.03],
        time_step_s: Some(0.0005),
        kp_nm_rad: Some(5000.0.into()),
        torque_limit_nm: Some(400.0.into()),
        ..MujocoConfig::default()
    };
    let (nominal, _) = standing(MujocoConfig::default())?;
    let (mut robot, rest) = standing(config)?;
    assert_eq!(robot.steps_per_period(), 4);
    assert!((robot.description().mass_kg - 1.07 * 95.0).abs() < 1e-9);
    let hip = at(&robot, Side::Right, LegJoint::HipPitch);
    let limits = robot.description().joints[hip].limits;
    assert!((limits.torque_nm - 400.0).abs() < 1e-9);
    for (axis, offset_m) in [0.02, -0.01, 0.03].into_iter().enumerate() {
        let moved = robot.state().com.position_m[axis] - nominal.state().com.position_m[axis];
        assert!((moved - offset_m * 57.0 / 95.0).abs() < 1e-9);
    }
    assert_eq!(robot.geometry(), nominal.geometry());
    let mut poses = [Vec::new(), Vec::new()];
    robot.poses(&mut poses[0]);
    nominal.poses(&mut poses[1]);
    assert_eq!(poses[0], poses[1], "the mass moved, the bodies did not");
    for _ in 0..5000 {
        robot.step(&rest)?;
    }
    let load_n: f64 = robot.state().feet.iter().map(|f| f.load_n).sum();
    assert!((load_n - 1.07 * 95.0 * 9.81).abs() < 1.0, "{load_n}");
    assert_ne!(robot.provenance()?.model_sha256, nominal.provenance()?.model_sha256);
    Ok(())
}

#[test]
fn feet_slip_on_ice_and_not_on_wood() -> Outcome {
    let slip = |friction| -> Result<f64, Box<dyn Error>> {
        let (mut robot, rest) = standing(MujocoConfig { friction: Some(friction), ..MujocoConfig::default() })?;
        robot.set_push([60.0, 0.0, 0.0])?;
        let start_m = robot.state().foot(Side::Left).centre_m[0];
        for _ in 0..150 {
            robot.step(&rest)?;
        }
        Ok(robot.state().foot(Side::Left).centre_m[0] - start_m)
    };
    // 60 N are 6 % of the weight. Soft contacts creep by a fraction of a millimetre.
    assert!(slip(0.02)? > 0.01);
    assert!(slip(0.8)?.abs() < 0.001);
    Ok(())
}

#[test]
fn snapshot_goes_back_to_the_bit() -> Outcome {
    let (mut robot, rest) = standing(MujocoConfig::default())?;
    let legs = robot.description().legs;
    let sway = |period: u32| {
        let mut targets = rest.clone();
        for (_, joint, role) in legs.roles() {
            let angle = 0.05 * (0.01 * f64::from(period)).sin();
            match joint {
                LegJoint::HipRoll => targets.joints[role.joint].position_rad -= angle,
                LegJoint::AnkleRoll => targets.joints[role.joint].position_rad += angle,
                _ => {}
            }
        }
        targets
    };
    robot.set_push([0.0, 20.0, 0.0])?;
    for period in 0..200 {
        robot.step(&sway(period))?;
    }
    let moment = robot.snapshot();
    let mut future = Vec::new();
    for period in 200..700 {
        future.push(robot.step(&sway(period))?.clone());
    }
    let (mut other, _) = standing(MujocoConfig::default())?;
    for one in [&mut robot, &mut other] {
        one.restore(&moment)?;
        assert_eq!(one.snapshot(), moment);
        for (period, expected) in (200..700).zip(&future) {
            assert_eq!(one.step(&sway(period))?, expected);
        }
    }
    Ok(())
}

#[test]
fn soles_are_level_in_any_posture_that_allows_it() -> Outcome {
    let (mut robot, mut rest) = standing(MujocoConfig::default())?;
    let ahead = |s: &RobotState| s.com.position_m[0] - s.foot(Side::Left).centre_m[0];
    let upright_m = ahead(robot.state());
    for side in Side::BOTH {
        let ankle = at(&robot, side, LegJoint::AnklePitch);
        rest.joints[ankle].position_rad += 3.0_f64.to_radians();
    }
    let state = robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    // Toes up by 3 degrees with an upright base: the base leans forward instead.
    assert!((state.base.tilt_rad() - 3.0_f64.to_radians()).abs() < 1e-9);
    // About 0.8 m above the ankles, so the mass moves forward by about 0.8 m times 3 degrees.
    assert!((ahead(state) - upright_m - 0.04).abs() < 0.004);
    for side in Side::BOTH {
        assert!(state.foot(side).centre_m[2].abs() < 1e-9);
    }
    Ok(())
}

#[test]
fn keeps_the_contract_disturbed_or_not() -> Outcome {
    let calm = MujocoConfig::default();
    let disturbed = MujocoConfig { start_joint_noise_deg: 0.5, start_velocity_noise_m_s: 0.02, ..calm.clone() };
    let make = |config: &MujocoConfig| {
        let what = "the built-in biped";
        MujocoRobot::new(config.clone()).map_err(|_| RobotError::Unsupported { what })
    };
    check(|| make(&calm), Start::Exact)?;
    check(|| make(&disturbed), Start::Disturbed)?;
    Ok(())
}

#[test]
fn has_a_shape_and_a_hash() -> Outcome {
    let (robot, _) = standing(MujocoConfig::default())?;
    let shapes = robot.geometry();
    let mut poses = Vec::new();
    robot.poses(&mut poses);
    assert_eq!(poses.len(), 12, "the world, the torso and ten bodies of the legs");
    assert!(shapes.iter().all(|shape| !shape.name.is_empty()));
    assert!(shapes.iter().any(|shape| shape.name == "right_sole"));
    let provenance = robot.provenance()?;
    assert_eq!(provenance.engine, "MuJoCo 3.17.0");
    assert_eq!(provenance.model_sha256.len(), 64);
    let (again, _) = standing(MujocoConfig::default())?;
    assert_eq!(again.provenance()?, provenance);
    Ok(())
}
