//! The map learned of a robot: one Gaussian process per component of the next state, and one for the
//! reward where the next state does not determine it \[MA09, sec. 4.2 and 7.2\].

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_gp::{Fitted, Points, RegressorKind, Scratch, check_memory};
use stridemap_process::{
    Action, ActionLaw, ActionLimits, Foresight, Goal, MeanMap, ProcessError, ProcessSpec, Situation, State, Stride,
    StrideEnd, StrideProcess, clipped_action,
};

use crate::error::MapError;
use crate::map_config::{MapConfig, MapDraw, MapStart};
use crate::saved_map::{FORMAT, SavedMap, SavedOutput};
use crate::stability::{Linearization, linearize};

/// One stride of the robot, as the map needs it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapSample {
    /// x(k) and u(k−1).
    pub at: Situation,
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

impl MapFailure {
    /// Whether this next state is a fall.
    #[must_use]
    pub fn fell(&self, next_state: &[f64]) -> bool {
        self.component.is_some_and(|c| next_state[c] < self.below)
    }
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

/// Where a map is evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPoint {
    /// x(k) and u(k−1).
    pub at: Situation,
    /// u(k).
    pub action: Action,
}

/// A prediction of one stride.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapPrediction {
    /// Mean of each component of the next state.
    pub means: State,
    /// Variance of the latent function of each component, in its unit squared.
    pub latent_variances: State,
    /// Mean and latent variance of the reward, where the next state does not determine it.
    pub reward: Option<(f64, f64)>,
}

/// The learned map as a [`StrideProcess`].
#[derive(Clone)]
pub struct LearnedMap {
    config: MapConfig,
    world: MapWorld,
    samples: Arc<Vec<MapSample>>,
    outputs: Arc<Vec<Fitted>>,
    reward: Option<Arc<Fitted>>,
    law: ActionLaw,
    /// Where the next stride begins, if it may; where the last one began, and what was predicted of it.
    at: Situation,
    is_ready: bool,
    from: Situation,
    predicted: MapPrediction,
    row: Vec<f64>,
    scratch: Scratch,
}

/// Makes columns of nothing but the rounding of zero what they are. A Gaussian process knows no units and takes
/// 10⁻¹⁷ for a number; of degrees, metres and seconds it is none.
fn settle(values: &mut [f64], columns: usize) {
    const ROUNDING: f64 = 1e-15;
    for column in 0..columns {
        let mut cells = values.iter().skip(column).step_by(columns);
        if cells.all(|v| v.abs() < ROUNDING) {
            let cells = values.iter_mut().skip(column).step_by(columns);
            cells.for_each(|v| *v = 0.0);
        }
    }
}

