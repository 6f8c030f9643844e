//! What a control period costs beside the bare physics in it:
//! `cargo run --release -p stridemap-mujoco --example bench`.
//!
//! Each row: the same commands given to [`Robot::step`], and their physics steps with nothing around them.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::time::Instant;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{MujocoConfig, MujocoRobot};
use stridemap_robot::{JointTargets, LegJoint, Legs, Robot, Side};

/// Control periods a measurement, and measurements of which the median counts.
const PERIODS: usize = 5000;
const REPEATS: usize = 9;

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "{:<22} {:>14} {:>14} {:>7} {:>9}",
        "", "bare us/step", "step us/step", "ratio", "of engine"
    );
    row("standing", |rest, _| *rest)?;
    row("marching on the spot", |rest, time_s| {
        marching(rest, time_s)
    })?;
    let mut build: Vec<f64> = Vec::new();
    for _ in 0..REPEATS {
        let start = Instant::now();
        MujocoRobot::new(MujocoConfig::default())?;
        build.push(start.elapsed().as_secs_f64() * 1e3);
    }
    println!("building a robot: {:.2} ms", median(&mut build));
    Ok(())
}

/// Rest plus a sway at the biped's natural frequency: both feet load and unload, none slips far.
fn marching(rest: &JointTargets, time_s: f64) -> JointTargets {
    let sway = 3.0_f64.to_radians() * (3.5 * time_s).sin();
    JointTargets {
        position_rad: Legs::from_fn(|side, joint| {
            let lift = 6.0_f64.to_radians() * (side.lateral_sign() * (3.5 * time_s).sin()).max(0.0);
            rest.position_rad[(side, joint)]
                + match joint {
                    LegJoint::HipRoll => -sway,
                    LegJoint::AnkleRoll => sway,
                    LegJoint::HipPitch | LegJoint::AnklePitch => lift,
                    LegJoint::Knee => -2.0 * lift,
                }
        }),
    }
}

fn row(
    name: &str,
    gait: impl Fn(&JointTargets, f64) -> JointTargets,
) -> Result<(), Box<dyn Error>> {
    let config = MujocoConfig::default();
    let rest = config.rest_targets();
    let mut robot = MujocoRobot::new(config)?;
    let steps = (PERIODS * robot.steps_per_period()) as f64;
    let (mut bare, mut full, mut share) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..REPEATS {
        robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        bare.push(robot.time_bare_steps(PERIODS, |time_s| gait(&rest, time_s)) * 1e6 / steps);
        robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?;
        let engine = robot.engine_seconds().unwrap_or(0.0);
        let start = Instant::now();
        for _ in 0..PERIODS {
            let targets = gait(&rest, robot.state().time_s);
            robot.step(&targets)?;
        }
        let seconds = start.elapsed().as_secs_f64();
        full.push(seconds * 1e6 / steps);
        share.push((robot.engine_seconds().unwrap_or(0.0) - engine) / seconds);
    }
    let (bare, full) = (median(&mut bare), median(&mut full));
    println!(
        "{name:<22} {bare:>14.2} {full:>14.2} {:>7.3} {:>9.3}",
        full / bare,
        median(&mut share)
    );
    let left = robot.state().foot(Side::Left).load_n;
    println!(
        "{:<22} ends at {:.2} m, left foot {left:.0} N",
        "",
        robot.state().com.position_m[2]
    );
    Ok(())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
