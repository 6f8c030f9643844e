//! A gait scaled to a robot: from mass, height and stance, by a rule that was measured on 14 robots.

use serde::{Deserialize, Serialize};
use stridemap_mujoco::{Dimensions, MujocoRobot};

use crate::error::LabError;
use crate::task::Task;

/// Numbers that the rule sets, and that a search moves.
pub const COORDINATES: usize = 11;
/// What one unit of the search is: of the crouch, ankle lean and hip lean in degrees, of all others in the logarithm.
const UNITS: [f64; COORDINATES] = [5.0, 0.25, 0.5, 0.35, 0.5, 2.5, 3.0, 0.6, 0.6, 0.5, 0.4];
/// The rule's crouch.
const CROUCH_DEG: f64 = 15.0;

/// Everything that `tune` sets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaitSetting {
    /// Rest angles of hip pitch, knee and ankle pitch.
    pub rest_deg: [f64; 3],
    /// Stiffness of the leg joints.
    pub kp_nm_rad: f64,
    /// Their damping.
    pub kv_nms_rad: f64,
    /// `ω_c`.
    pub natural_frequency_rad_s: f64,
    /// `K_c`.
    pub coupling_rad_s: f64,
    /// `A_hroll`.
    pub hip_roll_deg: f64,
    /// `A_aroll`.
    pub ankle_roll_deg: f64,
    /// `A_pitch`.
    pub pitch_deg: f64,
    /// Time constant of the phase's position filter; that of the velocity is 0.6 of it.
    pub position_filter_s: f64,
    /// Half of the distance of the feet.
    pub half_stance_m: f64,
}

/// The rule for one robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The robot at rest in the rule's crouch.
    pub dimensions: Dimensions,
    /// Ankle angle at which its soles are level and its mass is over them.
    ankle_deg: f64,
}

impl Scale {
    /// Measures a task's robot.
    ///
    /// # Errors
    ///
    /// [`LabError`] if the robot cannot be built.
    pub fn of(task: &Task) -> Result<Self, LabError> {
        let mut robot = task.robot.clone();
        for (name, deg) in [("hip_pitch", CROUCH_DEG), ("knee", -2.0 * CROUCH_DEG), ("ankle_pitch", CROUCH_DEG)] {
            robot.rest_deg.insert(name.into(), deg.into());
        }
        // Joints without servos need some gains to be built at all.
        robot.kp_nm_rad = robot.kp_nm_rad.or_else(|| Some(1.0.into()));
        robot.kv_nms_rad = robot.kv_nms_rad.or_else(|| Some(1.0.into()));
        let measured = |robot: &stridemap_mujoco::MujocoConfig| {
            MujocoRobot::new(robot.clone()).map(|mut robot| robot.dimensions()).map_err(|error| task.located(error))
        };
        let ankle_deg = CROUCH_DEG - measured(&robot)?.toes_up_rad.to_degrees();
        robot.rest_deg.insert("ankle_pitch".into(), ankle_deg.into());
        let dimensions = measured(&robot)?;
        let lean_deg = dimensions.com_ahead_m.atan2(dimensions.com_height_m).to_degrees();
        Ok(Self { dimensions, ankle_deg: ankle_deg - lean_deg })
    }

    /// Natural frequency of the robot as a pendulum.
    fn w0(&self) -> f64 {
        (self.dimensions.gravity_m_s2 / self.dimensions.com_height_m).sqrt()
    }

    /// Pitch amplitude that lifts a foot by a share of the centre of mass's height, in degrees.
    fn lift_deg(&self, share: f64) -> f64 {
        let Dimensions { com_height_m, leg_m, .. } = self.dimensions;
        (share * com_height_m / (2.0 * leg_m * CROUCH_DEG.to_radians().sin())).to_degrees()
    }

    /// The rung of the ladder: the rule with a pitch amplitude between what lifts too much and what lifts nothing.
    #[must_use]
    pub fn rung(&self, rung: usize) -> GaitSetting {
        const HIGHEST: f64 = 0.052;
        const STEP: f64 = 0.76;
        let share = HIGHEST * STEP.powi(i32::try_from(rung).unwrap_or(i32::MAX));
        GaitSetting { pitch_deg: self.lift_deg(share).min(20.0), ..self.at(&[0.0; COORDINATES], self.lift_deg(0.03)) }
    }

