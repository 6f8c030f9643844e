//! What a robot senses of itself, and how well.

use serde::{Deserialize, Serialize};

use crate::error::{MujocoError, check};

/// From what speed and heading are told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedSource {
    /// From the stance leg's joints and the gyroscope alone: the lower foot stands still, the heading is the gyroscope's sum.
    #[default]
    StanceLeg,
    /// From an odometry that the robot has besides, with the noise and bias that are stated; the heading likewise.
    Odometry,
    /// From the simulator's truth.
    Truth,
}

impl SpeedSource {
    /// What it is, for a report.
    #[must_use]
    pub const fn about(self) -> &'static str {
        match self {
            Self::StanceLeg => "stance-leg kinematics and gyroscope",
            Self::Odometry => "the robot's odometry, with noise and bias as stated",
            Self::Truth => "the simulator's truth",
        }
    }
}

/// A fault of the wiring, injected to see that the pre-flight names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WiringFault {
    /// Commands to two joints are exchanged, their readings are not.
    CommandOrder,
    /// Two joints of one leg are exchanged in commands and readings alike.
    JointOrder,
    /// The legs are exchanged, in commands and readings alike.
    LegsExchanged,
    /// A joint is turned around in commands and readings alike.
    JointSign,
    /// A joint's angle is turned around, its commands are not.
    ReadingSign,
    /// The gyroscope's x and y are exchanged.
    GyroAxes,
    /// The gyroscope's signs are wrong.
    GyroSign,
    /// The gyroscope tells degrees.
    GyroScale,
    /// Gravity points up.
    GravityInverted,
    /// Readings are stamped by another rate.
    Rate,
    /// Rates of joints are told in degrees.
    RateScale,
    /// The zeros of both knees are wrong.
    RestPose,
}

impl WiringFault {
    /// Every one, with the word by which the pre-flight names it.
    pub const ALL: [(Self, &'static str); 12] = [
        (Self::CommandOrder, "joint_order"),
        (Self::JointOrder, "joint_order"),
        (Self::LegsExchanged, "joint_order"),
        (Self::JointSign, "joint_sign"),
        (Self::ReadingSign, "joint_sign"),
        (Self::GyroAxes, "gyro_axes"),
        (Self::GyroSign, "gyro_sign"),
        (Self::GyroScale, "gyro_scale"),
        (Self::GravityInverted, "gravity_inverted"),
        (Self::Rate, "rate"),
        (Self::RateScale, "joint_rate_scale"),
        (Self::RestPose, "rest_pose"),
    ];
}

/// What a robot senses of itself: angles and rates of joints, gravity's direction and angular velocity of the base, with
/// white noise; place and heading as [`speed`](Self::speed) says. It has no force sensors: the lower foot is the stance foot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorConfig {
    /// From what speed and heading are told.
    pub speed: SpeedSource,
    /// Standard deviation of a joint's angle.
    pub joint_noise_rad: f64,
    /// Standard deviation of a joint's rate.
    pub joint_rate_noise_rad_s: f64,
    /// Standard deviation of each component of gravity's direction.
    pub gravity_noise: f64,
    /// Standard deviation of each component of the angular velocity.
    pub gyro_noise_rad_s: f64,
    /// Of an odometry: bias of the speed forward and to the left.
    #[serde(skip_serializing_if = "is_zero")]
    pub odometry_bias_m_s: [f64; 2],
    /// Of an odometry: standard deviation of its place, forward and to the left.
    pub odometry_noise_m: f64,
    /// How much higher the stance foot must be than the other until that is the stance foot.
    pub stance_hysteresis_m: f64,
    /// A fault of the wiring, injected for tests of the pre-flight.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<WiringFault>,
}

fn is_zero(bias: &[f64; 2]) -> bool {
    bias.iter().all(|b| b.to_bits() == 0)
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self {
            speed: SpeedSource::StanceLeg,
            joint_noise_rad: 0.005,
            joint_rate_noise_rad_s: 0.2,
            gravity_noise: 0.01,
            gyro_noise_rad_s: 0.05,
            odometry_bias_m_s: [0.0; 2],
            odometry_noise_m: 0.005,
            stance_hysteresis_m: 0.003,
            fault: None,
        }
    }
}

impl SensorConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`MujocoError::BadValue`] that names the field at fault.
    pub fn validate(&self) -> Result<(), MujocoError> {
        for (field, value, most) in [
            ("sensors.joint_noise_rad", self.joint_noise_rad, 1.0),
            ("sensors.joint_rate_noise_rad_s", self.joint_rate_noise_rad_s, 100.0),
            ("sensors.gravity_noise", self.gravity_noise, 1.0),
            ("sensors.gyro_noise_rad_s", self.gyro_noise_rad_s, 100.0),
            ("sensors.odometry_noise_m", self.odometry_noise_m, 10.0),
            ("sensors.stance_hysteresis_m", self.stance_hysteresis_m, 1.0),
        ] {
            check(field, value, (0.0..=most).contains(&value), "not negative, and small")?;
        }
        for bias in self.odometry_bias_m_s {
            check("sensors.odometry_bias_m_s", bias, bias.abs() <= 10.0, "-10 to 10 m/s")?;
        }
        Ok(())
    }
}
