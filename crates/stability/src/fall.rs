//! Bounds on the time to a fall.
//!
//! The stride map with curvature and heavy tails ([`crate::student`]) is drawn from its posterior; each draw's chance of a
//! fall is reckoned in it, by a transition matrix with absorption in one dimension and by particles in two and three,
//! whose chance of falling in the next stride is known without noise. What is said are the ends of the interval over draws.

use nalgebra::{DMatrix, DVector};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use statrs::distribution::{Beta, ContinuousCDF, StudentsT};

use crate::answer::{Bounds, CountsOnly, FallBounds, Refusal, StridesToFall, quantile};
use crate::record::Record;
use crate::rule::FallRule;
use crate::small::gamma;
use crate::student::{Draw, Features, dot, regress};

/// Draws of the map.
const DRAWS: usize = 150;
/// Cells of the transition matrix.
const CELLS: usize = 90;
/// Particles per draw.
const PARTICLES: usize = 200;
/// Fewer strides teach no map.
const FEWEST: usize = 60;
/// Most components of a state in which particles were checked.
const MOST_DIMENSIONS: usize = 3;
/// A boundary this far below the lowest stride is out of the map's sight.
const FAR_SD: f64 = 3.0;

/// What a draw of the map says.
#[derive(Clone, Debug)]
pub(crate) struct Fate {
    /// Mean number of strides to a fall.
    pub strides_to_fall: f64,
    /// Probability of no fall up to each stride, from 0 on.
    pub survival: Vec<f64>,
}

/// The record in standardised components, the one of the rule first and turned so that falls are below.
struct Learned {
    d: usize,
    /// Where falls begin, standardised.
    boundary: f64,
    /// Where walks begin.
    start: Vec<f64>,
    features: Vec<Features>,
    /// One regression after the other; the later ones see the next state of the earlier ones.
    draws: Vec<Vec<Draw>>,
    /// Largest value of the first component.
    top: f64,
}

/// Pairs of successive states, falls with a state included; states have the component of the rule first, `sign` times.
fn pairs(record: &Record, first: usize, sign: f64) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let turned = |x: &[f64]| -> Vec<f64> {
        let others = (0..x.len()).filter(|i| *i != first).map(|i| x[i]);
        std::iter::once(sign * x[first]).chain(others).collect()
    };
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for bout in &record.bouts {
        let ends = bout.states.iter().chain(bout.fallen_state.iter().filter(|_| bout.fell));
        for (a, b) in bout.states.iter().zip(ends.skip(1)) {
            from.push(turned(a));
            to.push(turned(b));
        }
    }
    (from, to)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    quantile(&values, 0.5)
}

impl Learned {
    fn of(record: &Record, first: usize, rule: &FallRule, rng: &mut ChaCha8Rng) -> Self {
        let sign = if rule.below { 1.0 } else { -1.0 };
        let (mut from, mut to) = pairs(record, first, sign);
        let (n, d) = (from.len(), record.state.len());
        let mut boundary = sign * rule.boundary;
        for i in 0..d {
            let mean = from.iter().map(|x| x[i]).sum::<f64>() / n as f64;
            let std = (from.iter().map(|x| (x[i] - mean).powi(2)).sum::<f64>() / n as f64).sqrt().max(1e-300);
            from.iter_mut().chain(&mut to).for_each(|x| x[i] = (x[i] - mean) / std);
            if i == 0 {
                boundary = (boundary - mean) / std;
            }
        }
        let start = (0..d).map(|i| median(from.iter().map(|x| x[i]).collect())).collect();
        let top = from.iter().chain(&to).map(|x| x[0]).fold(f64::NEG_INFINITY, f64::max) + 2.5;
        let widest = from.iter().flatten().map(|x| x.abs()).fold(boundary.abs().max(top), f64::max);
        let mut row = Vec::new();
        let features: Vec<Features> = (0..d).map(|i| Features::new(d, i, 1.2 * widest)).collect();
        let draws = features.iter().enumerate().map(|(i, features)| {
            let rows: Vec<Vec<f64>> = from
                .iter()
                .zip(&to)
                .map(|(x, y)| {
                    features.write(x, &y[..i], &mut row);
                    row.clone()
                })
                .collect();
            let y: Vec<f64> = to.iter().map(|y| y[i]).collect();
            regress(features, &rows, &y, DRAWS, rng)
        });
        let draws = draws.collect();
        Self { d, boundary, start, features, draws, top }
    }

