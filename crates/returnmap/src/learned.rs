//! The map learned of a robot: one Gaussian process per component of the next state, and one for the
//! reward where the next state does not determine it \[MA09, sec. 4.2 and 7.2\].

use std::sync::Arc;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_gp::{Bounds, FitOptions, Gp, Kernel, Mean, Points, Range, Scratch};

use crate::action_law::{ActionLaw, ActionLimits};
use crate::process::{
    Action, ProcessError, ProcessSpec, State, Stride, StrideEnd, StrideProcess,
};

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
}

impl MapConfig {
    /// Checks every value for a process of `states` and `actions` components.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] that names the key at fault.
    pub fn validate(&self, states: usize, actions: usize) -> Result<(), ProcessError> {
        let bad =
            |name, value, requirement| Err(ProcessError::Parameter { name, value, requirement });
        let dims = self.dims(states, actions);
        for input in [MapInput::State, MapInput::Action] {
            if !self.inputs.contains(&input) {
                return bad("map.inputs", 0.0, "must name \"state\" and \"action\"");
            }
        }
        if self.inputs.len() > 3 || (1..self.inputs.len()).any(|i| self.inputs[..i].contains(&self.inputs[i])) {
            return bad("map.inputs", self.inputs.len() as f64, "must name each input once");
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
        for (name, ranges) in [
            ("map.state_range", &self.state_range),
            ("map.start_range", &self.start_range),
        ] {
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
            MapInput::State => states,
            MapInput::Action | MapInput::LastAction => actions,
        };
        self.inputs.iter().map(width).sum()
    }

    fn input_row(&self, state: &[f64], action: &[f64], last_action: &[f64], row: &mut Vec<f64>) {
        for input in &self.inputs {
            row.extend_from_slice(match input {
                MapInput::State => state,
                MapInput::Action => action,
                MapInput::LastAction => last_action,
            });
        }
    }
}

/// One stride of the robot, as the map needs it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapSample {
    /// x(k).
    pub state: State,
    /// u(k−1).
    pub last_action: Action,
    /// u(k).
    pub action: Action,
    /// x(k+1).
    pub next_state: State,
    /// r(k+1).
    pub reward: f64,
}

/// The reward of a next state.
pub type StateReward = Arc<dyn Fn(&[f64]) -> f64 + Send + Sync>;

/// A next state below this in one component is a fall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapFailure {
    /// Component of the state; `None` if no state means a fall.
    pub component: Option<usize>,
    /// Where it begins.
    pub below: f64,
    /// What it costs.
    pub reward: f64,
}

/// What a map needs to know of the task beyond its data.
#[derive(Clone)]
pub struct MapWorld {
    /// Names and bounds.
    pub spec: ProcessSpec,
    /// The action law, the same as on the robot.
    pub limits: Vec<ActionLimits>,
    /// When a next state is a fall.
    pub failure: MapFailure,
    /// The reward of a next state; `None`: a Gaussian process of its own predicts it.
    pub reward: Option<StateReward>,
}

/// The learned map as a [`StrideProcess`].
#[derive(Clone)]
pub struct LearnedMap {
    config: MapConfig,
    world: MapWorld,
    samples: Arc<Vec<MapSample>>,
    outputs: Arc<Vec<Gp>>,
    reward: Option<Arc<Gp>>,
    law: ActionLaw,
    state: Option<State>,
    row: Vec<f64>,
    scratch: Scratch,
}

impl LearnedMap {
    /// Fits the map to strides by type-II maximum likelihood.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Parameter`] for a configuration outside its domain, [`ProcessError::Map`] if a
    /// Gaussian process cannot be fitted.
    ///
    /// # Cost
    ///
    /// `O(starts · N³)` per output for N strides: about a millisecond for 100.
    pub fn fit(
        config: MapConfig,
        world: MapWorld,
        samples: &[MapSample],
        rng: &mut ChaCha8Rng,
    ) -> Result<Self, ProcessError> {
        let (states, actions) = (world.spec.state.len(), world.spec.action.len());
        config.validate(states, actions)?;
        let dims = config.dims(states, actions);
        let mut inputs = Vec::with_capacity(samples.len() * dims);
        for s in samples {
            config.input_row(&s.state, &s.action, &s.last_action, &mut inputs);
        }
        let points = Points::new(&inputs, dims)?;
        let mut outputs = Vec::with_capacity(states);
        for component in 0..states {
            let y: Vec<f64> = samples.iter().map(|s| s.next_state[component]).collect();
            let noise = config.min_noise_std.as_ref().map(|stds| stds[component]);
            outputs.push(Gp::fit(points, &y, &options(&config, &inputs, &y, noise), rng)?);
        }
        let reward = if world.reward.is_none() {
            let y: Vec<f64> = samples.iter().map(|s| s.reward).collect();
            Some(Arc::new(Gp::fit(points, &y, &options(&config, &inputs, &y, None), rng)?))
        } else {
            None
        };
        Ok(Self {
            law: ActionLaw::new(world.limits.clone())?,
            config,
            world,
            samples: Arc::new(samples.to_vec()),
            outputs: Arc::new(outputs),
            reward,
            state: None,
            row: Vec::with_capacity(dims),
            scratch: Scratch::new(),
        })
    }

