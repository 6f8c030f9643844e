//! How a map is fitted and how strides are drawn from it.

use serde::{Deserialize, Serialize};
use stridemap_gp::{Bounds, FitOptions, Kernel, Mean, Range, Regressor, RegressorKind};

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_gp::Prediction;
use stridemap_process::{ProcessError, Situation};

/// What a map looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapInput {
    /// x(k).
    State,
    /// u(k).
    Action,
    /// u(k−1): what a state at the section cannot show of the stride before.
    LastAction,
}

/// What a stride in the map draws from the predictive distribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapDraw {
    /// The next observation: latent variance plus noise \[MA09, eqs. (11)–(13) with (10)\].
    Full,
    /// The latent function alone.
    Latent,
    /// The mean: a map without uncertainty.
    Mean,
}

/// Where episodes in a map start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapStart {
    /// Anywhere in the start range, uniformly.
    Uniform,
    /// At a state of the data, drawn at random, with the action that led to it.
    Data,
}

/// How a map is fitted and how strides are drawn from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapConfig {
    /// What the map looks at, in this order.
    pub inputs: Vec<MapInput>,
    /// Components of the state on which the dynamics do not depend, by index, mirrored from stride to
    /// stride: a heading, for no direction on the floor is special. The map does not look at them and
    /// learns their change,
    ///
    /// ```text
    /// x'ᵢ = −(xᵢ + change(other states, actions))
    /// ```
    ///
    /// Not in task files: the components of the state say it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invariant: Vec<usize>,
    /// Components of the last action that the map looks at, by index, where it looks at the last action;
    /// left out: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remembered: Option<Vec<usize>>,
    /// Which Gaussian process: `"exact"` up to some thousand strides, `"sparse"` for any number.
    #[serde(default, skip_serializing_if = "is_exact")]
    pub regressor: RegressorKind,
    /// Covariance function.
    pub kernel: Kernel,
    /// Mean function.
    pub mean: Mean,
    /// Searches for the hyperparameters, the first from the spread of the data.
    pub starts: usize,
    /// Smallest length scale per input; left out: a hundredth of the spread of the data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_length_scales: Option<Vec<f64>>,
    /// Smallest noise standard deviation of each component of the next state; left out: a
    /// ten-thousandth of the spread of the data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_noise_std: Option<Vec<f64>>,
    /// What a stride draws.
    pub draw: MapDraw,
    /// Next states are kept within `[lowest, highest]`, per component of the state.
    pub state_range: Vec<[f64; 2]>,
    /// Where episodes in the map start.
    pub start: MapStart,
    /// `[lowest, highest]` per component of the state, for [`MapStart::Uniform`] and for figures.
    pub start_range: Vec<[f64; 2]>,
    /// What is known before the robot's first stride, in tasks with goals: `"simulate"` (strides on the robot without its
    /// changes come first, free), or the directory of a run that learned a map of goals. Left out: nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<String>,
}

fn is_exact(kind: &RegressorKind) -> bool {
    *kind == RegressorKind::Exact
}

