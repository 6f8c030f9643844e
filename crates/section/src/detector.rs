//! Finding the section.

use serde::{Deserialize, Serialize};
use stridemap_robot::{RobotState, Side};

use crate::lateral::{LateralConfig, LateralDetector};
use crate::pendulum::{Pendulum, PendulumBase, pendulum};
use crate::stance::{StanceConfig, StanceDetector};

/// What can go wrong in a section's configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SectionError {
    /// A parameter lies outside its domain.
    #[error("section.{name} = {value}: {requirement}")]
    Parameter {
        /// Key in the configuration.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What it must satisfy.
        requirement: &'static str,
    },
}

/// How the section is detected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionConfig {
    /// The foot of the pendulum.
    pub pendulum_base: PendulumBase,
    /// When the stance passes from leg to leg.
    pub stance: StanceConfig,
    /// Time constant of the first-order filter on the roll rate.
    pub roll_rate_filter_s: f64,
    /// Least time between two sections; crossings that come sooner are passed over.
    pub refractory_s: f64,
    /// Finds the section as the turning point of the sway instead, for robots whose sensors are too
    /// noisy for a roll rate; the roll rate's filter is then not used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lateral: Option<LateralConfig>,
}

impl Default for SectionConfig {
    fn default() -> Self {
        Self {
            pendulum_base: PendulumBase::StanceFoot,
            stance: StanceConfig { load_share: 0.6 },
            roll_rate_filter_s: 0.01,
            refractory_s: 0.0,
            lateral: None,
        }
    }
}

impl SectionConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`SectionError::Parameter`] that names the key at fault.
    pub fn validate(&self) -> Result<(), SectionError> {
        let share = self.stance.load_share;
        if !(share > 0.5 && share < 1.0) {
            return Err(SectionError::Parameter {
                name: "stance.load_share",
                value: share,
                requirement: "must lie between 0.5 and 1",
            });
        }
        for (name, value, most) in [
            ("roll_rate_filter_s", self.roll_rate_filter_s, 1.0),
            ("refractory_s", self.refractory_s, 10.0),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(SectionError::Parameter {
                    name,
                    value,
                    requirement: "must be 0 or a short time",
                });
            }
        }
        self.lateral
            .as_ref()
            .map_or(Ok(()), LateralConfig::validate)
    }
}

/// The robot at the section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// When, on the robot's clock; between two control ticks.
    pub time_s: f64,
    /// The pendulum then; its filtered roll rate is zero.
    pub pendulum: Pendulum,
}

/// One look at the pendulum.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time_s: f64,
    pendulum: Pendulum,
    filtered_rate_rad_s: f64,
}

/// Finds the sections of a walking robot: the first time in each stance at which the filtered roll
/// rate of the pendulum passes from negative to zero or positive.
///
/// For consecutive ticks `t₀ < t₁` of one stance with filtered rates `r₀ < 0 ≤ r₁` the crossing is at
///
/// ```text
/// t* = t₀ + s (t₁ − t₀),   s = r₀ / (r₀ − r₁),   t₀ < t* ≤ t₁
/// ```
///
/// and the pendulum's state is interpolated with the same `s`: the error is of second order in the
/// control period. A rate that is exactly zero on a tick counts there, once. A rate that touches
/// zero from above, or starts a stance positive, does not count before it has been negative.
///
/// The filter starts anew with each stance, because the pendulum's roll jumps when its foot does.
#[derive(Clone, Debug)]
pub struct SectionDetector {
    config: SectionConfig,
    stance: StanceDetector,
    last: Option<Sample>,
    crossed_in_this_stance: bool,
    last_crossing_s: Option<f64>,
    /// The other way of finding it, which then replaces all of the above.
    lateral: Option<LateralDetector>,
}

impl SectionDetector {
    /// A detector that has seen nothing.
    ///
    /// # Errors
    ///
    /// [`SectionError::Parameter`] for a configuration outside its domain.
    pub fn new(config: SectionConfig) -> Result<Self, SectionError> {
        config.validate()?;
        Ok(Self {
            config,
            stance: StanceDetector::new(config.stance),
            last: None,
            crossed_in_this_stance: false,
            last_crossing_s: None,
            lateral: config
                .lateral
                .map(|lateral| LateralDetector::new(lateral, &config)),
        })
    }

    /// Forgets everything seen.
    pub fn reset(&mut self) {
        self.stance.reset();
        self.last = None;
        self.crossed_in_this_stance = false;
        self.last_crossing_s = None;
        if let Some(lateral) = &mut self.lateral {
            lateral.reset();
        }
    }

    /// The leg that the robot stands on, as far as it is known.
    #[must_use]
    pub fn stance(&self) -> Option<Side> {
        self.pendulum().map(|pendulum| pendulum.stance)
    }

    /// The pendulum at the last tick; `None` before the first stance.
    #[must_use]
    pub fn pendulum(&self) -> Option<Pendulum> {
        match &self.lateral {
            Some(lateral) => lateral.pendulum(),
            None => self.last.map(|sample| sample.pendulum),
        }
    }

