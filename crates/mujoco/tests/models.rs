//! Models that are not quite the built-in biped: each is read as MuJoCo means it, or refused by name.

use std::error::Error;
use std::path::Path;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{BIPED_XML, ModelSource, MujocoConfig, MujocoRobot, kinematic_model};
use stridemap_robot::{LegJoint, Robot};

type Outcome = Result<(), Box<dyn Error>>;

const SERVO: &str = "<position kp=\"3000\" kv=\"105\" forcerange=\"-600 600\"/>";
const KNEE: &str = "<position name=\"left_knee\" joint=\"left_knee\"/>";
/// Where the left knee is among the biped's joints.
const LEFT_KNEE: usize = 2;
const FLOOR: &str = "<geom name=\"floor\" class=\"floor\" type=\"plane\" size=\"0 0 1\" rgba=\"0.92 0.92 0.90 1\"/>";

/// The biped with parts of its text exchanged.
fn edited(name: &str, parts: &[(&str, &str)]) -> Result<MujocoConfig, Box<dyn Error>> {
    let mut text = BIPED_XML.to_owned();
    for (from, to) in parts {
        assert!(text.contains(from), "{name}: {from} is not in the model");
        text = text.replace(from, to);
    }
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.xml"));
    std::fs::write(&path, text)?;
    Ok(MujocoConfig { model: ModelSource::File(path), ..Default::default() })
}

/// Why a model is refused.
fn refused(name: &str, parts: &[(&str, &str)]) -> Result<String, Box<dyn Error>> {
    let error = MujocoRobot::new(edited(name, parts)?).err();
    Ok(error.ok_or(format!("{name} is taken"))?.to_string())
}

/// Stands for a second: the weight must rest on the feet, and the mass move by less than 5 mm up or down.
fn stands(name: &str, config: MujocoConfig) -> Result<MujocoRobot, Box<dyn Error>> {
    let mut robot = MujocoRobot::new(config)?;
    let rest = robot.description().rest();
    robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    let start_m = robot.state().com.position_m[2];
    assert!((start_m - 0.8124).abs() < 5e-4, "{name}: {start_m} m above the floor");
    for _ in 0..500 {
        robot.step(&rest)?;
        let height_m = robot.state().com.position_m[2];
        assert!((height_m - start_m).abs() < 0.005, "{name}: {height_m} m");
    }
    let load_n: f64 = robot.state().feet.iter().map(|f| f.load_n).sum();
    assert!((load_n / (95.0 * 9.81) - 1.0).abs() < 0.01, "{name}: {load_n} N");
    Ok(robot)
}

#[test]
fn servos_with_a_memory_start_at_their_command() -> Outcome {
    let lagging = SERVO.replace("kp=", "timeconst=\"0.2\" kp=");
    stands("filterexact", edited("filterexact", &[(SERVO, &lagging)])?)?;
    let general = "<general dyntype=\"filter\" dynprm=\"0.05\" gainprm=\"3000\" biastype=\"affine\" \
                   biasprm=\"0 -3000 -105\" forcerange=\"-600 600\"/>";
    let filter = [(SERVO, general), ("<position name", "<general name")];
    stands("filter", edited("filter", &filter)?)?;
    let delayed = SERVO.replace("kp=", "delay=\"0.004\" nsample=\"8\" kp=");
    stands("delayed", edited("delayed", &[(SERVO, &delayed)])?)?;
    Ok(())
}

#[test]
fn a_servo_in_other_units_is_the_same_servo() -> Outcome {
    // Control from -1 to 1 for -90 to 90 deg about 20 deg: force = kp (pi/2 ctrl + 0.349 - angle) - kv rate.
    let scaled = "<general gainprm=\"4712.38898\" biastype=\"affine\" biasprm=\"1047.197551 -3000 -105\" \
                  forcerange=\"-600 600\"/>";
    let config = edited("scaled", &[(SERVO, scaled), ("<position name", "<general name")])?;
    let mut robot = stands("scaled", config.clone())?;
    let rest = robot.description().rest();
    let mut own = MujocoRobot::new(MujocoConfig::default())?;
    for robot in [&mut robot, &mut own] {
        robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        (0..50).try_for_each(|_| robot.step(&rest).map(|_| ()))?;
    }
    let knee = |robot: &MujocoRobot| robot.state().joints[LEFT_KNEE];
    assert!((knee(&robot).torque_nm - knee(&own).torque_nm).abs() < 1e-3);
    // Softer by the task: the same sag under the same load, whatever the units.
    let soften = |config: MujocoConfig| MujocoConfig { kp_nm_rad: Some(1500.0.into()), ..config };
    let sag = |config| -> Result<f64, Box<dyn Error>> {
        let mut robot = MujocoRobot::new(soften(config))?;
        robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        (0..50).try_for_each(|_| robot.step(&rest).map(|_| ()))?;
        Ok(knee(&robot).position_rad)
    };
    assert!((sag(config)? - sag(MujocoConfig::default())?).abs() < 1e-6);
    Ok(())
}