impl MapConfig {
    /// Checks every value for a process of `states` and `actions` components.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] that names the key at fault.
    pub fn validate(&self, states: usize, actions: usize) -> Result<(), ProcessError> {
        let bad = |name, value, requirement| Err(ProcessError::Parameter { name, value, requirement });
        if let Some(&i) = self.invariant.iter().find(|i| **i >= states) {
            return bad("map.invariant", i as f64, "must be a component of the state");
        }
        let dims = self.dims(states, actions);
        for input in [MapInput::State, MapInput::Action] {
            if !self.inputs.contains(&input) {
                return bad("map.inputs", 0.0, "must name \"state\" and \"action\"");
            }
        }
        if self.inputs.len() > 3 || (1..self.inputs.len()).any(|i| self.inputs[..i].contains(&self.inputs[i])) {
            return bad("map.inputs", self.inputs.len() as f64, "must name each input once");
        }
        let beyond = |components: &Vec<usize>| components.iter().find(|i| **i >= actions).copied();
        if let Some(i) = self.remembered.as_ref().and_then(beyond) {
            return bad("map.remembered", i as f64, "must be a component of the action");
        }
        if self.starts == 0 {
            return bad("map.starts", 0.0, "must be at least 1");
        }
        if let Some(scales) = &self.min_length_scales {
            if scales.len() != dims {
                return bad("map.min_length_scales", scales.len() as f64, "needs one entry per input dimension");
            }
            if let Some(&scale) = scales.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
                return bad("map.min_length_scales", scale, "must be positive");
            }
        }
        if let Some(stds) = &self.min_noise_std {
            if stds.len() != states {
                return bad("map.min_noise_std", stds.len() as f64, "needs one entry per component of the state");
            }
            if let Some(&std) = stds.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
                return bad("map.min_noise_std", std, "must be positive");
            }
        }
        for (name, ranges) in [("map.state_range", &self.state_range), ("map.start_range", &self.start_range)] {
            if ranges.len() != states {
                return bad(name, ranges.len() as f64, "needs one [lowest, highest] per component of the state");
            }
            if let Some([low, _]) = ranges.iter().find(|[low, high]| low.is_nan() || high.is_nan() || low > high) {
                return bad(name, *low, "must begin below its end");
            }
        }
        if let Some([low, _]) = self.start_range.iter().find(|[l, h]| !(l.is_finite() && h.is_finite())) {
            return bad("map.start_range", *low, "must be finite");
        }
        Ok(())
    }

    /// Input dimensions of the map.
    #[must_use]
    pub fn dims(&self, states: usize, actions: usize) -> usize {
        let width = |input: &MapInput| match input {
            MapInput::State => states.saturating_sub(self.invariant.len()),
            MapInput::Action => actions,
            MapInput::LastAction => self.remembered.as_ref().map_or(actions, Vec::len),
        };
        self.inputs.iter().map(width).sum()
    }

    /// What the map sees, in the order of its input dimensions.
    pub(crate) fn input_row(&self, at: &Situation, action: &[f64], row: &mut Vec<f64>) {
        self.chosen(&at.state, action, &at.last_action, row);
    }

    /// The same of values or of their names.
    pub(crate) fn chosen<T: Clone>(&self, state: &[T], action: &[T], last_action: &[T], row: &mut Vec<T>) {
        for input in &self.inputs {
            match input {
                MapInput::State if self.invariant.is_empty() => row.extend_from_slice(state),
                MapInput::State => {
                    let seen = state.iter().enumerate();
                    let seen = seen.filter(|(i, _)| !self.is_invariant(*i));
                    row.extend(seen.map(|(_, x)| x.clone()));
                }
                MapInput::Action => row.extend_from_slice(action),
                MapInput::LastAction => match &self.remembered {
                    None => row.extend_from_slice(last_action),
                    Some(components) => {
                        row.extend(components.iter().map(|i| last_action[*i].clone()));
                    }
                },
            }
        }
    }

    /// Whether the dynamics do not depend on a component of the state.
    #[must_use]
    pub fn is_invariant(&self, component: usize) -> bool {
        self.invariant.contains(&component)
    }

    /// What the Gaussian process of a component is fitted to: its next value, or the change of an
    /// invariant one.
    pub(crate) fn target(&self, component: usize, state: &[f64], next: f64) -> f64 {
        if self.is_invariant(component) { -(next + state[component]) } else { next }
    }

    /// The next value of a component from what its Gaussian process says: the inverse of
    /// [`Self::target`].
    pub(crate) fn next(&self, component: usize, state: &[f64], target: f64) -> f64 {
        if self.is_invariant(component) { -(target + state[component]) } else { target }
    }

    /// What a stride draws of an output.
    pub(crate) fn draw(&self, gp: &dyn Regressor, at: Prediction, rng: &mut ChaCha8Rng) -> f64 {
        let variance = match self.draw {
            MapDraw::Full => at.latent_variance + gp.hyperparameters().noise_variance,
            MapDraw::Latent => at.latent_variance,
            MapDraw::Mean => return at.mean,
        };
        let z: f64 = StandardNormal.sample(rng);
        at.mean + variance.sqrt() * z
    }

    /// Search options for one output. The upper bounds, and lower ones not given, follow the spread of
    /// the data.
    pub(crate) fn fit_options(&self, inputs: &[f64], y: &[f64], noise_std: Option<f64>) -> FitOptions {
        let spread = |values: &mut dyn Iterator<Item = f64>| {
            let values: Vec<f64> = values.collect();
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
            if stridemap_gp::spread(&values) > 0.0 { variance.sqrt() } else { 1.0 }
        };
        let length_scales = self.min_length_scales.as_ref().map(|lower| {
            let dims = lower.len();
            (0..dims)
                .map(|d| {
                    let s = spread(&mut inputs.iter().skip(d).step_by(dims).copied());
                    Range::new(lower[d], (1e3 * s).max(lower[d]))
                })
                .collect()
        });
        let noise_variance = noise_std.map(|std| {
            let s = spread(&mut y.iter().copied());
            Range::new(std * std, (10.0 * s * s).max(std * std))
        });
        FitOptions {
            kernel: self.kernel,
            mean: self.mean,
            starts: self.starts,
            bounds: Bounds { length_scales, signal_variance: None, noise_variance },
            ..FitOptions::default()
        }
    }
}
