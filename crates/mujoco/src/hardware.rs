//! What stands between a simulation and a real machine: delays, noise, biases, weaker servos.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_robot::SensorFrame;
use stridemap_robot::kinematics::{of_rotation_vector, product};

use crate::error::{MujocoError, check};

/// The stream of an individual's constants; noise uses other streams.
const INDIVIDUAL_STREAM: u64 = 1;

/// Hardware effects that make a simulated robot a stand-in for a real one.
///
/// What belongs to one individual robot (biases, gain errors) is drawn once from
/// [`individual`](Self::individual) and stays; noise is drawn anew from the generator given at each
/// reset. The defaults are those that the experiments of the small humanoid use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HardwareConfig {
    /// Which individual; left out: the seed of the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub individual: Option<u64>,
    /// Sliding friction coefficient between feet and floor, > 0.
    pub friction: f64,
    /// Factor on every mass and moment of inertia, > 0.
    pub mass_scale: f64,
    /// Shift of the torso's centre of mass.
    pub torso_offset_m: [f64; 3],
    /// Stiffness of the servos of the legs, > 0.
    pub kp_nm_rad: f64,
    /// Dry friction in every joint, >= 0.
    pub joint_friction_nm: f64,
    /// Largest torque of a leg joint, > 0.
    pub torque_limit_nm: f64,
    /// Delay of commands, rounded to whole control periods.
    pub command_delay_s: f64,
    /// Delay of every sensor, rounded to whole control periods.
    pub sensor_delay_s: f64,
    /// Step of the encoders; 0 for none.
    pub encoder_step_deg: f64,
    /// Standard deviation of an encoder's noise.
    pub encoder_noise_deg: f64,
    /// Largest bias of an encoder; each has its own, uniform.
    pub encoder_bias_deg: f64,
    /// Standard deviation of the inertial unit's angles, about each axis.
    pub imu_noise_deg: f64,
    /// Largest bias of the inertial unit's angles, about each axis, uniform.
    pub imu_bias_deg: f64,
    /// Standard deviation of the gyroscope's noise, about each axis.
    pub gyro_noise_deg_s: f64,
    /// Largest bias of the gyroscope, about each axis, uniform.
    pub gyro_bias_deg_s: f64,
    /// Standard deviation of a foot's load.
    pub load_noise_n: f64,
    /// Largest relative error of a foot's load; each foot has its own, uniform.
    pub load_gain_error: f64,
    /// Share of commands that never arrive: the command before stays.
    pub lost_commands: f64,
}

impl Default for HardwareConfig {
    fn default() -> Self {
        Self {
            individual: None,
            friction: 0.7,
            mass_scale: 1.05,
            torso_offset_m: [0.005, 0.003, 0.0],
            kp_nm_rad: 19.0,
            joint_friction_nm: 0.1,
            torque_limit_nm: 4.1,
            command_delay_s: 0.008,
            sensor_delay_s: 0.008,
            encoder_step_deg: 0.088,
            encoder_noise_deg: 0.05,
            encoder_bias_deg: 0.5,
            imu_noise_deg: 0.2,
            imu_bias_deg: 0.5,
            gyro_noise_deg_s: 0.3,
            gyro_bias_deg_s: 0.3,
            load_noise_n: 0.3,
            load_gain_error: 0.05,
            lost_commands: 0.002,
        }
    }
}

impl HardwareConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`MujocoError::BadValue`] that names the field at fault.
    pub fn validate(&self) -> Result<(), MujocoError> {
        for (field, value) in [
            ("hardware.friction", self.friction),
            ("hardware.mass_scale", self.mass_scale),
            ("hardware.kp_nm_rad", self.kp_nm_rad),
            ("hardware.torque_limit_nm", self.torque_limit_nm),
        ] {
            check(field, value, value.is_finite() && value > 0.0, "a finite number > 0")?;
        }
        for (field, value, most) in [
            ("hardware.joint_friction_nm", self.joint_friction_nm, 1e3),
            ("hardware.command_delay_s", self.command_delay_s, 1.0),
            ("hardware.sensor_delay_s", self.sensor_delay_s, 1.0),
            ("hardware.encoder_step_deg", self.encoder_step_deg, 10.0),
            ("hardware.encoder_noise_deg", self.encoder_noise_deg, 10.0),
            ("hardware.encoder_bias_deg", self.encoder_bias_deg, 10.0),
            ("hardware.imu_noise_deg", self.imu_noise_deg, 10.0),
            ("hardware.imu_bias_deg", self.imu_bias_deg, 10.0),
            ("hardware.gyro_noise_deg_s", self.gyro_noise_deg_s, 100.0),
            ("hardware.gyro_bias_deg_s", self.gyro_bias_deg_s, 100.0),
            ("hardware.load_noise_n", self.load_noise_n, 1e3),
            ("hardware.load_gain_error", self.load_gain_error, 0.9),
            ("hardware.lost_commands", self.lost_commands, 0.9),
        ] {
            let good = (0.0..=most).contains(&value);
            check(field, value, good, "not negative, and small")?;
        }
        for value in self.torso_offset_m {
            check("hardware.torso_offset_m", value, value.is_finite(), "finite")?;
        }
        Ok(())
    }
}

