//! A section for robots with noisy sensors: the turning point of the sway, while one foot clearly
//! carries the load.

use stridemap_robot::{RobotState, Side};

use crate::config::{LateralConfig, SectionConfig};
use crate::pendulum::{Crossing, Pendulum, PendulumBase, pendulum};

/// What the detector remembers of the last tick.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time_s: f64,
    load_ratio: f64,
    velocity_m_s: [f64; 3],
    pendulum: Pendulum,
    /// Velocity towards the inner side of the stance foot.
    inward_m_s: f64,
}

/// Finds the turning points of the sway.
///
/// With `r` the filtered load ratio, + to the right, and `v` the filtered velocity of the centre of
/// mass in the direction from the loaded foot inwards, a section is where
///
/// ```text
/// v₀ < 0 ≤ v₁,   |r₁| > least,   at least the refractory time after the last,   on the other foot
/// ```
///
/// The pendulum is that of the tick pair, interpolated; its rates are those of the filtered velocity.
#[derive(Clone, Debug)]
pub(crate) struct LateralDetector {
    config: LateralConfig,
    base: PendulumBase,
    load_share: f64,
    refractory_s: f64,
    last: Option<Sample>,
    last_crossing: Option<(f64, Side)>,
}

impl LateralDetector {
    pub fn new(lateral: LateralConfig, config: &SectionConfig) -> Self {
        Self {
            config: lateral,
            base: config.pendulum_base,
            load_share: config.stance.load_share,
            refractory_s: config.refractory_s,
            last: None,
            last_crossing: None,
        }
    }

    pub fn reset(&mut self) {
        self.last = None;
        self.last_crossing = None;
    }

    pub fn pendulum(&self) -> Option<Pendulum> {
        self.last.map(|sample| sample.pendulum)
    }

