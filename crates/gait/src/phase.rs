//! The phase of the robot's own lateral motion, from where its weight rests.

use serde::{Deserialize, Serialize};
use stridemap_robot::{RobotState, Side};

use crate::filter::LowPass;
use crate::gait::GaitError;

/// Where the lateral centre of pressure comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseSource {
    /// The centre of pressure of the contact forces, relative to the middle between the feet.
    CentreOfPressure,
    /// `half_stance · (F_right − F_left) / (F_right + F_left)`: foot loads alone \[MA09, sec. 2.1:
    /// the simplified detection\].
    LoadRatio,
}

/// How the phase is detected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseConfig {
    /// Where the lateral centre of pressure comes from.
    pub source: PhaseSource,
    /// Time constant of the filter on `y_cop`.
    pub position_filter_s: f64,
    /// Time constant of the filter on its derivative.
    pub velocity_filter_s: f64,
    /// Half the distance between the feet, for [`PhaseSource::LoadRatio`].
    pub half_stance_m: f64,
}

impl PhaseConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`GaitError::Parameter`] that names the key at fault.
    pub fn validate(&self) -> Result<(), GaitError> {
        for (name, value) in
            [("phase.position_filter_s", self.position_filter_s), ("phase.velocity_filter_s", self.velocity_filter_s)]
        {
            if !(value.is_finite() && (0.0..=1.0).contains(&value)) {
                return Err(GaitError::Parameter { name, value, requirement: "must be 0 to 1 s" });
            }
        }
        let value = self.half_stance_m;
        if !(value.is_finite() && value > 0.0) {
            return Err(GaitError::Parameter { name: "phase.half_stance_m", value, requirement: "must be positive" });
        }
        Ok(())
    }
}

/// Detects the phase `φ = −atan2(ẏ_cop, y_cop)` \[MA09, eq. (1)\], with `y_cop` in m, positive to
/// the right, and `ẏ_cop` in m/s, not scaled.
///
/// The four-quadrant arctangent stands for the paper's arctangent: the phase must grow over the
/// whole circle as the weight passes from right to left and back.
#[derive(Clone, Debug)]
pub struct PhaseDetector {
    config: PhaseConfig,
    position: LowPass,
    velocity: LowPass,
    last_position_m: Option<f64>,
    phase_rad: f64,
}

impl PhaseDetector {
    /// A detector with phase 0 until it has seen a loaded foot twice.
    #[must_use]
    pub fn new(config: PhaseConfig) -> Self {
        Self {
            config,
            position: LowPass::new(config.position_filter_s),
            velocity: LowPass::new(config.velocity_filter_s),
            last_position_m: None,
            phase_rad: 0.0,
        }
    }

    /// Forgets everything seen.
    pub fn reset(&mut self) {
        *self = Self::new(self.config);
    }

    /// Takes the newest state, `dt_s` after the last, and returns the phase in (−π, π].
    ///
    /// While no foot carries load the last phase is kept.
    pub fn update(&mut self, state: &RobotState, dt_s: f64) -> f64 {
        let Some(raw_m) = self.lateral_cop_m(state) else {
            return self.phase_rad;
        };
        let y_m = self.position.update(raw_m, dt_s);
        if let Some(last_m) = self.last_position_m {
            let ydot_m_s = self.velocity.update((y_m - last_m) / dt_s, dt_s);
            self.phase_rad = -ydot_m_s.atan2(y_m);
        }
        self.last_position_m = Some(y_m);
        self.phase_rad
    }

    /// Lateral centre of pressure, positive to the right, unfiltered.
    fn lateral_cop_m(&self, state: &RobotState) -> Option<f64> {
        match self.config.source {
            PhaseSource::CentreOfPressure => {
                let cop_m = state.cop_m?;
                let [left, right] = [state.foot(Side::Left).centre_m, state.foot(Side::Right).centre_m];
                let (sin, cos) = state.base.heading_rad().sin_cos();
                let offset_x_m = cop_m[0] - 0.5 * (left[0] + right[0]);
                let offset_y_m = cop_m[1] - 0.5 * (left[1] + right[1]);
                Some(-(cos * offset_y_m - sin * offset_x_m))
            }
            PhaseSource::LoadRatio => {
                let right = state.right_load_fraction()?;
                Some(self.config.half_stance_m * (2.0 * right - 1.0))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const CONFIG: PhaseConfig = PhaseConfig {
        source: PhaseSource::CentreOfPressure,
        position_filter_s: 0.0,
        velocity_filter_s: 0.0,
        half_stance_m: 0.1,
    };

    fn standing(cop_right_m: f64, heading_rad: f64) -> RobotState {
        let mut state = RobotState::default();
        let (sin, cos) = heading_rad.sin_cos();
        state.base.orientation = [(heading_rad / 2.0).cos(), 0.0, 0.0, (heading_rad / 2.0).sin()];
        for side in Side::BOTH {
            let y_m = 0.1 * side.lateral_sign();
            state.feet[side.index()].centre_m = [2.0 - sin * y_m, 1.0 + cos * y_m, 0.0];
        }
        state.cop_m = Some([2.0 + sin * cop_right_m, 1.0 - cos * cop_right_m]);
        state
    }

    /// `y = a cos t` has `ẏ = −a sin t`, so that φ = atan2(sin t, cos t) = t, whatever the heading.
    #[test]
    fn phase_of_a_unit_rate_oscillation_is_time() {
        for heading_rad in [0.0, 1.0, -2.5] {
            let mut detector = PhaseDetector::new(CONFIG);
            let dt_s = 1e-4;
            for k in 0..70_000 {
                let t = f64::from(k) * dt_s;
                let phase = detector.update(&standing(0.05 * t.cos(), heading_rad), dt_s);
                if k > 1 {
                    let error = (phase - t + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
                    assert!(error.abs() < 1e-4, "t = {t}, error {error}");
                }
            }
        }
    }

    #[test]
    fn phase_is_kept_in_the_air() {
        let mut detector = PhaseDetector::new(CONFIG);
        detector.update(&standing(0.05, 0.0), 0.002);
        let before = detector.update(&standing(0.04, 0.0), 0.002);
        let mut airborne = standing(0.0, 0.0);
        airborne.cop_m = None;
        assert!(before != 0.0);
        assert!((detector.update(&airborne, 0.002) - before).abs() < 1e-15);
    }
}
