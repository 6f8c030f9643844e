//! The drift alarm: is the robot that walks still the one that was learned?
//!
//! Each stride the map predicts the next state; what it misses by, over what it says it may miss by, is a standardised
//! residual. Under the policy that was proven, and on the robot that was learned, these have a mean and a scatter of their
//! own (the map is not exact, and its noise was that of exploration), which strides of the policy tell once, for either stance leg
//! and with the memory from one stride to the next taken out. From then on a cumulative sum in each component,
//! both ways, finds a lasting shift ([`crate::cusum`]).

use serde::{Deserialize, Serialize};
use stridemap_map::LearnedMap;
use stridemap_process::StrideEnd;
use stridemap_record::Transition;
use stridemap_robot::Side;

use crate::algorithm::fit_map;
use crate::cusum::{Cusum, shift_found_within, threshold_for};
use crate::error::LabError;
use crate::run::FinishedRun;

/// False alarms in 1,000 strides for which the threshold is set.
pub const FALSE_ALARMS_PER_1000: f64 = 0.25;
/// Strides of an episode that are not looked at: the policy takes over from the start.
pub const SETTLE_STRIDES: usize = 14;
/// Fewest settled strides that say what the robot does by itself.
pub const FEWEST: usize = 40;
/// A scatter under this share of what the map itself says it may miss by counts as this: what is lost in that is no drift. (With a
/// fifth, a disturbed start of the biped stepping was taken for a drift in 12 of 20 walks.)
const LEAST_SCATTER: f64 = 1.0;
/// Most memory from stride to stride that is taken out.
const MOST_MEMORY: f64 = 0.8;

/// What one component of the state does by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Usual {
    /// Mean standardised residual, on the left leg, on the right, and on one that is not known.
    mean: [f64; 3],
    /// Memory: the part of a deviation that is there again one stride later.
    memory: f64,
    /// Standard deviation of what is new in a stride.
    scatter: f64,
}

/// A change that is found, and within how many strides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Detectable {
    /// Component of the state.
    pub component: String,
    /// Shift of its next value, in its unit.
    pub shift: f64,
    /// Strides in which that is found, on average.
    pub within_strides: f64,
}

/// An alarm: the robot is no longer the one that was learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriftAlarm {
    /// The stride, from 1.
    pub stride: usize,
    /// Component of the state that drifted farthest.
    pub component: String,
    /// Whether it is larger or smaller than the map says.
    pub larger: bool,
    /// The sum, and the threshold that it passed.
    pub sum: f64,
    /// The threshold.
    pub threshold: f64,
}

/// Watches strides as they come.
pub struct DriftMonitor {
    map: LearnedMap,
    names: Vec<String>,
    usual: Vec<Option<Usual>>,
    threshold: f64,
    learned: usize,
    /// What the map may miss by at a typical stride, by component, in its unit.
    typical: Vec<f64>,
    sums: Vec<Cusum>,
    last: Vec<Option<f64>>,
    strides: usize,
}

const fn of_side(side: Option<Side>) -> usize {
    match side {
        Some(Side::Left) => 0,
        Some(Side::Right) => 1,
        None => 2,
    }
}

/// Mean of some numbers; `None` of none.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
    (n > 0.0).then(|| sum / n)
}

impl Usual {
    /// Of the residuals of settled strides, with the leg of each; an episode's strides follow one another.
    fn of(residuals: &[(usize, f64, bool)]) -> Self {
        let all = mean(residuals.iter().map(|r| r.1)).unwrap_or(0.0);
        let on = |side: usize| mean(residuals.iter().filter(|r| r.0 == side).map(|r| r.1)).unwrap_or(all);
        let means = [on(0), on(1), all];
        let off: Vec<f64> = residuals.iter().map(|r| r.1 - means[r.0]).collect();
        // Pairs within an episode.
        let pairs = || (1..off.len()).filter(|&i| residuals[i].2).map(|i| (off[i - 1], off[i]));
        let (xy, xx) = pairs().fold((0.0, 0.0), |(xy, xx), (x, y)| (xy + x * y, xx + x * x));
        let memory = if xx > 0.0 { (xy / xx).clamp(-MOST_MEMORY, MOST_MEMORY) } else { 0.0 };
        let new = pairs().map(|(x, y)| (y - memory * x).powi(2));
        let scatter = mean(new).unwrap_or(0.0).sqrt().max(LEAST_SCATTER);
        Self { mean: means, memory, scatter }
    }

