//! Finding the section.

use std::f64::consts::PI;

use stridemap_robot::{RobotState, Side};

use crate::config::{SectionConfig, SectionError};
use crate::event::{Look, Scalar};
use crate::lateral::LateralDetector;
use crate::pendulum::{Crossing, Pendulum, pendulum};
use crate::stance::StanceDetector;

/// One look at the robot.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time_s: f64,
    pendulum: Pendulum,
    /// What passes zero, filtered where it is a rate.
    scalar: f64,
    /// Share of the load on the right foot, the last one known.
    right_load: f64,
}

/// Finds the sections of a walking robot: the first time in each stance at which a scalar, the filtered roll
/// rate of the pendulum where the task names no other ([`crate::SectionEvent`]), passes from negative to zero or positive.
///
/// For consecutive ticks `t₀ < t₁` of one stance with scalars `r₀ < 0 ≤ r₁` the crossing is at
///
/// ```text
/// t* = t₀ + s (t₁ − t₀),   s = r₀ / (r₀ − r₁),   t₀ < t* ≤ t₁
/// ```
///
/// and the pendulum's state is interpolated with the same `s`: the error is of second order in the
/// control period. A scalar that is exactly zero on a tick counts there, once. One that touches
/// zero from above, or starts a stance positive, does not count before it has been negative. An angle's jump
/// from π to −π is none.
///
/// The filter starts anew with each stance, because the pendulum's roll jumps when its foot does. At touchdown the
/// stance itself changes: `t*` is where the load passes its threshold, and the pendulum the first one on the new foot.
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
            lateral: config.lateral.map(|lateral| LateralDetector::new(lateral, &config)),
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

    /// Takes the newest state, and the gait's phase as a leg sees it, where it has one; tells whether a section
    /// was crossed since the state before.
    pub fn update(&mut self, state: &RobotState, phase_rad: impl Fn(Side) -> Option<f64>) -> Option<Crossing> {
        if let Some(lateral) = &mut self.lateral {
            return lateral.update(state);
        }
        let stance = self.stance.update(state)?;
        let pendulum = pendulum(state, stance, self.config.pendulum_base)?;
        let event = self.config.event;
        let last_load = self.last.map_or(0.5, |last| last.right_load);
        let clock_phase_rad = self.config.clock_phase_deg.to_radians();
        // With a leg of its own the gait's phase is that leg's, whichever stands.
        let clock_of = self.config.leg.filter(|_| event.kind == Scalar::Angle);
        let phase = |side: Side| phase_rad(clock_of.unwrap_or(side));
        let look = Look { pendulum: &pendulum, phase_rad: &phase, clock_phase_rad };
        let mut now = Sample {
            time_s: state.time_s,
            pendulum,
            scalar: (event.scalar)(&look)?,
            right_load: state.right_load_fraction().unwrap_or(last_load),
        };
        let before = self.last.filter(|sample| sample.pendulum.stance == stance || clock_of.is_some());
        let Some(before) = before else {
            self.crossed_in_this_stance = false;
            let other_foot = self.last.replace(now);
            let touchdown = event.kind == Scalar::Stance;
            return other_foot.filter(|_| touchdown).and_then(|before| {
                let share = |sample: &Sample| match stance {
                    Side::Right => sample.right_load,
                    Side::Left => 1.0 - sample.right_load,
                };
                let (f0, f1) = (share(&before), share(&now));
                let s = ((self.config.stance.load_share - f0) / (f1 - f0)).clamp(0.0, 1.0);
                self.crossing(before.time_s + s * (now.time_s - before.time_s), pendulum)
            });
        };

        let dt_s = state.time_s - before.time_s;
        let r0 = before.scalar;
        if event.kind == Scalar::Rate {
            let tau_s = self.config.roll_rate_filter_s;
            now.scalar = r0 + (now.scalar - r0) * dt_s / (tau_s + dt_s);
        }
        self.last = Some(now);
        let r1 = now.scalar;
        let jumped = event.kind == Scalar::Angle && r1 - r0 > PI;
        if (self.crossed_in_this_stance && clock_of.is_none()) || jumped || !(r0 < 0.0 && r1 >= 0.0) {
            return None;
        }
        let s = r0 / (r0 - r1);
        let there = match before.pendulum.stance == stance {
            true => before.pendulum.interpolate(&pendulum, s),
            false => pendulum,
        };
        self.crossing(before.time_s + s * dt_s, there)
    }

    /// A section, unless it comes too soon after the last.
    fn crossing(&mut self, time_s: f64, pendulum: Pendulum) -> Option<Crossing> {
        let too_soon = |last_s: f64| time_s - last_s < self.config.refractory_s;
        let other_leg = |leg: Side| leg != pendulum.stance && self.config.event.kind != Scalar::Angle;
        if self.last_crossing_s.is_some_and(too_soon) || self.config.leg.is_some_and(other_leg) {
            return None;
        }
        self.crossed_in_this_stance = true;
        self.last_crossing_s = Some(time_s);
        Some(Crossing { time_s, pendulum })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::SectionEvent;

    /// A unit-height mass that sways inside of the right foot: `y = 0.1 − 0.05 sin(t)` from the foot,
    /// so that the roll rate is zero and rising at `t = π/2`, where `y = 0.05`.
    fn swaying(t: f64, stance: Side) -> RobotState {
        let mut state = RobotState { time_s: t, ..Default::default() };
        state.feet[stance.index()].load_n = 100.0;
        state.com.position_m = [0.0, -stance.lateral_sign() * (0.1 - 0.05 * t.sin()), 1.0];
        state.com.velocity_m_s = [0.0, stance.lateral_sign() * 0.05 * t.cos(), 0.0];
        state
    }

    fn unfiltered() -> SectionConfig {
        SectionConfig { roll_rate_filter_s: 0.0, ..Default::default() }
    }

    fn crossings(config: SectionConfig, states: impl Iterator<Item = RobotState>) -> Vec<Crossing> {
        let mut detector = SectionDetector::new(config).unwrap();
        states.filter_map(|state| detector.update(&state, |_| None)).collect()
    }

    fn ticks(dt_s: f64, offset_s: f64, until_s: f64) -> impl Iterator<Item = f64> {
        (0..).map(move |k| offset_s + f64::from(k) * dt_s).take_while(move |t| *t < until_s)
    }

    #[test]
    fn error_of_the_crossing_falls_with_the_square_of_the_step() {
        let error = |dt_s: f64| {
            // The zero sits at a third of a step, where the chord's error is not zero by symmetry.
            let offset_s = std::f64::consts::FRAC_PI_2 - 10.0 * dt_s - dt_s / 3.0;
            let found = crossings(unfiltered(), ticks(dt_s, offset_s, 3.0).map(|t| swaying(t, Side::Right)));
            assert_eq!(found.len(), 1);
            (found[0].pendulum.roll_rad - 0.05_f64.atan()).abs()
        };
        let ratio = error(0.02) / error(0.01);
        assert!((ratio - 4.0).abs() < 0.2, "{ratio}");
        assert!(error(0.002) < 1e-7);
    }

    #[test]
    fn left_and_right_stance_give_the_same_crossing() {
        let at = |side| crossings(unfiltered(), ticks(0.01, 0.0, 3.0).map(move |t| swaying(t, side)));
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
        assert!(with_rates(&[1.0, 0.5, 0.0, 0.5]).is_empty(), "touched from above");
        assert!(with_rates(&[1.0, -1.0]).is_empty(), "falling");
        assert!(with_rates(&[-1.0, -0.1, -0.3, -1.0]).is_empty(), "did not reach zero");
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
        let slow = SectionConfig { refractory_s: 4.0, ..unfiltered() };
        assert_eq!(crossings(slow, walk()).len(), 1);
    }

    /// The load passes linearly from left to right within 0.1 s: 0.6 of it is on the right foot after 0.06 s, wherever
    /// the ticks are.
    #[test]
    fn touchdown_is_where_the_load_passes_its_threshold() {
        let config = SectionConfig { event: SectionEvent::TOUCHDOWN, ..unfiltered() };
        let loaded = |t: f64| {
            let mut state = swaying(t, Side::Right);
            let right = (10.0 * (t - 1.0)).clamp(0.0, 1.0);
            state.feet[Side::Right.index()].load_n = 100.0 * right;
            state.feet[Side::Left.index()].load_n = 100.0 * (1.0 - right);
            state
        };
        let found = crossings(config, ticks(0.007, 0.0, 2.0).map(loaded));
        assert_eq!(found.len(), 1);
        assert!((found[0].time_s - 1.06).abs() < 1e-12, "{found:?}");
        assert_eq!(found[0].pendulum.stance, Side::Right);
    }

    /// A clock of 1 rad/s passes 90 deg after π/2 s, and its jump from π to −π is no section.
    #[test]
    fn the_gait_clock_ticks_at_its_phase() {
        let config = SectionConfig { event: SectionEvent::GAIT_CLOCK, clock_phase_deg: 90.0, ..unfiltered() };
        let mut detector = SectionDetector::new(config).unwrap();
        let mut found = Vec::new();
        for t in ticks(0.01, 0.0, 2.0 * PI) {
            found.extend(detector.update(&swaying(t, Side::Right), |_| Some(t)));
        }
        assert_eq!(found.len(), 1);
        assert!((found[0].time_s - 0.5 * PI).abs() < 1e-12);
    }

    #[test]
    fn a_bad_configuration_names_its_key() {
        let mut config = SectionConfig::default();
        config.stance.load_share = 0.4;
        let error = SectionDetector::new(config).unwrap_err();
        assert!(error.to_string().starts_with("section.stance.load_share = 0.4"), "{error}");
    }
}