    /// The chance of each draw, for walks of `strides`.
    fn fates(&self, strides: usize, rng: &mut ChaCha8Rng) -> Vec<Fate> {
        (0..DRAWS)
            .map(|k| if self.d == 1 { self.by_matrix(k, strides) } else { self.by_particles(k, strides, rng) })
            .collect()
    }

    /// One dimension: cells from the boundary up; what is above stays in the last, what is below has fallen.
    fn by_matrix(&self, k: usize, strides: usize) -> Fate {
        let draw = &self.draws[0][k];
        let noise = Below::new(draw.dof);
        let width = (self.top - self.boundary) / CELLS as f64;
        let mut t = DMatrix::zeros(CELLS, CELLS);
        let mut row = Vec::new();
        for i in 0..CELLS {
            let centre = self.boundary + (i as f64 + 0.5) * width;
            self.features[0].write(&[centre], &[], &mut row);
            let mean = dot(&row, &draw.beta);
            let below = |edge: f64| noise.at((edge - mean) / draw.scale);
            let mut before = below(self.boundary);
            for j in 0..CELLS {
                let upper = if j + 1 == CELLS { 1.0 } else { below(self.boundary + (j + 1) as f64 * width) };
                t[(i, j)] = (upper - before).max(0.0);
                before = upper;
            }
        }
        let cell = ((self.start[0] - self.boundary) / width).clamp(0.0, CELLS as f64 - 1.0) as usize;
        let mut alive = DVector::zeros(CELLS);
        alive[cell] = 1.0;
        let back = t.transpose();
        let mut survival = vec![1.0];
        for _ in 0..strides {
            alive = &back * alive;
            survival.push(alive.sum());
        }
        let matrix = DMatrix::identity(CELLS, CELLS) * (1.0 + 1e-14) - t;
        let times = matrix.lu().solve(&DVector::from_element(CELLS, 1.0));
        Fate { strides_to_fall: times.map_or(f64::INFINITY, |m| m[cell].max(1.0)), survival }
    }

    /// More dimensions: particles that carry their chance of being alive, redrawn where it has become uneven.
    fn by_particles(&self, k: usize, strides: usize, rng: &mut ChaCha8Rng) -> Fate {
        let first = &self.draws[0][k];
        let noise = Below::new(first.dof);
        let mut states = vec![self.start.clone(); PARTICLES];
        let (mut survival, mut hazards) = (vec![1.0], Vec::new());
        let mut row = Vec::new();
        for _ in 0..strides.max(2 * FEWEST) {
            let mut chances = Vec::with_capacity(PARTICLES);
            for x in &mut states {
                self.features[0].write(x, &[], &mut row);
                let mean = dot(&row, &first.beta);
                let falls = noise.at((self.boundary - mean) / first.scale);
                chances.push(1.0 - falls);
                // The next state of one that does not fall.
                let mut next = vec![self.boundary];
                for _ in 0..20 {
                    let drawn = mean + first.scale * student(first.dof, rng);
                    if drawn >= self.boundary {
                        next[0] = drawn;
                        break;
                    }
                }
                for i in 1..self.d {
                    self.features[i].write(x, &next, &mut row);
                    let draw = &self.draws[i][k];
                    next.push(dot(&row, &draw.beta) + draw.scale * student(draw.dof, rng));
                }
                let end = 1.2 * self.top.abs().max(self.boundary.abs()) + 4.0;
                next.iter_mut().for_each(|z| *z = z.clamp(-end, end));
                *x = next;
            }
            let alive = chances.iter().sum::<f64>() / PARTICLES as f64;
            hazards.push(1.0 - alive);
            survival.push(survival[survival.len() - 1] * alive);
            states = redraw(&states, &chances, rng);
        }
        // Once the start is forgotten the chance is the same in every stride.
        let late = &hazards[hazards.len() / 4..];
        let hazard = (late.iter().sum::<f64>() / late.len() as f64).max(1e-12);
        let strides_to_fall = survival.iter().sum::<f64>() + survival[survival.len() - 1] * (1.0 / hazard - 1.0);
        survival.truncate(strides + 1);
        Fate { strides_to_fall, survival }
    }
}