    /// A residual in standard deviations of what is new in a stride.
    fn step(&self, side: usize, residual: f64, last: Option<f64>) -> f64 {
        (residual - self.mean[side] - self.memory * last.unwrap_or(0.0)) / self.scatter
    }
}

impl DriftMonitor {
    /// A monitor for a map, that learns from strides of the policy on the robot that was learned what they do by themselves.
    ///
    /// # Errors
    ///
    /// [`LabError::TooFewStrides`] with fewer than 40 settled strides; [`LabError::Map`].
    pub fn new(map: LearnedMap, strides: &[Transition]) -> Result<Self, LabError> {
        let names: Vec<String> = map.world().spec.state.iter().map(|d| d.name.clone()).collect();
        let invariant = map.config().invariant.clone();
        let mut seen: Vec<Vec<(usize, f64, bool)>> = vec![Vec::new(); names.len()];
        let mut typical = vec![0.0; names.len()];
        let mut before = None;
        for t in strides.iter().filter(|t| t.k >= SETTLE_STRIDES && t.end == StrideEnd::Crossing) {
            let follows = before == Some((t.episode, t.k.wrapping_sub(1)));
            before = Some((t.episode, t.k));
            for (i, (residual, may_miss)) in residuals(&map, t)?.into_iter().enumerate() {
                seen[i].push((of_side(t.stance), residual, follows));
                typical[i] += may_miss;
            }
        }
        let learned = seen.first().map_or(0, Vec::len);
        if learned < FEWEST {
            return Err(LabError::TooFewStrides { found: learned, needed: FEWEST });
        }
        typical.iter_mut().for_each(|sum| *sum /= learned as f64);
        let usual: Vec<Option<Usual>> =
            seen.iter().enumerate().map(|(i, seen)| (!invariant.contains(&i)).then(|| Usual::of(seen))).collect();
        let sums = 2 * usual.iter().flatten().count();
        // Means are learned for either leg apart: from half of the strides each.
        let threshold = threshold_for(FALSE_ALARMS_PER_1000 / 1000.0, sums, learned / 2);
        let (n, last) = (names.len(), vec![None; names.len()]);
        Ok(Self { map, names, usual, threshold, learned, typical, sums: vec![Cusum::default(); n], last, strides: 0 })
    }

    /// Strides from which it learned what the robot does by itself.
    #[must_use]
    pub const fn learned(&self) -> usize {
        self.learned
    }

    /// What it finds within so many strides on average, by component.
    #[must_use]
    pub fn detectable(&self, within_strides: f64) -> Vec<Detectable> {
        let shift = shift_found_within(within_strides, self.threshold);
        let of = |i: usize| {
            let usual = self.usual[i]?;
            // A lasting shift loses what memory takes out of it.
            let shift = shift * usual.scatter / (1.0 - usual.memory) * self.typical[i];
            Some(Detectable { component: self.names[i].clone(), shift, within_strides })
        };
        (0..self.names.len()).filter_map(of).collect()
    }

    /// Takes a stride; an alarm if the robot is no longer the one that was learned. After one it begins anew.
    ///
    /// # Errors
    ///
    /// [`LabError::Map`].
    pub fn saw(&mut self, t: &Transition) -> Result<Option<DriftAlarm>, LabError> {
        self.strides += 1;
        if t.end != StrideEnd::Crossing || t.k < SETTLE_STRIDES {
            self.begin_anew();
            return Ok(None);
        }
        let mut farthest: Option<(usize, f64)> = None;
        for (i, (residual, _)) in residuals(&self.map, t)?.into_iter().enumerate() {
            let Some(usual) = &self.usual[i] else { continue };
            let side = of_side(t.stance);
            let sum = self.sums[i].step(usual.step(side, residual, self.last[i]));
            self.last[i] = Some(residual - usual.mean[side]);
            if farthest.is_none_or(|(_, most)| sum.abs() > most.abs()) {
                farthest = Some((i, sum));
            }
        }
        let Some((i, sum)) = farthest.filter(|(_, sum)| sum.abs() > self.threshold) else { return Ok(None) };
        self.begin_anew();
        Ok(Some(DriftAlarm {
            stride: self.strides,
            component: self.names[i].clone(),
            larger: sum > 0.0,
            sum: sum.abs(),
            threshold: self.threshold,
        }))
    }

