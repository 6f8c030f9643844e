//! The paper's gait: four oscillators phase-locked to the robot.

use stridemap_robot::{JointTargets, LegJoint, LegRole, RobotDescription, RobotState, Side};

use crate::config::{GaitConfig, RampConfig};
use crate::gait::{Gait, GaitError, Modulation};
use crate::modulations::{
    ANKLE_LEAN, ANKLE_ROLL_STEP, COUNT, CROUCH, FREQUENCY, HIP_LEAN, PITCH, ROLL, STEP, WALK, modulations,
};
use crate::phase::PhaseDetector;
use crate::targets::{Amplitudes, Phases, joint_offsets};

use std::f64::consts::{FRAC_PI_2, PI};

/// Desired phase differences `φ_dⁱ` to the robot's phase \[MA09, sec. 2.2\].
const DESIRED_PHASE_RAD: Phases = [-FRAC_PI_2, 0.0, FRAC_PI_2, PI];

/// Sinusoidal joint targets driven by four oscillators that are coupled to the robot's own phase.
///
/// ```text
/// φ̇_cⁱ = ω_c + K_c sin(φ(y_cop) − φ_cⁱ + φ_dⁱ)                       [MA09, eq. (2)]
/// ```
///
/// integrated by one Euler step per control period.
#[derive(Clone, Debug)]
pub struct OscillatorGait {
    config: GaitConfig,
    rest: JointTargets,
    legs: Vec<(Side, LegJoint, LegRole)>,
    modulations: [Modulation; COUNT],
    values: [f64; COUNT],
    detector: PhaseDetector,
    phases_rad: Phases,
    time_s: f64,
}

impl OscillatorGait {
    /// A gait about a robot's rest posture. It moves the leg joints, but not a hip yaw, and holds all others.
    ///
    /// # Errors
    ///
    /// [`GaitError::Parameter`] for a configuration outside its domain; [`GaitError::NoJoint`] for a robot without one
    /// of the joints that are not optional.
    pub fn new(config: GaitConfig, robot: &RobotDescription) -> Result<Self, GaitError> {
        config.validate()?;
        let optional = [LegJoint::HipYaw, LegJoint::AnkleRoll];
        let mut needed = robot.legs.iter().filter(|(_, j, _)| !optional.contains(j));
        if let Some((side, joint, _)) = needed.find(|(.., role)| role.is_none()) {
            let (side, joint) = (side.name(), joint.name());
            return Err(GaitError::NoJoint { side, joint });
        }
        let legs: Vec<_> = robot.legs.roles().collect();
        let ankle_rolls = legs.iter().any(|(_, joint, _)| *joint == LegJoint::AnkleRoll);
        let modulations = modulations(&config, ankle_rolls);
        let values = std::array::from_fn(|i| modulations[i].neutral);
        Ok(Self {
            rest: robot.rest(),
            legs,
            modulations,
            values,
            detector: PhaseDetector::new(config.phase),
            config,
            phases_rad: DESIRED_PHASE_RAD,
            time_s: 0.0,
        })
    }

    /// The oscillators' phases.
    #[must_use]
    pub const fn phases_rad(&self) -> Phases {
        self.phases_rad
    }

    /// Amplitudes now: nominal, modulated and ramped.
    fn amplitudes(&self) -> Amplitudes {
        let ramp = |[begin, end]: [f64; 2]| {
            if self.time_s >= end { 1.0 } else { ((self.time_s - begin) / (end - begin)).max(0.0) }
        };
        let (roll_ramp, pitch_ramp) = (ramp(self.config.ramp_s.roll), ramp(self.config.ramp_s.pitch));
        let nominal = self.config.amplitude_deg;
        let hip_roll_deg = self.values[ROLL];
        let ankle_roll_deg = hip_roll_deg + (nominal.ankle_roll - nominal.hip_roll);
        Amplitudes {
            hip_roll_rad: (roll_ramp * hip_roll_deg).to_radians(),
            ankle_roll_rad: (roll_ramp * (ankle_roll_deg + self.values[ANKLE_ROLL_STEP])).to_radians(),
            pitch_rad: (pitch_ramp * (self.values[PITCH] + self.values[STEP])).to_radians(),
            walk_rad: (pitch_ramp * self.values[WALK]).to_radians(),
        }
    }
}

impl Gait for OscillatorGait {
    fn modulations(&self) -> &[Modulation] {
        &self.modulations
    }

    fn rest(&self) -> &JointTargets {
        &self.rest
    }

