//! A user's own model: other names and signs, torque motors, other mass and lengths.

use std::error::Error;
use std::path::Path;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{ActuatorKind, ModelSource, MujocoConfig, MujocoError, MujocoRobot};
use stridemap_robot::contract::{Start, check};
use stridemap_robot::{JointTargets, LegJoint, Robot, RobotError, Side};

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
    let mut robot = MujocoRobot::new(config)?;
    let rest = robot.description().rest();
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
    assert!(state.base.heading_rad().abs() < 0.05, "the root's x points backwards, the robot's forward");
    // The soles are 0.21 m long with their centre 0.03 m before the ankle, and 0.09 m wide.
    let cop = state.cop_m.ok_or("no load")?;
    let [left, right] = Side::BOTH.map(|side| state.foot(side).centre_m);
    assert!(left[1] > 0.0 && right[1] < 0.0, "{left:?} {right:?}");
    assert!((cop[0] - left[0]).abs() < 0.105, "{cop:?} {left:?}");
    assert!(cop[1] < left[1] + 0.045 && cop[1] > right[1] - 0.045);
    for (joint, rest) in state.joints.iter().zip(&rest.joints) {
        let error = joint.position_rad - rest.position_rad;
        assert!(error.abs() < 0.1, "{rest:?} {error}");
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
            LegJoint::HipYaw => &mut leg.hip_yaw,
            LegJoint::HipRoll => &mut leg.hip_roll,
            LegJoint::HipPitch => &mut leg.hip_pitch,
            LegJoint::Knee => &mut leg.knee,
            LegJoint::AnklePitch => &mut leg.ankle_pitch,
            LegJoint::AnkleRoll => &mut leg.ankle_roll,
        };
        let mapped = name.take().ok_or("not mapped")?;
        *name = Some(match mapped.strip_prefix('-') {
            Some(bare) => bare.to_owned(),
            None => format!("-{mapped}"),
        });
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
        Ok(MujocoRobot::new(config).err().ok_or("no error")?.to_string())
    };
    let says = error(|c| c.left.knee = Some("-L_knee".into()))?;
    assert!(says.starts_with("left.knee: the model has no joint named \"L_knee\""), "{says}");
    assert!(says.contains("L_kn"), "{says}");
    let says = error(|c| c.right.foot = "soleR".into())?;
    assert!(says.contains("right.foot") && says.contains("sole_R"), "{says}");
    let says = error(|c| c.right.knee = Some("-L_kn".into()))?;
    assert!(says.contains("left.knee and right.knee both name"), "{says}");
    let says = error(|c| c.kp_nm_rad = None)?;
    assert!(says.contains("kp_nm_rad"), "{says}");
    let says = error(|c| c.left.knee = Some("float".into()))?;
    assert!(says.contains("not a hinge"), "{says}");
    let says = error(|c| {
        c.rest_deg.insert("sholder_r".into(), 0.0.into());
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
    let make = |with: fn(MujocoConfig) -> MujocoConfig| {
        let config = config().map(with).map_err(|_| RobotError::Unsupported { what: "this configuration" })?;
        MujocoRobot::new(config).map_err(|_| RobotError::Unsupported { what: "this model" })
    };
    // Motors and bare joints take gains and torques; position servos, as the biped's, refuse them by name.
    check(|| make(|config| config), Start::Exact)?;
    check(|| make(yawing_without_ankle_rolls), Start::Exact)?;
    Ok(())
}

/// The same robot with its hip yaws named, and its ankle rolls left out of the gait.
fn yawing_without_ankle_rolls(mut config: MujocoConfig) -> MujocoConfig {
    config.left.hip_yaw = Some("-L_hip_z".into());
    config.right.hip_yaw = Some("-R_hip_z".into());
    for leg in [&mut config.left, &mut config.right] {
        leg.ankle_roll = None;
    }
    config.rest_deg.insert("hip_yaw".into(), 2.0.into());
    config
}

#[test]
fn hip_yaws_are_leg_joints_where_they_are_named_and_ankle_rolls_may_be_left_out() -> Outcome {
    // The yaw axis of either leg points up: without the minus it is right, with it each is told.
    let mut robot = MujocoRobot::new(yawing_without_ankle_rolls(config()?))?;
    let report = robot.joint_report()?;
    assert_eq!(report.len(), 10);
    for joint in &report {
        let wrong = joint.problem.as_deref().map(|p| p.contains("+z"));
        assert_eq!(wrong, (joint.joint == LegJoint::HipYaw).then_some(true), "{joint:?}");
    }
    let mut right = yawing_without_ankle_rolls(config()?);
    for (leg, name) in [(&mut right.left, "L_hip_z"), (&mut right.right, "R_hip_z")] {
        leg.hip_yaw = Some(name.into());
    }
    let mut upright = MujocoRobot::new(right.clone())?;
    assert!(upright.joint_report()?.iter().all(|joint| joint.problem.is_none()));
    // The same joints in the same order, whatever their roles; yawed by as much, the other way.
    let (rest, own) = (upright.description().rest(), robot.description().rest());
    assert_eq!(rest.joints.len(), 14);
    let yaw = upright.description().legs[(Side::Left, LegJoint::HipYaw)].ok_or("no yaw")?;
    assert!((rest.joints[yaw.joint].position_rad - 2.0_f64.to_radians()).abs() < 1e-12);
    assert!((own.joints[yaw.joint].position_rad + 2.0_f64.to_radians()).abs() < 1e-12);
    for (robot, rest) in [(&mut robot, &own), (&mut upright, &rest)] {
        robot.reset(rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        (0..1000).try_for_each(|_| robot.step(rest).map(|_| ()))?;
        assert!(robot.state().base.tilt_rad() < 0.1);
    }
    // At a tenth of its stiffness, and at the same angle, the knee pushes a tenth as hard.
    let knee = upright.description().legs[(Side::Left, LegJoint::Knee)].ok_or("no knee")?;
    let held_nm = upright.state().joints[knee.joint].torque_nm;
    let mut soft = rest.clone();
    soft.joints[knee.joint].kp = Some(100.0);
    soft.joints[knee.joint].kd = Some(0.0);
    upright.step(&soft)?;
    let softened_nm = upright.state().joints[knee.joint].torque_nm;
    assert!((softened_nm / held_nm - 0.1).abs() < 0.05, "{softened_nm} of {held_nm}");
    // What is left out for the gait keeps its name for the rest posture.
    right.rest_deg.insert("ankle_roll".into(), 1.0.into());
    let says = MujocoRobot::new(right).err().ok_or("no error")?.to_string();
    assert!(says.contains("ankle_roll"), "{says}");
    Ok(())
}

#[test]
fn a_model_without_floor_or_freejoint_is_refused() -> Outcome {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(here.join("tests/models/foreign.xml"))?;
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR"));
    for (name, what, hint) in
        [("floorless.xml", "<geom name=\"ground\"", "floor"), ("bolted.xml", "<freejoint name=\"float\"", "freejoint")]
    {
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
