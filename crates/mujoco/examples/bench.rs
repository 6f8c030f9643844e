//! What a control period costs beside the bare physics in it:
//! `cargo run --release -p stridemap-mujoco --example bench`.
//!
//! Each row gives the same commands to [`Robot::step`] and to bare `mj_step` calls. The commands of the stepping row are
//! recorded from a run of the gait beforehand: the simulator is deterministic, so both pass through that run again.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::time::Instant;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{MujocoConfig, MujocoRobot};
use stridemap_robot::{JointTargets, Robot};

#[path = "../tests/common/gait.rs"]
mod gait;

/// Control periods of a measurement (20 s).
const PERIODS: usize = 10_000;
/// Measurements, of which the median counts; bare and full take turns.
const REPEATS: usize = 9;

fn main() -> Result<(), Box<dyn Error>> {
    let config = MujocoConfig::default();
    let mut robot = MujocoRobot::new(config.clone())?;
    let rest = robot.description().rest();
    println!("{:<10} {:>16} {:>16} {:>7}", "", "bare us/mj_step", "full us/mj_step", "ratio");
    row("standing", &mut robot, &rest, &vec![rest.clone(); PERIODS])?;
    let stepping = record(&mut robot, &rest, config.control_period_s)?;
    row("stepping", &mut robot, &rest, &stepping)?;
    let mut build = Vec::new();
    for _ in 0..REPEATS {
        let start = Instant::now();
        MujocoRobot::new(config.clone())?;
        build.push(start.elapsed().as_secs_f64() * 1e3);
    }
    println!("building a robot: {:.2} ms", median(&mut build));
    println!("{}", robot.provenance()?.model_sha256);
    Ok(())
}

/// The commands of the gait over the length of a measurement.
fn record(robot: &mut MujocoRobot, rest: &JointTargets, period_s: f64) -> Result<Vec<JointTargets>, Box<dyn Error>> {
    let mut gait = gait::Gait::new();
    robot.reset(rest, &mut ChaCha8Rng::seed_from_u64(1))?;
    let mut commands = Vec::with_capacity(PERIODS);
    for _ in 0..PERIODS {
        let targets = gait.targets(robot.description(), robot.state(), period_s);
        robot.step(&targets)?;
        commands.push(targets);
    }
    Ok(commands)
}

fn row(
    name: &str,
    robot: &mut MujocoRobot,
    rest: &JointTargets,
    commands: &[JointTargets],
) -> Result<(), Box<dyn Error>> {
    let steps = (PERIODS * robot.steps_per_period()) as f64;
    let (mut bare, mut full, mut ratio) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..REPEATS {
        robot.reset(rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        let bare_us = robot.time_bare_steps(commands) * 1e6 / steps;
        robot.reset(rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        let start = Instant::now();
        for targets in commands {
            robot.step(targets)?;
        }
        let full_us = start.elapsed().as_secs_f64() * 1e6 / steps;
        bare.push(bare_us);
        full.push(full_us);
        ratio.push(full_us / bare_us);
    }
    let height_m = robot.state().com.position_m[2];
    if height_m < 0.6 {
        return Err(format!("{name}: the robot fell, so this row would time a fall").into());
    }
    println!("{name:<10} {:>16.2} {:>16.2} {:>7.3}", median(&mut bare), median(&mut full), median(&mut ratio));
    Ok(())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
