//! Do the bounds on falls hold the truth? Systems whose falls can be counted by brute force.
//!
//! Seven of one dimension: quadratic maps with normal, heavy-tailed and state-dependent noise, and a rimless wheel on random
//! slopes (McGeer 1990, Byl & Tedrake 2009) whose falls the next slope decides; two of two dimensions.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::answer::Bounds;
use crate::fall::{by_counts, interval};
use crate::record::{Bout, Record};
use crate::rule::FallRule;
use crate::small::{gamma, normal};

/// Strides of a record, and of a walk.
const STRIDES: usize = 100;
const WALK: usize = 60;

/// How a system moves.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// x' = a x + c x² + (1 + h |x|) s e, with e normal or Student's; falls below -1.
    Quadratic { curvature: f64, std: f64, dof: Option<f64>, grows: f64 },
    /// Angular rate after each impact; falls when it does not get over the vertical.
    Wheel { slope_rad: f64, slope_std_rad: f64 },
    /// Two components, the first curved; falls below -1.
    Pair { std: f64 },
}

/// A system with falls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FallSystem {
    /// Its name.
    pub name: &'static str,
    motion: Motion,
}

/// The systems of the study.
pub const SYSTEMS: [FallSystem; 9] = [
    FallSystem {
        name: "quadratic, noise 0.22",
        motion: Motion::Quadratic { curvature: -0.25, std: 0.22, dof: None, grows: 0.0 },
    },
    FallSystem {
        name: "quadratic, noise 0.15",
        motion: Motion::Quadratic { curvature: -0.25, std: 0.15, dof: None, grows: 0.0 },
    },
    FallSystem {
        name: "quadratic, noise 0.18 of t4",
        motion: Motion::Quadratic { curvature: -0.25, std: 0.18, dof: Some(4.0), grows: 0.0 },
    },
    FallSystem {
        name: "noise grows with distance",
        motion: Motion::Quadratic { curvature: 0.0, std: 0.16, dof: None, grows: 1.0 },
    },
    FallSystem { name: "wheel, slope 0.11 sd 0.03", motion: Motion::Wheel { slope_rad: 0.11, slope_std_rad: 0.03 } },
    FallSystem { name: "wheel, slope 0.10 sd 0.03", motion: Motion::Wheel { slope_rad: 0.10, slope_std_rad: 0.03 } },
    FallSystem { name: "wheel, slope 0.12 sd 0.02", motion: Motion::Wheel { slope_rad: 0.12, slope_std_rad: 0.02 } },
    FallSystem { name: "two states, noise 0.26", motion: Motion::Pair { std: 0.26 } },
    FallSystem { name: "two states, noise 0.20", motion: Motion::Pair { std: 0.20 } },
];

const HALF_ANGLE_RAD: f64 = std::f64::consts::PI / 8.0;
const GRAVITY: f64 = 9.81;

impl FallSystem {
    fn state(&self) -> Vec<String> {
        match self.motion {
            Motion::Pair { .. } => vec!["x".into(), "y".into()],
            _ => vec!["x".into()],
        }
    }

    /// Where walks begin.
    fn start(&self) -> Vec<f64> {
        match self.motion {
            Motion::Quadratic { .. } => vec![0.0],
            Motion::Pair { .. } => vec![0.0, 0.0],
            Motion::Wheel { slope_rad, .. } => {
                let eta = (2.0 * HALF_ANGLE_RAD).cos();
                let gain = (slope_rad - HALF_ANGLE_RAD).cos() - (slope_rad + HALF_ANGLE_RAD).cos();
                vec![eta * (2.0 * GRAVITY * gain / (1.0 - eta * eta)).sqrt()]
            }
        }
    }

    /// The rule that a user would give: of the wheel the rate that gets over the nominal slope.
    fn rule(&self) -> FallRule {
        let boundary = match self.motion {
            Motion::Wheel { slope_rad, .. } => (2.0 * GRAVITY * (1.0 - (HALF_ANGLE_RAD - slope_rad).cos())).sqrt(),
            _ => -1.0,
        };
        FallRule { component: "x".into(), below: true, boundary }
    }

    /// The next state, whether it fell, and whether a section was seen then.
    fn stride(&self, x: &[f64], rng: &mut ChaCha8Rng) -> (Vec<f64>, bool, bool) {
        match self.motion {
            Motion::Quadratic { curvature, std, dof, grows } => {
                let e = match dof {
                    None => normal(rng),
                    Some(v) => normal(rng) / (2.0 * gamma(0.5 * v, rng) / v).sqrt() / (v / (v - 2.0)).sqrt(),
                };
                let at = x[0].clamp(-5.0, 5.0);
                let next = 0.7 * at + curvature * at * at + std * (1.0 + grows * x[0].abs()) * e;
                (vec![next], next < -1.0, true)
            }
            Motion::Wheel { slope_rad, slope_std_rad } => {
                let slope = slope_rad + slope_std_rad * normal(rng);
                let squared = x[0] * x[0];
                let barrier = 2.0 * GRAVITY * (1.0 - (HALF_ANGLE_RAD - slope).max(0.0).cos());
                let gain = (slope - HALF_ANGLE_RAD).cos() - (slope + HALF_ANGLE_RAD).cos();
                let energy = squared + 2.0 * GRAVITY * gain;
                let next = (2.0 * HALF_ANGLE_RAD).cos() * energy.max(0.0).sqrt();
                (vec![next], squared < barrier || energy <= 0.0, false)
            }
            Motion::Pair { std } => {
                let first = 0.6 * x[0] + 0.3 * x[1] - 0.35 * x[0] * x[0] + std * normal(rng);
                let second = -0.25 * x[0] + 0.7 * x[1] + 0.7 * std * normal(rng);
                (vec![first, second], first < -1.0, true)
            }
        }
    }

