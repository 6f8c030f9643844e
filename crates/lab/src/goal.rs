//! What the robot is asked to do, stride by stride: lines `[[goal]]` of a task file.

use std::collections::VecDeque;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use stridemap_process::{Goal, GoalDimension};
use stridemap_record::StrideMeasures;

use crate::registry::{Part, Registry, named};

/// A number that is measured of every stride, by name: what a goal may ask for, and what a map of goals predicts.
pub struct MeasurePart {
    /// The name used in files, with its unit.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// Its value, as the robot measures it.
    pub of: fn(&StrideMeasures) -> f64,
}

impl Part for MeasurePart {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

named! {
    /// A measure of a stride, by name.
    Measure, MeasurePart, measures
}

macro_rules! measure {
    ($name:literal, $about:literal, $of:expr) => {{
        static PART: MeasurePart = MeasurePart { name: $name, about: $about, of: $of };
        &PART
    }};
}

impl Measure {
    /// Mean power of the joints over the stride.
    pub const POWER_W: Self =
        Self(measure!("power_w", "Σ |τ ω| of every joint, mean over the stride, W", |m| m.motion.power_w));
}

/// The registry of measures of a stride.
#[must_use]
pub fn measures() -> &'static Registry<MeasurePart> {
    static MEASURES: Registry<MeasurePart> = Registry::new(
        "measure of a stride",
        &[
            measure!("forward_speed_m_s", "speed of the base along its heading, mean over the stride, m/s", |m| m
                .motion
                .forward_speed_m_s),
            measure!("lateral_speed_m_s", "speed of the base to the left of its heading, likewise, m/s", |m| m
                .motion
                .lateral_speed_m_s),
            measure!("yaw_rate_rad_s", "change of heading over time, rad/s, + to the left", |m| m
                .motion
                .yaw_rate_rad_s),
            measure!("mean_roll_rad", "roll of the base, mean over the stride, rad, + to the right", |m| m
                .motion
                .mean_roll_rad),
            measure!("mean_pitch_rad", "pitch of the base, mean over the stride, rad, + forward", |m| m
                .motion
                .mean_pitch_rad),
            Measure::POWER_W.0,
            measure!(
                "heading_deg",
                "heading at the stride's end relative to the episode's first, deg, + towards the side of the stance leg",
                |m| m.heading_deg
            ),
            measure!("stride_s", "duration of the stride, s", |m| m.duration_s),
        ],
    );
    &MEASURES
}

/// One component of the goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalConfig {
    /// The measure of the stride that shall have the goal's value.
    pub name: Measure,
    /// Goals are drawn uniformly between these.
    pub range: [f64; 2],
    /// Strides for which a goal is kept.
    pub hold: usize,
    /// The error that counts as one, in the unit of the measure.
    pub unit: f64,
    /// The modulation that asks the gait for it directly, where there is one: the nominal controller sets it to the goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command: Option<String>,
}

impl GoalConfig {
    /// How far a stride was from its goal, in units.
    #[must_use]
    pub fn error(&self, measures: &StrideMeasures, goal: f64) -> f64 {
        ((self.name.of)(measures) - goal) / self.unit
    }

    pub(crate) fn dimension(&self) -> GoalDimension {
        GoalDimension { name: self.name.name.into(), lower: self.range[0], upper: self.range[1] }
    }

    fn draw(&self, rng: &mut ChaCha8Rng) -> f64 {
        self.range[0] + (self.range[1] - self.range[0]) * rng.random::<f64>()
    }
}

/// Goals drawn at random, each kept for so many strides.
///
/// # Arguments
///
/// - `hold` – strides for which each is kept; `None`: as each component of the goal says.
#[must_use]
pub fn drawn(goals: &[GoalConfig], hold: Option<usize>, strides: usize, rng: &mut ChaCha8Rng) -> Vec<Goal> {
    let mut now = Goal::new();
    let of_stride = |k: usize| {
        for (i, goal) in goals.iter().enumerate() {
            if k.is_multiple_of(hold.unwrap_or(goal.hold)) {
                let value = goal.draw(rng);
                if i < now.len() { now[i] = value } else { now.push(value) }
            }
        }
        now.clone()
    };
    (0..strides).map(of_stride).collect()
}

