//! The map behind goals: what a stride will measure, and where it will end, from where it begins and what is done.
//!
//! ```text
//! (x(k), u(k)) ──▶ measures of the stride (speeds, lean, power), with what is not known of them
//!              └─▶ x(k+1)
//! ```
//!
//! One Gaussian process each, a plane plus a smooth rest ([`Grouped`]), of the newest strides. With a prior, another such
//! map, they are fitted to what it leaves: a map that was learned on a simulated robot is corrected by the strides of
//! the real one.

use std::sync::Arc;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use stridemap_gp::{Grouped, GroupedOptions, GroupedScratch, Points, SavedGrouped};

use crate::error::MapError;

/// One stride, as the map of goals needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalSample {
    /// x(k).
    pub state: Vec<f64>,
    /// u(k), as applied.
    pub action: Vec<f64>,
    /// What was measured of it, in the order of [`GoalMapConfig::measures`].
    pub measures: Vec<f64>,
    /// x(k+1); `None` where the stride did not reach the section.
    pub next: Option<Vec<f64>>,
}

/// How a map of goals is fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalMapConfig {
    /// Names of what it predicts of a stride.
    pub measures: Vec<String>,
    /// What counts as one step of each component of the action.
    pub units: Vec<f64>,
    /// Components of the state that are mirrored and on which nothing depends, as in [`MapConfig`](crate::MapConfig).
    pub invariant: Vec<usize>,
    /// Whether it looks at the state; without, a stride is what the action makes of it.
    pub sees_state: bool,
    /// Whether it bends; a plane without.
    pub bends: bool,
    /// Newest strides that it is fitted to.
    pub rows: usize,
}

/// Medians of the priors of a Gaussian process whose inputs and targets have a spread of one: slopes of the plane by the
/// state and by the action, size of the bend, its length scales in state and action, noise.
const MEDIANS: [f64; 6] = [0.6, 0.6, 0.5, 3.6, 2.0, 0.4];
/// Standard deviation of their logarithms.
const LOG_STD: f64 = 0.7;

/// Centre and spread of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Scale {
    centre: f64,
    spread: f64,
}

impl Scale {
    fn of(values: &[f64]) -> Self {
        let n = values.len().max(1) as f64;
        let centre = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / n;
        Self { centre, spread: if variance > 1e-24 { variance.sqrt() } else { 1.0 } }
    }

    fn scaled(&self, value: f64) -> f64 {
        (value - self.centre) / self.spread
    }

    fn unscaled(&self, value: f64) -> f64 {
        self.centre + self.spread * value
    }
}

/// What was fitted to strides.
#[derive(Clone, Debug)]
struct Part {
    outputs: Grouped,
    scales: Vec<Scale>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedPart {
    outputs: SavedGrouped,
    scales: Vec<Scale>,
}

/// A [`GoalMap`] as it is kept in a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedGoalMap {
    config: GoalMapConfig,
    inputs: Vec<Scale>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    measures: Option<SavedPart>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    next: Option<SavedPart>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    prior: Option<Box<SavedGoalMap>>,
}

/// The map behind goals.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "SavedGoalMap", into = "SavedGoalMap")]
pub struct GoalMap {
    config: GoalMapConfig,
    /// Of the components of the state that it sees, then of the action.
    inputs: Vec<Scale>,
    measures: Option<Part>,
    next: Option<Part>,
    prior: Option<Arc<GoalMap>>,
}

impl PartialEq for GoalMap {
    /// By how it was fitted and what to.
    fn eq(&self, other: &Self) -> bool {
        let saved = |part: &Option<Part>| part.as_ref().map(|part| part.outputs.saved().clone());
        self.config == other.config
            && self.inputs == other.inputs
            && saved(&self.measures) == saved(&other.measures)
            && saved(&self.next) == saved(&other.next)
            && self.prior == other.prior
    }
}

/// Memory for predictions.
#[derive(Clone, Debug, Default)]
pub struct GoalScratch {
    measures: GroupedScratch,
    next: GroupedScratch,
    z: Vec<f64>,
    prior: Option<Box<GoalScratch>>,
}