#[test]
fn what_a_servo_cannot_be_told_is_no_part_of_its_range() -> Outcome {
    let narrow = SERVO.replace("kp=", "ctrlrange=\"-30 30\" kp=");
    let config = edited("narrow", &[(SERVO, &narrow)])?;
    let report = MujocoRobot::new(config)?.joint_report()?;
    let knee = report.iter().find(|j| j.joint == LegJoint::Knee).ok_or("no knee")?;
    // <position> takes radians: -30 to 30 rad cut nothing off.
    assert!((knee.range_deg[0] + 140.0).abs() < 1e-9);
    let narrow = SERVO.replace("kp=", "ctrlrange=\"-0.5 0.5\" kp=");
    let config = edited("narrower", &[(SERVO, &narrow)])?;
    let report = MujocoRobot::new(config)?.joint_report()?;
    let knee = report.iter().find(|j| j.joint == LegJoint::Knee).ok_or("no knee")?;
    assert!((knee.range_deg[0] + 0.5_f64.to_degrees()).abs() < 1e-9);
    let problem = knee.problem.as_deref().ok_or("rests within its range")?;
    assert!(problem.contains("rest angle of -40.0 deg is outside"), "{problem}");
    Ok(())
}

#[test]
fn what_takes_no_angles_is_refused_by_name() -> Outcome {
    let knee = |by: &str| by.replace("NAME", "name=\"odd\" joint=\"left_knee\"");
    for (name, by, says) in [
        ("intvelocity", "<intvelocity NAME kp=\"3000\" kv=\"105\" actrange=\"-3 3\"/>", "rates"),
        ("velocity", "<velocity NAME kv=\"100\"/>", "rates"),
        ("damper", "<damper NAME kv=\"10\" ctrlrange=\"0 1\"/>", "gain that is not fixed"),
        ("cylinder", "<cylinder NAME timeconst=\"0.1\" area=\"2\"/>", "filter"),
        ("muscle", "<muscle NAME lengthrange=\"0.1 2\" ctrlrange=\"0 1\"/>", "muscle"),
        (
            "user",
            "<general NAME dyntype=\"user\" gainprm=\"3000\" biastype=\"affine\" biasprm=\"0 -3000 -105\" actdim=\"1\"/>",
            "dyntype",
        ),
        ("one_way", "<position NAME kp=\"3000\" kv=\"105\" forcerange=\"0 600\"/>", "no torque in one direction"),
        (
            "second",
            "<position name=\"left_knee\" joint=\"left_knee\"/><position NAME kp=\"10\"/>",
            "two position servos",
        ),
    ] {
        let message = refused(name, &[(KNEE, &knee(by))])?;
        assert!(message.contains("the joint \"left_knee\" has the actuator"), "{name}: {message}");
        assert!(message.contains("odd") && message.contains(says), "{name}: {message}");
        assert!(message.contains("<position>"), "{name}: {message}");
    }
    Ok(())
}

#[test]
fn what_would_act_unasked_is_refused_and_the_rest_let_be() -> Outcome {
    let beside = |more: &str| format!("{more}</mujoco>");
    let tendon = |actuator: &str| {
        beside(&format!(
            "<tendon><fixed name=\"rope\"><joint joint=\"left_knee\" coef=\"1\"/></fixed></tendon>\
             <actuator>{actuator}</actuator>"
        ))
    };
    let pull = tendon("<position name=\"pull\" tendon=\"rope\" kp=\"100\"/>");
    let message = refused("tendon", &[("</mujoco>", &pull)])?;
    assert!(message.contains("\"pull\"") && message.contains("leg joint"), "{message}");
    let idle = tendon("<motor name=\"idle\" tendon=\"rope\"/>");
    stands("idle", edited("idle", &[("</mujoco>", &idle)])?)?;
    // A group that is switched off is not there.
    let off = [
        ("timestep=\"0.001\"", "timestep=\"0.001\" actuatorgroupdisable=\"3\""),
        ("</mujoco>", &pull.replace("kp=", "group=\"3\" kp=")),
    ];
    stands("off", edited("off", &off)?)?;
    let group = SERVO.replace("kp=", "group=\"3\" kp=");
    let message = refused("all_off", &[off[0], (SERVO, &group)])?;
    assert!(message.contains("no position servo that is enabled"), "{message}");
    Ok(())
}

