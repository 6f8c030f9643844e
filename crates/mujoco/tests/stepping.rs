//! The biped steps on the spot under coupled oscillators: the model is the one that the gaits were found for.
//!
//! A bare version of the nominal controller of Morimoto and Atkeson (2009), sec. 6, kept here so that this crate can be
//! tested without the crates above it.

use std::error::Error;
use std::f64::consts::{FRAC_PI_2, PI};

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use stridemap_mujoco::{MujocoConfig, MujocoRobot};
use stridemap_robot::{JointTargets, LegJoint, Legs, Robot, RobotState, Side};

/// First-order low-pass filter.
struct Filter {
    time_constant_s: f64,
    value: f64,
}

impl Filter {
    fn next(&mut self, input: f64, period_s: f64) -> f64 {
        self.value += period_s / (self.time_constant_s + period_s) * (input - self.value);
        self.value
    }
}

/// Phase of the lateral sway and the two oscillators of the pitch joints.
struct Gait {
    lateral: Filter,
    rate: Filter,
    phases: [f64; 4],
    omega_rad_s: f64,
    coupling: f64,
}

impl Gait {
    fn new() -> Self {
        Self {
            lateral: Filter {
                time_constant_s: 0.05,
                value: 0.0,
            },
            rate: Filter {
                time_constant_s: 0.03,
                value: 0.0,
            },
            phases: [0.0, FRAC_PI_2, PI, 3.0 * FRAC_PI_2],
            omega_rad_s: 3.5,
            coupling: 10.0,
        }
    }

    fn targets(&mut self, rest: &JointTargets, state: &RobotState, period_s: f64) -> JointTargets {
        let middle = [0, 1].map(|i| 0.5 * (state.feet[0].centre_m[i] + state.feet[1].centre_m[i]));
        if let Some(cop) = state.cop_m {
            let heading = state.base.heading_rad();
            let right = (cop[0] - middle[0]) * heading.sin() - (cop[1] - middle[1]) * heading.cos();
            let before = self.lateral.value;
            let after = self.lateral.next(right, period_s);
            self.rate.next((after - before) / period_s, period_s);
        }
        let robot_phase = -self.rate.value.atan2(self.lateral.value);
        let offsets = [0.0, FRAC_PI_2, PI, 3.0 * FRAC_PI_2];
        for (phase, offset) in self.phases.iter_mut().zip(offsets) {
            let pull = self.coupling * (robot_phase - *phase + offset).sin();
            *phase += period_s * (self.omega_rad_s + pull);
        }
        let ramp =
            |from_s: f64, to_s: f64| ((state.time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
        let roll = 4.0_f64.to_radians() * ramp(0.0, 1.0) * self.phases[0].sin();
        let pitch = |side: Side| {
            let phase = match side {
                Side::Right => self.phases[0],
                Side::Left => self.phases[2],
            };
            6.0_f64.to_radians() * ramp(1.0, 4.0) * phase.sin()
        };
        JointTargets {
            position_rad: Legs::from_fn(|side, joint| {
                rest.position_rad[(side, joint)]
                    + match joint {
                        LegJoint::HipRoll => -roll,
                        LegJoint::AnkleRoll => roll,
                        LegJoint::HipPitch | LegJoint::AnklePitch => pitch(side),
                        LegJoint::Knee => -2.0 * pitch(side),
                    }
            }),
        }
    }
}

#[test]
fn steps_on_the_spot_without_a_fall() -> Result<(), Box<dyn Error>> {
    let config = MujocoConfig::default();
    let period_s = config.control_period_s;
    let rest = config.rest_targets();
    let mut robot = MujocoRobot::new(config)?;
    let mut state = robot
        .reset(&rest, &mut ChaCha8Rng::seed_from_u64(1))?
        .clone();
    let height_m = state.com.position_m[2];
    let mut gait = Gait::new();
    let (mut stance, mut strides, mut first_s, mut last_s) = (Side::Left, 0_u32, 0.0, 0.0);
    while state.time_s < 30.0 {
        let targets = gait.targets(&rest, &state, period_s);
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
    assert!(
        (stride_s - 0.541).abs() < 0.01,
        "{stride_s} s a stride, {strides} strides"
    );
    Ok(())
}