    /// Takes the newest state; tells whether a section was crossed since the one before.
    pub fn update(&mut self, state: &RobotState) -> Option<Crossing> {
        if let Some(lateral) = &mut self.lateral {
            return lateral.update(state);
        }
        let stance = self.stance.update(state)?;
        let pendulum = pendulum(state, stance, self.config.pendulum_base)?;
        let before = self.last.filter(|sample| sample.pendulum.stance == stance);
        let Some(before) = before else {
            self.crossed_in_this_stance = false;
            self.last = Some(Sample {
                time_s: state.time_s,
                pendulum,
                filtered_rate_rad_s: pendulum.roll_rate_rad_s,
            });
            return None;
        };

        let dt_s = state.time_s - before.time_s;
        let (r0, tau_s) = (before.filtered_rate_rad_s, self.config.roll_rate_filter_s);
        let r1 = r0 + (pendulum.roll_rate_rad_s - r0) * dt_s / (tau_s + dt_s);
        self.last = Some(Sample {
            time_s: state.time_s,
            pendulum,
            filtered_rate_rad_s: r1,
        });

        if self.crossed_in_this_stance || !(r0 < 0.0 && r1 >= 0.0) {
            return None;
        }
        let s = r0 / (r0 - r1);
        let time_s = before.time_s + s * dt_s;
        if self
            .last_crossing_s
            .is_some_and(|last_s| time_s - last_s < self.config.refractory_s)
        {
            return None;
        }
        self.crossed_in_this_stance = true;
        self.last_crossing_s = Some(time_s);
        Some(Crossing {
            time_s,
            pendulum: before.pendulum.interpolate(&pendulum, s),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit-height mass that sways inside of the right foot: `y = 0.1 − 0.05 sin(t)` from the foot,
    /// so that the roll rate is zero and rising at `t = π/2`, where `y = 0.05`.
    fn swaying(t: f64, stance: Side) -> RobotState {
        let mut state = RobotState {
            time_s: t,
            ..Default::default()
        };
        state.feet[stance.index()].load_n = 100.0;
        state.com.position_m = [0.0, -stance.lateral_sign() * (0.1 - 0.05 * t.sin()), 1.0];
        state.com.velocity_m_s = [0.0, stance.lateral_sign() * 0.05 * t.cos(), 0.0];
        state
    }

    fn unfiltered() -> SectionConfig {
        SectionConfig {
            roll_rate_filter_s: 0.0,
            ..Default::default()
        }
    }

    fn crossings(config: SectionConfig, states: impl Iterator<Item = RobotState>) -> Vec<Crossing> {
        let mut detector = SectionDetector::new(config).unwrap();
        states.filter_map(|state| detector.update(&state)).collect()
    }

    fn ticks(dt_s: f64, offset_s: f64, until_s: f64) -> impl Iterator<Item = f64> {
        (0..)
            .map(move |k| offset_s + f64::from(k) * dt_s)
            .take_while(move |t| *t < until_s)
    }

    #[test]
    fn error_of_the_crossing_falls_with_the_square_of_the_step() {
        let error = |dt_s: f64| {
            // The zero sits at a third of a step, where the chord's error is not zero by symmetry.
            let offset_s = std::f64::consts::FRAC_PI_2 - 10.0 * dt_s - dt_s / 3.0;
            let found = crossings(
                unfiltered(),
                ticks(dt_s, offset_s, 3.0).map(|t| swaying(t, Side::Right)),
            );
            assert_eq!(found.len(), 1);
            (found[0].pendulum.roll_rad - 0.05_f64.atan()).abs()
        };
        let ratio = error(0.02) / error(0.01);
        assert!((ratio - 4.0).abs() < 0.2, "{ratio}");
        assert!(error(0.002) < 1e-7);
    }

    #[test]
    fn left_and_right_stance_give_the_same_crossing() {
        let at = |side| {
            crossings(
                unfiltered(),
                ticks(0.01, 0.0, 3.0).map(move |t| swaying(t, side)),
            )
        };
        let (left, right) = (at(Side::Left), at(Side::Right));
        assert_eq!((left.len(), right.len()), (1, 1));
        assert!((left[0].pendulum.roll_rad - right[0].pendulum.roll_rad).abs() < 1e-15);
        assert!((left[0].time_s - right[0].time_s).abs() < 1e-15);
    }

    fn with_rates(rates: &[f64]) -> Vec<Crossing> {
        let states = rates.iter().enumerate().map(|(k, &rate)| {
            let mut state = swaying(0.1 * k as f64, Side::Right);
            state.com.position_m = [0.0, 0.1, 1.0];
            state.com.velocity_m_s = [0.0, rate, 0.0];
            state
        });
        crossings(unfiltered(), states)
    }

    #[test]
    fn a_zero_exactly_on_a_tick_counts_once() {
        let found = with_rates(&[-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(found.len(), 1);
        assert!((found[0].time_s - 0.2).abs() < 1e-15);
    }

    #[test]
    fn touching_wrong_direction_and_a_positive_start_do_not_count() {
        assert!(
            with_rates(&[1.0, 0.5, 0.0, 0.5]).is_empty(),
            "touched from above"
        );
        assert!(with_rates(&[1.0, -1.0]).is_empty(), "falling");
        assert!(
            with_rates(&[-1.0, -0.1, -0.3, -1.0]).is_empty(),
            "did not reach zero"
        );
    }

    #[test]
    fn only_the_first_crossing_of_a_stance_counts() {
        assert_eq!(with_rates(&[-1.0, 1.0, -1.0, 1.0]).len(), 1);
    }

    #[test]
    fn a_new_stance_may_cross_again_and_the_refractory_time_forbids_it() {
        let walk = || {
            ticks(0.01, 0.0, 6.0).map(|t| {
                if t < 3.0 {
                    swaying(t, Side::Right)
                } else {
                    let mut state = swaying(t - 3.0, Side::Left);
                    state.time_s = t;
                    state
                }
            })
        };
        assert_eq!(crossings(unfiltered(), walk()).len(), 2);
        let slow = SectionConfig {
            refractory_s: 4.0,
            ..unfiltered()
        };
        assert_eq!(crossings(slow, walk()).len(), 1);
    }

    #[test]
    fn a_bad_configuration_names_its_key() {
        let mut config = SectionConfig::default();
        config.stance.load_share = 0.4;
        let error = SectionDetector::new(config).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("section.stance.load_share = 0.4"),
            "{error}"
        );
    }
}
