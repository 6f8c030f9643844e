//! A network made here, whose answer is known by hand, on a robot of three joints.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use stridemap_onnx::write::{Layer, mlp};
use stridemap_robot::{BaseState, JointDescription, JointLimits, JointState};

use super::*;

/// The first answer is the sum of all inputs, the second twice the first input.
fn network(dir: &Path, inputs: usize) -> std::path::PathBuf {
    let mut second = vec![0.0; inputs];
    second[0] = 2.0;
    let layer = Layer { weights: vec![vec![1.0; inputs], second], bias: vec![0.0, 0.0] };
    let bytes = mlp(&[layer], "Relu", false, &[("names", "[\"knee\", \"hip\"]"), ("kp", "30.0, 20.0")]);
    let path = dir.join("net.onnx");
    std::fs::write(&path, bytes).unwrap();
    path
}

fn robot() -> RobotDescription {
    let joint = |name: &str| JointDescription { name: name.into(), limits: JointLimits::default(), rest_rad: 0.0 };
    RobotDescription {
        control_period_s: 0.02,
        mass_kg: 10.0,
        joints: ["hip", "knee", "arm"].map(joint).into(),
        ..RobotDescription::default()
    }
}

fn term(term: TermKind) -> TermConfig {
    TermConfig { term, scale: Each::All(1.0), history: 1, clip: None }
}

fn policy(onnx: std::path::PathBuf, observation: Vec<TermConfig>) -> PolicyConfig {
    PolicyConfig {
        onnx,
        sha256: None,
        licence: None,
        rate_hz: 50.0,
        joints: Source::Metadata { metadata: "names".into() },
        kp: Source::Metadata { metadata: "kp".into() },
        kd: Source::Here(Each::All(1.5)),
        rest_rad: Each::PerJoint(vec![0.5, -0.25]),
        action_scale: Each::All(0.1),
        action_clip: Some(3.0),
        observation_clip: None,
        observation,
        history_fill: HistoryFill::Zero,
        command_range: None,
        gyro_frame: None,
        held: vec![HeldJoint { joint: "arm".into(), rest_rad: 0.3, kp: 5.0, kd: 0.5 }],
    }
}

fn clock() -> ClockConfig {
    ClockConfig { period_s: 1.0, start_rad: vec![0.0, PI], still_below: Some(0.01), still_rad: Some(PI) }
}

fn says(policy: PolicyConfig, robot: &RobotDescription) -> String {
    PolicyGait::new(policy, Some(clock()), [0.0; 3], robot).unwrap_err().to_string()
}

/// Joints in the policy's order on a robot in its own; the answer clipped; stiffness, gain and rest as they say.
#[test]
fn targets_are_what_the_network_answers() {
    let dir = tempfile::tempdir().unwrap();
    let observation = vec![term(TermKind::JointPosition), term(TermKind::Command)];
    let policy = policy(network(dir.path(), 5), observation);
    let mut gait = PolicyGait::new(policy, None, [0.2, 0.0, 0.0], &robot()).unwrap();
    gait.modulate(STIFFNESS, 1.0).unwrap();
    gait.modulate(GAIN, 0.5).unwrap();
    let mut state = RobotState { joints: vec![JointState::default(); 3], ..RobotState::default() };
    state.joints[0].position_rad = -0.15; // hip: rests at -0.25, so 0.1 from there
    state.joints[1].position_rad = 2.5; // knee: 2.0 from rest
    let mut out = JointTargets::default();
    gait.targets(&state, 0.02, &mut out);
    // Seen: 2.0, 0.1, command 0.2, 0, 0; answers 2.3, and 4.0 clipped to 3.
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    assert!(near(gait.answered()[0], 2.3) && near(gait.answered()[1], 3.0));
    assert!(near(out.joints[1].position_rad, 0.5 + 0.5 * 0.1 * 2.3));
    assert!(near(out.joints[0].position_rad, -0.25 + 0.5 * 0.1 * 3.0));
    assert!(near(out.joints[1].kp.unwrap(), 1.2 * 30.0) && near(out.joints[0].kp.unwrap(), 1.2 * 20.0));
    assert!(near(out.joints[0].kd.unwrap(), 1.5));
    assert!(near(out.joints[2].position_rad, 0.3) && near(out.joints[2].kp.unwrap(), 5.0));
    gait.reset();
    assert!(gait.values[STIFFNESS].abs() < 1e-12 && near(gait.values[FORWARD], 0.2));
}

/// Gravity and gyroscope of a robot that pitches forward; a sensed tilt adds to the pitch. (Forward pitch turns about +y:
/// what points down in the world points forward and down in the base.)
#[test]
fn a_sensed_tilt_is_a_pitch() {
    let dir = tempfile::tempdir().unwrap();
    let policy = policy(network(dir.path(), 6), vec![term(TermKind::Gravity), term(TermKind::BaseAngularVelocity)]);
    let mut gait = PolicyGait::new(policy, None, [0.0; 3], &robot()).unwrap();
    let pitched = |rad: f64| RobotState {
        joints: vec![JointState::default(); 3],
        base: BaseState {
            orientation: [(0.5 * rad).cos(), 0.0, (0.5 * rad).sin(), 0.0],
            angular_velocity_rad_s: [0.0, 0.0, 1.0],
            ..BaseState::default()
        },
        ..RobotState::default()
    };
    let mut out = JointTargets::default();
    gait.targets(&pitched(0.2), 0.02, &mut out);
    let [x, y, z] = [gait.observed()[0], gait.observed()[1], gait.observed()[2]];
    assert!((x - 0.2_f32.sin()).abs() < 1e-6 && y.abs() < 1e-6 && (z + 0.2_f32.cos()).abs() < 1e-6);
    gait.modulate(TILT, 0.1).unwrap();
    gait.targets(&pitched(0.1), 0.02, &mut out);
    assert!((gait.observed()[0] - 0.2_f32.sin()).abs() < 1e-6);
    assert!((gait.observed()[3] + 0.1_f32.sin()).abs() < 1e-6, "a rate about z is seen about -x as well");
}

