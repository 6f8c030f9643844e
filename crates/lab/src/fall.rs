//! What a fall is: one definition for the robot, its map, its guard and every report.
//!
//! A stride ends as a fall when one of four criteria is met. Which one, with the value that was
//! measured and the threshold that it passed, is data, and goes wherever a fall is told.

use std::fmt;

use serde::{Deserialize, Serialize};
use stridemap_returnmap::{MapFailure, StrideEnd};
use stridemap_robot::RobotState;

use crate::plant::InPlace;
use crate::state::StateComponent;
use crate::strides::{StridePhase, Transition};

/// When a stride counts as a fall or a stall, and what that costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailureConfig {
    /// Reward of a fall or a stall.
    pub reward: f64,
    /// A section with `ψ_roll` below this is a fall (the mass hangs over the outer side).
    pub psi_roll_below_deg: f64,
    /// Whether `psi_roll_below_deg` counts from the robot's own mean `ψ_roll` when it steps in place
    /// (over its warm-up strides), so that it means the same on a heavier robot.
    #[serde(default, skip_serializing_if = "is_false")]
    pub psi_roll_relative: bool,
    /// A centre of mass below this share of its first height is a fall.
    pub com_height_below: f64,
    /// A base tilted by more than this is a fall.
    pub tilt_above_deg: f64,
    /// No section for this long is a stall.
    pub no_section_s: f64,
}

const fn is_false(value: &bool) -> bool {
    !*value
}

/// By what a fall is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FallCriterion {
    /// `ψ_roll` at a section, deg.
    PsiRoll,
    /// Height of the centre of mass, as a share of its first.
    Height,
    /// Tilt of the base, deg.
    Tilt,
    /// Time without a section, s: a stall.
    NoSection,
}

impl FallCriterion {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::PsiRoll, Self::Height, Self::Tilt, Self::NoSection];

    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PsiRoll => "psi_roll",
            Self::Height => "height",
            Self::Tilt => "tilt",
            Self::NoSection => "no_section",
        }
    }

    /// The key of a task that holds its threshold.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::PsiRoll => "failure.psi_roll_below_deg",
            Self::Height => "failure.com_height_below",
            Self::Tilt => "failure.tilt_above_deg",
            Self::NoSection => "failure.no_section_s",
        }
    }

    /// How a stride that it ended is said to have ended.
    #[must_use]
    pub const fn end(self) -> StrideEnd {
        match self {
            Self::NoSection => StrideEnd::NoCrossing,
            _ => StrideEnd::Fell,
        }
    }
}

/// The cause of a fall or a stall.
///
/// # Example
///
/// ```
/// use stridemap_lab::{Fall, FallCriterion};
///
/// let fall = Fall { criterion: FallCriterion::PsiRoll, value: -0.312, threshold: 0.0 };
/// assert_eq!(fall.to_string(), "psi_roll -0.31 deg, below 0 (failure.psi_roll_below_deg)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fall {
    /// By what it is told.
    pub criterion: FallCriterion,
    /// What was measured, in the criterion's unit.
    pub value: f64,
    /// What it passed, in the same unit. A relative threshold is here as it was on this robot.
    pub threshold: f64,
}

impl fmt::Display for Fall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, key) = (self.value, self.criterion.key());
        // As many digits as a threshold needs, and no more.
        let threshold = (self.threshold * 1e3).round() / 1e3;
        match self.criterion {
            FallCriterion::PsiRoll => {
                write!(f, "psi_roll {value:.2} deg, below {threshold} ({key})")
            }
            FallCriterion::Height => {
                write!(
                    f,
                    "height {value:.2} of the first, below {threshold} ({key})"
                )
            }
            FallCriterion::Tilt => write!(f, "tilt {value:.1} deg, above {threshold} ({key})"),
            FallCriterion::NoSection => {
                write!(
                    f,
                    "no section for {value:.2} s, more than {threshold} ({key})"
                )
            }
        }
    }
}

