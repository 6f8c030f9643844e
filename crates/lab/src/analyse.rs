//! What a walking run's data and map say: what the last action is worth to the map, and the flip of
//! the map beside the robot's own.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use stridemap_learn::ConstantPolicy;
use stridemap_returnmap::{LearnedMap, MapInput, StrideEnd};

use crate::algorithm::fit_map;
use crate::error::{Invalid, LabError};
use crate::feedback::stride_model;
use crate::reward::StateComponent;
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, Batch, StridePhase, StrideRole, Transition, make_strides};
use crate::task::Task;

/// Every which stride is held out.
const FOLDS: usize = 5;
/// The kick of the free decay, on the action that kicks, deg.
const KICK_DEG: f64 = 1.0;

/// Strides of the ramp from the nominal gait to a constant action.
const RAMP_STRIDES: f64 = 20.0;

/// How well a map that sees this predicts the pitch rate at the next section of strides it has not
/// seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Components of the state among the inputs, by name.
    pub state: Vec<String>,
    /// Whether u(k−1) is among them.
    pub last_action: bool,
    /// Root mean square of the residuals.
    pub residual_deg_s: f64,
    /// Their median magnitude, as a standard deviation: a few strides on the way to a fall do not count.
    pub robust_residual_deg_s: f64,
    /// Strides predicted.
    pub strides: usize,
}

/// The flip at one constant action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flip {
    /// The action.
    pub action: Vec<f64>,
    /// Multiplier of the map most negative in real part, at its steady state under this action.
    pub map: f64,
    /// The robot's own: the factor from stride to stride by which kicks of ±1 deg decay; null where
    /// it fell.
    pub robot: Option<f64>,
}

/// What `analyse` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Analysis {
    /// Predictions of held-out strides: with the paper's state and with the task's, each without and with
    /// the last action.
    pub pitch_rate_residual_deg_s: Vec<HeldOut>,
    /// Flips at three actions inside the data.
    pub flips: Vec<Flip>,
}

fn pitch_rate(task: &Task) -> Result<usize, LabError> {
    let position = task
        .state
        .iter()
        .position(|c| *c == StateComponent::PsiPitchRateDegS);
    position.ok_or_else(|| {
        LabError::Invalid(Invalid {
            key: "state".into(),
            requirement: "the pitch rate is analysed; it must be a component of the state".into(),
        })
    })
}

fn usable(transitions: &[Transition]) -> Vec<&Transition> {
    transitions
        .iter()
        .filter(|t| t.role == StrideRole::Training && t.end == StrideEnd::Crossing)
        .collect()
}