/// Fifty periods are a cycle; the phases rest while the command is zero, and begin anew.
#[test]
fn the_clock_advances_before_the_observation_and_rests_at_zero() {
    let dir = tempfile::tempdir().unwrap();
    let policy = policy(network(dir.path(), 4), vec![term(TermKind::ClockCos), term(TermKind::ClockSin)]);
    let mut gait = PolicyGait::new(policy, Some(clock()), [0.3, 0.0, 0.0], &robot()).unwrap();
    let state = RobotState { joints: vec![JointState::default(); 3], ..RobotState::default() };
    let mut out = JointTargets::default();
    gait.targets(&state, 0.02, &mut out);
    let step = TAU / 50.0;
    assert!((f64::from(gait.observed()[0]) - step.cos()).abs() < 1e-6);
    assert!((f64::from(gait.observed()[3]) + step.sin()).abs() < 1e-6, "the right foot is half a cycle ahead");
    for k in 2..=200 {
        gait.targets(&state, 0.02, &mut out);
        let left = gait.phase_rad(Side::Left).unwrap();
        assert_eq!(left == 0.0, k % 50 == 0, "{k} {left}");
    }
    gait.modulate(FORWARD, 0.0).unwrap();
    for _ in 0..13 {
        gait.targets(&state, 0.02, &mut out);
    }
    assert!(gait.observed()[..2].iter().all(|cos| (cos + 1.0).abs() < 1e-6), "both feet stand");
    assert!((gait.phase_rad(Side::Left).unwrap() - 13.0 * step).abs() < 1e-9, "sections are found on");
    gait.modulate(FORWARD, 0.3).unwrap();
    gait.targets(&state, 0.02, &mut out);
    assert!((gait.observed()[0] - 1.0).abs() < 1e-6 && (gait.observed()[1] + 1.0).abs() < 1e-6);
    assert!(FRAC_PI_2 > step);
}

/// Oldest first; before there is a history: zeros, or the first observation.
#[test]
fn histories_are_filled_as_they_say() {
    let dir = tempfile::tempdir().unwrap();
    for (fill, first) in [(HistoryFill::Zero, 0.0), (HistoryFill::First, 0.4)] {
        let observation =
            vec![TermConfig { history: 3, scale: Each::All(2.0), clip: Some(0.5), ..term(TermKind::CommandYawRate) }];
        let policy = PolicyConfig { history_fill: fill, ..policy(network(dir.path(), 3), observation) };
        let mut gait = PolicyGait::new(policy, None, [0.0, 0.0, 0.2], &robot()).unwrap();
        let state = RobotState { joints: vec![JointState::default(); 3], ..RobotState::default() };
        let mut out = JointTargets::default();
        gait.targets(&state, 0.02, &mut out);
        gait.modulate(YAW, 0.9).unwrap();
        gait.targets(&state, 0.02, &mut out);
        let expected = [first, 0.4, 0.5];
        assert!(gait.observed().iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{:?}", gait.observed());
    }
}

#[test]
fn what_does_not_fit_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let net = || network(dir.path(), 5);
    let good = || policy(net(), vec![term(TermKind::JointPosition), term(TermKind::Command)]);
    let text = says(policy(net(), vec![term(TermKind::Gravity)]), &robot());
    assert!(text.contains("gait.policy.observation: adds up to 3 numbers (gravity 3); the network takes 5"), "{text}");
    let mut other = robot();
    other.joints[1].name = "ankle".into();
    let text = says(good(), &other);
    assert!(text.contains("the robot has no joint \"knee\""), "{text}");
    let text = says(PolicyConfig { held: Vec::new(), ..good() }, &robot());
    assert!(text.contains("\"arm\" is neither among policy.joints nor held"), "{text}");
    let text = says(PolicyConfig { sha256: Some("00".into()), ..good() }, &robot());
    assert!(text.contains("gait.policy.sha256: is not the SHA-256"), "{text}");
    let text = says(PolicyConfig { rate_hz: 100.0, ..good() }, &robot());
    assert!(text.contains("robot.control_period_s must be 0.01"), "{text}");
    let text = says(PolicyConfig { onnx: dir.path().join("none.onnx"), ..good() }, &robot());
    assert!(text.contains("gait.policy.onnx"), "{text}");
    let scale = TermConfig { scale: Each::PerJoint(vec![1.0, 2.0, 3.0]), ..term(TermKind::JointPosition) };
    let text = says(policy(net(), vec![scale, term(TermKind::Command)]), &robot());
    assert!(text.contains("gait.policy.observation.0.scale: has 3 numbers; joint_position has 2"), "{text}");
    let kp = Source::Metadata { metadata: "stiffness".into() };
    let text = says(PolicyConfig { kp, ..good() }, &robot());
    assert!(text.contains("no metadata \"stiffness\" (it has: kp, names)"), "{text}");
    let outline = RobotDescription { mass_kg: 0.0, ..RobotDescription::default() };
    let unread = PolicyConfig { onnx: dir.path().join("none.onnx"), ..good() };
    assert!(PolicyGait::new(unread, None, [0.0; 3], &outline).unwrap().network().is_none());
}
