//! A user's own model: other names and signs, torque motors, other mass and lengths.

use std::error::Error;
use std::path::Path;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{ActuatorKind, ModelSource, MujocoConfig, MujocoError, MujocoRobot};
use stridemap_robot::contract::{Start, check};
use stridemap_robot::{Guarded, JointTargets, LegJoint, Robot, RobotError, Side};

type Outcome = Result<(), Box<dyn Error>>;

fn config() -> Result<MujocoConfig, Box<dyn Error>> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(here.join("tests/models/foreign.toml"))?;
    let mut config: MujocoConfig = toml::from_str(&text)?;
    if let ModelSource::File(path) = &mut config.model {
        *path = here.join(&path);
    }
    Ok(config)
}

fn standing() -> Result<(MujocoRobot, JointTargets), Box<dyn Error>> {
    let config = config()?;
    let rest = config.rest_targets();
    let mut robot = MujocoRobot::new(config)?;
    robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    Ok((robot, rest))
}

#[test]
fn stands_for_five_seconds_under_the_pd_law() -> Outcome {
    let (mut robot, rest) = standing()?;
    assert!((robot.description().mass_kg - 60.0).abs() < 1e-9);
    let height_m = robot.state().com.position_m[2];
    for _ in 0..2500 {
        robot.step(&rest)?;
    }
    let state = robot.state();
    let weight_n = 60.0 * 9.81;
    let load_n: f64 = state.feet.iter().map(|f| f.load_n).sum();
    assert!((load_n - weight_n).abs() < 0.01 * weight_n, "{load_n} N");
    assert!((state.com.position_m[2] - height_m).abs() < 0.02);
    assert!(state.base.tilt_rad() < 0.1, "{}", state.base.tilt_rad());
    assert!(
        state.base.heading_rad().abs() < 0.05,
        "the root's x points backwards, the robot's forward"
    );
    // The soles are 0.21 m long with their centre 0.03 m before the ankle, and 0.09 m wide.
    let cop = state.cop_m.ok_or("no load")?;
    let [left, right] = Side::BOTH.map(|side| state.foot(side).centre_m);
    assert!(left[1] > 0.0 && right[1] < 0.0, "{left:?} {right:?}");
    assert!((cop[0] - left[0]).abs() < 0.105, "{cop:?} {left:?}");
    assert!(cop[1] < left[1] + 0.045 && cop[1] > right[1] - 0.045);
    for (side, joint, angle) in rest.position_rad.iter() {
        let error = state.joints[(side, joint)].position_rad - angle;
        assert!(error.abs() < 0.1, "{side:?} {joint:?} {error}");
    }
    Ok(())
}

#[test]
fn start_is_where_the_reference_says() -> Outcome {
    let (robot, _) = standing()?;
    let state = robot.state();
    assert!(state.base.tilt_rad() < 1e-6);
    assert!(state.base.heading_rad().abs() < 1e-9);
    for side in Side::BOTH {
        let [_, y, z] = state.foot(side).centre_m;
        assert!((y - 0.075 * side.lateral_sign()).abs() < 1e-6);
        assert!(z.abs() < 1e-6, "{z}");
    }
    Ok(())
}

#[test]
fn joint_report_finds_the_map_plausible_and_each_wrong_sign() -> Outcome {
    let report = MujocoRobot::new(config()?)?.joint_report()?;
    assert_eq!(report.len(), 10);
    for joint in &report {
        assert_eq!(joint.problem, None, "{joint:?}");
        let expected = match joint.joint {
            LegJoint::AnkleRoll => ActuatorKind::None,
            _ => ActuatorKind::TorqueMotor,
        };
        assert_eq!(joint.actuator, expected);
        if joint.joint == LegJoint::Knee {
            // The foot hangs below the knee: stretching swings it forward.
            assert!(joint.sole_m_per_rad[0] > 0.2);
            assert!((joint.range_deg[0] + 2.4_f64.to_degrees()).abs() < 1e-9);
        }
    }
    for (position, right) in report.iter().enumerate() {
        let mut config = config()?;
        let leg = match right.side {
            Side::Left => &mut config.left,
            Side::Right => &mut config.right,
        };
        let name = match right.joint {
            LegJoint::HipRoll => &mut leg.hip_roll,
            LegJoint::HipPitch => &mut leg.hip_pitch,
            LegJoint::Knee => &mut leg.knee,
            LegJoint::AnklePitch => &mut leg.ankle_pitch,
            LegJoint::AnkleRoll => &mut leg.ankle_roll,
        };
        *name = match name.strip_prefix('-') {
            Some(bare) => bare.to_owned(),
            None => format!("-{name}"),
        };
        let report = MujocoRobot::new(config)?.joint_report()?;
        let wrong: Vec<usize> = (0..10).filter(|&i| report[i].problem.is_some()).collect();
        assert_eq!(wrong, [position]);
    }
    Ok(())
}