/// Where the goals of a plant come from: a random stream of their own, or a list.
#[derive(Clone, Debug)]
pub(crate) struct Goals {
    config: Vec<GoalConfig>,
    rng: ChaCha8Rng,
    k: usize,
    listed: Option<VecDeque<Goal>>,
    now: Goal,
}

/// What tells the stream of goals from that of the robot: a bit that no role of a stream has.
const GOALS: u64 = 1 << 63;

impl Goals {
    pub(crate) fn new(config: Vec<GoalConfig>) -> Self {
        Self { config, rng: ChaCha8Rng::seed_from_u64(0), k: 0, listed: None, now: Goal::new() }
    }

    /// Takes the goals of the next strides from a list, its last for ever after; `None`: at random.
    pub(crate) fn list(&mut self, goals: Option<Vec<Goal>>) {
        self.listed = goals.map(Into::into);
        self.now = self.listed.as_mut().and_then(VecDeque::pop_front).unwrap_or_default();
    }

    /// An episode begins, from a generator in this state.
    pub(crate) fn begin(&mut self, rng: &ChaCha8Rng) {
        if self.listed.is_none() && !self.config.is_empty() {
            self.rng = ChaCha8Rng::from_seed(rng.get_seed());
            self.rng.set_stream(rng.get_stream() ^ GOALS);
            self.rng.set_word_pos(rng.get_word_pos());
            self.k = 0;
            self.now = self.config.iter().map(|goal| goal.draw(&mut self.rng)).collect();
        }
    }

    /// A stride ended.
    pub(crate) fn advance(&mut self) {
        if let Some(listed) = &mut self.listed {
            self.now = listed.pop_front().unwrap_or_else(|| self.now.clone());
            return;
        }
        self.k += 1;
        for (now, goal) in self.now.iter_mut().zip(&self.config) {
            if self.k.is_multiple_of(goal.hold) {
                *now = goal.draw(&mut self.rng);
            }
        }
    }

    /// The goal of the next stride.
    pub(crate) const fn now(&self) -> &Goal {
        &self.now
    }

    pub(crate) fn config(&self) -> &[GoalConfig] {
        &self.config
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speed(hold: usize) -> GoalConfig {
        let name = Measure(measures().find("forward_speed_m_s").unwrap());
        GoalConfig { name, range: [0.1, 0.4], hold, unit: 0.1, command: None }
    }

    /// Goals are kept as long as they say, lie in their range, depend on the episode's generator alone, and a fall
    /// draws new ones.
    #[test]
    fn goals_are_held_and_have_a_stream_of_their_own() {
        let mut goals = Goals::new(vec![speed(3), speed(2)]);
        let rng = ChaCha8Rng::seed_from_u64(5);
        let mut episode = || {
            goals.begin(&rng);
            let mut all = Vec::new();
            for _ in 0..12 {
                all.push(goals.now().clone());
                goals.advance();
            }
            all
        };
        let (first, again) = (episode(), episode());
        assert_eq!(first, again);
        for (i, hold) in [(0, 3), (1, 2)] {
            for k in 1..12 {
                let kept = first[k][i].to_bits() == first[k - 1][i].to_bits();
                assert_eq!(kept, k % hold != 0, "component {i}, stride {k}");
                assert!((0.1..0.4).contains(&first[k][i]));
            }
        }
        goals.list(Some(vec![Goal::from_slice(&[0.2, 0.3]), Goal::from_slice(&[0.3, 0.3])]));
        goals.begin(&rng);
        assert_eq!(goals.now().as_slice(), [0.2, 0.3]);
        goals.advance();
        goals.advance();
        assert_eq!(goals.now().as_slice(), [0.3, 0.3]);
    }
}
