//! The few lengths of a robot from which a gait can be scaled.

use stridemap_robot::{LegJoint, Robot, Side};

use crate::axis::Drive;
use crate::foreign::is_added;
use crate::robot::MujocoRobot;

/// The few lengths of a robot from which a gait can be scaled, at rest with level soles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dimensions {
    /// Mass of the robot.
    pub mass_kg: f64,
    /// Size of gravity.
    pub gravity_m_s2: f64,
    /// Height of the centre of mass over the soles.
    pub com_height_m: f64,
    /// How far the centre of mass is ahead of the soles' centres.
    pub com_ahead_m: f64,
    /// Half of the distance between the soles' centres.
    pub half_stance_m: f64,
    /// Thigh and shank together.
    pub leg_m: f64,
    /// How far the toes are up while the base is as upright as in the model's reference posture.
    pub toes_up_rad: f64,
}

impl MujocoRobot {
    /// Measures the robot at rest; it hangs in the model's reference posture afterwards, as before its first reset.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_mujoco::{MujocoConfig, MujocoRobot};
    ///
    /// let d = MujocoRobot::new(MujocoConfig::default())?.dimensions();
    /// assert!((d.mass_kg - 95.0).abs() < 1.0 && (d.half_stance_m - 0.09).abs() < 0.01);
    /// assert!((d.com_height_m - 0.812).abs() < 0.01 && d.toes_up_rad.abs() < 1e-6);
    /// # Ok::<(), stridemap_mujoco::MujocoError>(())
    /// ```
    pub fn dimensions(&mut self) -> Dimensions {
        let toes_up_rad = self.rest_on_floor();
        self.data.kinematics();
        self.data.com_pos();
        let com = self.data.subtree_com()[self.binding.torso];
        let soles = Side::BOTH.map(|side| self.on_foot(side, self.soles[side.index()].centre_m));
        let middle = [0, 1, 2].map(|i| 0.5 * (soles[0][i] + soles[1][i]));
        let anchor = |side: Side, joint: LegJoint| {
            let role = self.binding.legs[(side, joint)]?;
            Some(self.data.xanchor()[self.binding.axes[role.joint].joint])
        };
        let length = |side: Side, from: LegJoint, to: LegJoint| {
            let (Some(a), Some(b)) = (anchor(side, from), anchor(side, to)) else { return 0.0 };
            (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
        };
        let leg = |side| {
            length(side, LegJoint::HipPitch, LegJoint::Knee) + length(side, LegJoint::Knee, LegJoint::AnklePitch)
        };
        let dimensions = Dimensions {
            mass_kg: self.description().mass_kg,
            gravity_m_s2: self.gravity_m_s2().iter().map(|g| g * g).sum::<f64>().sqrt(),
            com_height_m: com[2] - middle[2],
            com_ahead_m: com[0] - middle[0],
            half_stance_m: 0.5 * (soles[0][1] - soles[1][1]).abs(),
            leg_m: 0.5 * (leg(Side::Left) + leg(Side::Right)),
            toes_up_rad,
        };
        self.hang();
        dimensions
    }

    /// Smallest and largest stiffness of the legs' position servos; `None` without any.
    #[must_use]
    pub fn servo_stiffness(&self) -> Option<[f64; 2]> {
        let stiffness = self.binding.axes.iter().filter(|axis| axis.of_leg).filter_map(|axis| {
            let (Drive::Servo { .. }, Some(servo)) = (axis.drive, axis.actuator) else { return None };
            if is_added(&self.model, servo) {
                return None;
            }
            let gear = self.model.actuator_gear()[self.model.actuator_outadr()[servo] as usize][0];
            Some(-self.model.actuator_biasprm()[servo][1] * gear * gear)
        });
        let all: Vec<f64> = stiffness.collect();
        let least = all.iter().copied().reduce(f64::min)?;
        Some([least, all.into_iter().fold(least, f64::max)])
    }
}