/// Particles drawn again in proportion to their chances, at even distances.
fn redraw(states: &[Vec<f64>], chances: &[f64], rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let total: f64 = chances.iter().sum();
    if total <= 0.0 {
        return states.to_vec();
    }
    let step = total / states.len() as f64;
    let (mut at, mut passed, mut i) = (rng.random::<f64>() * step, chances[0], 0);
    let mut kept = Vec::with_capacity(states.len());
    for _ in 0..states.len() {
        while passed < at && i + 1 < states.len() {
            i += 1;
            passed += chances[i];
        }
        kept.push(states[i].clone());
        at += step;
    }
    kept
}

/// Student's distribution function from a table over asinh t: a matrix asks it thousands of times.
struct Below {
    table: Vec<f64>,
}

impl Below {
    const HALF: f64 = 9.0;
    const KNOTS: usize = 1800;

    fn new(dof: f64) -> Self {
        let noise = StudentsT::new(0.0, 1.0, dof).ok();
        let knot = |i: usize| (2.0 * Self::HALF * i as f64 / Self::KNOTS as f64 - Self::HALF).sinh();
        let of = |i: usize| noise.as_ref().map_or(0.5, |n| n.cdf(knot(i)));
        Self { table: (0..=Self::KNOTS).map(of).collect() }
    }

    fn at(&self, t: f64) -> f64 {
        let at = (t.asinh() + Self::HALF) * Self::KNOTS as f64 / (2.0 * Self::HALF);
        let at = at.clamp(0.0, Self::KNOTS as f64 - 1e-6);
        let i = at as usize;
        self.table[i] + (at - i as f64) * (self.table[i + 1] - self.table[i])
    }
}

fn student(dof: f64, rng: &mut ChaCha8Rng) -> f64 {
    crate::small::normal(rng) / (2.0 * gamma(0.5 * dof, rng) / dof).sqrt()
}

/// Falls that no state foretold — the next slope decided — make the map's chance of a fall wrong by an unknown factor:
/// log-normal with standard deviation 1.2, and the falls counted tell it.
fn correct(fates: &[Fate], falls: usize, strides: usize, rng: &mut ChaCha8Rng) -> Vec<Fate> {
    const SPREAD: f64 = 1.2;
    let grid: Vec<f64> = (-30..=30).map(|i| 0.1 * f64::from(i)).collect();
    let of = |fate: &Fate, z: f64| {
        let expected = strides as f64 / fate.strides_to_fall * (SPREAD * z).exp();
        -0.5 * z * z + falls as f64 * expected.max(1e-300).ln() - expected
    };
    let each: Vec<(usize, f64, f64)> =
        fates.iter().enumerate().flat_map(|(i, fate)| grid.iter().map(move |z| (i, *z, of(fate, *z)))).collect();
    let most = each.iter().map(|e| e.2).fold(f64::NEG_INFINITY, f64::max);
    let total: f64 = each.iter().map(|e| (e.2 - most).exp()).sum();
    let draws = 2 * fates.len();
    let step = total / draws as f64;
    let (mut at, mut passed) = (rng.random::<f64>() * step, 0.0);
    let mut kept = Vec::with_capacity(draws);
    for (i, z, log) in each {
        passed += (log - most).exp();
        while at < passed && kept.len() < draws {
            let factor = (SPREAD * z).exp();
            let survival = fates[i].survival.iter().map(|s| s.max(1e-300).powf(factor)).collect();
            kept.push(Fate { strides_to_fall: (fates[i].strides_to_fall / factor).max(1.0), survival });
            at += step;
        }
    }
    kept
}

/// What draws say: both ends of the mean number of strides to a fall, and of the chance of one within the walk.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Interval {
    pub strides_to_fall: Bounds,
    pub probability: Bounds,
    /// Survival at each stride: low, middle, high.
    pub survival: Vec<[f64; 3]>,
}

/// The interval of a record, for walks of `strides`; `component` is that of the rule.
pub(crate) fn interval(record: &Record, component: usize, rule: &FallRule, strides: usize, seed: u64) -> Interval {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(20);
    let learned = Learned::of(record, component, rule, &mut rng);
    let mut fates = learned.fates(strides, &mut rng);
    let untold = record.bouts.iter().filter(|b| b.fell && b.fallen_state.is_none()).count();
    if untold > 0 {
        fates = correct(&fates, record.falls(), record.strides(), &mut rng);
    }
    let ends = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        [0.025, 0.5, 0.975].map(|q| quantile(&values, q))
    };
    let [low, _, high] = ends(fates.iter().map(|f| f.strides_to_fall).collect());
    let survival: Vec<[f64; 3]> = (0..=strides).map(|k| ends(fates.iter().map(|f| f.survival[k]).collect())).collect();
    let last = survival[strides];
    Interval {
        strides_to_fall: Bounds { low, high },
        probability: Bounds { low: 1.0 - last[2], high: 1.0 - last[0] },
        survival,
    }
}