/// A normal disturbance; `None` for a standard deviation of zero.
pub(crate) fn noise(standard_deviation: f64) -> Option<Normal<f64>> {
    (standard_deviation > 0.0).then(|| Normal::new(0.0, standard_deviation).ok()).flatten()
}

/// What one individual's sensors get wrong, always in the same way.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Individual {
    encoder_bias_rad: Vec<f64>,
    imu_bias_rad: [f64; 3],
    load_gain: [f64; 2],
    gyro_bias_rad_s: [f64; 3],
}

impl Individual {
    /// The individual of a number.
    pub fn new(config: &HardwareConfig, joints: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(config.individual.unwrap_or(0));
        rng.set_stream(INDIVIDUAL_STREAM);
        let mut up_to = |most: f64| most * (2.0 * rng.random::<f64>() - 1.0);
        Self {
            encoder_bias_rad: (0..joints).map(|_| up_to(config.encoder_bias_deg.to_radians())).collect(),
            imu_bias_rad: [0; 3].map(|_| up_to(config.imu_bias_deg.to_radians())),
            load_gain: [0; 2].map(|_| 1.0 + up_to(config.load_gain_error)),
            gyro_bias_rad_s: [0; 3].map(|_| up_to(config.gyro_bias_deg_s.to_radians())),
        }
    }

    /// What the sensors say of the truth.
    pub fn read(&self, truth: &SensorFrame, config: &HardwareConfig, rng: &mut ChaCha8Rng) -> SensorFrame {
        let mut normal = |std: f64| {
            let z: f64 = StandardNormal.sample(rng);
            std * z
        };
        let mut read = truth.clone();
        let step = config.encoder_step_deg.to_radians();
        for (joint, bias) in read.joints.iter_mut().zip(&self.encoder_bias_rad) {
            let angle = joint.position_rad + bias + normal(config.encoder_noise_deg.to_radians());
            joint.position_rad = if step > 0.0 { (angle / step).round() * step } else { angle };
        }
        let noise = config.imu_noise_deg.to_radians();
        let error = self.imu_bias_rad.map(|bias| bias + normal(noise));
        read.orientation = product(truth.orientation, of_rotation_vector(error));
        let noise = config.gyro_noise_deg_s.to_radians();
        for (rate, bias) in (read.angular_velocity_rad_s.iter_mut()).zip(self.gyro_bias_rad_s) {
            *rate += bias + normal(noise);
        }
        for ((load, gain), true_n) in (read.loads_n.iter_mut().zip(self.load_gain)).zip(truth.loads_n) {
            *load = (gain * true_n + normal(config.load_noise_n)).max(0.0);
        }
        read
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_robot::JointState;

    fn truth() -> SensorFrame {
        SensorFrame {
            time_s: 1.0,
            joints: vec![JointState { position_rad: 0.3, ..Default::default() }; 20],
            orientation: [1.0, 0.0, 0.0, 0.0],
            angular_velocity_rad_s: [0.0; 3],
            loads_n: [15.0, 16.0],
        }
    }

    /// Means over many readings are the individual's biases, within 4 standard errors; spreads are
    /// those of the noise (an encoder's step adds step²/12).
    #[test]
    fn noise_and_biases_are_as_large_as_they_say() {
        let config = HardwareConfig { individual: Some(3), ..Default::default() };
        let one = Individual::new(&config, 20);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let n = 4000;
        let reads: Vec<SensorFrame> = (0..n).map(|_| one.read(&truth(), &config, &mut rng)).collect();
        let moments = |values: &dyn Fn(&SensorFrame) -> f64| {
            let mean = reads.iter().map(values).sum::<f64>() / f64::from(n);
            let square = reads.iter().map(|r| (values(r) - mean).powi(2)).sum::<f64>();
            (mean, (square / f64::from(n)).sqrt())
        };
        let (mean, std) = moments(&|r| r.joints[4].position_rad.to_degrees());
        let expected_std = (0.05_f64.powi(2) + 0.088_f64.powi(2) / 12.0).sqrt();
        let bias = one.encoder_bias_rad[4].to_degrees();
        assert!((mean - 0.3_f64.to_degrees() - bias).abs() < 4.0 * 0.06 / 60.0 + 0.002);
        assert!((std - expected_std).abs() < 0.05 * expected_std, "{std}");
        assert!(bias.abs() <= 0.5);
        let (mean, std) = moments(&|r| (2.0 * r.orientation[1]).to_degrees());
        assert!((mean - one.imu_bias_rad[0].to_degrees()).abs() < 4.0 * 0.2 / 60.0);
        assert!((std - 0.2).abs() < 0.01, "{std}");
        let (mean, std) = moments(&|r| r.loads_n[1]);
        assert!((mean - 16.0 * one.load_gain[1]).abs() < 4.0 * 0.3 / 60.0);
        assert!((std - 0.3).abs() < 0.02, "{std}");
    }

    #[test]
    fn individuals_differ_and_stay_themselves() {
        let of = |individual| {
            let config = HardwareConfig { individual: Some(individual), ..Default::default() };
            Individual::new(&config, 20)
        };
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
    }

    #[test]
    fn a_bad_value_is_named() {
        let config = HardwareConfig { lost_commands: 1.5, ..Default::default() };
        let says = config.validate().unwrap_err().to_string();
        assert!(says.contains("hardware.lost_commands"), "{says}");
    }
}
