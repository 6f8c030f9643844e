//! A bare version of the nominal controller of Morimoto and Atkeson (2009), sec. 6, kept here so that this crate can be
//! tested and timed without the crates above it.

use std::f64::consts::{FRAC_PI_2, PI};

use stridemap_robot::{JointTargets, LegJoint, RobotDescription, RobotState, Side};

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
pub(crate) struct Gait {
    lateral: Filter,
    rate: Filter,
    phases: [f64; 4],
    omega_rad_s: f64,
    coupling: f64,
}

impl Gait {
    /// The gait at the start of a run.
    pub(crate) fn new() -> Self {
        Self {
            lateral: Filter { time_constant_s: 0.05, value: 0.0 },
            rate: Filter { time_constant_s: 0.03, value: 0.0 },
            phases: [0.0, FRAC_PI_2, PI, 3.0 * FRAC_PI_2],
            omega_rad_s: 3.5,
            coupling: 10.0,
        }
    }

    /// Targets for the next control period.
    pub(crate) fn targets(&mut self, robot: &RobotDescription, state: &RobotState, period_s: f64) -> JointTargets {
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
        let ramp = |from_s: f64, to_s: f64| ((state.time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
        let roll = 4.0_f64.to_radians() * ramp(0.0, 1.0) * self.phases[0].sin();
        let pitch = |side: Side| {
            let phase = match side {
                Side::Right => self.phases[0],
                Side::Left => self.phases[2],
            };
            6.0_f64.to_radians() * ramp(1.0, 4.0) * phase.sin()
        };
        let mut targets = robot.rest();
        for (side, joint, role) in robot.legs.roles() {
            targets.joints[role.joint].position_rad += role.sign
                * match joint {
                    LegJoint::HipYaw => 0.0,
                    LegJoint::HipRoll => -roll,
                    LegJoint::AnkleRoll => roll,
                    LegJoint::HipPitch | LegJoint::AnklePitch => pitch(side),
                    LegJoint::Knee => -2.0 * pitch(side),
                };
        }
        targets
    }
}
