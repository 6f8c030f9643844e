//! A guard on the robot: it watches what announces a fall, stride by stride.
//!
//! Near its cliff the robot alternates: left and right strides differ more and more (a flip, that is a
//! multiplier beyond −1), seen first in the pitch rate, in `ψ_roll` only one or two strides before the
//! fall; and it turns. The guard warns when two successive changes of the pitch rate have opposite
//! signs and are both large, when two strides together turn the robot by more than a straight walk
//! does, when `ψ_roll` is low, or, where asked for, when its running mean is high. Large, low and high
//! are relative: to what the map cannot predict (its residual), and to the robot's own stepping in
//! place.

use serde::{Deserialize, Serialize};

use crate::mean_roll::{MeanRoll, MeanRollConfig, MeanRollLimit};
use stridemap_record::{InPlace, StrideMeasures, Warning};

/// What the guard warns of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GuardConfig {
    /// First strides of an episode in which it is silent about the pitch rate: the start is uneven.
    pub silent_strides: usize,
    /// Changes of the pitch rate that are large on any robot, deg/s; left out: not watched, as for all below.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_rate_change_deg_s: Option<f64>,
    /// Change of heading over two strides, one on each leg, that is large, deg.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_deg: Option<f64>,
    /// Change of heading since the episode began that is large, deg.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_deg: Option<f64>,
    /// Factor on the large changes and turns while exploring, whose targets move by themselves.
    pub exploring_factor: f64,
    /// Added to the changes of the pitch rate, in standard deviations of what the map cannot predict of the pitch rate.
    pub residual_stds: f64,
    /// `ψ_roll` this far below its mean in place is low, deg.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psi_roll_below_in_place_deg: Option<f64>,
    /// When the running mean of `ψ_roll` is high.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_psi_roll: Option<MeanRollConfig>,
}

/// Thresholds in the robot's own units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GuardThresholds {
    /// Two opposite changes of the pitch rate beyond this warn.
    pub pitch_rate_change_deg_s: f64,
    /// A turn over two strides beyond this warns.
    pub turn_deg: f64,
    /// A change of heading since the beginning beyond this warns.
    pub heading_deg: f64,
    /// A section with `ψ_roll` below this warns.
    pub psi_roll_below_deg: f64,
    /// A running mean of `ψ_roll` above this warns.
    pub mean_psi_roll: Option<MeanRollLimit>,
}

impl GuardConfig {
    /// Thresholds for a robot that steps in place like this, and a map with this residual of the pitch
    /// rate (zero before there is one).
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::GuardConfig;
    /// use stridemap_record::InPlace;
    ///
    /// let config = GuardConfig {
    ///     silent_strides: 3,
    ///     pitch_rate_change_deg_s: Some(6.0),
    ///     turn_deg: Some(6.5),
    ///     heading_deg: None,
    ///     exploring_factor: 2.0,
    ///     residual_stds: 2.0,
    ///     psi_roll_below_in_place_deg: Some(2.0),
    ///     mean_psi_roll: None,
    /// };
    /// let in_place = InPlace { sections: 9, psi_roll_deg: -0.8, pitch_rate_change_deg_s: 0.5 };
    /// let t = config.thresholds(in_place, 0.25);
    /// assert!((t.pitch_rate_change_deg_s - 7.0).abs() < 1e-12); // 6 + 0.5 in place + 2 x 0.25
    /// assert!((t.psi_roll_below_deg + 2.8).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn thresholds(&self, in_place: InPlace, residual_deg_s: f64) -> GuardThresholds {
        GuardThresholds {
            pitch_rate_change_deg_s: self.pitch_rate_change_deg_s.unwrap_or(f64::INFINITY)
                + in_place.pitch_rate_change_deg_s
                + self.residual_stds * residual_deg_s,
            turn_deg: self.turn_deg.unwrap_or(f64::INFINITY),
            heading_deg: self.heading_deg.unwrap_or(f64::INFINITY),
            psi_roll_below_deg: in_place.psi_roll_deg - self.psi_roll_below_in_place_deg.unwrap_or(f64::INFINITY),
            mean_psi_roll: self.mean_psi_roll.map(|m| m.limit(in_place.psi_roll_deg)),
        }
    }
}

impl GuardThresholds {
    /// Thresholds while exploring: changes and turns may be this much larger, headings wander.
    #[must_use]
    pub const fn exploring(self, factor: f64) -> Self {
        Self {
            pitch_rate_change_deg_s: factor * self.pitch_rate_change_deg_s,
            turn_deg: factor * self.turn_deg,
            heading_deg: f64::INFINITY,
            ..self
        }
    }
}

