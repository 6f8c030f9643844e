//! The built-in biped against physics that does not come from the simulator.

use std::error::Error;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{MujocoConfig, MujocoRobot};
use stridemap_robot::{JointTargets, LegJoint, Robot, Side};

type Outcome = Result<(), Box<dyn Error>>;

/// The biped at rest, reset with seed 1.
fn standing(config: MujocoConfig) -> Result<(MujocoRobot, JointTargets), Box<dyn Error>> {
    let rest = config.rest_targets();
    let mut robot = MujocoRobot::new(config)?;
    robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    Ok((robot, rest))
}

#[test]
fn weighs_95_kg_with_its_mass_0_812_m_high() -> Outcome {
    let (robot, rest) = standing(MujocoConfig::default())?;
    assert!((robot.description().mass_kg - 95.0).abs() < 1e-9);
    let state = robot.state();
    assert!((state.com.position_m[2] - 0.8124).abs() < 5e-4, "{state:?}");
    assert!(state.base.tilt_rad() < 1e-9);
    for (side, joint, angle) in rest.position_rad.iter() {
        assert!((state.joints[(side, joint)].position_rad - angle).abs() < 1e-12);
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
    assert!(
        state.joints[(Side::Left, LegJoint::Knee)].torque_nm > 0.0,
        "the knee is held up"
    );
    Ok(())
}