impl LearnedMap {
    /// Fits the map to strides by type-II maximum likelihood.
    ///
    /// # Errors
    ///
    /// [`MapError::Process`] for a configuration outside its domain, [`MapError::Gp`] if a
    /// Gaussian process cannot be fitted.
    ///
    /// # Cost
    ///
    /// `O(starts · N³)` per output for N strides, about a millisecond for 100; sparse, seconds for 50,000.
    pub fn fit(
        config: MapConfig,
        world: MapWorld,
        samples: &[MapSample],
        rng: &mut ChaCha8Rng,
    ) -> Result<Self, MapError> {
        let (states, actions) = (world.spec.state.len(), world.spec.action.len());
        config.validate(states, actions)?;
        if config.regressor == RegressorKind::Exact {
            check_memory(samples.len(), states + usize::from(world.reward.is_none()))?;
        }
        let dims = config.dims(states, actions);
        let mut inputs = Vec::with_capacity(samples.len() * dims);
        for s in samples {
            config.input_row(&s.at, &s.action, &mut inputs);
        }
        settle(&mut inputs, dims);
        let points = Points::new(&inputs, dims)?;
        let mut outputs = Vec::with_capacity(states);
        for component in 0..states {
            let target = |s: &MapSample| config.target(component, &s.at.state, s.next_state[component]);
            let mut y: Vec<f64> = samples.iter().map(target).collect();
            settle(&mut y, 1);
            let noise = config.min_noise_std.as_ref().map(|stds| stds[component]);
            outputs.push(Fitted::fit(config.regressor, points, &y, &config.fit_options(&inputs, &y, noise), rng)?);
        }
        let reward = if world.reward.is_none() {
            let y: Vec<f64> = samples.iter().map(|s| s.reward).collect();
            Some(Arc::new(Fitted::fit(config.regressor, points, &y, &config.fit_options(&inputs, &y, None), rng)?))
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
            at: Situation::default(),
            is_ready: false,
            from: Situation::default(),
            predicted: MapPrediction::default(),
            row: Vec::with_capacity(dims),
            scratch: Scratch::new(),
        })
    }

    /// What it knows of the task.
    #[must_use]
    pub const fn world(&self) -> &MapWorld {
        &self.world
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
    pub fn outputs(&self) -> &[Fitted] {
        &self.outputs
    }

    /// The Gaussian process of the reward, where the next state does not determine it.
    #[must_use]
    pub fn reward_output(&self) -> Option<&Fitted> {
        self.reward.as_deref()
    }

    /// The log marginal likelihood of each output, the reward's last.
    #[must_use]
    pub fn log_marginal_likelihoods(&self) -> Vec<f64> {
        let all = self.outputs.iter().chain(self.reward.as_deref());
        all.map(|gp| gp.log_marginal_likelihood()).collect()
    }

    /// Predicts the next state and, where it has a Gaussian process of its own, the reward.
    ///
    /// # Errors
    ///
    /// [`MapError::Gp`] for inputs that are not finite.
    pub fn predict(&self, at: &Situation, action: &[f64]) -> Result<MapPrediction, MapError> {
        let mut row = Vec::new();
        self.config.input_row(at, action, &mut row);
        let (mut means, mut latent_variances) = (State::new(), State::new());
        for (i, gp) in self.outputs.iter().enumerate() {
            let p = gp.predict(&row)?;
            means.push(self.config.next(i, &at.state, p.mean));
            latent_variances.push(p.latent_variance);
        }
        let reward = self.reward.as_ref().map(|gp| gp.predict(&row)).transpose()?;
        Ok(MapPrediction { means, latent_variances, reward: reward.map(|p| (p.mean, p.latent_variance)) })
    }

    /// Slopes of the next state by central differences, and what the map does not know of them.
    ///
    /// # Arguments
    ///
    /// - `moves` – per direction a point ahead, a point behind, and half the way between them.
    ///
    /// # Returns
    ///
    /// The slopes, components of the state by directions; and for each component the posterior
    /// covariance of its row of slopes, from the joint distribution of the latent function at all
    /// points \[RW06, eq. (2.24)\].
    ///
    /// # Errors
    ///
    /// [`MapError::Gp`] for inputs that are not finite.
    pub fn slopes(&self, moves: &[(MapPoint, MapPoint, f64)]) -> Result<(DMatrix<f64>, Vec<DMatrix<f64>>), MapError> {
        let count = moves.len();
        let dims = self.config.dims(self.world.spec.state.len(), self.world.spec.action.len());
        let mut inputs = Vec::with_capacity(2 * count * dims);
        for p in moves.iter().flat_map(|(ahead, behind, _)| [ahead, behind]) {
            self.config.input_row(&p.at, &p.action, &mut inputs);
        }
        let points = Points::new(&inputs, dims)?;
        // The difference quotient: slopes = D f, with two entries a row.
        let mut quotient = DMatrix::zeros(count, 2 * count);
        for (d, (_, _, half)) in moves.iter().enumerate() {
            quotient[(d, 2 * d)] = 0.5 / half;
            quotient[(d, 2 * d + 1)] = -0.5 / half;
        }
        let mut slopes = DMatrix::zeros(self.outputs.len(), count);
        let mut covariances = Vec::with_capacity(self.outputs.len());
        for (i, gp) in self.outputs.iter().enumerate() {
            let joint = gp.predict_joint(points)?;
            let next = moves
                .iter()
                .flat_map(|(ahead, behind, _)| [ahead, behind])
                .zip(&joint.mean)
                .map(|(p, mean)| self.config.next(i, &p.at.state, *mean));
            let values = DVector::from_iterator(2 * count, next);
            slopes.set_row(i, &(&quotient * values).transpose());
            let covariance = DMatrix::from_row_slice(2 * count, 2 * count, &joint.covariance);
            covariances.push(&quotient * covariance * quotient.transpose());
        }
        Ok((slopes, covariances))
    }

    /// The same map, of which strides draw something else.
    #[must_use]
    pub fn drawing(mut self, draw: MapDraw) -> Self {
        self.config.draw = draw;
        self
    }

    /// The same map, in which another next state is a fall.
    #[must_use]
    pub fn failing(mut self, failure: MapFailure) -> Self {
        self.world.failure = failure;
        self
    }

    /// Starts an episode in a situation of the caller's choice: x(0), u(−1) and a goal.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Length`] if it has other components than the process; [`ProcessError::Parameter`] for one that is
    /// not finite.
    pub fn start_at(&mut self, at: Situation) -> Result<(), ProcessError> {
        let spec = &self.world.spec;
        for (what, found, expected) in
            [("state", at.state.len(), spec.state.len()), ("last action", at.last_action.len(), spec.action.len())]
        {
            if found != expected {
                return Err(ProcessError::Length { what, expected, found });
            }
        }
        if let Some(&value) = at.state.iter().chain(&at.last_action).find(|v| !v.is_finite()) {
            return Err(ProcessError::Parameter { name: "start", value, requirement: "must be finite" });
        }
        self.law.reset_to(at.last_action.clone());
        self.at = at;
        self.is_ready = true;
        Ok(())
    }

    /// Draws the next state from the predictive distribution, as a stride does; the action is taken as it is, and
    /// nothing is a fall.
    ///
    /// # Errors
    ///
    /// [`MapError::Gp`] for inputs that are not finite.
    pub fn sample(&self, at: &Situation, action: &[f64], rng: &mut ChaCha8Rng) -> Result<State, MapError> {
        let mut row = Vec::new();
        self.config.input_row(at, action, &mut row);
        let drawn = self.outputs.iter().zip(&self.config.state_range).enumerate();
        let drawn = drawn.map(|(i, (gp, [low, high]))| {
            let drawn = self.config.draw(&**gp, gp.predict(&row)?, rng);
            Ok(self.config.next(i, &at.state, drawn).clamp(*low, *high))
        });
        drawn.collect()
    }

    /// Derivatives of the mean by state and action, by central differences of a thousandth of the shortest length
    /// scale; the action is taken as it is.
    ///
    /// # Errors
    ///
    /// As [`linearize`].
    pub fn linearized(&self, at: &Situation, action: &[f64]) -> Result<Linearization, MapError> {
        struct Unclipped<'a>(&'a LearnedMap);
        impl MeanMap for Unclipped<'_> {
            fn mean_next_state(&self, at: &Situation, action: &[f64]) -> Result<State, ProcessError> {
                Ok(self.0.predict(at, action)?.means)
            }
        }
        const SHARE: f64 = 1e-3;
        let scales = self.outputs.iter().flat_map(|gp| &gp.hyperparameters().length_scales);
        let step = SHARE * scales.copied().fold(f64::INFINITY, f64::min);
        let steps = vec![step; at.state.len().max(action.len())];
        linearize(&Unclipped(self), at, action, &steps[..at.state.len()], &steps[..action.len()])
    }

    /// What is kept of the map in a file.
    ///
    /// # Errors
    ///
    /// [`MapError::Gp`] if the leave-one-out scores cannot be computed.
    pub fn to_saved(&self, iteration: usize) -> Result<SavedMap, MapError> {
        let spec = &self.world.spec;
        let mut names: Vec<String> = spec.state.iter().map(|d| d.name.clone()).collect();
        let action: Vec<String> = spec.action.iter().map(|d| d.name.clone()).collect();
        let last: Vec<String> = action.iter().map(|name| format!("last_{name}")).collect();
        let mut inputs = Vec::new();
        self.config.chosen(&names, &action, &last, &mut inputs);
        names.push("reward".into());
        let all = self.outputs.iter().chain(self.reward.as_deref());
        let mut outputs: Vec<SavedOutput> =
            all.zip(names).map(|(gp, name)| SavedOutput::of(gp, name, &inputs)).collect::<Result<_, _>>()?;
        // What is shown of an invariant component is its next value, as for the others.
        for &i in &self.config.invariant {
            let shown = &mut outputs[i].leave_one_out;
            for values in [&mut shown.mean, &mut shown.actual] {
                for (value, s) in values.iter_mut().zip(self.samples.iter()) {
                    *value = self.config.next(i, &s.at.state, *value);
                }
            }
        }
        Ok(SavedMap {
            format: FORMAT,
            iteration,
            config: self.config.clone(),
            spec: self.world.spec.clone(),
            samples: self.samples.len(),
            outputs,
        })
    }

    /// A stride as far as it does not depend on a reward: that is the price of a fall, or zero.
    ///
    /// # Errors
    ///
    /// As [`StrideProcess::stride`].
    pub fn imagine(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        if !self.is_ready {
            return Err(ProcessError::NotReset);
        }
        let last_action = self.law.apply(action)?;
        self.is_ready = false;
        std::mem::swap(&mut self.at, &mut self.from);
        let (at, config) = (&self.from, &self.config);
        self.row.clear();
        config.input_row(at, &last_action, &mut self.row);
        let MapPrediction { means, latent_variances, .. } = &mut self.predicted;
        means.clear();
        latent_variances.clear();
        self.at.state.clear();
        for (i, gp) in self.outputs.iter().enumerate() {
            let p = gp.predict_with(&self.row, &mut self.scratch).map_err(MapError::from)?;
            let drawn = config.next(i, &at.state, config.draw(&**gp, p, rng));
            let [low, high] = config.state_range[i];
            self.at.state.push(drawn.clamp(low, high));
            means.push(config.next(i, &at.state, p.mean));
            latent_variances.push(p.latent_variance);
        }
        self.at.last_action = last_action;
        self.at.goal = at.goal.clone();
        self.is_ready = !self.world.failure.fell(&self.at.state);
        let (reward, end) =
            if self.is_ready { (0.0, StrideEnd::Crossing) } else { (self.world.failure.reward, StrideEnd::Fell) };
        Ok(Stride { next: self.at.clone(), reward, end })
    }

    /// Where the stride imagined last began, and what was predicted of it.
    ///
    /// # Errors
    ///
    /// [`MapError::Gp`] if the reward has a Gaussian process of its own, and there was no such stride.
    pub fn imagined(&mut self) -> Result<(&Situation, &MapPrediction), MapError> {
        let reward = self.reward.as_ref().map(|gp| gp.predict(&self.row)).transpose()?;
        self.predicted.reward = reward.map(|p| (p.mean, p.latent_variance));
        Ok((&self.from, &self.predicted))
    }
}

