//! Joint maps from kinematics alone, against maps that are known.

use std::path::{Path, PathBuf};

use stridemap_mujoco::{BIPED_XML, LegMap, MujocoConfig, MujocoError, MujocoRobot, OP3_XML, guess};
use stridemap_robot::{LEG_JOINTS, Robot, Side};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn written(dir: &Path, name: &str, text: &str) -> std::io::Result<PathBuf> {
    std::fs::write(dir.join(name), text)?;
    Ok(dir.join(name))
}

/// Every joint of a map, without hip yaws, which the built-in maps leave out.
fn joints(map: &LegMap) -> Vec<Option<(f64, &str)>> {
    LEG_JOINTS.into_iter().filter(|joint| joint.name() != "hip_yaw").map(|joint| map.joint(joint)).collect()
}

#[test]
fn the_maps_of_the_built_in_robots_are_found() -> Outcome {
    let dir = tempfile::tempdir()?;
    for (text, map) in [(BIPED_XML, LegMap::biped as fn(Side) -> LegMap), (OP3_XML, LegMap::op3)] {
        let found = guess(&written(dir.path(), "robot.xml", text)?)?;
        assert!(found.is_certain() && found.config.heading_deg.is_none() && found.config.add.is_empty());
        for side in Side::BOTH {
            assert_eq!(joints(found.config.leg(side)), joints(&map(side)));
            assert_eq!(found.config.leg(side).foot, map(side).foot);
        }
    }
    Ok(())
}

/// The biped without floor and free joint, turned by 90 deg: both are added, and it looks along +y.
#[test]
fn what_is_missing_is_added_and_the_heading_found() -> Outcome {
    let dir = tempfile::tempdir()?;
    let free = without_free_joint_and_floor(BIPED_XML);
    let found = guess(&written(dir.path(), "robot.xml", &free)?)?;
    assert_eq!(found.config.add.len(), 2, "{:?}", found.notes);
    let config = MujocoConfig { kp_nm_rad: Some(3000.0.into()), kv_nms_rad: Some(100.0.into()), ..found.config };
    let mut robot = MujocoRobot::new(config)?;
    let rest = robot.description().rest();
    let mut rng = <rand_chacha::ChaCha8Rng as rand_chacha::rand_core::SeedableRng>::seed_from_u64(1);
    robot.reset(&rest, &mut rng)?;
    for _ in 0..500 {
        robot.step(&rest)?;
    }
    let state = robot.state();
    assert!(state.base.tilt_rad().to_degrees() < 3.0 && state.base.heading_rad().abs() < 0.02);
    let across = state.feet[0].centre_m[1] - state.feet[1].centre_m[1];
    assert!((across - 0.18).abs() < 0.02, "it looks along +x in the world: {across}");
    Ok(())
}

/// The biped's text without free joint and floor, its torso turned to look along +y.
fn without_free_joint_and_floor(text: &str) -> String {
    let mut out = String::new();
    for line in text.lines() {
        if line.contains("<freejoint") || line.contains("type=\"plane\"") {
            continue;
        }
        out += &line.replace("<body name=\"torso\"", "<body name=\"torso\" euler=\"0 0 90\"");
        out.push('\n');
    }
    out
}

/// A robot of sticks as URDF: no floor, no free joint, no servo can be said there. Masses stay: 10 + 2 (3 + 2 + 1) kg.
#[test]
fn a_urdf_is_a_robot() -> Outcome {
    let dir = tempfile::tempdir()?;
    let path = written(dir.path(), "sticks.urdf", &sticks())?;
    let found = guess(&path)?;
    let names = found.config.left.joint(stridemap_robot::LegJoint::Knee);
    assert_eq!(names, Some((-1.0, "l_knee")));
    assert!(found.config.left.hip_yaw.is_none() && found.config.left.ankle_roll.is_none(), "{:?}", found.config.left);
    let config = MujocoConfig { kp_nm_rad: Some(600.0.into()), kv_nms_rad: Some(20.0.into()), ..found.config };
    let mut robot = MujocoRobot::new(config)?;
    let size = robot.dimensions();
    assert!((size.mass_kg - 22.0).abs() < 1e-9, "{size:?}");
    assert!((size.leg_m - 0.8).abs() < 1e-9 && (size.half_stance_m - 0.1).abs() < 1e-9, "{size:?}");
    Ok(())
}

fn sticks() -> String {
    let link = |name: &str, mass: f64, z: f64, size: [f64; 3]| {
        format!(
            "<link name=\"{name}\"><inertial><origin xyz=\"0 0 {z}\"/><mass value=\"{mass}\"/><inertia ixx=\"0.05\" \
             iyy=\"0.05\" izz=\"0.05\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial><visual><geometry><mesh \
             filename=\"package://nowhere/{name}.dae\"/></geometry></visual><collision><origin xyz=\"{} 0 {z}\"/>\
             <geometry><box size=\"{} {} {}\"/></geometry></collision></link>",
            if name.ends_with("foot") { 0.03 } else { 0.0 },
            size[0],
            size[1],
            size[2]
        )
    };
    let joint = |name: &str, parent: &str, child: &str, at: &str, axis: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin \
             xyz=\"{at}\"/><axis xyz=\"{axis}\"/><limit lower=\"-2\" upper=\"2\" effort=\"200\" velocity=\"10\"/></joint>"
        )
    };
    let mut out = format!("<robot name=\"sticks\">{}", link("base", 10.0, 0.1, [0.2, 0.2, 0.2]));
    for (side, y) in [("l", 0.1), ("r", -0.1)] {
        let n = |part: &str| format!("{side}_{part}");
        out += &link(&n("hip"), 1.0, 0.0, [0.02; 3]);
        out += &link(&n("thigh"), 2.0, -0.2, [0.05, 0.05, 0.3]);
        out += &link(&n("shank"), 2.0, -0.2, [0.05, 0.05, 0.3]);
        out += &link(&n("foot"), 1.0, -0.03, [0.22, 0.1, 0.02]);
        out += &joint(&n("hip_roll"), "base", &n("hip"), &format!("0 {y} 0"), "1 0 0");
        out += &joint(&n("hip_pitch"), &n("hip"), &n("thigh"), "0 0 0", "0 1 0");
        out += &joint(&n("knee"), &n("thigh"), &n("shank"), "0 0 -0.4", "0 1 0");
        out += &joint(&n("ankle"), &n("shank"), &n("foot"), "0 0 -0.4", "0 1 0");
    }
    out + "</robot>"
}

#[test]
fn what_is_no_biped_is_told_with_what_was_found() -> Outcome {
    let dir = tempfile::tempdir()?;
    let one_leg = "<mujoco><worldbody><body name=\"base\"><freejoint/><geom size=\".1\"/><body><joint name=\"a\"/><geom \
                   size=\".1\"/></body></body></worldbody></mujoco>";
    let error = guess(&written(dir.path(), "robot.xml", one_leg)?).err();
    assert!(matches!(&error, Some(MujocoError::NotABiped { reason, .. }) if reason.contains("chain")), "{error:?}");
    Ok(())
}
