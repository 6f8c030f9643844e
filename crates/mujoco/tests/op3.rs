//! The small humanoid: its model, its sensors, and the estimate that is made of them.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_mujoco::{
    HardwareConfig, LegMap, ModelSource, MujocoConfig, MujocoRobot, SimulatedMachine, estimator, kinematic_model,
};
use stridemap_robot::contract::{Start, check};
use stridemap_robot::{EstimatedRobot, LegJoint, Machine, Robot, RobotDescription, RobotError, Side};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn op3() -> MujocoConfig {
    let rest =
        [("hip_pitch", 24.0), ("knee", -40.0), ("ankle_pitch", 20.0), ("l_sho_roll", 75.0), ("r_sho_roll", -75.0)];
    MujocoConfig {
        model: ModelSource::Op3,
        left: LegMap::op3(Side::Left),
        right: LegMap::op3(Side::Right),
        control_period_s: 0.008,
        rest_deg: rest.map(|(name, deg)| (name.to_owned(), deg.into())).into(),
        ..MujocoConfig::default()
    }
}

fn at_rest(robot: &RobotDescription) -> Vec<f64> {
    robot.joints.iter().map(|joint| joint.rest_rad).collect()
}

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(1)
}

#[test]
fn mass_size_and_joints_are_those_of_the_robot() -> Outcome {
    let config = op3();
    let robot = MujocoRobot::new(config)?;
    assert!((robot.description().mass_kg - 3.147).abs() < 0.01);
    assert_eq!(robot.description().joints.len(), 20);
    let report = robot.joint_report()?;
    let problems: Vec<_> = report.iter().filter_map(|j| j.problem.as_ref()).collect();
    assert!(problems.is_empty(), "{problems:?}");
    Ok(())
}

#[test]
fn it_stands_on_both_feet_at_rest() -> Outcome {
    let config = op3();
    let mut robot = MujocoRobot::new(config)?;
    let rest = robot.description().rest();
    robot.reset(&rest, &mut rng())?;
    for _ in 0..250 {
        robot.step(&rest)?;
    }
    let state = robot.state();
    let carried = state.feet[0].load_n + state.feet[1].load_n;
    assert!((carried / (robot.description().mass_kg * 9.81) - 1.0).abs() < 0.01);
    assert!(state.base.tilt_rad() < 0.1, "{}", state.base.tilt_rad());
    Ok(())
}

/// The estimator's arithmetic against the simulator's own, in many postures, with perfect sensors:
/// centre of mass and feet relative to the base agree to rounding.
#[test]
fn kinematics_agree_with_the_simulator() -> Outcome {
    let config = op3();
    let model = kinematic_model(&config)?;
    let mut machine = SimulatedMachine::new(&config)?;
    assert!((model.mass_kg() - machine.robot().description().mass_kg).abs() < 1e-12);
    let hold = at_rest(machine.robot().description());
    machine.reset(&hold, &mut rng())?;
    for period in 0..100 {
        let command: Vec<f64> =
            hold.iter().enumerate().map(|(i, a)| a + 0.3 * (0.1 * f64::from(period) + i as f64).sin()).collect();
        let frame = machine.step(&command)?.clone();
        let angles: Vec<f64> = frame.joints.iter().map(|j| j.position_rad).collect();
        let placed = model.place(&angles, frame.orientation);
        let Some(truth) = machine.true_state() else {
            return Err("a simulated machine knows where it is".into());
        };
        for k in 0..3 {
            let base = truth.base.position_m[k];
            assert!((placed.com_m[k] - (truth.com.position_m[k] - base)).abs() < 1e-9);
            for side in 0..2 {
                let sole = truth.feet[side].centre_m[k] - base;
                assert!((placed.soles_m[side][k] - sole).abs() < 1e-9);
            }
        }
    }
    Ok(())
}

