//! What a fall is: one definition for the robot, its map, its guard and every report.
//!
//! A stride ends as a fall when one of four criteria is met. Which one, with the value that was
//! measured and the threshold that it passed, is data, and goes wherever a fall is told.

use serde::{Deserialize, Serialize};
use stridemap_map::MapFailure;
use stridemap_record::{Fall, FallCriterion, InPlace};
use stridemap_robot::RobotState;

use crate::state::StateComponent;

/// When a stride counts as a fall or a stall, and what that costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureConfig {
    /// Reward of a fall or a stall.
    pub reward: f64,
    /// A section with `ψ_roll` below this is a fall (the mass hangs over the outer side); left out: no `ψ_roll` is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psi_roll_below_deg: Option<f64>,
    /// Whether `psi_roll_below_deg` counts from the robot's own mean `ψ_roll` when it steps in place
    /// (over its warm-up strides), so that it means the same on a heavier robot.
    #[serde(default, skip_serializing_if = "is_false")]
    pub psi_roll_relative: bool,
    /// A centre of mass below this share of its first height is a fall.
    pub com_height_below: f64,
    /// A base that is lower than this is a fall; told as a share of the centre of mass's first height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_below_m: Option<f64>,
    /// A base tilted by more than this is a fall.
    pub tilt_above_deg: f64,
    /// No section for this long is a stall.
    pub no_section_s: f64,
}

const fn is_false(value: &bool) -> bool {
    !*value
}

impl FailureConfig {
    /// `ψ_roll` at a section below which a robot that steps in place like this counts as fallen; none
    /// while a relative threshold has nothing to be relative to.
    #[must_use]
    pub fn least_psi_roll_deg(&self, in_place: &InPlace) -> f64 {
        match (self.psi_roll_below_deg, self.psi_roll_relative, in_place.sections) {
            (None, ..) | (_, true, 0) => f64::NEG_INFINITY,
            (Some(below), false, _) => below,
            (Some(below), true, _) => in_place.psi_roll_deg + below,
        }
    }

    /// Whether a robot in this state is down; `first_com_height_m` is its height at the start.
    #[must_use]
    pub fn of_body(&self, state: &RobotState, first_com_height_m: f64) -> Option<Fall> {
        let (height_m, tilt_rad) = (state.com.position_m[2], state.base.tilt_rad());
        if height_m < self.com_height_below * first_com_height_m {
            return Some(Fall {
                criterion: FallCriterion::Height,
                value: height_m / first_com_height_m,
                threshold: self.com_height_below,
            });
        }
        let base_m = state.base.position_m[2];
        if let Some(least_m) = self.base_below_m.filter(|least_m| base_m < *least_m) {
            let share = |height_m: f64| height_m / first_com_height_m;
            let criterion = FallCriterion::Height;
            return Some(Fall { criterion, value: share(base_m), threshold: share(least_m) });
        }
        (tilt_rad > self.tilt_above_deg.to_radians()).then(|| Fall {
            criterion: FallCriterion::Tilt,
            value: tilt_rad.to_degrees(),
            threshold: self.tilt_above_deg,
        })
    }

    /// Whether a section with this `ψ_roll` is a fall.
    #[must_use]
    pub fn of_section(&self, psi_roll_deg: f64, in_place: &InPlace) -> Option<Fall> {
        let threshold = self.least_psi_roll_deg(in_place);
        (psi_roll_deg < threshold).then_some(Fall { criterion: FallCriterion::PsiRoll, value: psi_roll_deg, threshold })
    }

    /// Whether so long without a section is a stall.
    #[must_use]
    pub fn of_wait(&self, waited_s: f64) -> Option<Fall> {
        (waited_s > self.no_section_s).then_some(Fall {
            criterion: FallCriterion::NoSection,
            value: waited_s,
            threshold: self.no_section_s,
        })
    }

    /// The part of it that a state shows, for a map of a robot that steps in place like this.
    #[must_use]
    pub fn in_map(&self, state: &[StateComponent], in_place: &InPlace) -> MapFailure {
        MapFailure {
            component: state.iter().position(|c| *c == StateComponent::PSI_ROLL_DEG),
            below: self.least_psi_roll_deg(in_place),
            reward: self.reward,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_process::StrideEnd;

    /// A robot 0.5 m high, upright unless said otherwise.
    fn state(height_m: f64, tilt_deg: f64) -> RobotState {
        let mut state = RobotState::default();
        state.com.position_m[2] = height_m;
        let half = 0.5 * tilt_deg.to_radians();
        state.base.orientation = [half.cos(), half.sin(), 0.0, 0.0];
        state
    }

    const FAILURE: FailureConfig = FailureConfig {
        reward: -1.0,
        psi_roll_below_deg: Some(-5.0),
        psi_roll_relative: true,
        com_height_below: 0.75,
        base_below_m: None,
        tilt_above_deg: 45.0,
        no_section_s: 2.5,
    };

    #[test]
    fn every_fall_has_its_cause_with_value_and_threshold() {
        let in_place = InPlace { sections: 9, psi_roll_deg: 3.0, pitch_rate_change_deg_s: 0.0 };
        assert_eq!(FAILURE.of_body(&state(0.5, 0.0), 0.5), None);
        let low = FAILURE.of_body(&state(0.3, 0.0), 0.5).unwrap();
        assert_eq!(low.criterion, FallCriterion::Height);
        assert!((low.value - 0.6).abs() < 1e-12 && (low.threshold - 0.75).abs() < 1e-12);
        let tilted = FAILURE.of_body(&state(0.5, 50.0), 0.5).unwrap();
        assert_eq!(tilted.criterion, FallCriterion::Tilt);
        assert!((tilted.value - 50.0).abs() < 1e-9 && (tilted.threshold - 45.0).abs() < 1e-12);
        // 5 deg below the robot's own 3 deg; nothing before it is known how it steps in place.
        let out = FAILURE.of_section(-2.5, &in_place).unwrap();
        assert_eq!((out.criterion, out.threshold), (FallCriterion::PsiRoll, -2.0));
        assert_eq!(FAILURE.of_section(-1.5, &in_place), None);
        assert_eq!(FAILURE.of_section(-90.0, &InPlace::default()), None);
        let stall = FAILURE.of_wait(2.502).unwrap();
        assert_eq!(stall.criterion.end(), StrideEnd::NoCrossing);
        assert!(stall.to_string().contains("2.50 s, more than 2.5 (failure.no_section_s)"));
        for criterion in FallCriterion::ALL {
            assert_eq!(serde_json::to_string(&criterion).unwrap(), format!("{:?}", criterion.name()));
        }
    }

    /// Robot and map say the same of the same section, whatever the threshold counts from.
    #[test]
    fn map_and_robot_agree_on_what_a_fall_is() {
        let in_place = InPlace { sections: 9, psi_roll_deg: 3.0, pitch_rate_change_deg_s: 0.0 };
        let state = [StateComponent::PSI_PITCH_DEG, StateComponent::PSI_ROLL_DEG];
        for relative in [false, true] {
            let failure = FailureConfig { psi_roll_relative: relative, ..FAILURE };
            for in_place in [in_place, InPlace::default()] {
                let map = failure.in_map(&state, &in_place);
                for psi_roll_deg in [-6.0, -4.0, -2.1, -1.9, 3.0] {
                    assert_eq!(
                        map.fell(&[0.0, psi_roll_deg]),
                        failure.of_section(psi_roll_deg, &in_place).is_some(),
                        "{relative} {in_place:?} {psi_roll_deg}"
                    );
                }
            }
        }
    }
}