/// The upper end of the chance of a fall within a walk, from the number of falls alone (Jeffreys).
pub(crate) fn by_counts(falls: usize, strides: usize, walk: usize) -> f64 {
    let (a, b) = (falls as f64 + 0.5, strides.saturating_sub(falls) as f64 + 0.5);
    let hazard = Beta::new(a, b).map_or(1.0, |d| d.inverse_cdf(0.975));
    1.0 - (1.0 - hazard).powf(walk as f64)
}

/// What is said of falls under a rule about the component number `first`, and what is refused; `one_map` says whether one
/// map holds for the whole record.
pub(crate) fn bounds(
    record: &Record,
    first: usize,
    rule: &FallRule,
    one_map: bool,
    seed: u64,
) -> (FallBounds, Vec<Refusal>, Option<Interval>) {
    let mut refused = Vec::new();
    let walk = record.stride_s.map(|s| (60.0 / s).round().clamp(1.0, 1e5) as usize);
    let strides = record.strides();
    let values: Vec<f64> = record.bouts.iter().flat_map(|b| b.states.iter().map(move |x| x[first])).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let std = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
    let sign = if rule.below { 1.0 } else { -1.0 };
    let nearest = values.iter().map(|x| sign * (x - rule.boundary)).fold(f64::INFINITY, f64::min);
    let boundary_sd = nearest / std;
    let because = if strides < FEWEST {
        Some(("short_record", "60 strides"))
    } else if record.state.len() > MOST_DIMENSIONS {
        Some(("too_many_components", "name at most three components of the state"))
    } else if !one_map {
        Some(("check_failed", "a record in which the gait does not change, or more of the state (--state)"))
    } else {
        None
    };
    let mut said = FallBounds {
        rule: rule.to_string(),
        probability_60_s: None,
        strides_to_fall: None,
        counts_only: CountsOnly { probability_60_s_high: walk.map(|walk| by_counts(record.falls(), strides, walk)) },
        boundary_sd,
    };
    if walk.is_none() {
        let remedy = "a column time_s, or --stride-s";
        refused.push(Refusal::new("fall.probability_60_s", "strides_have_no_duration", remedy));
    }
    if let Some((because, remedy)) = because {
        refused.push(Refusal::new("fall.strides_to_fall", because, remedy));
        if walk.is_some() {
            refused.push(Refusal::new("fall.probability_60_s", because, remedy));
        }
        return (said, refused, None);
    }
    let found = interval(record, first, rule, walk.unwrap_or(FEWEST), seed);
    let far = boundary_sd > FAR_SD;
    if walk.is_some() {
        let low = if far { 0.0 } else { found.probability.low };
        said.probability_60_s = Some(Bounds { low, high: found.probability.high });
    }
    let Bounds { low, high } = found.strides_to_fall;
    if far {
        let remedy = "a record that comes nearer to the boundary: pushes, a rougher floor";
        refused.push(Refusal::new("fall.strides_to_fall", "boundary_far_from_all_strides", remedy));
    } else {
        let wide = high / low > 100.0;
        said.strides_to_fall = Some(StridesToFall { low, high: Some(high).filter(|_| !wide) });
        if wide {
            let remedy = "more strides near the boundary";
            refused.push(Refusal::new("fall.strides_to_fall.value", "interval_over_two_decades", remedy));
        }
    }
    (said, refused, Some(found))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;

    #[test]
    fn the_table_of_students_distribution_is_near_enough() {
        for dof in [2.5, 7.0, 200.0] {
            let (table, exact) = (Below::new(dof), StudentsT::new(0.0, 1.0, dof).unwrap());
            for t in [-6.0, -3.3, -1.01, 0.0, 0.4, 2.2, 30.0] {
                assert!((table.at(t) / exact.cdf(t) - 1.0).abs() < 0.01, "{dof} {t}");
            }
        }
    }

    #[test]
    fn counts_alone_say_what_the_recipe_measured() {
        // No fall in 100 strides: at most 0.78 in 60.
        assert!((by_counts(0, 100, 60) - 0.78).abs() < 0.005, "{}", by_counts(0, 100, 60));
        assert!(by_counts(1, 100, 60) > by_counts(0, 100, 60));
    }
}