impl MeanMap for LearnedMap {
    fn mean_next_state(&self, at: &Situation, action: &[f64]) -> Result<State, ProcessError> {
        Ok(self.predict(at, &clipped_action(&self.world.spec, action)?)?.means)
    }
}

impl StrideProcess for LearnedMap {
    fn spec(&self) -> &ProcessSpec {
        &self.world.spec
    }

    fn foresight(&self) -> Option<&dyn Foresight> {
        Some(self)
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        self.law.reset();
        let state: State = match self.config.start {
            MapStart::Uniform => {
                self.config.start_range.iter().map(|[low, high]| low + (high - low) * rng.random::<f64>()).collect()
            }
            MapStart::Data => {
                let sample = &self.samples[rng.random_range(0..self.samples.len())];
                self.law.reset_to(sample.at.last_action.clone());
                sample.at.state.clone()
            }
        };
        self.at = Situation { state, last_action: self.law.last().clone(), goal: Goal::new() };
        self.is_ready = true;
        Ok(self.at.clone())
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let mut stride = self.imagine(action, rng)?;
        if stride.end == StrideEnd::Crossing {
            stride.reward = match (&self.world.reward, &self.reward) {
                (Some(of_state), _) => of_state(&stride.next.state),
                (None, Some(gp)) => {
                    let p = gp.predict_with(&self.row, &mut self.scratch).map_err(MapError::from)?;
                    self.config.draw(&***gp, p, rng)
                }
                (None, None) => 0.0,
            };
        }
        Ok(stride)
    }
}
