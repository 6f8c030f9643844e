//! Does a gait step, or does it only sway? Measured tick by tick, without a word about what is wanted of it.

use serde::{Deserialize, Serialize};
use stridemap_robot::{Robot, RobotState, Side};
use stridemap_section::Crossing;

/// A foot that carries less than this share of the weight is in the air.
const UNLOADED: f64 = 0.01;
/// Single supports on alternating feet, per section, of a gait that steps: one, give or take.
const SUPPORTS_PER_SECTION: std::ops::RangeInclusive<f64> = 0.75..=1.6;
/// Mean height of a swinging foot, as a share of the centre of mass's, from which a gait steps.
pub(crate) const CLEARANCE_SHARE: f64 = 0.005;
/// Share of the time with load on both feet up to which a gait steps.
const BOTH_FEET_SHARE: f64 = 0.85;
/// A joint within this share of its largest torque is saturated.
const SATURATED: f64 = 0.98;
/// Time before a fall that is looked at for its cause.
const BEFORE_FALL_S: f64 = 0.5;

/// What a robot does under its nominal gait.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GaitVerdict {
    /// The feet leave the floor in turn.
    Steps,
    /// It sways, and stays up, but the feet hardly leave the floor.
    Shuffles,
    /// It does not stay up.
    Falls,
}

/// How a robot steps, from the end of its start-up on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Stepping {
    /// Sections seen.
    pub sections: usize,
    /// Single supports, each on the other foot than the one before.
    pub supports: usize,
    /// Mean over swings of the sole's greatest height.
    pub clearance_m: f64,
    /// The same as a share of the centre of mass's height at the start.
    pub clearance_share: f64,
    /// Share of the time with load on both feet.
    pub both_feet_share: f64,
    /// Mean time between sections.
    pub stride_s: f64,
    /// Standard deviation of that.
    pub stride_spread_s: f64,
    /// Mean of `psi_roll` at the sections.
    #[serde(default)]
    pub psi_roll_deg: f64,
    /// Standard deviation of that.
    pub psi_roll_spread_deg: f64,
    /// Greatest tilt of the base.
    pub tilt_deg: f64,
    /// Turn of the base.
    pub turn_deg: f64,
    /// Way of the centre of mass along the first heading, per second.
    pub speed_m_s: f64,
    /// Share of the time in which a joint was at its largest torque: joint, share; the most saturated first.
    pub saturated: Vec<(String, f64)>,
    /// How it was about to fall, in words, if it fell.
    pub falling: Option<String>,
}

impl Stepping {
    /// Whether these are steps.
    #[must_use]
    pub fn verdict(&self, fell: bool) -> GaitVerdict {
        let per_section = self.supports as f64 / self.sections.max(1) as f64;
        if fell {
            GaitVerdict::Falls
        } else if SUPPORTS_PER_SECTION.contains(&per_section)
            && self.clearance_share >= CLEARANCE_SHARE
            && self.both_feet_share <= BOTH_FEET_SHARE
        {
            GaitVerdict::Steps
        } else {
            GaitVerdict::Shuffles
        }
    }
}

/// A gait over time, from its start, for a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaitTrace {
    /// Time and `ψ_roll` of each section.
    pub sections: Vec<(f64, f64)>,
    /// Time, foot (left 0, right 1) and greatest height of each swing.
    pub swings: Vec<(f64, usize, f64)>,
}

/// What the last ticks looked like.
#[derive(Clone, Debug)]
struct Tick {
    time_s: f64,
    saturated: Vec<usize>,
    sole_tilt: bool,
}

/// Measures [`Stepping`].
#[derive(Clone, Debug, Default)]
pub(crate) struct StepMeter {
    from_s: f64,
    begun: Option<(f64, [f64; 2], f64)>,
    height_m: f64,
    heading_rad: f64,
    turned_rad: f64,
    at_m: [f64; 2],
    last_s: f64,
    ticks: usize,
    both: usize,
    support: Option<Side>,
    supports: usize,
    swing_m: [Option<f64>; 2],
    swings_m: Vec<f64>,
    trace: GaitTrace,
    sections_s: Vec<f64>,
    psi_roll_deg: Vec<f64>,
    tilt_deg: f64,
    saturated: Vec<usize>,
    before: std::collections::VecDeque<Tick>,
    lean: [f64; 2],
}