    pub fn update(&mut self, state: &RobotState) -> Option<Crossing> {
        let ratio = match (state.right_load_fraction(), &self.last) {
            (Some(right), _) => 2.0 * right - 1.0,
            (None, Some(last)) => last.load_ratio,
            (None, None) => return None,
        };
        let (load_ratio, velocity_m_s) = match &self.last {
            None => (ratio, state.com.velocity_m_s),
            Some(last) => {
                let dt_s = state.time_s - last.time_s;
                let pass = |old: f64, new: f64, tau_s: f64| old + (new - old) * dt_s / (tau_s + dt_s);
                let c = &self.config;
                let velocity =
                    [0, 1, 2].map(|k| pass(last.velocity_m_s[k], state.com.velocity_m_s[k], c.velocity_filter_s));
                (pass(last.load_ratio, ratio, c.load_filter_s), velocity)
            }
        };
        // The stance changes with hysteresis; the first one is the more loaded foot.
        let threshold = 2.0 * self.load_share - 1.0;
        let stance = match &self.last {
            _ if load_ratio > threshold => Side::Right,
            _ if load_ratio < -threshold => Side::Left,
            Some(last) => last.pendulum.stance,
            None if load_ratio > 0.0 => Side::Right,
            None => Side::Left,
        };
        let mut smooth = state.clone();
        smooth.com.velocity_m_s = velocity_m_s;
        let pendulum = pendulum(&smooth, stance, self.base)?;
        let (sin, cos) = state.base.heading_rad().sin_cos();
        let left_m_s = cos * velocity_m_s[1] - sin * velocity_m_s[0];
        let now = Sample {
            time_s: state.time_s,
            load_ratio,
            velocity_m_s,
            pendulum,
            inward_m_s: -stance.lateral_sign() * left_m_s,
        };
        let before = self.last.replace(now)?;
        if before.pendulum.stance != stance
            || !(before.inward_m_s < 0.0 && now.inward_m_s >= 0.0)
            || load_ratio.abs() <= self.config.least_load_ratio
        {
            return None;
        }
        let s = before.inward_m_s / (before.inward_m_s - now.inward_m_s);
        let time_s = before.time_s + s * (now.time_s - before.time_s);
        if let Some((last_s, last_side)) = self.last_crossing
            && (last_side == stance || time_s - last_s < self.refractory_s)
        {
            return None;
        }
        self.last_crossing = Some((time_s, stance));
        Some(Crossing { time_s, pendulum: before.pendulum.interpolate(&now.pendulum, s) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::SectionDetector;
    use crate::stance::StanceConfig;

    const TICK_S: f64 = 0.008;

    fn config() -> SectionConfig {
        SectionConfig {
            stance: StanceConfig { load_share: 0.6 },
            refractory_s: 0.2,
            lateral: Some(LateralConfig { velocity_filter_s: 0.0, load_filter_s: 0.0, least_load_ratio: 0.7 }),
            ..SectionConfig::default()
        }
    }

    /// A mass that sways by 3 cm about the middle between feet 10 cm apart, the load following it,
    /// once in 2π/6 s: turning points at π/12, 3π/12, ... from 0, on alternate feet.
    fn sway(time_s: f64, load_amplitude: f64) -> RobotState {
        let (sin, cos) = (6.0 * time_s).sin_cos();
        let mut state = RobotState { time_s, ..Default::default() };
        for side in Side::BOTH {
            let foot = &mut state.feet[side.index()];
            foot.centre_m[1] = 0.05 * side.lateral_sign();
            foot.load_n = 15.0 * (1.0 + side.lateral_sign() * load_amplitude * sin);
        }
        state.com.position_m = [0.0, 0.03 * sin, 0.25];
        state.com.velocity_m_s = [0.0, 0.18 * cos, 0.0];
        state
    }

    fn found(config: SectionConfig, states: impl Iterator<Item = RobotState>) -> Vec<Crossing> {
        let mut detector = SectionDetector::new(config).unwrap();
        states.filter_map(|s| detector.update(&s, |_| None)).collect()
    }

    fn ticks() -> impl Iterator<Item = f64> {
        (0..400).map(|k| f64::from(k) * TICK_S)
    }

    #[test]
    fn turning_points_are_found_on_alternate_feet() {
        let crossings = found(config(), ticks().map(|t| sway(t, 0.95)));
        assert_eq!(crossings.len(), 6);
        for (i, crossing) in crossings.iter().enumerate() {
            let expected_s = std::f64::consts::PI / 12.0 * (2.0 * i as f64 + 1.0);
            assert!((crossing.time_s - expected_s).abs() < 1e-3);
            let side = [Side::Left, Side::Right][i % 2];
            assert_eq!(crossing.pendulum.stance, side);
            let psi = (0.02_f64 / 0.25).atan();
            assert!((crossing.pendulum.roll_rad - psi).abs() < 1e-3);
        }
    }

    #[test]
    fn a_sway_that_does_not_unload_a_foot_is_no_step() {
        assert!(found(config(), ticks().map(|t| sway(t, 0.6))).is_empty());
    }

    #[test]
    fn the_refractory_time_and_the_other_foot_forbid_a_second_crossing() {
        // The velocity trembles about its zero, as that of a noisy robot does.
        let trembling = ticks().map(|t| {
            let mut state = sway(t, 0.95);
            state.com.velocity_m_s[1] += 0.05 * (300.0 * t).sin();
            state
        });
        let crossings = found(config(), trembling);
        assert_eq!(crossings.len(), 6);
        let slow = SectionConfig { refractory_s: 0.7, ..config() };
        let sparse = found(slow, ticks().map(|t| sway(t, 0.95)));
        assert_eq!(sparse.len(), 2, "every other foot comes too soon");
    }

    #[test]
    fn a_filter_delays_the_section_by_its_time_constant() {
        let mut slow = config();
        if let Some(lateral) = &mut slow.lateral {
            lateral.velocity_filter_s = 0.02;
        }
        let late = found(slow, ticks().map(|t| sway(t, 0.99)));
        // A first-order filter turns the phase by atan(ω τ), here 0.0199 s of time.
        let expected_s = 3.0 * std::f64::consts::PI / 12.0 + (6.0_f64 * 0.02).atan() / 6.0;
        assert!((late[1].time_s - expected_s).abs() < 4e-3, "{}", late[1].time_s);
    }

    #[test]
    fn bad_values_are_named() {
        let mut bad = config();
        if let Some(lateral) = &mut bad.lateral {
            lateral.least_load_ratio = 1.0;
        }
        let says = SectionDetector::new(bad).unwrap_err().to_string();
        assert!(says.starts_with("section.lateral.least_load_ratio"), "{says}");
    }
}
