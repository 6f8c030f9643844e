use rand_chacha::rand_core::SeedableRng;

use super::*;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// The state as numbers: time, then the 17 positions, then the velocities.
const FIRST_VELOCITY: usize = 1 + 17;

#[test]
fn a_diverged_state_is_an_error_until_the_next_reset() -> Outcome {
    let config = MujocoConfig::default();
    let rest = MujocoRobot::new(config.clone())?.description().rest();
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    for poison in [f64::NAN, f64::INFINITY, 1e15] {
        let mut robot = MujocoRobot::new(config.clone())?;
        robot.reset(&rest, rng)?;
        robot.step(&rest)?;
        let mut moment = robot.snapshot();
        moment.numbers[FIRST_VELOCITY] = poison;
        robot.restore(&moment)?;
        for _ in 0..2 {
            let error = robot.step(&rest).err();
            let Some(RobotError::Simulator { time_s, warning }) = error else {
                return Err(format!("{poison}: {error:?}").into());
            };
            assert!((time_s - 0.002).abs() < 1e-12 || (time_s - 0.004).abs() < 1e-12);
            assert!(warning.contains("Nan, Inf or huge value"), "{warning}");
        }
        robot.reset(&rest, rng)?;
        robot.step(&rest)?;
    }
    Ok(())
}

#[test]
fn two_halves_of_a_step_are_a_step_to_the_bit() -> Outcome {
    let config = MujocoConfig::default();
    let mut halves = MujocoRobot::new(config.clone())?;
    let rest = halves.description().rest();
    let commands: Vec<JointTargets> = (0..500)
        .map(|period| {
            let sway = 0.05 * (0.02 * f64::from(period)).sin();
            let rests = rest.joints.iter().map(|c| c.position_rad).enumerate();
            JointTargets::positions(rests.map(|(at, rest)| if at < 5 { rest + sway } else { rest - sway }))
        })
        .collect();
    let mut whole = MujocoRobot::new(config)?;
    for robot in [&mut halves, &mut whole] {
        robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    }
    let start = halves.data.qpos().to_vec();
    for targets in &commands {
        halves.step(targets)?;
    }
    for targets in &commands {
        whole.command(targets);
        for _ in 0..whole.steps_per_period() {
            whole.data.step();
        }
    }
    assert_ne!(halves.data.qpos(), start, "it moved");
    assert_eq!(halves.data.qpos(), whole.data.qpos());
    assert_eq!(halves.data.qvel(), whole.data.qvel());
    Ok(())
}

#[test]
fn a_foreign_snapshot_is_refused() -> Outcome {
    let mut robot = MujocoRobot::new(MujocoConfig::default())?;
    let mut moment = robot.snapshot();
    moment.numbers = Box::new([0.0; 3]);
    let found = 3;
    assert!(matches!(robot.restore(&moment), Err(MujocoError::ForeignSnapshot { found: f, .. }) if f == found));
    Ok(())
}