    /// The rule, moved by so many units of the search, with a pitch amplitude at zero.
    #[must_use]
    pub fn at(&self, moved: &[f64], pitch_deg: f64) -> GaitSetting {
        let by = |i: usize| moved.get(i).map_or(0.0, |z| z.clamp(-4.0, 4.0) * UNITS[i]);
        let Dimensions { mass_kg, gravity_m_s2, com_height_m, half_stance_m, .. } = self.dimensions;
        let crouch_deg = (CROUCH_DEG + by(0)).clamp(4.0, 40.0);
        let omega = 1.06 * self.w0() * by(1).exp();
        let hip_roll_deg = (0.49 * half_stance_m.atan2(com_height_m)).to_degrees() * by(2).exp();
        let kp = 4.2 * mass_kg * gravity_m_s2 * com_height_m * by(7).exp();
        GaitSetting {
            rest_deg: [crouch_deg + by(6), -2.0 * crouch_deg, crouch_deg - CROUCH_DEG + self.ankle_deg + by(5)],
            kp_nm_rad: kp,
            kv_nms_rad: 0.10 * kp / self.w0() * (by(8) - by(7)).exp(),
            natural_frequency_rad_s: omega,
            coupling_rad_s: 3.0 * omega * by(9).exp(),
            hip_roll_deg: hip_roll_deg.min(20.0),
            ankle_roll_deg: (1.09 * hip_roll_deg * by(3).exp()).min(20.0),
            pitch_deg: (pitch_deg * by(4).exp()).min(25.0),
            position_filter_s: 0.166 / omega * by(10).exp(),
            half_stance_m,
        }
    }
}

impl GaitSetting {
    /// Puts the setting into a task, rounded to what a file should hold.
    pub fn put_into(&self, task: &mut Task) {
        let (robot, gait) = (&mut task.robot, &mut task.gait);
        for (name, deg) in ["hip_pitch", "knee", "ankle_pitch"].into_iter().zip(self.rest_deg) {
            robot.rest_deg.insert(name.into(), deg.into());
        }
        robot.kp_nm_rad = Some(self.kp_nm_rad.into());
        robot.kv_nms_rad = Some(self.kv_nms_rad.into());
        gait.natural_frequency_rad_s = self.natural_frequency_rad_s;
        gait.coupling_rad_s = self.coupling_rad_s;
        gait.amplitude_deg.hip_roll = self.hip_roll_deg;
        gait.amplitude_deg.ankle_roll = self.ankle_roll_deg;
        gait.amplitude_deg.pitch = self.pitch_deg;
        gait.phase.position_filter_s = self.position_filter_s;
        gait.phase.velocity_filter_s = self.velocity_filter_s();
        gait.phase.half_stance_m = self.half_stance_m;
    }

    /// Time constant of the phase's velocity filter.
    #[must_use]
    pub fn velocity_filter_s(&self) -> f64 {
        three_digits(0.6 * self.position_filter_s)
    }

    /// Rounded to three digits, as it is written down and tried.
    #[must_use]
    pub fn rounded(mut self) -> Self {
        let numbers = [
            &mut self.kp_nm_rad,
            &mut self.kv_nms_rad,
            &mut self.natural_frequency_rad_s,
            &mut self.coupling_rad_s,
            &mut self.hip_roll_deg,
            &mut self.ankle_roll_deg,
            &mut self.pitch_deg,
            &mut self.position_filter_s,
            &mut self.half_stance_m,
        ];
        for number in numbers.into_iter().chain(&mut self.rest_deg) {
            *number = three_digits(*number);
        }
        self
    }
}

/// A number to three significant digits.
fn three_digits(value: f64) -> f64 {
    if value.abs() < 1e-12 { 0.0 } else { format!("{value:.2e}").parse().unwrap_or(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mass 95 kg, height 0.83 m: kp = 4.2 m g h = 3,250 N m/rad, ω_c = 1.06 sqrt(g / h) = 3.64 rad/s.
    #[test]
    fn the_rule_of_the_biped() {
        let task = crate::builtin::load("stepping", &[]).unwrap().task;
        let scale = Scale::of(&task).unwrap();
        let rule = scale.at(&[0.0; COORDINATES], 4.0);
        let d = scale.dimensions;
        assert!((rule.kp_nm_rad - 4.2 * d.mass_kg * 9.81 * d.com_height_m).abs() < 1.0, "{rule:?}");
        assert!((rule.natural_frequency_rad_s - 1.06 * (9.81 / d.com_height_m).sqrt()).abs() < 1e-9);
        assert!((rule.coupling_rad_s / rule.natural_frequency_rad_s - 3.0).abs() < 1e-12);
        // 0.052 h / (2 L sin 15 deg), then 76 % of it.
        let lift = (0.052 * d.com_height_m / (2.0 * d.leg_m * 15_f64.to_radians().sin())).to_degrees();
        assert!((scale.rung(0).pitch_deg - lift).abs() < 1e-9 && (scale.rung(1).pitch_deg - 0.76 * lift).abs() < 1e-9);
        assert!((three_digits(1234.5) - 1230.0).abs() < 1e-9 && (three_digits(-0.012_34) + 0.0123).abs() < 1e-12);
    }
}
