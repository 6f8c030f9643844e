//! The inverted pendulum between stance foot and centre of mass.

use serde::{Deserialize, Serialize};
use stridemap_robot::{RobotState, Side};

/// The foot of the pendulum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PendulumBase {
    /// The centre of the stance foot's sole.
    StanceFoot,
    /// The centre of pressure. It sits on the sole's outer edge at the section, so that angles are
    /// larger by the angle between edge and centre.
    CentreOfPressure,
}

/// State of the pendulum at one instant, mirrored so that left and right stance look the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pendulum {
    /// `ψ_roll`: + when the mass is on the inner side of its foot; negative means that it hangs over
    /// the outer side.
    pub roll_rad: f64,
    /// `ψ̇_roll`.
    pub roll_rate_rad_s: f64,
    /// `ψ_pitch`: + when the mass is ahead of its foot.
    pub pitch_rad: f64,
    /// `ψ̇_pitch`: + when the mass moves forward.
    pub pitch_rate_rad_s: f64,
    /// The leg that the pendulum stands on.
    pub stance: Side,
}

impl Pendulum {
    /// The state a share `s` ∈ \[0, 1\] of the way from `self` to `next`, by linear interpolation.
    /// Both must stand on the same leg.
    pub(crate) fn interpolate(&self, next: &Self, s: f64) -> Self {
        let mix = |a: f64, b: f64| a + s * (b - a);
        Self {
            roll_rad: mix(self.roll_rad, next.roll_rad),
            roll_rate_rad_s: mix(self.roll_rate_rad_s, next.roll_rate_rad_s),
            pitch_rad: mix(self.pitch_rad, next.pitch_rad),
            pitch_rate_rad_s: mix(self.pitch_rate_rad_s, next.pitch_rate_rad_s),
            stance: self.stance,
        }
    }
}

/// The pendulum of a state that stands on `stance`.
///
/// In axes that turn with the pelvis' heading, with the mass at `(x, ±y, h)` from its foot (x
/// forward, y towards the inner side):
///
/// ```text
/// ψ_roll = atan2(y, h)     ψ̇_roll = (ẏ h − y ḣ) / (y² + h²)
/// ψ_pitch = atan2(x, h)    ψ̇_pitch = (ẋ h − x ḣ) / (x² + h²)
/// ```
///
/// The foot is taken to be at rest and the heading constant while they carry the pendulum. `None` if
/// the base is the centre of pressure and no foot carries load.
///
/// # Example
///
/// A mass 1 m above and 0.1 m inside the left foot, moving outwards at 0.2 m/s:
///
/// ```
/// use stridemap_robot::{RobotState, Side};
/// use stridemap_section::{PendulumBase, pendulum};
///
/// let mut state = RobotState::default();
/// state.feet[Side::Left.index()].centre_m = [0.0, 0.1, 0.0];
/// state.com.position_m = [0.0, 0.0, 1.0];
/// state.com.velocity_m_s = [0.0, 0.2, 0.0];
/// let p = pendulum(&state, Side::Left, PendulumBase::StanceFoot).unwrap();
/// assert!((p.roll_rad - 0.1_f64.atan()).abs() < 1e-15);
/// assert!((p.roll_rate_rad_s + 0.2 / 1.01).abs() < 1e-15);
/// ```
#[must_use]
pub fn pendulum(state: &RobotState, stance: Side, base: PendulumBase) -> Option<Pendulum> {
    let [foot_x, foot_y, foot_z] = state.foot(stance).centre_m;
    let [base_x, base_y] = match base {
        PendulumBase::StanceFoot => [foot_x, foot_y],
        PendulumBase::CentreOfPressure => state.cop_m?,
    };
    let (sin, cos) = state.base.heading_rad().sin_cos();
    let forward_and_left = |x: f64, y: f64| (cos * x + sin * y, cos * y - sin * x);

    let [com_x, com_y, com_z] = state.com.position_m;
    let [vel_x, vel_y, h_dot] = state.com.velocity_m_s;
    let (x, left) = forward_and_left(com_x - base_x, com_y - base_y);
    let (x_dot, left_dot) = forward_and_left(vel_x, vel_y);
    let inward = -stance.lateral_sign();
    let (y, y_dot, h) = (inward * left, inward * left_dot, com_z - foot_z);

    Some(Pendulum {
        roll_rad: y.atan2(h),
        roll_rate_rad_s: (y_dot * h - y * h_dot) / (y * y + h * h),
        pitch_rad: x.atan2(h),
        pitch_rate_rad_s: (x_dot * h - x * h_dot) / (x * x + h * h),
        stance,
    })
}

/// The robot at the section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// When, on the robot's clock; between two control ticks.
    pub time_s: f64,
    /// The pendulum then; its filtered roll rate is zero.
    pub pendulum: Pendulum,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(heading_rad: f64, mirror: f64) -> RobotState {
        let mut state = RobotState::default();
        let (sin, cos) = heading_rad.sin_cos();
        let turn = |x: f64, y: f64| [cos * x - sin * y, sin * x + cos * y];
        state.base.orientation = [(heading_rad / 2.0).cos(), 0.0, 0.0, (heading_rad / 2.0).sin()];
        for side in Side::BOTH {
            let [x, y] = turn(0.02, 0.1 * side.lateral_sign());
            state.feet[side.index()].centre_m = [x, y, 0.01];
        }
        let ([x, y], [vx, vy]) = (turn(0.05, 0.04 * mirror), turn(0.3, 0.1 * mirror));
        state.com.position_m = [x, y, 0.9];
        state.com.velocity_m_s = [vx, vy, -0.05];
        state
    }

    #[test]
    fn the_mirror_image_on_the_other_leg_and_any_heading_look_the_same() {
        let reference = pendulum(&state(0.0, 1.0), Side::Left, PendulumBase::StanceFoot).unwrap();
        for (heading_rad, mirror, side) in [(1.2, 1.0, Side::Left), (0.0, -1.0, Side::Right), (-2.0, -1.0, Side::Right)]
        {
            let p = pendulum(&state(heading_rad, mirror), side, PendulumBase::StanceFoot).unwrap();
            for (a, b) in [
                (p.roll_rad, reference.roll_rad),
                (p.roll_rate_rad_s, reference.roll_rate_rad_s),
                (p.pitch_rad, reference.pitch_rad),
                (p.pitch_rate_rad_s, reference.pitch_rate_rad_s),
            ] {
                assert!((a - b).abs() < 1e-12);
            }
        }
    }

    /// The rates are the derivatives of the angles: central differences along a straight motion.
    #[test]
    fn rates_are_derivatives_of_angles() {
        let moved = |t: f64| {
            let mut s = state(0.4, 1.0);
            for i in 0..3 {
                s.com.position_m[i] += t * s.com.velocity_m_s[i];
            }
            pendulum(&s, Side::Right, PendulumBase::StanceFoot).unwrap()
        };
        let (before, now, after) = (moved(-1e-5), moved(0.0), moved(1e-5));
        assert!(((after.roll_rad - before.roll_rad) / 2e-5 - now.roll_rate_rad_s).abs() < 1e-8);
        assert!(((after.pitch_rad - before.pitch_rad) / 2e-5 - now.pitch_rate_rad_s).abs() < 1e-8);
    }
}