    fn reset(&mut self) {
        self.values = std::array::from_fn(|i| self.modulations[i].neutral);
        self.detector.reset();
        self.phases_rad = DESIRED_PHASE_RAD;
        self.time_s = 0.0;
    }

    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError> {
        let m = self.modulations.get(index).ok_or(GaitError::NoSuchModulation { index, count: COUNT })?;
        if !(m.lower..=m.upper).contains(&value) {
            return Err(GaitError::ModulationOutOfRange { name: m.name, value, lower: m.lower, upper: m.upper });
        }
        self.values[index] = value;
        Ok(())
    }

    fn targets(&mut self, state: &RobotState, dt_s: f64, out: &mut JointTargets) {
        let phi = self.detector.update(state, dt_s);
        let k_c = if self.time_s < self.config.coupling_delay_s { 0.0 } else { self.config.coupling_rad_s };
        let omega_c = self.values[FREQUENCY];
        for (phi_c, phi_d) in self.phases_rad.iter_mut().zip(DESIRED_PHASE_RAD) {
            *phi_c += (omega_c + k_c * (phi - *phi_c + phi_d).sin()) * dt_s;
        }
        self.time_s += dt_s;

        let offset_rad = joint_offsets(&self.phases_rad, &self.amplitudes());
        out.joints.clone_from(&self.rest.joints);
        for &(side, joint, LegRole { joint: at, sign }) in &self.legs {
            let lean_deg = match joint {
                LegJoint::HipPitch => self.values[HIP_LEAN] + self.values[CROUCH],
                LegJoint::Knee => -2.0 * self.values[CROUCH],
                LegJoint::AnklePitch => self.values[ANKLE_LEAN] + self.values[CROUCH],
                LegJoint::HipYaw | LegJoint::HipRoll | LegJoint::AnkleRoll => 0.0,
            };
            if let Some(command) = out.joints.get_mut(at) {
                let moved_rad = offset_rad[(side, joint)] + lean_deg.to_radians();
                command.position_rad += sign * moved_rad;
            }
        }
    }

    /// `φ_c¹` for the right leg, `φ_c³` for the left.
    fn phase_rad(&self, leg: Side) -> Option<f64> {
        Some(match leg {
            Side::Right => self.phases_rad[0],
            Side::Left => self.phases_rad[2],
        })
    }

