//! Maps and policies on grids, as CSV tables for figures.

use std::fmt::Write;

use stridemap_learn::{Policy, SavedPolicy};
use stridemap_returnmap::LearnedMap;

use crate::error::LabError;

/// Points along an axis of a one-dimensional grid.
const LINE: usize = 121;
/// Points along each axis of a grid of a state and an action.
const PLANE: usize = 41;

/// `points` values from `low` to `high`, both included.
fn axis(low: f64, high: f64, points: usize) -> impl Iterator<Item = f64> + Clone {
    (0..points).map(move |i| low + (high - low) * i as f64 / (points - 1) as f64)
}

/// A range widened by half of its width on both sides, so that figures show where the data end.
fn widened([low, high]: [f64; 2]) -> [f64; 2] {
    let margin = 0.5 * (high - low).max(1e-9);
    [low - margin, high + margin]
}

/// A policy along each component of the state, the others in the middle of their range.
///
/// Columns: the component that varies (`along`, its index), the state, mean and standard deviation of
/// each action.
#[must_use]
pub fn policy_table(policy: &SavedPolicy, ranges: &[[f64; 2]]) -> String {
    let spec = policy.spec();
    let mut text = String::from("along");
    for d in &spec.state {
        let _ = write!(text, ",{}", d.name);
    }
    for d in &spec.action {
        let _ = write!(text, ",mean_{0},std_{0}", d.name);
    }
    text.push('\n');
    let middle: Vec<f64> = ranges
        .iter()
        .map(|[low, high]| 0.5 * (low + high))
        .collect();
    for (along, range) in ranges.iter().enumerate() {
        let [low, high] = widened(*range);
        for value in axis(low, high, LINE) {
            let mut state = middle.clone();
            state[along] = value;
            let _ = write!(text, "{along}");
            for x in &state {
                let _ = write!(text, ",{x}");
            }
            for (mean, std) in policy.mean(&state).iter().zip(policy.std(&state)) {
                let _ = write!(text, ",{mean},{std}");
            }
            text.push('\n');
        }
    }
    text
}

/// A map over a plane of one component of the state and one of the action; the others at the middle of
/// the data, the last action equal to the action.
///
/// Columns: indices of the two components (`state_axis`, `action_axis`), state, action, and for each
/// output the mean, the standard deviation of the latent function and that of the noise.
///
/// # Errors
///
/// [`LabError::Process`] if the map cannot be evaluated.
pub fn map_table(map: &LearnedMap) -> Result<String, LabError> {
    use stridemap_returnmap::StrideProcess;
    let spec = map.spec();
    let samples = map.samples();
    let span = |value: &dyn Fn(usize) -> f64| {
        let all = (0..samples.len()).map(value);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| {
            [l.min(v), h.max(v)]
        })
    };
    let states: Vec<[f64; 2]> = (0..spec.state.len())
        .map(|d| widened(span(&|i| samples[i].state[d])))
        .collect();
    let actions: Vec<[f64; 2]> = (0..spec.action.len())
        .map(|d| widened(span(&|i| samples[i].action[d])))
        .collect();
    let middle = |ranges: &[[f64; 2]]| -> Vec<f64> {
        ranges
            .iter()
            .map(|[low, high]| 0.5 * (low + high))
            .collect()
    };

    let mut text = String::from("state_axis,action_axis");
    for d in &spec.state {
        let _ = write!(text, ",{}", d.name);
    }
    for d in &spec.action {
        let _ = write!(text, ",{}", d.name);
    }
    for d in &spec.state {
        let _ = write!(text, ",mean_{0},latent_std_{0},noise_std_{0}", d.name);
    }
    text.push('\n');
    for (i, state_range) in states.iter().enumerate() {
        for (j, action_range) in actions.iter().enumerate() {
            for x in axis(state_range[0], state_range[1], PLANE) {
                for u in axis(action_range[0], action_range[1], PLANE) {
                    let (mut state, mut action) = (middle(&states), middle(&actions));
                    state[i] = x;
                    action[j] = u;
                    let (means, variances) = map.predict(&state, &action, &action)?;
                    let _ = write!(text, "{i},{j}");
                    for value in state.iter().chain(&action) {
                        let _ = write!(text, ",{value}");
                    }
                    for ((mean, variance), gp) in means.iter().zip(&variances).zip(map.outputs()) {
                        let noise = gp.hyperparameters().noise_variance;
                        let _ = write!(text, ",{mean},{},{}", variance.sqrt(), noise.sqrt());
                    }
                    text.push('\n');
                }
            }
        }
    }
    Ok(text)
}