/// Residuals of the pitch rate over all folds.
fn residuals(
    task: &Task,
    transitions: &[&Transition],
    component: usize,
    seed: u64,
) -> Result<Vec<f64>, LabError> {
    let mut all = Vec::with_capacity(transitions.len());
    for fold in 0..FOLDS {
        let train: Vec<Transition> = transitions
            .iter()
            .enumerate()
            .filter(|(i, _)| i % FOLDS != fold)
            .map(|(_, t)| (*t).clone())
            .collect();
        let map = fit_map(task, &train, seed, 0)?;
        for t in transitions.iter().skip(fold).step_by(FOLDS) {
            let (means, _) = map.predict(&t.state, &t.action, &t.last_action)?;
            all.push(t.next_state[component] - means[component]);
        }
    }
    Ok(all)
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// The task and its strides as they would be with these components of the state alone.
fn seeing(task: &Task, strides: &[&Transition], kept: &[usize]) -> (Task, Vec<Transition>) {
    fn pick<T: Clone>(values: &[T], kept: &[usize]) -> Vec<T> {
        kept.iter().map(|i| values[*i].clone()).collect()
    }
    let mut task = task.clone();
    task.state = pick(&task.state, kept);
    task.map.state_range = pick(&task.map.state_range, kept);
    task.map.start_range = pick(&task.map.start_range, kept);
    task.map.min_noise_std = task.map.min_noise_std.map(|stds| pick(&stds, kept));
    task.map.min_length_scales = None;
    let strides = strides.iter().map(|t| Transition {
        state: kept.iter().map(|i| t.state[*i]).collect(),
        next_state: kept.iter().map(|i| t.next_state[*i]).collect(),
        ..(*t).clone()
    });
    (task, strides.collect())
}

/// Held-out residuals of the pitch rate: with the paper's state and with the task's own where that is
/// more, each without and with the last action among the map's inputs.
///
/// # Errors
///
/// [`LabError::TooFewStrides`], or of the map.
pub fn held_out(
    task: &Task,
    transitions: &[Transition],
    seed: u64,
) -> Result<Vec<HeldOut>, LabError> {
    const PAPER: [StateComponent; 3] = [
        StateComponent::PsiRollDeg,
        StateComponent::PsiPitchDeg,
        StateComponent::PsiPitchRateDegS,
    ];
    pitch_rate(task)?;
    let all: Vec<usize> = (0..task.state.len()).collect();
    let of_paper: Vec<usize> = all
        .iter()
        .copied()
        .filter(|i| PAPER.contains(&task.state[*i]))
        .collect();
    let mut views = vec![of_paper];
    if views[0] != all {
        views.push(all);
    }
    let strides = usable(transitions);
    let mut rows = Vec::new();
    for kept in &views {
        let (mut task, strides) = seeing(task, &strides, kept);
        let strides: Vec<&Transition> = strides.iter().collect();
        let component = pitch_rate(&task)?;
        for last_action in [false, true] {
            task.map.inputs = vec![MapInput::State, MapInput::Action];
            if last_action {
                task.map.inputs.push(MapInput::LastAction);
            }
            let found = residuals(&task, &strides, component, seed)?;
            rows.push(HeldOut {
                state: task.state.iter().map(|c| c.name().into()).collect(),
                last_action,
                residual_deg_s: root_mean_square(&found),
                robust_residual_deg_s: crate::algorithm::robust_std(&found),
                strides: found.len(),
            });
        }
    }
    Ok(rows)
}

/// The multiplier most negative in real part of the map's state under a constant action: there the
/// last action is the action, so that it is that of F alone.
fn flip_of_map(map: &LearnedMap, action: &[f64]) -> Result<f64, LabError> {
    let model = stride_model(map, action, &[])?;
    // Components on which nothing depends have multipliers of −1 of their own.
    let invariant = &map.config().invariant;
    let eigenvalues = model
        .of_state
        .remove_rows_at(invariant)
        .remove_columns_at(invariant)
        .complex_eigenvalues();
    Ok(eigenvalues
        .iter()
        .map(|e| e.re)
        .fold(f64::INFINITY, f64::min))
}

/// The factor from stride to stride by which the robot's state decays after kicks of the first
/// component of the action by ±1 deg, at a constant action: least squares over the strides after the
/// kick, on the difference between the kicked run and its twin without a kick.
fn flip_of_robot(task: &Task, action: &[f64], component: usize) -> Result<Option<f64>, LabError> {
    const SETTLE: usize = 50;
    const AFTER: usize = 8;
    // The action law would spread a kick over many strides: without it the kick is one stride's, and
    // the way up to the action is a ramp of our own.
    let mut free = task.clone();
    for action in &mut free.action {
        (action.gain, action.rate_per_stride) = (1.0, None);
    }
    let neutral: Vec<f64> = task.action_limits()?.iter().map(|l| l.neutral).collect();
    let mut decays: Vec<(f64, f64)> = Vec::new();
    let run = |kick: f64| -> Result<Option<Vec<f64>>, LabError> {
        let mut plant = free.plant()?;
        let spec = free.process_spec()?;
        let base = ConstantPolicy::new(spec, action)?;
        let kicked = Kick {
            base: &base,
            neutral: &neutral,
            at: SETTLE,
            kick,
            k: std::sync::atomic::AtomicUsize::new(0),
        };
        let batch = Batch {
            iteration: 0,
            phase: StridePhase::Record,
            role: StrideRole::Record,
            strides: SETTLE + 2 + AFTER,
        };
        let mut rng = stream(0, Role::Check, 3);
        let transitions = make_strides(
            &mut plant,
            &ActionSource::Mean(&kicked),
            batch,
            &mut rng,
            &mut |_, _| {},
            &mut |_| Ok(()),
        )?;
        let stood = transitions.iter().all(|t| t.end == StrideEnd::Crossing);
        Ok(stood.then(|| {
            let after = transitions.iter().skip(SETTLE + 1);
            after.map(|t| t.next_state[component]).collect()
        }))
    };
    let Some(twin) = run(0.0)? else {
        return Ok(None);
    };
    for kick in [KICK_DEG, -KICK_DEG] {
        let Some(kicked) = run(kick)? else {
            return Ok(None);
        };
        let off: Vec<f64> = kicked.iter().zip(&twin).map(|(a, b)| a - b).collect();
        decays.extend(off.windows(2).map(|w| (w[0], w[1])));
    }
    let x = DMatrix::from_iterator(decays.len(), 1, decays.iter().map(|d| d.0));
    let y = DVector::from_iterator(decays.len(), decays.iter().map(|d| d.1));
    let xx = x.norm_squared();
    Ok((xx > 0.0).then(|| (x.transpose() * y)[0] / xx))
}

/// A constant after a ramp, but for one stride.
struct Kick<'a> {
    base: &'a ConstantPolicy,
    neutral: &'a [f64],
    at: usize,
    kick: f64,
    k: std::sync::atomic::AtomicUsize,
}

impl stridemap_learn::Policy for Kick<'_> {
    fn mean(&self, state: &[f64]) -> stridemap_returnmap::Action {
        let k = self.k.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let share = ((k + 1) as f64 / RAMP_STRIDES).min(1.0);
        let mut action = self.base.mean(state);
        for (u, n) in action.iter_mut().zip(self.neutral) {
            *u = n + share * (*u - n);
        }
        if k == self.at {
            action[0] += self.kick;
        }
        action
    }

    fn std(&self, state: &[f64]) -> stridemap_returnmap::Action {
        self.base.std(state)
    }
}

/// Analyses a run: held-out residuals, and flips of the map and of the robot at three shares of the
/// best proven action.
///
/// # Errors
///
/// [`LabError`] of the room at fault.
pub fn analyse(
    task: &Task,
    transitions: &[Transition],
    best: &[f64],
    seed: u64,
) -> Result<Analysis, LabError> {
    /// Shares of the way from the nominal gait to the best proven action.
    const SHARES: [f64; 3] = [0.7, 0.85, 1.0];
    let component = pitch_rate(task)?;
    let map = fit_map(task, transitions, seed, 0)?;
    let limits = task.action_limits()?;
    let mut flips = Vec::new();
    for share in SHARES {
        let action: Vec<f64> = best
            .iter()
            .zip(&limits)
            .map(|(u, l)| l.neutral + share * (u - l.neutral))
            .collect();
        flips.push(Flip {
            map: flip_of_map(&map, &action)?,
            robot: flip_of_robot(task, &action, component)?,
            action,
        });
    }
    Ok(Analysis {
        pitch_rate_residual_deg_s: held_out(task, transitions, seed)?,
        flips,
    })
}
