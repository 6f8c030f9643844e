//! What is known of a robot at one instant.

use crate::legs::Side;

/// One joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointState {
    /// Angle, in the robot's own sign.
    pub position_rad: f64,
    /// Rate of the angle.
    pub velocity_rad_s: f64,
    /// Torque that the actuator applies, in the direction of a growing angle.
    pub torque_nm: f64,
}

/// The pelvis (floating base).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseState {
    /// Origin of the base in the world.
    pub position_m: [f64; 3],
    /// Orientation of the base in the world, unit quaternion (w, x, y, z).
    pub orientation: [f64; 4],
    /// Angular velocity, expressed in the base's own axes, as a gyroscope measures it.
    pub angular_velocity_rad_s: [f64; 3],
}

impl Default for BaseState {
    fn default() -> Self {
        Self { position_m: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0], angular_velocity_rad_s: [0.0; 3] }
    }
}

impl BaseState {
    /// Yaw about the world's z, in (−π, π], of the base's x axis projected on the floor.
    ///
    /// # Example
    ///
    /// ```
    /// let quarter_turn = stridemap_robot::BaseState {
    ///     orientation: [0.5_f64.sqrt(), 0.0, 0.0, 0.5_f64.sqrt()],
    ///     ..Default::default()
    /// };
    /// assert!((quarter_turn.heading_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn heading_rad(&self) -> f64 {
        let [w, x, y, z] = self.orientation;
        (2.0 * (x * y + w * z)).atan2(1.0 - 2.0 * (y * y + z * z))
    }

    /// Angle between the base's z axis and the vertical, in [0, π].
    ///
    /// # Example
    ///
    /// ```
    /// let lying = stridemap_robot::BaseState {
    ///     orientation: [0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0, 0.0],
    ///     ..Default::default()
    /// };
    /// assert!((lying.tilt_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn tilt_rad(&self) -> f64 {
        let [_, x, y, _] = self.orientation;
        (1.0 - 2.0 * (x * x + y * y)).clamp(-1.0, 1.0).acos()
    }
}

/// The whole robot's centre of mass in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CentreOfMass {
    /// Position.
    pub position_m: [f64; 3],
    /// Velocity.
    pub velocity_m_s: [f64; 3],
}

/// One foot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FootState {
    /// Centre of the sole in the world.
    pub centre_m: [f64; 3],
    /// Vertical force of the floor on the foot; 0 in the air.
    pub load_n: f64,
}

/// What is known of a robot at one instant.
///
/// World frame: x along the first heading, y to its left, z up, floor at z = 0. A robot without
/// position sensing may place its world wherever it likes (for instance under the stance foot), as
/// long as centre of mass, feet and centre of pressure share it within one state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotState {
    /// Time on the robot's own clock since its reset.
    pub time_s: f64,
    /// The joints, in the robot's order ([`RobotDescription::joints`](crate::RobotDescription::joints)).
    pub joints: Vec<JointState>,
    /// The pelvis.
    pub base: BaseState,
    /// The centre of mass.
    pub com: CentreOfMass,
    /// The feet, by [`Side::index`].
    pub feet: [FootState; 2],
    /// Centre of pressure on the floor (x, y); `None` while no foot carries load.
    pub cop_m: Option<[f64; 2]>,
}

impl RobotState {
    /// The foot on a side.
    #[must_use]
    pub fn foot(&self, side: Side) -> &FootState {
        &self.feet[side.index()]
    }

    /// Share of the load on the right foot, in \[0, 1\]; `None` while no foot carries load.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_robot::{RobotState, Side};
    ///
    /// let mut state = RobotState::default();
    /// assert_eq!(state.right_load_fraction(), None);
    /// state.feet[Side::Left.index()].load_n = 300.0;
    /// state.feet[Side::Right.index()].load_n = 100.0;
    /// assert_eq!(state.right_load_fraction(), Some(0.25));
    /// ```
    #[must_use]
    pub fn right_load_fraction(&self) -> Option<f64> {
        let [left, right] = [self.feet[0].load_n.max(0.0), self.feet[1].load_n.max(0.0)];
        let total = left + right;
        (total > 0.0).then(|| right / total)
    }

    /// The first entry that is NaN or infinite, by name; `None` if all are finite.
    #[must_use]
    pub fn first_not_finite(&self) -> Option<&'static str> {
        let all = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let checks: [(&'static str, bool); 6] = [
            ("time_s", self.time_s.is_finite()),
            ("joints", self.joints.iter().all(|j| all(&[j.position_rad, j.velocity_rad_s, j.torque_nm]))),
            (
                "base",
                all(&self.base.position_m) && all(&self.base.orientation) && all(&self.base.angular_velocity_rad_s),
            ),
            ("com", all(&self.com.position_m) && all(&self.com.velocity_m_s)),
            ("feet", self.feet.iter().all(|f| all(&f.centre_m) && f.load_n.is_finite())),
            ("cop_m", self.cop_m.is_none_or(|c| all(&c))),
        ];
        checks.into_iter().find(|(_, finite)| !finite).map(|(name, _)| name)
    }
}