/// Slopes at a point, by central differences.
#[derive(Clone, Debug)]
pub struct GoalSlopes {
    /// Of the measures by the state.
    pub measures_by_state: DMatrix<f64>,
    /// Of the measures by the action.
    pub measures_by_action: DMatrix<f64>,
    /// Of the next state by the state.
    pub next_by_state: DMatrix<f64>,
    /// Of the next state by the action.
    pub next_by_action: DMatrix<f64>,
}

impl GoalMap {
    /// Fits the map to strides; without any it is its prior.
    ///
    /// # Errors
    ///
    /// [`MapError::Gp`] if a Gaussian process cannot be fitted.
    ///
    /// # Cost
    ///
    /// About half a second for 120 strides, nine components of the state and six measures.
    pub fn fit(config: GoalMapConfig, samples: &[GoalSample], prior: Option<Arc<Self>>) -> Result<Self, MapError> {
        let samples = &samples[samples.len().saturating_sub(config.rows)..];
        let mut map = Self { inputs: Vec::new(), measures: None, next: None, prior, config };
        let Some(first) = samples.first() else { return Ok(map) };
        let seen = map.seen(first.state.len());
        let column = |of: &dyn Fn(&GoalSample) -> f64| Scale::of(&samples.iter().map(of).collect::<Vec<_>>());
        map.inputs = seen.iter().map(|&i| column(&|s| s.state[i])).collect();
        for (j, unit) in map.config.units.iter().enumerate() {
            let centre = column(&|s| s.action[j]).centre;
            map.inputs.push(Scale { centre, spread: *unit });
        }
        let mut scratch = GoalScratch::default();
        let mut residuals = Vec::with_capacity(samples.len());
        for s in samples {
            let mut row = s.measures.clone();
            if let Some(prior) = &map.prior {
                prior.look(&s.state, &mut scratch);
                let expected = prior.measures(&s.action, &[], &mut scratch).0;
                row.iter_mut().zip(expected).for_each(|(y, e)| *y -= e);
            }
            residuals.push(row);
        }
        let all: Vec<&GoalSample> = samples.iter().collect();
        let count = map.config.measures.len();
        map.measures = Some(map.part(&all, count, &|i, output| residuals[i][output])?);
        let reached: Vec<&GoalSample> = samples.iter().filter(|s| s.next.is_some()).collect();
        if map.config.sees_state && !reached.is_empty() {
            let mut residuals = Vec::with_capacity(reached.len());
            for s in &reached {
                let next = s.next.clone().unwrap_or_default();
                let mut row: Vec<f64> = (0..next.len()).map(|i| map.changed(i, s.state[i], next[i])).collect();
                if let Some(prior) = &map.prior {
                    prior.look(&s.state, &mut scratch);
                    let expected = prior.raw_next(&s.state, &s.action, &mut scratch);
                    row.iter_mut().zip(expected).for_each(|(y, e)| *y -= e);
                }
                residuals.push(row);
            }
            map.next = Some(map.part(&reached, first.state.len(), &|i, output| residuals[i][output])?);
        }
        Ok(map)
    }

    /// Components of the state that the map looks at.
    fn seen(&self, states: usize) -> Vec<usize> {
        let all = if self.config.sees_state { states } else { 0 };
        (0..all).filter(|i| !self.config.invariant.contains(i)).collect()
    }

    fn part(
        &self,
        samples: &[&GoalSample],
        outputs: usize,
        target: &dyn Fn(usize, usize) -> f64,
    ) -> Result<Part, MapError> {
        let mut inputs = Vec::new();
        for s in samples {
            self.query(&s.state, &s.action, &mut inputs);
        }
        let dims = self.inputs.len();
        let mut scales = Vec::with_capacity(outputs);
        let mut targets = Vec::with_capacity(outputs);
        for output in 0..outputs {
            let y: Vec<f64> = (0..samples.len()).map(|i| target(i, output)).collect();
            let scale = Scale::of(&y);
            targets.push(y.iter().map(|y| scale.scaled(*y)).collect::<Vec<f64>>());
            scales.push(scale);
        }
        let targets: Vec<&[f64]> = targets.iter().map(Vec::as_slice).collect();
        let first = dims - self.config.units.len();
        let options = GroupedOptions { first, bends: self.config.bends, medians: MEDIANS, log_std: LOG_STD };
        Ok(Part { outputs: Grouped::fit(Points::new(&inputs, dims)?, &targets, options)?, scales })
    }