fn estimated(hardware: Option<HardwareConfig>) -> Result<EstimatedRobot<SimulatedMachine>, String> {
    let config = MujocoConfig { estimated: true, hardware, ..op3() };
    let machine = SimulatedMachine::new(&config).map_err(|e| e.to_string())?;
    let estimator = estimator(&config).map_err(|e| e.to_string())?;
    EstimatedRobot::new(machine, estimator).map_err(|e| e.to_string())
}

fn as_robot_error(what: String) -> RobotError {
    RobotError::Link { time_s: 0.0, what }
}

#[test]
fn contract_holds_with_and_without_hardware_effects() -> Outcome {
    check(|| estimated(None).map_err(as_robot_error), Start::Exact)?;
    let real = || estimated(Some(HardwareConfig::default())).map_err(as_robot_error);
    check(real, Start::Disturbed)?;
    Ok(())
}

/// Shifting the weight slowly from foot to foot: with perfect sensors and feet that do not slip, the
/// estimate follows the truth; with hardware effects it is off by its biases, and by little more.
#[test]
fn the_estimate_follows_the_truth() -> Outcome {
    for (hardware, most_mm) in [(None, 2.0), (Some(HardwareConfig::default()), 12.0)] {
        let mut robot = estimated(hardware)?;
        let (rest, legs) = (robot.description().rest(), robot.description().legs);
        robot.reset(&rest, &mut rng())?;
        let mut worst_mm = 0.0_f64;
        for period in 0..500 {
            let sway = 0.06 * (0.012 * f64::from(period)).sin();
            let mut targets = rest.clone();
            for (_, joint, role) in legs.roles() {
                targets.joints[role.joint].position_rad += match joint {
                    LegJoint::HipRoll => -role.sign * sway,
                    LegJoint::AnkleRoll => role.sign * sway,
                    _ => 0.0,
                };
            }
            robot.step(&targets)?;
            let (estimate, truth) = (robot.state(), robot.true_state());
            let Some(truth) = truth else {
                return Err("no truth".into());
            };
            // Relative to the middle of the feet: where the world begins is the estimator's own choice.
            let lateral = |s: &stridemap_robot::RobotState| {
                s.com.position_m[1] - 0.5 * (s.feet[0].centre_m[1] + s.feet[1].centre_m[1])
            };
            worst_mm = worst_mm.max(1e3 * (lateral(estimate) - lateral(truth)).abs());
        }
        assert!(worst_mm < most_mm, "{worst_mm} mm");
        assert!(worst_mm > 0.0);
    }
    Ok(())
}

#[test]
fn commands_and_readings_are_late_by_their_delays() -> Outcome {
    let quiet = HardwareConfig {
        encoder_step_deg: 0.0,
        encoder_noise_deg: 0.0,
        encoder_bias_deg: 0.0,
        imu_noise_deg: 0.0,
        imu_bias_deg: 0.0,
        gyro_noise_deg_s: 0.0,
        gyro_bias_deg_s: 0.0,
        load_noise_n: 0.0,
        load_gain_error: 0.0,
        lost_commands: 0.0,
        command_delay_s: 0.0,
        sensor_delay_s: 0.0,
        ..HardwareConfig::default()
    };
    let hold = at_rest(MujocoRobot::new(op3())?.description());
    let run = |command_delay_s: f64, sensor_delay_s: f64| -> Result<Vec<f64>, Box<dyn std::error::Error>> {
        let config = MujocoConfig {
            hardware: Some(HardwareConfig { command_delay_s, sensor_delay_s, ..quiet.clone() }),
            ..op3()
        };
        let mut machine = SimulatedMachine::new(&config)?;
        machine.reset(&hold, &mut rng())?;
        let mut command = hold.clone();
        command[0] += 0.2;
        (0..40).map(|_| Ok(machine.step(&command)?.joints[0].position_rad)).collect()
    };
    let prompt = run(0.0, 0.0)?;
    let commands_late = run(0.008, 0.0)?;
    let sensors_late = run(0.0, 0.016)?;
    for k in 2..40 {
        assert!((commands_late[k] - prompt[k - 1]).abs() < 2e-4);
        assert!((sensors_late[k] - prompt[k - 2]).abs() < 1e-15);
    }
    Ok(())
}