/// Watches the strides of one episode.
#[derive(Clone, Debug)]
pub struct Guard {
    thresholds: GuardThresholds,
    silent: usize,
    seen: usize,
    last_rate: Option<f64>,
    last_change: f64,
    last_turn_deg: f64,
    heading_deg: f64,
    mean_roll: MeanRoll,
}

impl Guard {
    /// A guard at the beginning of an episode.
    #[must_use]
    pub fn new(config: &GuardConfig, thresholds: GuardThresholds) -> Self {
        Self {
            thresholds,
            silent: config.silent_strides,
            seen: 0,
            last_rate: None,
            last_change: 0.0,
            last_turn_deg: 0.0,
            heading_deg: 0.0,
            mean_roll: MeanRoll::default(),
        }
    }

    /// Looks at a stride that reached the section.
    pub fn watch(&mut self, measures: &StrideMeasures) -> Option<Warning> {
        let rate = measures.psi_pitch_rate_deg_s;
        let change = self.last_rate.map_or(0.0, |last| rate - last);
        let before = std::mem::replace(&mut self.last_change, change);
        self.last_rate = Some(rate);
        self.seen += 1;
        let large = self.thresholds.pitch_rate_change_deg_s;
        let flips = change * before < 0.0 && change.abs() > large && before.abs() > large;
        let turn_before = std::mem::replace(&mut self.last_turn_deg, measures.turn_deg);
        self.heading_deg += measures.turn_deg;
        // The pelvis turns to and fro with every step: the heading is that between two.
        let heading_deg = self.heading_deg - 0.5 * measures.turn_deg;
        let turns = (measures.turn_deg + turn_before).abs() > self.thresholds.turn_deg
            || heading_deg.abs() > self.thresholds.heading_deg;
        let limit = self.thresholds.mean_psi_roll;
        let high = limit.is_some_and(|l| self.mean_roll.is_high(measures.psi_roll_deg, l));
        if self.seen > self.silent && flips {
            Some(Warning::Flip)
        } else if self.seen > self.silent && turns {
            Some(Warning::Turn)
        } else if measures.psi_roll_deg < self.thresholds.psi_roll_below_deg {
            Some(Warning::LowRoll)
        } else if high {
            Some(Warning::HighMeanRoll)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(silent_strides: usize) -> GuardConfig {
        GuardConfig {
            silent_strides,
            pitch_rate_change_deg_s: Some(3.0),
            turn_deg: Some(6.0),
            heading_deg: Some(20.0),
            exploring_factor: 1.0,
            residual_stds: 0.0,
            psi_roll_below_in_place_deg: Some(1.0),
            mean_psi_roll: None,
        }
    }

    fn warnings(rates: &[f64], silent_strides: usize) -> Vec<Option<Warning>> {
        let config = config(silent_strides);
        let mut guard = Guard::new(&config, config.thresholds(InPlace::default(), 0.0));
        let stride = |rate: &f64| StrideMeasures { psi_pitch_rate_deg_s: *rate, ..Default::default() };
        rates.iter().map(|r| guard.watch(&stride(r))).collect()
    }

    #[test]
    fn alternation_warns_and_a_ramp_does_not() {
        let flip = Some(Warning::Flip);
        assert_eq!(warnings(&[20.0, 16.0, 20.0, 16.0], 0), [None, None, flip, flip]);
        assert_eq!(warnings(&[20.0, 18.0, 20.0, 18.0], 0), [None; 4]);
        assert_eq!(warnings(&[0.0, 5.0, 10.0, 15.0], 0), [None; 4]);
        assert_eq!(warnings(&[20.0, 16.0, 20.0, 16.0], 3), [None, None, None, flip]);
    }

    /// The pelvis turns to and fro with every step; what stays over two steps is a turn.
    #[test]
    fn a_turn_over_two_strides_warns() {
        let config = config(0);
        let mut guard = Guard::new(&config, config.thresholds(InPlace::default(), 0.0));
        let mut seen = |turn_deg| guard.watch(&StrideMeasures { turn_deg, ..Default::default() });
        assert_eq!([5.0, -8.0, 9.0].map(&mut seen), [None; 3]);
        assert_eq!(seen(-2.0), Some(Warning::Turn));
    }

    #[test]
    fn a_low_roll_warns_at_once() {
        let config = config(9);
        let in_place = InPlace::of(&[(-0.8, 1.0), (-0.8, 1.5)]);
        assert!((in_place.pitch_rate_change_deg_s - 0.5).abs() < 1e-12);
        let mut guard = Guard::new(&config, config.thresholds(in_place, 0.0));
        let at = |psi_roll_deg| StrideMeasures { psi_roll_deg, ..Default::default() };
        assert_eq!(guard.watch(&at(-1.7)), None);
        assert_eq!(guard.watch(&at(-1.9)), Some(Warning::LowRoll));
    }
}