impl FailureConfig {
    /// `ψ_roll` at a section below which a robot that steps in place like this counts as fallen; none
    /// while a relative threshold has nothing to be relative to.
    #[must_use]
    pub fn least_psi_roll_deg(&self, in_place: &InPlace) -> f64 {
        match (self.psi_roll_relative, in_place.sections) {
            (false, _) => self.psi_roll_below_deg,
            (true, 0) => f64::NEG_INFINITY,
            (true, _) => in_place.psi_roll_deg + self.psi_roll_below_deg,
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
        (psi_roll_deg < threshold).then_some(Fall {
            criterion: FallCriterion::PsiRoll,
            value: psi_roll_deg,
            threshold,
        })
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
            component: state
                .iter()
                .position(|c| *c == StateComponent::PSI_ROLL_DEG),
            below: self.least_psi_roll_deg(in_place),
            reward: self.reward,
        }
    }
}

/// A fall on the robot, and when it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RobotFall {
    /// Iteration of Algorithm 1, from 1.
    pub iteration: usize,
    /// In which phase of the run.
    pub phase: StridePhase,
    /// The measured policy (`"nominal"`, `"iteration-1"`, `"final"`) of a record stride.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what: Option<String>,
    /// The stride among those of its batch, from 1; null for a fall in a start, before the first stride.
    pub stride: Option<usize>,
    /// Its cause.
    #[serde(flatten)]
    pub fall: Fall,
}

impl RobotFall {
    /// The falls with a known cause among strides of one batch.
    pub(crate) fn among(strides: &[Transition]) -> impl Iterator<Item = Self> {
        strides.iter().enumerate().filter_map(|(i, t)| {
            Some(Self {
                iteration: t.iteration,
                phase: t.phase,
                what: None,
                stride: Some(i + 1),
                fall: t.fall?,
            })
        })
    }
}

impl fmt::Display for RobotFall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.what, self.phase) {
            (Some(what), _) => write!(f, "measuring {what}")?,
            (None, phase) => write!(f, "iteration {}, {}", self.iteration, phase.name())?,
        }
        match self.stride {
            Some(stride) => write!(f, ", stride {stride}: {}", self.fall),
            None => write!(f, ", in a start: {}", self.fall),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        psi_roll_below_deg: -5.0,
        psi_roll_relative: true,
        com_height_below: 0.75,
        tilt_above_deg: 45.0,
        no_section_s: 2.5,
    };

    #[test]
    fn every_fall_has_its_cause_with_value_and_threshold() {
        let in_place = InPlace {
            sections: 9,
            psi_roll_deg: 3.0,
            pitch_rate_change_deg_s: 0.0,
        };
        assert_eq!(FAILURE.of_body(&state(0.5, 0.0), 0.5), None);
        let low = FAILURE.of_body(&state(0.3, 0.0), 0.5).unwrap();
        assert_eq!(low.criterion, FallCriterion::Height);
        assert!((low.value - 0.6).abs() < 1e-12 && (low.threshold - 0.75).abs() < 1e-12);
        let tilted = FAILURE.of_body(&state(0.5, 50.0), 0.5).unwrap();
        assert_eq!(tilted.criterion, FallCriterion::Tilt);
        assert!((tilted.value - 50.0).abs() < 1e-9 && (tilted.threshold - 45.0).abs() < 1e-12);
        // 5 deg below the robot's own 3 deg; nothing before it is known how it steps in place.
        let out = FAILURE.of_section(-2.5, &in_place).unwrap();
        assert_eq!(
            (out.criterion, out.threshold),
            (FallCriterion::PsiRoll, -2.0)
        );
        assert_eq!(FAILURE.of_section(-1.5, &in_place), None);
        assert_eq!(FAILURE.of_section(-90.0, &InPlace::default()), None);
        let stall = FAILURE.of_wait(2.502).unwrap();
        assert_eq!(stall.criterion.end(), StrideEnd::NoCrossing);
        assert!(
            stall
                .to_string()
                .contains("2.50 s, more than 2.5 (failure.no_section_s)")
        );
        for criterion in FallCriterion::ALL {
            assert_eq!(
                serde_json::to_string(&criterion).unwrap(),
                format!("{:?}", criterion.name())
            );
        }
    }

    /// Robot and map say the same of the same section, whatever the threshold counts from.
    #[test]
    fn map_and_robot_agree_on_what_a_fall_is() {
        let in_place = InPlace {
            sections: 9,
            psi_roll_deg: 3.0,
            pitch_rate_change_deg_s: 0.0,
        };
        let state = [StateComponent::PSI_PITCH_DEG, StateComponent::PSI_ROLL_DEG];
        for relative in [false, true] {
            let failure = FailureConfig {
                psi_roll_relative: relative,
                ..FAILURE
            };
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