    fn begin_anew(&mut self) {
        self.sums.fill(Cusum::default());
        self.last.fill(None);
    }
}

/// The monitor of a run: its map, and the strides by which its final policy was measured.
///
/// # Errors
///
/// As [`DriftMonitor::new`] and [`fit_map`].
pub fn drift_monitor(run: &FinishedRun) -> Result<DriftMonitor, LabError> {
    let progress = &run.progress;
    let (seed, iteration) = (run.provenance.seed, progress.iterations.len());
    let map = fit_map(&run.task, &progress.transitions, &progress.in_place(), seed, iteration)?;
    DriftMonitor::new(map, &run.final_strides()?)
}

/// What the map misses a stride by, over what it says it may miss by, and that, by component.
fn residuals(map: &LearnedMap, t: &Transition) -> Result<Vec<(f64, f64)>, LabError> {
    let p = map.predict(&t.situation(), &t.action)?;
    let outputs = map.outputs().iter().enumerate();
    let of = |(i, gp): (usize, &stridemap_gp::Fitted)| {
        let may_miss = (p.latent_variances[i] + gp.hyperparameters().noise_variance).sqrt();
        ((t.next_state[i] - p.means[i]) / may_miss, may_miss)
    };
    Ok(outputs.map(of).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algorithm::Algorithm;
    use crate::builtin;
    use crate::plant::Batch;
    use crate::recorder::NoRecorder;
    use crate::seed::{Role, stream};
    use crate::strides::{ActionSource, make_strides};
    use crate::task::Task;
    use crate::walks::disturbed;
    use stridemap_record::{InPlace, StridePhase, StrideRole};

    /// A map of 20 strides of the biped stepping, and 70 strides of its nominal gait: no alarm on that robot from another start; one
    /// soon after 5 kg are added in the middle of the walk, and the robot does not notice the change but by its weight.
    #[test]
    fn a_payload_in_the_middle_of_a_walk_is_found_and_nothing_else() {
        let sets = ["collect.strides=[20]".into(), "record.pose_seconds=0".into()];
        let task = builtin::load("stepping", &sets).unwrap().task;
        let mut algorithm = Algorithm::new(&task, 1).unwrap();
        algorithm.collect(&mut NoRecorder).unwrap();
        let map = fit_map(&task, &algorithm.progress.transitions, &InPlace::default(), 1, 1).unwrap();
        let policy = task.nominal_policy().unwrap();
        let moved = disturbed(&task);
        let heavy = builtin::load("stepping", &["robot.mass_scale=1.0526316".into()]).unwrap().task;
        let walk = |index: u64, change: Option<&Task>, strides: usize| {
            let mut plant = moved.plant().unwrap();
            let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides };
            let mut rng = stream(1, Role::Run, index);
            let before = &mut |plant: &mut crate::plant::Plant, stride: usize| {
                if let Some(to) = change.filter(|_| stride == 30) {
                    plant.change_robot(to.robot.build().unwrap()).unwrap();
                }
            };
            make_strides(&mut plant, &ActionSource::Mean(&policy), batch, &mut rng, before, &mut |_| Ok(())).unwrap()
        };
        let usual = walk(0, None, 70);
        let alarms = |strides: &[Transition]| {
            let mut monitor = DriftMonitor::new(map.clone(), &usual).unwrap();
            strides.iter().filter_map(|t| monitor.saw(t).unwrap()).map(|a| a.stride).collect::<Vec<_>>()
        };
        assert_eq!(alarms(&walk(1, None, 60)), [0; 0]);
        // The same robot in its own place changes nothing, to the bit.
        assert_eq!(walk(1, Some(&task), 40), walk(1, None, 40));
        let found = alarms(&walk(2, Some(&heavy), 60));
        assert!(found.first().is_some_and(|stride| (31..=45).contains(stride)), "{found:?}");
        assert!(DriftMonitor::new(map.clone(), &usual[..40]).is_err(), "too few settled strides");
    }
}