    /// How the map was fitted and is drawn from.
    #[must_use]
    pub const fn config(&self) -> &MapConfig {
        &self.config
    }

    /// The strides that it was fitted to.
    #[must_use]
    pub fn samples(&self) -> &[MapSample] {
        &self.samples
    }

    /// One Gaussian process per component of the next state.
    #[must_use]
    pub fn outputs(&self) -> &[Gp] {
        &self.outputs
    }

    /// The Gaussian process of the reward, where the next state does not determine it.
    #[must_use]
    pub fn reward_output(&self) -> Option<&Gp> {
        self.reward.as_deref()
    }

    /// The log marginal likelihood of each output, the reward's last.
    #[must_use]
    pub fn log_marginal_likelihoods(&self) -> Vec<f64> {
        let all = self.outputs.iter().chain(self.reward.as_deref());
        all.map(Gp::log_marginal_likelihood).collect()
    }

    /// Predicts the next state: means and latent variances, per component.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Map`] for inputs that are not finite.
    pub fn predict(
        &self,
        state: &[f64],
        action: &[f64],
        last_action: &[f64],
    ) -> Result<(State, State), ProcessError> {
        let mut row = Vec::new();
        self.config.input_row(state, action, last_action, &mut row);
        let (mut means, mut variances) = (State::new(), State::new());
        for gp in self.outputs.iter() {
            let p = gp.predict(&row)?;
            means.push(p.mean);
            variances.push(p.latent_variance);
        }
        Ok((means, variances))
    }

    /// Draws from one output at the prepared input row.
    fn draw(&mut self, output: Output, rng: &mut ChaCha8Rng) -> Result<f64, ProcessError> {
        let gp = match output {
            Output::Component(i) => &self.outputs[i],
            Output::Reward(ref gp) => gp.as_ref(),
        };
        let p = gp.predict_with(&self.row, &mut self.scratch)?;
        let variance = match self.config.draw {
            MapDraw::Full => p.latent_variance + gp.hyperparameters().noise_variance,
            MapDraw::Latent => p.latent_variance,
            MapDraw::Mean => return Ok(p.mean),
        };
        let z: f64 = StandardNormal.sample(rng);
        Ok(p.mean + variance.sqrt() * z)
    }
}

enum Output {
    Component(usize),
    Reward(Arc<Gp>),
}

/// Search options for one output. The upper bounds, and lower ones not given, follow the spread of
/// the data.
fn options(config: &MapConfig, inputs: &[f64], y: &[f64], noise_std: Option<f64>) -> FitOptions {
    let spread = |values: &mut dyn Iterator<Item = f64>| {
        let values: Vec<f64> = values.collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        if variance > 0.0 { variance.sqrt() } else { 1.0 }
    };
    let length_scales = config.min_length_scales.as_ref().map(|lower| {
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
        kernel: config.kernel,
        mean: config.mean,
        starts: config.starts,
        bounds: Bounds { length_scales, signal_variance: None, noise_variance },
        ..FitOptions::default()
    }
}

impl StrideProcess for LearnedMap {
    fn spec(&self) -> &ProcessSpec {
        &self.world.spec
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<State, ProcessError> {
        self.law.reset();
        let state: State = match self.config.start {
            MapStart::Uniform => self
                .config
                .start_range
                .iter()
                .map(|[low, high]| low + (high - low) * rng.random::<f64>())
                .collect(),
            MapStart::Data => {
                let sample = &self.samples[rng.random_range(0..self.samples.len())];
                self.law.reset_to(sample.last_action.clone());
                sample.state.clone()
            }
        };
        self.state = Some(state.clone());
        Ok(state)
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let Some(state) = self.state.take() else {
            return Err(ProcessError::NotReset);
        };
        let last_action = self.law.last().clone();
        let action = self.law.apply(action)?;
        let mut row = std::mem::take(&mut self.row);
        row.clear();
        self.config.input_row(&state, &action, &last_action, &mut row);
        self.row = row;
        let mut next_state = State::new();
        for i in 0..self.outputs.len() {
            let drawn = self.draw(Output::Component(i), rng)?;
            let [low, high] = self.config.state_range[i];
            next_state.push(drawn.clamp(low, high));
        }
        let failure = self.world.failure;
        let fell = failure.component.is_some_and(|c| next_state[c] < failure.below);
        let reward = match (&self.world.reward, &self.reward) {
            _ if fell => failure.reward,
            (Some(of_state), _) => of_state(&next_state),
            (None, Some(gp)) => self.draw(Output::Reward(Arc::clone(gp)), rng)?,
            (None, None) => 0.0,
        };
        let end = if fell { StrideEnd::Fell } else { StrideEnd::Crossing };
        if !fell {
            self.state = Some(next_state.clone());
        }
        Ok(Stride { action, next_state, reward, end })
    }
}
