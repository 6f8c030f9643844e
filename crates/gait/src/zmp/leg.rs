//! Inverse kinematics of a leg of six joints in closed form.

use stridemap_robot::LEG_JOINTS;

/// Lengths of a leg whose three hip axes meet in a point, and whose two ankle axes do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegLengths {
    /// Hip to knee, m.
    pub thigh_m: f64,
    /// Knee to ankle, m.
    pub shank_m: f64,
}

impl LegLengths {
    /// Joint angles, rad, in the order and signs of [`LEG_JOINTS`], that bring the ankle to a place seen from the hip (x
    /// forward, y left, z up, in axes of the upright pelvis), the sole level, turned by `yaw_rad` about the vertical.
    /// Where the leg is too short it points there, straight but for a hundredth of its length.
    ///
    /// ```text
    /// hip roll = atan2(y, −z),   d² = y² + z²,   L² = x² + d²           (x, y turned back by the yaw)
    /// cos κ = (L² − a² − b²) / (2 a b),   knee = −κ
    /// hip pitch = atan2(x, d) + atan2(b sin κ, a + b cos κ),   ankle pitch = κ − hip pitch,   ankle roll = −hip roll
    /// ```
    ///
    /// # Example
    ///
    /// Straight down by thigh and shank of 0.4 m less a little bend: with 0.4 √2 between hip and ankle the knee is at a
    /// right angle.
    ///
    /// ```
    /// use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
    /// use stridemap_gait::LegLengths;
    ///
    /// let leg = LegLengths { thigh_m: 0.4, shank_m: 0.4 };
    /// let [yaw, hip_roll, hip_pitch, knee, ankle_pitch, ankle_roll] = leg.angles_rad([0.0, 0.0, -0.4 * 2f64.sqrt()], 0.0);
    /// assert!((knee + FRAC_PI_2).abs() < 1e-12 && (hip_pitch - FRAC_PI_4).abs() < 1e-12);
    /// assert!((ankle_pitch - FRAC_PI_4).abs() < 1e-12 && yaw == 0.0 && hip_roll == 0.0 && ankle_roll == 0.0);
    /// ```
    #[must_use]
    pub fn angles_rad(&self, ankle_m: [f64; 3], yaw_rad: f64) -> [f64; LEG_JOINTS.len()] {
        /// Share of its full length to which a leg is stretched at most.
        const STRETCHED: f64 = 0.99;
        let (a, b) = (self.thigh_m, self.shank_m);
        let (sin, cos) = yaw_rad.sin_cos();
        let [x, y, z] = [cos * ankle_m[0] + sin * ankle_m[1], cos * ankle_m[1] - sin * ankle_m[0], ankle_m[2]];
        let hip_roll = y.atan2(-z);
        let down = y.hypot(z);
        let length = x.hypot(down).clamp((a - b).abs() + 1e-6, STRETCHED * (a + b));
        let bend = ((length * length - a * a - b * b) / (2.0 * a * b)).clamp(-1.0, 1.0).acos();
        let hip_pitch = x.atan2(down) + (b * bend.sin()).atan2(a + b * bend.cos());
        [yaw_rad, hip_roll, hip_pitch, -bend, bend - hip_pitch, 0.0 - hip_roll]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forwards again: yaw, roll, then the leg's plane.
    #[test]
    fn the_foot_is_where_it_was_asked_to_be_and_level() {
        let leg = LegLengths { thigh_m: 0.37, shank_m: 0.35 };
        for asked in [[0.1, 0.05, -0.6], [-0.2, -0.1, -0.55], [0.0, 0.15, -0.65]] {
            for yaw in [0.0, 0.3, -0.5] {
                let [psi, roll, pitch, knee, ankle_pitch, ankle_roll] = leg.angles_rad(asked, yaw);
                let shank = pitch + knee;
                let (x, down) = (
                    leg.thigh_m * pitch.sin() + leg.shank_m * shank.sin(),
                    leg.thigh_m * pitch.cos() + leg.shank_m * shank.cos(),
                );
                let (y, z) = (down * roll.sin(), -down * roll.cos());
                let found = [psi.cos() * x - psi.sin() * y, psi.sin() * x + psi.cos() * y, z];
                for (f, a) in found.iter().zip(asked) {
                    assert!((f - a).abs() < 1e-12, "{found:?} {asked:?}");
                }
                assert!((shank + ankle_pitch).abs() < 1e-12 && (roll + ankle_roll).abs() < 1e-12);
                assert!(knee < 0.0);
            }
        }
    }

    #[test]
    fn out_of_reach_the_leg_points_there() {
        let leg = LegLengths { thigh_m: 0.3, shank_m: 0.3 };
        let [_, _, pitch, knee, ..] = leg.angles_rad([0.9, 0.0, -0.9], 0.0);
        assert!((pitch + 0.5 * knee - std::f64::consts::FRAC_PI_4).abs() < 1e-9 && knee.is_finite());
    }
}