impl StepMeter {
    /// A meter that begins at a time.
    pub(crate) fn from(from_s: f64) -> Self {
        Self { from_s, ..Self::default() }
    }

    /// One control tick.
    pub(crate) fn tick(&mut self, robot: &dyn Robot, state: &RobotState, crossing: Option<&Crossing>) {
        if state.time_s < self.last_s {
            *self = Self::from(self.from_s);
        }
        if self.height_m <= 0.0 {
            self.height_m = state.com.position_m[2];
        }
        self.last_s = state.time_s;
        let description = robot.description();
        let full = |(joint, limits): (&stridemap_robot::JointState, &stridemap_robot::JointDescription)| {
            joint.torque_nm.abs() >= SATURATED * limits.limits.torque_nm
        };
        let saturated: Vec<usize> = (state.joints.iter().zip(&description.joints).enumerate())
            .filter(|(_, pair)| full(*pair))
            .map(|(at, _)| at)
            .collect();
        let weight_n = description.mass_kg * 9.81;
        let loaded = Side::BOTH.map(|side| state.foot(side).load_n > UNLOADED * weight_n);
        self.watch_for_falls(state, &saturated, loaded);
        let landed = self.watch_feet(state, loaded);
        if let Some(crossing) = crossing {
            self.trace.sections.push((state.time_s, crossing.pendulum.roll_rad.to_degrees()));
        }
        if state.time_s < self.from_s {
            return;
        }
        self.saturated.resize(state.joints.len(), 0);
        saturated.iter().for_each(|&joint| self.saturated[joint] += 1);
        let [x, y, _] = state.com.position_m;
        let heading_rad = state.base.heading_rad();
        if self.begun.is_none() {
            self.begun = Some((state.time_s, [x, y], heading_rad));
            self.heading_rad = heading_rad;
        }
        self.turned_rad += crate::measure::wrapped_rad(heading_rad - self.heading_rad);
        self.heading_rad = heading_rad;
        self.at_m = [x, y];
        self.ticks += 1;
        self.both += usize::from(loaded == [true, true]);
        self.tilt_deg = self.tilt_deg.max(state.base.tilt_rad().to_degrees());
        self.swings_m.extend(landed.into_iter().flatten());
        let support = match loaded {
            [true, false] => Some(Side::Left),
            [false, true] => Some(Side::Right),
            _ => None,
        };
        if support.is_some() && support != self.support {
            self.support = support;
            self.supports += 1;
        }
        if let Some(crossing) = crossing {
            self.sections_s.push(state.time_s);
            self.psi_roll_deg.push(crossing.pendulum.roll_rad.to_degrees());
        }
    }

    /// The greatest height of each swing that ended with this tick.
    fn watch_feet(&mut self, state: &RobotState, loaded: [bool; 2]) -> [Option<f64>; 2] {
        Side::BOTH.map(|side| {
            let swing = &mut self.swing_m[side.index()];
            if !loaded[side.index()] {
                let height_m = state.foot(side).centre_m[2];
                *swing = Some(swing.map_or(height_m, |most: f64| most.max(height_m)));
                return None;
            }
            let height_m = swing.take()?;
            self.trace.swings.push((state.time_s, side.index(), height_m));
            Some(height_m)
        })
    }

    /// The gait over time.
    pub(crate) fn trace(&self) -> GaitTrace {
        self.trace.clone()
    }

    fn watch_for_falls(&mut self, state: &RobotState, saturated: &[usize], loaded: [bool; 2]) {
        let feet = Side::BOTH.map(|side| state.foot(side).centre_m);
        let bearing: Vec<[f64; 3]> = (0..2).filter(|&i| loaded[i]).map(|i| feet[i]).collect();
        if !bearing.is_empty() {
            let (sin, cos) = state.base.heading_rad().sin_cos();
            let from = |axis: usize| {
                state.com.position_m[axis] - bearing.iter().map(|foot| foot[axis]).sum::<f64>() / bearing.len() as f64
            };
            let (x, y) = (from(0), from(1));
            self.lean = [cos * x + sin * y, cos * y - sin * x];
        }
        let sole_tilt = bearing.len() == 1 && bearing[0][2] > 0.004;
        self.before.push_back(Tick { time_s: state.time_s, saturated: saturated.to_vec(), sole_tilt });
        while self.before.front().is_some_and(|tick| tick.time_s < state.time_s - BEFORE_FALL_S) {
            self.before.pop_front();
        }
    }