    /// A record of 100 strides, begun anew after each fall.
    fn record(&self, rng: &mut ChaCha8Rng) -> Record {
        let mut x = self.start();
        for _ in 0..20 {
            let (next, fell, _) = self.stride(&x, rng);
            x = if fell { self.start() } else { next };
        }
        let mut bouts = vec![Bout { states: vec![x.clone()], ..Bout::default() }];
        for _ in 0..STRIDES {
            let (next, fell, seen) = self.stride(&x, rng);
            let bout = bouts.len() - 1;
            if fell {
                bouts[bout].fell = true;
                bouts[bout].fallen_state = seen.then_some(next);
                x = self.start();
                bouts.push(Bout { states: vec![x.clone()], ..Bout::default() });
            } else {
                bouts[bout].states.push(next.clone());
                x = next;
            }
        }
        Record { state: self.state(), bouts, stride_s: Some(1.0) }
    }

    /// By brute force: mean strides to a fall of those who walk on, and the chance of a fall in a walk.
    fn truth(&self, walks: usize, seed: u64) -> (f64, f64) {
        const CAP: usize = 2000;
        const ENOUGH: usize = 3000;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::MAX);
        let mut alive = vec![self.start(); walks];
        let (mut falls, mut exposure, mut probability) = (0, 0, 0.0);
        for k in 1..=CAP {
            let before = alive.len();
            alive = alive.iter().map(|x| self.stride(x, &mut rng)).filter(|s| !s.1).map(|s| s.0).collect();
            if k > 20 {
                (falls, exposure) = (falls + before - alive.len(), exposure + before);
            }
            if k == WALK {
                probability = 1.0 - alive.len() as f64 / walks as f64;
            }
            if alive.is_empty() || k > WALK && falls > ENOUGH {
                break;
            }
        }
        (exposure as f64 / (falls as f64).max(1.0), probability)
    }
}

/// How often bounds on falls held the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FallCoverage {
    /// Of which system.
    pub system: String,
    /// Records of 100 strides.
    pub records: usize,
    /// Mean strides to a fall, by brute force.
    pub strides_to_fall: f64,
    /// Chance of a fall in 60 strides, by brute force.
    pub probability: f64,
    /// Share of intervals that held the first, and the second.
    pub coverage: [f64; 2],
    /// Share of lower ends below the mean strides to a fall, and of upper ends above the chance: what is said.
    pub bounds: [f64; 2],
    /// Median width of the interval of strides to a fall, decades.
    pub decades: f64,
    /// Share of upper ends from counts alone that were above the chance.
    pub counts_only: f64,
}

/// Coverage of the bounds on one system, over `records` records, in parallel; the same for the same seed.
#[must_use]
pub fn fall_coverage(system: &FallSystem, records: usize, seed: u64) -> FallCoverage {
    let (strides_to_fall, probability) = system.truth(20_000, seed);
    let rule = system.rule();
    let found: Vec<(Bounds, Bounds, f64)> = (0..records as u64)
        .into_par_iter()
        .map(|number| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(number);
            let record = system.record(&mut rng);
            let said = interval(&record, 0, &rule, WALK, rng.random());
            let counts = by_counts(record.falls(), record.strides(), WALK);
            (said.strides_to_fall, said.probability, counts)
        })
        .collect();
    let share = |held: &dyn Fn(&(Bounds, Bounds, f64)) -> bool| {
        found.iter().filter(|f| held(f)).count() as f64 / found.len().max(1) as f64
    };
    let within = |b: &Bounds, x: f64| b.low <= x && x <= b.high;
    let mut decades: Vec<f64> = found.iter().map(|f| (f.0.high / f.0.low).log10()).collect();
    decades.sort_by(f64::total_cmp);
    FallCoverage {
        system: system.name.into(),
        records,
        strides_to_fall,
        probability,
        coverage: [share(&|f| within(&f.0, strides_to_fall)), share(&|f| within(&f.1, probability))],
        bounds: [share(&|f| f.0.low <= strides_to_fall), share(&|f| f.1.high >= probability)],
        decades: crate::answer::quantile(&decades, 0.5),
        counts_only: share(&|f| f.2 >= probability),
    }
}

impl FallCoverage {
    /// The heading of a table of these.
    pub const HEADING: &str = "system                       records  strides to fall  P60     interval holds: strides, P60 | \
                               bound holds: strides, P60 | decades | counts alone";
}

impl std::fmt::Display for FallCoverage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([a, b], [c, d]) = (self.coverage, self.bounds);
        write!(
            f,
            "{:<28} {:>7}  {:>15.0}  {:.4}                 {a:>7.2}  {b:.2} |              {c:>7.2}  {d:.2} |    {:>4.1} |  {:.2}",
            self.system, self.records, self.strides_to_fall, self.probability, self.decades, self.counts_only
        )
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::float_cmp, reason = "the same numbers")]

    use super::*;

    #[test]
    fn bounds_hold_the_truth_of_a_map_with_one_state_and_of_one_with_two() {
        for system in [SYSTEMS[0], SYSTEMS[7]] {
            let found = fall_coverage(&system, 8, 3);
            assert!(found.bounds.iter().all(|b| *b >= 0.8), "{found}");
            assert!(found.strides_to_fall > 50.0 && found.probability < 0.6, "{found}");
        }
    }
}
