//! A pretrained policy as the gait of a task, with a network and a model that the test makes.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::fmt::Write as _;
use std::path::Path;

use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{LabError, Plant, builtin, preflight, refuse_miswired};
use stridemap_mujoco::{BIPED_XML, MujocoConfig, MujocoRobot};
use stridemap_onnx::write::{Layer, mlp};
use stridemap_process::StrideProcess as _;
use stridemap_robot::Robot as _;

/// A policy that holds the rest posture, whatever it sees: the biped stands, and its clock goes on.
fn standing(dir: &Path) -> (usize, String) {
    let robot = MujocoRobot::new(MujocoConfig::default()).unwrap();
    let joints = &robot.description().joints;
    let (names, n) = (joints.iter().map(|j| format!("{:?}", j.name)).collect::<Vec<_>>().join(", "), joints.len());
    let rest = joints.iter().map(|j| j.rest_rad.to_string()).collect::<Vec<_>>().join(", ");
    let layer = Layer { weights: vec![vec![0.0; 3 + n + 2]; n], bias: vec![0.0; n] };
    std::fs::write(dir.join("net.onnx"), mlp(&[layer], "Elu", false, &[("names", &format!("[{names}]"))])).unwrap();
    std::fs::write(dir.join("robot.xml"), BIPED_XML).unwrap();
    let policy = format!(
        "[policy]\nonnx = \"net.onnx\"\nrate_hz = 50.0\njoints = {{ metadata = \"names\" }}\nkp = 3000.0\nkd = 100.0\n\
         rest_rad = [{rest}]\naction_scale = 0.25\nobservation = [{{ term = \"gravity\" }}, {{ term = \"joint_position\" }}, \
         {{ term = \"clock_cos\" }}]\n[clock]\nperiod_s = 1.0\nstart_rad = [0.0, 3.141592653589793]\n\
         [model]\nmjcf = \"robot.xml\"\nfeet = [\"left_foot\", \"right_foot\"]\ntime_step_s = 0.001\nfallen_below_m = 0.4\n"
    );
    std::fs::write(dir.join("policy.toml"), &policy).unwrap();
    let mut task = String::from("extends = \"stepping\"\nname = \"standing\"\nstate = [\"recent_pitch_rad\"]\n");
    task.push_str(
        "[gait]\nkind = \"onnx\"\npolicy_file = \"policy.toml\"\n[section]\nevent = \"gait_clock\"\nleg = \"left\"\n",
    );
    task.push_str(
        "[[action]]\nmodulates = \"stiffness\"\nbounds = [0.0, 1.5]\nunit = 1.0\nexplore = { center = [0.0, 1.0] }\n",
    );
    task.push_str("[[reward]]\nquantity = \"forward_speed_m_s\"\n");
    task.push_str(
        "weight = 1.0\n[robot.sensors]\njoint_noise_rad = 0.0\njoint_rate_noise_rad_s = 0.0\ngravity_noise = 0.0\n",
    );
    let _ = writeln!(task, "gyro_noise_rad_s = 0.0\n[failure]\npsi_roll_below_deg = \"none\"");
    std::fs::write(dir.join("task.toml"), task).unwrap();
    (n, policy)
}

fn plant(dir: &Path, sets: &[&str]) -> Result<Plant, LabError> {
    let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
    builtin::load_file(&dir.join("task.toml"), &sets)?.task.plant()
}