#[test]
fn the_floor_is_what_lies_under_the_feet() -> Outcome {
    let floor = |by: &str| vec![(FLOOR, by.to_owned())];
    let box_floor = "<geom class=\"floor\" type=\"box\" pos=\"0 0 -0.1\" size=\"20 20 0.1\"/>";
    let beside = [
        ("wall", "<geom type=\"box\" pos=\"4 0 1\" size=\"0.1 4 1\" contype=\"1\"/>"),
        ("roof", "<geom type=\"box\" pos=\"0 0 3\" size=\"9 9 0.1\" contype=\"1\"/>"),
        ("untouchable", "<geom type=\"box\" pos=\"0 0 0.2\" size=\"9 9 0.1\" contype=\"2\"/>"),
        ("column", "<body pos=\"1 1 0\"><geom type=\"cylinder\" size=\"0.2 2\" contype=\"1\"/></body>"),
    ];
    let hills = "<geom class=\"floor\" type=\"hfield\" hfield=\"hills\" pos=\"0 0 0.3\"/>";
    // A height field from 0 to 0.5 m that is flat, at 0.5 m of its range, where the robot stands.
    let field = "<asset><hfield name=\"hills\" nrow=\"3\" ncol=\"5\" size=\"8 4 0.5 0.1\" \
                 elevation=\"0 1 1 1 0  0 1 1 1 1  0 1 1 1 0\"/></asset><worldbody>";
    for (name, by) in [
        (
            "podium",
            "<body pos=\"0 0 0.2\" euler=\"0 0 30\"><geom class=\"floor\" type=\"box\" size=\"2 2 0.1\"/></body>",
        ),
        ("hills", hills),
    ] {
        let mut parts = floor(by);
        if name == "hills" {
            parts.push(("<worldbody>", field.to_owned()));
        }
        let parts: Vec<_> = parts.iter().map(|(from, to)| (*from, to.as_str())).collect();
        // The model's own start is deep in this floor; Stridemap puts the soles on it.
        let robot = stands(name, edited(name, &parts)?)?;
        let mut poses = Vec::new();
        robot.poses(&mut poses);
        assert!((poses[0].position_m[2] + if name == "hills" { 0.8 } else { 0.3 }).abs() < 1e-9, "{name}");
    }
    for (name, what) in beside {
        let by = format!("{box_floor}{what}");
        stands(name, edited(name, &[(FLOOR, &by)])?)?;
    }
    let slope = FLOOR.replace("size=", "euler=\"0 2 0\" size=");
    let message = refused("slope", &[(FLOOR, &slope)])?;
    assert!(message.contains("not level"), "{message}");
    let step = format!("{FLOOR}<geom type=\"box\" pos=\"0 1 0\" size=\"1 1 0.03\" contype=\"1\"/>");
    let message = refused("step", &[(FLOOR, &step)])?;
    assert!(message.contains("not level") && message.contains("0.0300"), "{message}");
    let message = refused("away", &[(FLOOR, &box_floor.replace("pos=\"0", "pos=\"30"))])?;
    assert!(message.contains("no floor under the left foot"), "{message}");
    Ok(())
}

#[test]
fn a_world_in_which_nothing_can_walk_is_refused() -> Outcome {
    let option = "<option timestep=\"0.001\"";
    for (name, to, says) in [
        ("sideways", "gravity=\"1 0 -9.7\"", "gravity is (1, 0, -9.7)"),
        ("weightless", "gravity=\"0 0 0\"", "gravity"),
    ] {
        let message = refused(name, &[(option, &format!("{option} {to}"))])?;
        assert!(message.contains(says), "{name}: {message}");
    }
    for flag in ["gravity", "contact", "constraint", "actuation"] {
        let to = format!("<flag {flag}=\"disable\" island=\"disable\"");
        let message = refused(flag, &[("<flag island=\"disable\"", &to)])?;
        assert!(message.contains(&format!("<flag {flag}=\"disable\"/>")), "{message}");
    }
    Ok(())
}

/// A leg that is drawn with bent knee and ankle and calls those angles by their values: where the soles are is
/// the same as for one drawn straight.
#[test]
fn a_joint_drawn_at_its_ref_is_where_its_angle_says() -> Outcome {
    const BENT: &str = "17.188733853924695"; // 0.3 rad
    let (knee, ankle) =
        ("<joint name=\"left_knee\" axis=\"0 -1 0\"", "<joint name=\"left_ankle_pitch\" axis=\"0 -1 0\"");
    let (shank, foot) = ("<body name=\"left_shank\" pos=\"0 0 -0.37\"", "<body name=\"left_ankle\" pos=\"0 0 -0.37\"");
    let config = edited(
        "ref",
        &[
            (knee, &format!("{knee} ref=\"-{BENT}\"")),
            (ankle, &format!("{ankle} ref=\"{BENT}\"")),
            (shank, &format!("{shank} euler=\"0 {BENT} 0\"")),
            (foot, &format!("{foot} euler=\"0 -{BENT} 0\"")),
        ],
    )?;
    let angles: Vec<f64> = (0..10).map(|j| 0.05 * f64::from(j) - 0.3).collect();
    let place = |config: &MujocoConfig| -> Result<_, Box<dyn Error>> {
        Ok(kinematic_model(config)?.place(&angles, [1.0, 0.0, 0.0, 0.0]))
    };
    let (straight, bent) = (place(&MujocoConfig::default())?, place(&config)?);
    for (a, b) in straight.soles_m.iter().zip(&bent.soles_m) {
        assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-9), "{a:?} {b:?}");
    }
    assert!((0..3).all(|i| (straight.com_m[i] - bent.com_m[i]).abs() < 1e-9));
    Ok(())
}
