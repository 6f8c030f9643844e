//! From phases and amplitudes to joint angles \[MA09, eqs. (3)–(6), (26), (29)\].

use stridemap_robot::{LegJoint, Legs, Side};

/// The four oscillators' phases `φ_c¹ … φ_c⁴` in rad; entry `i − 1` is `φ_cⁱ`.
pub type Phases = [f64; 4];

/// Amplitudes of the sinusoids, in rad, as they are at one instant (ramps and modulations included).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Amplitudes {
    /// `A_hroll` of eq. (3).
    pub hip_roll_rad: f64,
    /// `A_aroll` of eq. (4), plus `A_a_step` of eq. (29).
    pub ankle_roll_rad: f64,
    /// `A^pitch` of eq. (5), plus `A_step` of eq. (26).
    pub pitch_rad: f64,
    /// `A_walk` of eq. (6).
    pub walk_rad: f64,
}

/// Joint angles relative to the rest posture.
///
/// ```text
/// hip yaw    0
/// hip roll   −A_hroll sin φ_c¹          both legs, about +x          [MA09, eq. (3)]
/// ankle roll +A_aroll sin φ_c¹          both legs, about +x          [MA09, eq. (4), (29)]
/// hip pitch  +A^pitch s − A_walk w      s = sin φ_c¹ right, sin φ_c³ left
/// knee       −2 A^pitch s                                            [MA09, eq. (5), (26)]
/// ankle      +A^pitch s + A_walk w      w = sin φ_c² right, sin φ_c⁴ left   [MA09, eq. (6)]
/// ```
///
/// Signs are Stridemap's own (hip + forward, knee flexion −, ankle + toes up). With them the foot
/// stays parallel to the floor in stepping, and `A_walk > 0` walks forward. The signs printed in
/// eqs. (5) and (6) cannot both hold under one ankle convention; see NOTATION.md.
///
/// # Example
///
/// At `φ_c¹ = π/2` the right leg is shortest and the left leg longest:
///
/// ```
/// use std::f64::consts::{FRAC_PI_2, PI};
/// use stridemap_gait::{Amplitudes, joint_offsets};
/// use stridemap_robot::{LegJoint, Side};
///
/// let phases = [FRAC_PI_2, PI, 3.0 * FRAC_PI_2, 0.0];
/// let amplitudes = Amplitudes { pitch_rad: 0.1, ..Default::default() };
/// let offset_rad = joint_offsets(&phases, &amplitudes);
/// assert!((offset_rad[(Side::Right, LegJoint::Knee)] + 0.2).abs() < 1e-15);
/// assert!((offset_rad[(Side::Left, LegJoint::Knee)] - 0.2).abs() < 1e-15);
/// ```
#[must_use]
pub fn joint_offsets(phases: &Phases, amplitudes: &Amplitudes) -> Legs<f64> {
    let a = amplitudes;
    let [sin1, sin2, sin3, sin4] = phases.map(f64::sin);
    Legs::from_fn(|side, joint| {
        let (s, w) = match side {
            Side::Right => (sin1, sin2),
            Side::Left => (sin3, sin4),
        };
        match joint {
            LegJoint::HipYaw => 0.0,
            LegJoint::HipRoll => -a.hip_roll_rad * sin1,
            LegJoint::AnkleRoll => a.ankle_roll_rad * sin1,
            LegJoint::HipPitch => a.pitch_rad * s - a.walk_rad * w,
            LegJoint::Knee => -2.0 * a.pitch_rad * s,
            LegJoint::AnklePitch => a.pitch_rad * s + a.walk_rad * w,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_robot::LEG_JOINTS;

    /// Hip, knee and ankle pitch rotate the foot about the same axis, so their sum is the foot's
    /// pitch: hip and knee turn it with their own sign, the ankle too (thigh forward lifts the toes,
    /// flexion lowers them, ankle + lifts them).
    #[test]
    fn the_foot_stays_parallel_to_the_floor() {
        let phases = [0.3, 1.1, 2.0, 4.0];
        let amplitudes = Amplitudes { hip_roll_rad: 0.1, ankle_roll_rad: 0.1, pitch_rad: 0.2, walk_rad: 0.15 };
        let offset = joint_offsets(&phases, &amplitudes);
        for side in Side::BOTH {
            let pitch: f64 =
                [LegJoint::HipPitch, LegJoint::Knee, LegJoint::AnklePitch].iter().map(|&j| offset[(side, j)]).sum();
            let roll = offset[(side, LegJoint::HipRoll)] + offset[(side, LegJoint::AnkleRoll)];
            assert!(pitch.abs() < 1e-15 && roll.abs() < 1e-15);
        }
    }

    /// Half a period later the legs have changed places.
    #[test]
    fn legs_are_half_a_period_apart() {
        use std::f64::consts::{FRAC_PI_2, PI};
        let at = |phi: f64| [phi, phi + FRAC_PI_2, phi + PI, phi + 3.0 * FRAC_PI_2];
        let amplitudes = Amplitudes { hip_roll_rad: 0.1, ankle_roll_rad: 0.2, pitch_rad: 0.3, walk_rad: 0.4 };
        let (now, later) = (joint_offsets(&at(0.7), &amplitudes), joint_offsets(&at(0.7 + PI), &amplitudes));
        for joint in LEG_JOINTS {
            let mirrored = match joint {
                LegJoint::HipYaw | LegJoint::HipRoll | LegJoint::AnkleRoll => -later[(Side::Left, joint)],
                _ => later[(Side::Left, joint)],
            };
            assert!((now[(Side::Right, joint)] - mirrored).abs() < 1e-12, "{joint:?}");
        }
    }
}
