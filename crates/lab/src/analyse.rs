//! What a walking run's data and map say: what the last action is worth to the map, and the flip of
//! the map beside the robot's own.

use serde::{Deserialize, Serialize};
use stridemap_map::{Kick, MapDraw, MapInput, decay_after_kick};
use stridemap_process::StrideEnd;
use stridemap_record::{InPlace, Proof, StrideRole, Transition};

use crate::algorithm::fit_map;
use crate::error::{Invalid, LabError};
use crate::recorder::Progress;
use crate::seed::{Role, stream};
use crate::state::StateComponent;
use crate::task::Task;

/// Every which stride is held out.
const FOLDS: usize = 5;
/// The kick of the free decay, on the action that kicks, deg.
const KICK_DEG: f64 = 1.0;

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
    /// The factor from stride to stride by which kicks of ±1 deg decay in the map; null where it fell.
    pub map: Option<f64>,
    /// The same on the robot.
    pub robot: Option<f64>,
}

/// What `analyse` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Analysis {
    /// Predictions of held-out strides: with the paper's state and with the task's, each without and with
    /// the last action.
    pub pitch_rate_residual_deg_s: Vec<HeldOut>,
    /// Flips at actions inside the data.
    pub flips: Vec<Flip>,
}

fn pitch_rate(task: &Task) -> Result<usize, LabError> {
    let position = task.state.iter().position(|c| *c == StateComponent::PSI_PITCH_RATE_DEG_S);
    position.ok_or_else(|| {
        LabError::Invalid(Invalid {
            key: "state".into(),
            requirement: "the pitch rate is analysed; it must be a component of the state".into(),
        })
    })
}

fn usable(transitions: &[Transition]) -> Vec<&Transition> {
    transitions.iter().filter(|t| t.role == StrideRole::Training && t.end == StrideEnd::Crossing).collect()
}

/// Residuals of the pitch rate over all folds.
fn residuals(task: &Task, transitions: &[&Transition], component: usize, seed: u64) -> Result<Vec<f64>, LabError> {
    let mut all = Vec::with_capacity(transitions.len());
    for fold in 0..FOLDS {
        let train: Vec<Transition> =
            transitions.iter().enumerate().filter(|(i, _)| i % FOLDS != fold).map(|(_, t)| (*t).clone()).collect();
        let map = fit_map(task, &train, &InPlace::default(), seed, 0)?;
        for t in transitions.iter().skip(fold).step_by(FOLDS) {
            let means = map.predict(&t.situation(), &t.action)?.means;
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
pub fn held_out(task: &Task, transitions: &[Transition], seed: u64) -> Result<Vec<HeldOut>, LabError> {
    const PAPER: [StateComponent; 3] =
        [StateComponent::PSI_ROLL_DEG, StateComponent::PSI_PITCH_DEG, StateComponent::PSI_PITCH_RATE_DEG_S];
    pitch_rate(task)?;
    let all: Vec<usize> = (0..task.state.len()).collect();
    let of_paper: Vec<usize> = all.iter().copied().filter(|i| PAPER.contains(&task.state[*i])).collect();
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

/// Actions inside the data: those at which the robot walked in its proofs, the longest first, and
/// the points halfway from each to the longest one.
fn walked_actions(proofs: &[&Proof]) -> Vec<Vec<f64>> {
    let mut longest: Vec<&Proof> = proofs.to_vec();
    longest.sort_by_key(|p| std::cmp::Reverse(p.strides));
    let walked: Vec<&[f64]> = longest.iter().map(|p| p.action.as_slice()).filter(|u| !u.is_empty()).collect();
    let halfway = walked.iter().skip(1).map(|u| {
        let both = u.iter().zip(walked[0]);
        both.map(|(a, b)| 0.5 * (a + b)).collect()
    });
    let walked = walked.iter().map(|u| u.to_vec());
    walked.chain(halfway).collect()
}

/// The flips of the robot and of its map at these actions in turn, until there are enough at which the
/// robot walks; those at which it falls are among the answers.
fn flips(task: &Task, progress: &Progress, actions: Vec<Vec<f64>>, seed: u64) -> Result<Vec<Flip>, LabError> {
    const ENOUGH: usize = 3;
    // The action law would spread a kick over many strides: without it the kick is one stride's. The
    // map's own mean is what it knows.
    let mut free = task.clone();
    for action in &mut free.action {
        (action.gain, action.rate_per_stride) = (1.0, None);
    }
    free.map.draw = MapDraw::Mean;
    let neutral: Vec<f64> = task.action_limits()?.iter().map(|l| l.neutral).collect();
    let watched = pitch_rate(task)?;
    let in_place = progress.in_place();
    let mut map = fit_map(&free, &progress.transitions, &in_place, seed, 0)?;
    let mut robot = free.plant()?;
    let rng = stream(seed, Role::Check, 3);
    let mut found: Vec<Flip> = Vec::new();
    for action in actions {
        if found.iter().filter(|f| f.robot.is_some()).count() >= ENOUGH {
            break;
        }
        let kick = Kick { action: &action, neutral: &neutral, component: 0, size: KICK_DEG, watched };
        found.push(Flip {
            map: decay_after_kick(&mut map, &kick, &rng)?,
            robot: decay_after_kick(&mut robot, &kick, &rng)?,
            action,
        });
    }
    Ok(found)
}

/// Analyses a run: held-out residuals, and flips of the map and of the robot at three actions inside
/// the data at which the robot walks.
///
/// # Errors
///
/// [`LabError`] of the room at fault.
pub fn analyse(task: &Task, progress: &Progress, seed: u64) -> Result<Analysis, LabError> {
    let walked = walked_actions(&progress.proofs());
    Ok(Analysis {
        pitch_rate_residual_deg_s: held_out(task, &progress.transitions, seed)?,
        flips: flips(task, progress, walked, seed)?,
    })
}