#[test]
fn exchanged_legs_are_noticed() -> Outcome {
    let mut config = config()?;
    std::mem::swap(&mut config.left, &mut config.right);
    let report = MujocoRobot::new(config)?.joint_report()?;
    assert!(report.iter().all(|joint| joint.problem.is_some()));
    Ok(())
}

#[test]
fn errors_name_what_is_missing_and_what_is_near() -> Outcome {
    let error = |change: fn(&mut MujocoConfig)| -> Result<String, Box<dyn Error>> {
        let mut config = config()?;
        change(&mut config);
        Ok(MujocoRobot::new(config)
            .err()
            .ok_or("no error")?
            .to_string())
    };
    let says = error(|c| c.left.knee = "-L_knee".into())?;
    assert!(
        says.starts_with("left.knee: the model has no joint named \"L_knee\""),
        "{says}"
    );
    assert!(says.contains("L_kn"), "{says}");
    let says = error(|c| c.right.foot = "soleR".into())?;
    assert!(
        says.contains("right.foot") && says.contains("sole_R"),
        "{says}"
    );
    let says = error(|c| c.right.knee = "-L_kn".into())?;
    assert!(
        says.contains("left.knee and right.knee both name"),
        "{says}"
    );
    let says = error(|c| c.kp_nm_rad = None)?;
    assert!(says.contains("kp_nm_rad"), "{says}");
    let says = error(|c| c.left.knee = "float".into())?;
    assert!(says.contains("not a hinge"), "{says}");
    let says = error(|c| {
        c.rest_deg.insert("sholder_r".into(), 0.0);
    })?;
    assert!(says.contains("shoulder_r"), "{says}");
    let says = error(|c| c.model = ModelSource::File("none/such.xml".into()))?;
    assert!(says.contains("none/such.xml"), "{says}");
    let says = error(|c| c.control_period_s = 0.0025)?;
    assert!(says.contains("0.0025") && says.contains("0.001"), "{says}");
    Ok(())
}

#[test]
fn keeps_the_contract() -> Outcome {
    let rest = config()?.rest_targets();
    let make = || {
        let config = config().map_err(|_| RobotError::Unsupported {
            what: "this configuration",
        })?;
        MujocoRobot::new(config).map_err(|_| RobotError::Unsupported { what: "this model" })
    };
    check(make, &rest, Start::Exact)?;
    check(|| make().map(Guarded::new), &rest, Start::Exact)?;
    Ok(())
}

#[test]
fn a_model_without_floor_or_freejoint_is_refused() -> Outcome {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(here.join("tests/models/foreign.xml"))?;
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR"));
    for (name, what, hint) in [
        ("floorless.xml", "<geom name=\"ground\"", "floor"),
        ("bolted.xml", "<freejoint name=\"float\"", "freejoint"),
    ] {
        let path = scratch.join(name);
        let start = text.find(what).ok_or("not in the model")?;
        let end = start + text[start..].find("/>").ok_or("not closed")? + 2;
        std::fs::write(&path, format!("{}{}", &text[..start], &text[end..]))?;
        let mut config = config()?;
        config.model = ModelSource::File(path);
        let error = MujocoRobot::new(config).err().ok_or("no error")?;
        assert!(matches!(error, MujocoError::NotABiped { .. }), "{error}");
        assert!(error.to_string().contains(hint), "{error}");
    }
    Ok(())
}