    /// What was measured; `fell` adds how.
    pub(crate) fn stepping(&self, robot: &stridemap_robot::RobotDescription, fell: bool) -> Stepping {
        let strides: Vec<f64> = self.sections_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let ticks = self.ticks.max(1) as f64;
        let clearance_m = mean(&self.swings_m);
        let mut saturated: Vec<(String, f64)> = (self.saturated.iter().zip(&robot.joints))
            .filter(|(count, _)| **count > 0)
            .map(|(&count, joint)| (joint.name.clone(), count as f64 / ticks))
            .collect();
        saturated.sort_by(|a, b| b.1.total_cmp(&a.1));
        let speed_m_s = self.begun.map_or(0.0, |(from_s, from_m, heading_rad)| {
            let (sin, cos) = heading_rad.sin_cos();
            let way_m = cos * (self.at_m[0] - from_m[0]) + sin * (self.at_m[1] - from_m[1]);
            way_m / (self.last_s - from_s).max(1e-9)
        });
        Stepping {
            sections: self.sections_s.len(),
            supports: self.supports,
            clearance_m,
            clearance_share: clearance_m / self.height_m.max(1e-9),
            both_feet_share: self.both as f64 / ticks,
            stride_s: mean(&strides),
            stride_spread_s: spread(&strides),
            psi_roll_deg: mean(&self.psi_roll_deg),
            psi_roll_spread_deg: spread(&self.psi_roll_deg),
            tilt_deg: self.tilt_deg,
            turn_deg: self.turned_rad.to_degrees(),
            speed_m_s,
            saturated,
            falling: fell.then(|| self.falling(robot)),
        }
    }

    /// Where to it was about to fall, and what was wrong before.
    fn falling(&self, robot: &stridemap_robot::RobotDescription) -> String {
        let [ahead_m, left_m] = self.lean;
        let direction = match (ahead_m.abs() > left_m.abs(), ahead_m > 0.0, left_m > 0.0) {
            (true, true, _) => "forwards",
            (true, false, _) => "backwards",
            (false, _, true) => "to the left",
            (false, _, false) => "to the right",
        };
        let ticks = self.before.len().max(1);
        let most = (0..robot.joints.len())
            .map(|joint| (self.before.iter().filter(|tick| tick.saturated.contains(&joint)).count(), joint))
            .max_by_key(|(count, _)| *count);
        let on_edge = self.before.iter().filter(|tick| tick.sole_tilt).count();
        let cause = match most {
            Some((count, joint)) if 4 * count > ticks => {
                let share = 100 * count / ticks;
                format!("{} was at its largest torque for {share} % of the last half second", robot.joints[joint].name)
            }
            _ if 2 * on_edge > ticks => "it stood on the edge of a sole".into(),
            _ => format!(
                "its mass was {:.0} mm {} and {:.0} mm {} of the feet that bore it",
                1e3 * ahead_m.abs(),
                if ahead_m > 0.0 { "ahead" } else { "behind" },
                1e3 * left_m.abs(),
                if left_m > 0.0 { "left" } else { "right" }
            ),
        };
        format!("{direction}: {cause}")
    }
}

pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

pub(crate) fn spread(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (squares / values.len().saturating_sub(1).max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sway_with_both_feet_loaded_is_no_step() {
        let steps = Stepping {
            sections: 40,
            supports: 41,
            clearance_m: 0.02,
            clearance_share: 0.025,
            both_feet_share: 0.4,
            ..Stepping::default()
        };
        assert_eq!(steps.verdict(false), GaitVerdict::Steps);
        assert_eq!(steps.verdict(true), GaitVerdict::Falls);
        for shuffle in [
            Stepping { both_feet_share: 0.9, ..steps.clone() },
            Stepping { clearance_share: 0.004, ..steps.clone() },
            Stepping { supports: 10, ..steps.clone() },
        ] {
            assert_eq!(shuffle.verdict(false), GaitVerdict::Shuffles);
        }
    }

    #[test]
    fn spreads_are_standard_deviations() {
        assert!((spread(&[1.0, 2.0, 3.0]) - 1.0).abs() < 1e-12 && (mean(&[1.0, 2.0, 3.0]) - 2.0).abs() < 1e-12);
    }
}