    /// Appends the point that the Gaussian processes are asked at.
    fn query(&self, state: &[f64], action: &[f64], z: &mut Vec<f64>) {
        let (of_state, of_action) = self.inputs.split_at(self.inputs.len() - self.config.units.len());
        z.extend(self.seen(state.len()).iter().zip(of_state).map(|(i, scale)| scale.scaled(state[*i])));
        z.extend(action.iter().zip(of_action).map(|(u, scale)| scale.scaled(*u)));
    }

    fn changed(&self, component: usize, state: f64, next: f64) -> f64 {
        if self.config.invariant.contains(&component) { -(next + state) } else { next }
    }

    /// How it was fitted.
    #[must_use]
    pub const fn config(&self) -> &GoalMapConfig {
        &self.config
    }

    /// Strides that it was fitted to.
    #[must_use]
    pub fn strides(&self) -> usize {
        self.measures.as_ref().map_or(0, |part| part.outputs.len())
    }

    /// Puts the state from which strides are asked for.
    pub fn look(&self, state: &[f64], scratch: &mut GoalScratch) {
        scratch.z.clear();
        let mut z = std::mem::take(&mut scratch.z);
        if !self.inputs.is_empty() {
            self.query(state, &[], &mut z);
            z.resize(self.inputs.len(), 0.0);
            for (part, memory) in [(&self.measures, &mut scratch.measures), (&self.next, &mut scratch.next)] {
                if let Some(part) = part {
                    part.outputs.look_at(0, &z, memory);
                }
            }
        }
        scratch.z = z;
        if let Some(prior) = &self.prior {
            prior.look(state, scratch.prior.get_or_insert_default());
        }
    }

    fn put(&self, action: &[f64], scratch: &mut GoalScratch, next: bool) {
        let first = self.inputs.len() - self.config.units.len();
        for ((z, u), scale) in scratch.z[first..].iter_mut().zip(action).zip(&self.inputs[first..]) {
            *z = scale.scaled(*u);
        }
        let (part, memory) = match next {
            true => (&self.next, &mut scratch.next),
            false => (&self.measures, &mut scratch.measures),
        };
        if let Some(part) = part {
            part.outputs.look_at(1, &scratch.z, memory);
        }
    }

    /// Means of the measures of a stride with an action from the state that was [looked](Self::look) from, and latent
    /// variances of those that are `charged`, zero of the others.
    #[must_use]
    pub fn measures(&self, action: &[f64], charged: &[bool], scratch: &mut GoalScratch) -> (Vec<f64>, Vec<f64>) {
        let count = self.config.measures.len();
        let (mut means, mut variances) = match (&self.prior, &mut scratch.prior) {
            (Some(prior), Some(memory)) => (prior.measures(action, &[], memory).0, vec![0.0; count]),
            _ => (vec![0.0; count], vec![0.0; count]),
        };
        if let Some(part) = &self.measures {
            self.put(action, scratch, false);
            for (i, scale) in part.scales.iter().enumerate() {
                if charged.get(i).is_some_and(|charged| *charged) {
                    let (mean, variance) = part.outputs.predict(i, &mut scratch.measures, &scratch.z);
                    means[i] += scale.unscaled(mean);
                    variances[i] = variance * scale.spread * scale.spread;
                } else {
                    means[i] += scale.unscaled(part.outputs.mean(i, &mut scratch.measures, &scratch.z));
                }
            }
        }
        (means, variances)
    }

    fn raw_next(&self, state: &[f64], action: &[f64], scratch: &mut GoalScratch) -> Vec<f64> {
        let mut next = match (&self.prior, &mut scratch.prior) {
            (Some(prior), Some(memory)) => prior.raw_next(state, action, memory),
            _ => vec![0.0; state.len()],
        };
        match &self.next {
            Some(part) => {
                self.put(action, scratch, true);
                for (i, scale) in part.scales.iter().enumerate() {
                    next[i] += scale.unscaled(part.outputs.mean(i, &mut scratch.next, &scratch.z));
                }
            }
            // Nothing is known: a state stays what it is.
            None if self.prior.is_none() => {
                (0..next.len()).for_each(|i| next[i] = self.changed(i, state[i], state[i]));
            }
            None => {}
        }
        next
    }