    fn start_up_s(&self) -> f64 {
        let RampConfig { roll, pitch } = self.config.ramp_s;
        roll[1].max(pitch[1]).max(self.config.coupling_delay_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_robot::{JointDescription, JointLimits, Legs, Side};

    /// A robot with an arm, its right leg's signs turned around, with these joints of the legs.
    fn robot(has: impl Fn(Side, LegJoint) -> bool) -> RobotDescription {
        let joint = |name: String, rest_deg: f64| JointDescription {
            name,
            limits: JointLimits::default(),
            rest_rad: rest_deg.to_radians(),
        };
        let mut joints = vec![joint("arm".into(), 5.0)];
        let legs = Legs::from_fn(|side, part| {
            let sign = side.lateral_sign();
            let rest_deg = match part {
                LegJoint::HipPitch | LegJoint::AnklePitch => 20.0,
                LegJoint::Knee => -40.0,
                _ => 0.0,
            };
            has(side, part).then(|| {
                joints.push(joint(part.name().into(), sign * rest_deg));
                let joint = joints.len() - 1;
                LegRole { joint, sign }
            })
        });
        RobotDescription { joints, legs, ..RobotDescription::default() }
    }

    fn gait(config: GaitConfig) -> OscillatorGait {
        OscillatorGait::new(config, &robot(|_, joint| joint != LegJoint::HipYaw)).unwrap()
    }

    fn targets(gait: &mut OscillatorGait, state: &RobotState, dt_s: f64) -> JointTargets {
        let mut out = JointTargets::default();
        gait.targets(state, dt_s, &mut out);
        out
    }

    fn weight_at(cop_right_m: f64) -> RobotState {
        let mut state = RobotState { cop_m: Some([0.0, -cop_right_m]), ..Default::default() };
        for side in Side::BOTH {
            state.feet[side.index()].centre_m[1] = 0.09 * side.lateral_sign();
        }
        state
    }

    /// Locked to `φ = Ω t`, the phase lag obeys `Ω = ω_c + K_c sin(lag)` (set φ̇_c = Ω in eq. 2).
    /// Filters off, `y = a cos(t)`: Ω = 1 rad/s.
    #[test]
    fn oscillators_lock_with_the_lag_that_eq_2_implies() {
        let mut config = GaitConfig::default();
        config.phase.position_filter_s = 0.0;
        config.phase.velocity_filter_s = 0.0;
        config.natural_frequency_rad_s = 3.5;
        let mut gait = gait(config);
        let dt_s = 1e-4;
        let mut t = 0.0;
        for k in 0..100_000 {
            t = f64::from(k) * dt_s;
            targets(&mut gait, &weight_at(0.05 * t.cos()), dt_s);
        }
        let lag = ((1.0 - 3.5) / 10.0_f64).asin();
        for (phi_c, phi_d) in gait.phases_rad().iter().zip(DESIRED_PHASE_RAD) {
            let difference = (t + phi_d - phi_c - lag + PI).rem_euclid(2.0 * PI) - PI;
            assert!(difference.abs() < 1e-3, "{difference}");
        }
    }

    #[test]
    fn starts_in_the_rest_posture_and_ends_its_ramp_at_full_amplitude() {
        let mut gait = gait(GaitConfig::default());
        let first = targets(&mut gait, &weight_at(0.0), 0.002);
        assert_eq!(first.joints.len(), 11);
        assert_eq!(first.joints[0], gait.rest().joints[0], "the arm is held");
        for (now, rest) in first.joints.iter().zip(&gait.rest().joints) {
            let from_rest = now.position_rad - rest.position_rad;
            assert!(from_rest.abs() < 0.002 * 4_f64.to_radians() * 1.001, "{from_rest}");
        }
        gait.time_s = gait.start_up_s();
        let full = gait.amplitudes();
        assert!((full.pitch_rad - 6_f64.to_radians()).abs() < 1e-15);
        assert!((full.hip_roll_rad - 4_f64.to_radians()).abs() < 1e-15);
    }

    #[test]
    fn modulations_move_what_they_name_and_reset_forgets_them() {
        let mut gait = gait(GaitConfig::default());
        gait.time_s = 10.0;
        gait.modulate(STEP, 2.0).unwrap();
        gait.modulate(ANKLE_ROLL_STEP, 1.0).unwrap();
        let a = gait.amplitudes();
        assert!((a.pitch_rad - 8_f64.to_radians()).abs() < 1e-15);
        assert!((a.ankle_roll_rad - 5_f64.to_radians()).abs() < 1e-15);
        assert!((a.hip_roll_rad - 4_f64.to_radians()).abs() < 1e-15);
        gait.modulate(ANKLE_LEAN, 2.0).unwrap();
        gait.modulate(CROUCH, -10.0).unwrap();
        let t = targets(&mut gait, &weight_at(0.0), 1e-9);
        let hip_plus_knee_plus_ankle: f64 = [LegJoint::HipPitch, LegJoint::Knee, LegJoint::AnklePitch]
            .iter()
            .map(|&j| t.joints[j.index()].position_rad)
            .sum();
        assert!((hip_plus_knee_plus_ankle - 2_f64.to_radians()).abs() < 1e-12);
        gait.reset();
        assert!(gait.values.iter().zip(gait.modulations()).all(|(v, m)| (v - m.neutral).abs() < 1e-15));
    }

    /// A hip yaw is held, an ankle roll may be missing, and nothing else changes but signs.
    #[test]
    fn moves_the_joints_that_there_are() {
        let mut usual = gait(GaitConfig::default());
        let other = robot(|_, joint| joint != LegJoint::AnkleRoll);
        let mut other = OscillatorGait::new(GaitConfig::default(), &other).unwrap();
        for gait in [&mut usual, &mut other] {
            gait.time_s = 10.0;
            gait.modulate(CROUCH, 3.0).unwrap();
        }
        let [a, b] = [&mut usual, &mut other].map(|g| targets(g, &weight_at(0.03), 0.01));
        for (side, joint, LegRole { joint: at, .. }) in other.legs.clone() {
            let mut roles = usual.legs.iter();
            let role = roles.find(|(s, j, _)| (*s, *j) == (side, joint));
            let expected = role.map_or(other.rest.joints[at], |(.., r)| a.joints[r.joint]);
            assert_eq!(b.joints[at], expected, "{side:?} {joint:?}");
        }
        assert!(other.modulate(ANKLE_ROLL_STEP, 1.0).is_err());
        let kneeless = robot(|side, joint| side == Side::Left || joint != LegJoint::Knee);
        let error = OscillatorGait::new(GaitConfig::default(), &kneeless).unwrap_err();
        assert!(error.to_string().contains("robot.right: names no knee"));
    }

    #[test]
    fn a_nan_modulation_is_refused() {
        let mut gait = gait(GaitConfig::default());
        assert!(matches!(
            gait.modulate(STEP, f64::NAN),
            Err(GaitError::ModulationOutOfRange { name: "step_amplitude_deg", .. })
        ));
        assert!(matches!(gait.modulate(99, 0.0), Err(GaitError::NoSuchModulation { .. })));
    }
}
