//! The biped steps on the spot under coupled oscillators.

use std::error::Error;

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{MujocoConfig, MujocoRobot};
use stridemap_robot::{Robot, Side};

#[path = "common/gait.rs"]
mod gait;
use gait::Gait;

#[test]
fn steps_on_the_spot_without_a_fall() -> Result<(), Box<dyn Error>> {
    let config = MujocoConfig::default();
    let period_s = config.control_period_s;
    let mut robot = MujocoRobot::new(config)?;
    let rest = robot.description().rest();
    let mut state = robot.reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?.clone();
    let height_m = state.com.position_m[2];
    let mut gait = Gait::new();
    let (mut stance, mut strides, mut first_s, mut last_s) = (Side::Left, 0_u32, 0.0, 0.0);
    while state.time_s < 30.0 {
        let targets = gait.targets(robot.description(), &state, period_s);
        state.clone_from(robot.step(&targets)?);
        assert!(
            state.com.position_m[2] > 0.75 * height_m && state.base.tilt_rad() < 0.8,
            "fell at {:.2} s",
            state.time_s
        );
        let Some(right) = state.right_load_fraction() else {
            continue;
        };
        let now = match stance {
            Side::Left if right > 0.6 => Side::Right,
            Side::Right if right < 0.4 => Side::Left,
            same => same,
        };
        if now != stance && state.time_s > 10.0 {
            strides += 1;
            last_s = state.time_s;
            if strides == 1 {
                first_s = state.time_s;
            }
        }
        stance = now;
    }
    let stride_s = (last_s - first_s) / f64::from(strides - 1);
    // A regression value of this model under this controller, not a reference: an earlier experiment with the same
    // masses, lengths and gains had 0.577 s, and the difference is not explained. No fall is the claim.
    assert!((stride_s - 0.541).abs() < 0.01, "{stride_s} s a stride, {strides} strides");
    Ok(())
}
