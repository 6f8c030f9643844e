//! What is asked of a robot's joints.

use crate::error::RobotError;

/// What is asked of one joint for the next control period, in the robot's own sign.
///
/// ```text
/// τ = kp (position − q) + kd (velocity − q̇) + torque      within the joint's torque limit
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointCommand {
    /// Desired angle (way, for a slide in metres).
    pub position_rad: f64,
    /// Desired rate.
    pub velocity_rad_s: f64,
    /// Stiffness, N m/rad, >= 0; `None`: that of the robot's own servo.
    pub kp: Option<f64>,
    /// Damping, N m s/rad, >= 0; `None`: that of the robot's own servo.
    pub kd: Option<f64>,
    /// Torque added to the servo's.
    pub torque_nm: f64,
}

impl JointCommand {
    /// A desired angle, held by the robot's own servo.
    #[must_use]
    pub fn position(position_rad: f64) -> Self {
        Self { position_rad, ..Self::default() }
    }

    /// The first thing asked for beyond an angle, which not every robot can do; `None` if there is none.
    #[must_use]
    pub fn beyond_position(&self) -> Option<&'static str> {
        [
            (self.kp.is_some(), "a stiffness (kp)"),
            (self.kd.is_some(), "a damping (kd)"),
            (self.velocity_rad_s.abs() > 0.0, "a rate"),
            (self.torque_nm.abs() > 0.0, "a torque"),
        ]
        .into_iter()
        .find_map(|(asked, what)| asked.then_some(what))
    }
}

/// What a gait asks of the joints for the next control period: one command for each, in the robot's order
/// ([`RobotDescription::joints`](crate::RobotDescription::joints)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointTargets {
    /// Commands, one per joint.
    pub joints: Vec<JointCommand>,
}

impl JointTargets {
    /// Angles, held by the robot's own servos.
    pub fn positions(angles_rad: impl IntoIterator<Item = f64>) -> Self {
        let joints = angles_rad.into_iter().map(JointCommand::position);
        Self { joints: joints.collect() }
    }

    /// Refuses targets that are not one per joint, not finite, or with gains below zero, naming the first at fault.
    ///
    /// `names` are those of the robot's joints.
    ///
    /// # Errors
    ///
    /// [`RobotError::CommandLength`] or [`RobotError::BadCommand`].
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_robot::{JointTargets, RobotError};
    ///
    /// let mut targets = JointTargets::positions([0.1, -0.2]);
    /// assert!(targets.check(["hip", "knee"]).is_ok());
    /// assert!(targets.check(["hip"]).is_err());
    /// targets.joints[1].kp = Some(-1.0);
    /// let error = targets.check(["hip", "knee"]).unwrap_err();
    /// assert!(error.to_string().contains("knee has kp = -1"));
    /// ```
    pub fn check<'a>(
        &self,
        names: impl IntoIterator<Item = &'a str, IntoIter: ExactSizeIterator>,
    ) -> Result<(), RobotError> {
        let names = names.into_iter();
        let (expected, found) = (names.len(), self.joints.len());
        if expected != found {
            return Err(RobotError::CommandLength { expected, found });
        }
        for (command, name) in self.joints.iter().zip(names) {
            let least = f64::NEG_INFINITY;
            for (what, value, least) in [
                ("position_rad", Some(command.position_rad), least),
                ("velocity_rad_s", Some(command.velocity_rad_s), least),
                ("kp", command.kp, 0.0),
                ("kd", command.kd, 0.0),
                ("torque_nm", Some(command.torque_nm), least),
            ] {
                if let Some(value) = value
                    && !(value.is_finite() && value >= least)
                {
                    return Err(RobotError::BadCommand { joint: name.to_owned(), what, value });
                }
            }
        }
        Ok(())
    }
}