#[test]
fn a_policy_is_loaded_by_its_file_and_strides_are_cycles_of_its_clock() {
    let dir = tempfile::tempdir().unwrap();
    let (joints, policy) = standing(dir.path());
    let loaded = builtin::load_file(&dir.path().join("task.toml"), &[]).unwrap();
    // What was resolved is the same task, wherever it lies.
    let other = tempfile::tempdir().unwrap();
    let saved = other.path().join("config.toml");
    std::fs::write(&saved, &loaded.resolved).unwrap();
    assert!(builtin::load_file(&saved, &[]).unwrap().task == loaded.task);
    let mut rng = stream(1, Role::Run, 0);
    let mut plant = plant(dir.path(), &[]).unwrap();
    let mass_kg = plant.robot().description().mass_kg;
    let start = plant.reset(&mut rng).unwrap();
    assert!(start.state[0].abs() < 0.05);
    for _ in 0..2 {
        let stride = plant.stride(&[0.5], &mut rng).unwrap();
        let measures = plant.last_measures();
        assert!((measures.duration_s - 1.0).abs() < 1e-9, "{measures:?}");
        let (seen, truth) = (measures.motion, measures.true_motion);
        assert!(truth.forward_speed_m_s.abs() < 0.01 && truth.yaw_rate_rad_s.abs() < 0.01, "{truth:?}");
        assert!((seen.forward_speed_m_s - truth.forward_speed_m_s).abs() < 0.005, "{seen:?} {truth:?}");
        assert!((stride.next.state[0] - truth.mean_pitch_rad).abs() < 0.005);
    }
    // Nobody feels the floor: the lower foot carries it all.
    let loads: f64 = plant.robot().state().feet.iter().map(|foot| foot.load_n).sum();
    assert!((loads - 9.81 * mass_kg).abs() < 1.0, "{loads}");

    // Another robot than its model.
    let mut changed = self::plant(
        dir.path(),
        &["robot.changes.payload_kg=5", "robot.changes.imu_pitch_rad=0.04", "robot.changes.action_delay_s=0.015"],
    )
    .unwrap();
    assert!((changed.robot().description().mass_kg - mass_kg - 5.0).abs() < 1e-9);
    let off = changed.reset(&mut rng).unwrap().state[0] - changed.last_measures().true_motion.mean_pitch_rad;
    assert!((off - 0.04).abs() < 0.02, "{off}");

    let error = self::plant(dir.path(), &["robot.changes.payload_body=nose", "robot.changes.payload_kg=1"]).err();
    let text = error.unwrap().to_string();
    assert!(text.contains("robot.changes.payload_body") && text.contains("nose"), "{text}");
    for (from, to, says) in [
        ("term = \"gravity\"", "term = \"command\", history = 2", "gait.policy.observation: adds up to"),
        ("time_step_s = 0.001", "time_step_s = 0.001\nweight_kg = 3", "weight_kg"),
        ("rate_hz = 50.0", "rate_hz = 0.0", "gait.policy.rate_hz"),
        ("action_scale = 0.25", "action_scale = [1, 2]", "gait.policy.action_scale: has 2 numbers"),
    ] {
        std::fs::write(dir.path().join("policy.toml"), policy.replacen(from, to, 1)).unwrap();
        let text = self::plant(dir.path(), &[]).err().unwrap().to_string();
        assert!(text.contains(says), "{from} -> {to}: {text}");
    }
    assert!(joints >= 10);
}

/// What a task needs and is not there is told with the command that gets it.
#[test]
fn a_task_tells_how_to_get_what_it_needs() {
    let error = builtin::load("g1-velocity", &["gait.policy.onnx=fetched:g9/none.onnx".into()]).unwrap().task;
    let robot = stridemap_robot::RobotDescription { mass_kg: 1.0, control_period_s: 0.02, ..Default::default() };
    let text = error.gait(&robot).err().unwrap().to_string();
    assert!(text.contains("get it with `stridemap fetch g9`"), "{text}");
    let task = builtin::load("g1-velocity", &["gait.model.mjcf=fetched:g9/none.xml".into()]).unwrap().task;
    let text = task.plant().err().unwrap().to_string();
    assert!(text.contains("get it with `stridemap fetch g9`"), "{text}");
}

/// Faults of the wiring are named, each by its word; robots that carry something, with a weak leg and late commands, are not
/// taken for them. (`bench preflight` injects all twelve on public robots.)
#[test]
fn wiring_is_told_from_physics() {
    let dir = tempfile::tempdir().unwrap();
    standing(dir.path());
    let told = |set: &str| {
        let task = builtin::load_file(&dir.path().join("task.toml"), &[set.into()]).unwrap().task;
        let faults = preflight(&task, &mut stream(1, Role::Check, 4)).unwrap();
        faults.into_iter().map(|fault| fault.kind).collect::<Vec<_>>()
    };
    for healthy in ["N", "B", "C"] {
        let faults = told(&format!("robot.changes.preset={healthy}"));
        assert!(faults.is_empty(), "{healthy}: {faults:?}");
    }
    for (fault, kind) in [("gyro_axes", "gyro_axes"), ("reading_sign", "joint_sign"), ("rate", "rate")] {
        let faults = told(&format!("robot.sensors.fault={fault}"));
        assert!(faults.iter().any(|named| named == kind), "{fault}: {faults:?}");
    }
    let task = builtin::load_file(&dir.path().join("task.toml"), &["robot.sensors.fault=gravity_inverted".into()]);
    let text = refuse_miswired(&task.unwrap().task, 1).unwrap_err().to_string();
    assert!(text.contains("robot: is wired wrongly (gravity_inverted: "), "{text}");
}