    /// Mean of the next state, from the state that was [looked](Self::look) from.
    #[must_use]
    pub fn next_state(&self, state: &[f64], action: &[f64], scratch: &mut GoalScratch) -> Vec<f64> {
        let mut next = self.raw_next(state, action, scratch);
        for &i in &self.config.invariant {
            next[i] = -(next[i] + state[i]);
        }
        next
    }

    /// Slopes of measures and next state at a point.
    #[must_use]
    pub fn slopes(&self, state: &[f64], action: &[f64], scratch: &mut GoalScratch) -> GoalSlopes {
        /// Half the way between two points, in spreads of an input.
        const HALF: f64 = 0.05;
        let (n, m, outputs) = (state.len(), action.len(), self.config.measures.len());
        let mut slopes = GoalSlopes {
            measures_by_state: DMatrix::zeros(outputs, n),
            measures_by_action: DMatrix::zeros(outputs, m),
            next_by_state: DMatrix::zeros(n, n),
            next_by_action: DMatrix::zeros(n, m),
        };
        let steps = self.steps(n);
        for d in 0..n + m {
            let half = HALF * steps[d];
            let mut at = |sign: f64| {
                let (mut x, mut u) = (state.to_vec(), action.to_vec());
                if d < n {
                    x[d] += sign * half
                } else {
                    u[d - n] += sign * half
                }
                self.look(&x, scratch);
                (self.measures(&u, &[], scratch).0, self.next_state(&x, &u, scratch))
            };
            let ((y1, x1), (y0, x0)) = (at(1.0), at(-1.0));
            let (measures, next, column) = if d < n {
                (&mut slopes.measures_by_state, &mut slopes.next_by_state, d)
            } else {
                (&mut slopes.measures_by_action, &mut slopes.next_by_action, d - n)
            };
            for i in 0..outputs {
                measures[(i, column)] = (y1[i] - y0[i]) / (2.0 * half);
            }
            for i in 0..n {
                next[(i, column)] = (x1[i] - x0[i]) / (2.0 * half);
            }
        }
        slopes
    }

    /// Spread of each component of the state and unit of each of the action.
    #[must_use]
    pub fn steps(&self, states: usize) -> Vec<f64> {
        let mut steps = vec![1.0; states];
        match (&self.prior, self.inputs.is_empty()) {
            (Some(prior), true) => return prior.steps(states),
            _ => {
                for (i, scale) in self.seen(states).into_iter().zip(&self.inputs) {
                    steps[i] = scale.spread;
                }
            }
        }
        steps.extend(&self.config.units);
        steps
    }
}

impl From<GoalMap> for SavedGoalMap {
    fn from(map: GoalMap) -> Self {
        let part = |part: Option<Part>| {
            part.map(|part| SavedPart { outputs: part.outputs.saved().clone(), scales: part.scales })
        };
        Self {
            config: map.config,
            inputs: map.inputs,
            measures: part(map.measures),
            next: part(map.next),
            prior: map.prior.map(|prior| Box::new((*prior).clone().into())),
        }
    }
}

impl TryFrom<SavedGoalMap> for GoalMap {
    type Error = MapError;

    fn try_from(saved: SavedGoalMap) -> Result<Self, MapError> {
        let part = |part: Option<SavedPart>| -> Result<Option<Part>, MapError> {
            part.map(|part| Ok(Part { outputs: Grouped::try_from(part.outputs)?, scales: part.scales })).transpose()
        };
        Ok(Self {
            config: saved.config,
            inputs: saved.inputs,
            measures: part(saved.measures)?,
            next: part(saved.next)?,
            prior: saved.prior.map(|prior| Self::try_from(*prior).map(Arc::new)).transpose()?,
        })
    }
}

#[cfg(test)]
mod tests;
