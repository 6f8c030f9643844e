//! Maps and policies on grids, as CSV tables for figures.

use std::fmt::Write;

use stridemap_learn::{Policy, SavedPolicy};
use stridemap_map::{LearnedMap, MapError};
use stridemap_process::{Action, Goal, Situation, State, StrideProcess};

use crate::columns::Columns;
use crate::error::RecordError;
use crate::table::Table;

/// Points along an axis of a one-dimensional grid.
const LINE: usize = 121;
/// The same of a policy that plans, which takes its time.
const PLANNED: usize = 11;
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

/// The middle one of some values, the upper of two; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// A policy along each component of the state, the others in the middle of their range.
///
/// Columns: the component that varies (`along`, its index), the state, mean and standard deviation of
/// each action, and the value function where the learner kept one.
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
    // The critic's value, if the policy has one: constants and feedback have none.
    let critic = match policy {
        SavedPolicy::GaussianNetwork(network) => Some(network),
        _ => None,
    };
    if critic.is_some() {
        text.push_str(",value");
    }
    text.push('\n');
    let middle: Vec<f64> = ranges.iter().map(|[low, high]| 0.5 * (low + high)).collect();
    for (along, range) in ranges.iter().enumerate() {
        let [low, high] = widened(*range);
        let points = if matches!(policy, SavedPolicy::GoalPlanner(_)) { PLANNED } else { LINE };
        for value in axis(low, high, points) {
            let mut state = middle.clone();
            state[along] = value;
            let _ = write!(text, "{along}");
            for x in &state {
                let _ = write!(text, ",{x}");
            }
            let at = Situation::of_state(&state);
            for (mean, std) in policy.mean(&at).iter().zip(policy.std(&at)) {
                let _ = write!(text, ",{mean},{std}");
            }
            if let Some(network) = critic {
                let _ = write!(text, ",{}", network.value(&at));
            }
            text.push('\n');
        }
    }
    text
}

/// Where figures cut through a map: the ranges of its data, and a state and an action in them.
struct Cut {
    states: Vec<[f64; 2]>,
    actions: Vec<[f64; 2]>,
    state: State,
    action: Action,
}

impl Cut {
    /// With some components changed, the last action equal to the action.
    fn moved(&self, change: impl FnOnce(&mut State, &mut Action)) -> Situation {
        let mut at = Situation { state: self.state.clone(), last_action: self.action.clone(), goal: Goal::new() };
        change(&mut at.state, &mut at.last_action);
        at
    }

    /// The state to which the map settles under the policy's mean (from the median of the data, kept within
    /// the data), and the action there.
    fn through(map: &LearnedMap, policy: &SavedPolicy) -> Result<Self, MapError> {
        /// Long enough for multipliers up to about 0.9.
        const STRIDES: usize = 40;
        let (spec, samples) = (map.spec(), map.samples());
        let span = |value: &dyn Fn(usize) -> f64| {
            let all = (0..samples.len()).map(value);
            all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
        };
        let states: Vec<[f64; 2]> = (0..spec.state.len()).map(|d| span(&|i| samples[i].at.state[d])).collect();
        let actions: Vec<[f64; 2]> = (0..spec.action.len()).map(|d| span(&|i| samples[i].action[d])).collect();
        let middle: State =
            (0..spec.state.len()).map(|d| median(samples.iter().map(|s| s.at.state[d]).collect())).collect();
        let mut at = Situation::of_state(&middle);
        for _ in 0..STRIDES {
            at.last_action = policy.mean(&at);
            let next = map.predict(&at, &at.last_action)?.means;
            for ((x, to), [low, high]) in at.state.iter_mut().zip(next).zip(&states) {
                *x = to.clamp(*low, *high);
            }
        }
        Ok(Self {
            states: states.into_iter().map(widened).collect(),
            actions: actions.into_iter().map(widened).collect(),
            action: policy.mean(&at),
            state: at.state,
        })
    }
}

/// A map over planes of one component of the state and one of the action; the other components where the
/// map settles under the policy, the last action equal to the action.
///
/// Columns: indices of the two components (`state_axis`, `action_axis`), state, action, and for each
/// output the mean, the standard deviation of the latent function and that of the noise.
///
/// # Errors
///
/// [`MapError`] if the map cannot be evaluated.
pub fn map_table(map: &LearnedMap, policy: &SavedPolicy) -> Result<String, MapError> {
    let spec = map.spec();
    let cut = Cut::through(map, policy)?;
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
    for (i, state_range) in cut.states.iter().enumerate() {
        for (j, action_range) in cut.actions.iter().enumerate() {
            for x in axis(state_range[0], state_range[1], PLANE) {
                for u in axis(action_range[0], action_range[1], PLANE) {
                    let at = cut.moved(|state, action| (state[i], action[j]) = (x, u));
                    let p = map.predict(&at, &at.last_action)?;
                    let _ = write!(text, "{i},{j}");
                    for value in at.state.iter().chain(&at.last_action) {
                        let _ = write!(text, ",{value}");
                    }
                    for ((mean, variance), gp) in p.means.iter().zip(&p.latent_variances).zip(map.outputs()) {
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

/// A map along each of its inputs in turn, through the point at which it settles under a policy; the last
/// action equal to the action.
///
/// Columns: the input that varies (`along`: states first, then actions), state, action, and for each
/// output, the reward's last where it has its own, the mean, the standard deviation of the latent function
/// and that of the noise.
///
/// # Errors
///
/// [`MapError`] if the map cannot be evaluated.
pub fn line_table(map: &LearnedMap, policy: &SavedPolicy) -> Result<String, MapError> {
    let spec = map.spec();
    let cut = Cut::through(map, policy)?;
    let outputs: Vec<_> = map.outputs().iter().chain(map.reward_output()).collect();
    let names = spec.state.iter().map(|d| d.name.as_str());
    let mut text = String::from("along");
    for d in &spec.state {
        let _ = write!(text, ",{}", d.name);
    }
    for d in &spec.action {
        let _ = write!(text, ",{}", d.name);
    }
    for name in names.chain(["reward"]).take(outputs.len()) {
        let _ = write!(text, ",mean_{name},latent_std_{name},noise_std_{name}");
    }
    text.push('\n');
    for (along, [low, high]) in cut.states.iter().chain(&cut.actions).enumerate() {
        for value in axis(*low, *high, LINE) {
            let at = cut.moved(|state, action| match along.checked_sub(state.len()) {
                None => state[along] = value,
                Some(j) => action[j] = value,
            });
            let p = map.predict(&at, &at.last_action)?;
            let _ = write!(text, "{along}");
            for value in at.state.iter().chain(&at.last_action) {
                let _ = write!(text, ",{value}");
            }
            let predicted = p.means.iter().copied().zip(p.latent_variances.iter().copied());
            for ((mean, variance), gp) in predicted.chain(p.reward).zip(&outputs) {
                let noise = gp.hyperparameters().noise_variance;
                let _ = write!(text, ",{mean},{},{}", variance.sqrt(), noise.sqrt());
            }
            text.push('\n');
        }
    }
    Ok(text)
}

/// A policy on lines through the state space, as `figures/data/policy-<iteration>.csv` holds it.
///
/// All columns are equally long; a line varies one component of the state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolicyGrid {
    /// Which component of the state varies along the line of each row.
    pub along: Vec<usize>,
    /// One column per component of the state.
    pub state: Vec<Vec<f64>>,
    /// Mean of each component of the action.
    pub mean: Vec<Vec<f64>>,
    /// Standard deviation of each component of the action: how much the policy explores.
    pub std: Vec<Vec<f64>>,
    /// Value function, if it is known.
    pub value: Option<Vec<f64>>,
    /// Centres of the basis functions.
    pub centres: Vec<Vec<f64>>,
}

/// One column of a table per component.
fn per(table: &Table, prefix: &str, names: &[String]) -> Result<Vec<Vec<f64>>, RecordError> {
    let column = |name: &String| table.numbers(&format!("{prefix}{name}"));
    names.iter().map(column).collect()
}

impl PolicyGrid {
    pub(crate) fn read(table: &Table, columns: &Columns) -> Result<Self, RecordError> {
        let value = table.has("value").then(|| table.numbers("value"));
        Ok(Self {
            along: table.counts("along")?,
            state: per(table, "", &columns.state)?,
            mean: per(table, "mean_", &columns.action)?,
            std: per(table, "std_", &columns.action)?,
            value: value.transpose()?,
            centres: Vec::new(),
        })
    }
}

/// A learned map on planes of one component of the state and one of the action, as
/// `figures/data/map-<iteration>.csv` holds it. All columns are equally long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapGrid {
    /// Component of the state that varies in the plane of each row.
    pub state_axis: Vec<usize>,
    /// Component of the action that varies.
    pub action_axis: Vec<usize>,
    /// One column per component of the state.
    pub state: Vec<Vec<f64>>,
    /// One column per component of the action.
    pub action: Vec<Vec<f64>>,
    /// Mean of each component of the next state.
    pub mean: Vec<Vec<f64>>,
    /// Standard deviation of the latent function.
    pub latent_std: Vec<Vec<f64>>,
    /// Standard deviation of the noise.
    pub noise_std: Vec<Vec<f64>>,
}

impl MapGrid {
    pub(crate) fn read(table: &Table, columns: &Columns) -> Result<Self, RecordError> {
        Ok(Self {
            state_axis: table.counts("state_axis")?,
            action_axis: table.counts("action_axis")?,
            state: per(table, "", &columns.state)?,
            action: per(table, "", &columns.action)?,
            mean: per(table, "mean_", &columns.state)?,
            latent_std: per(table, "latent_std_", &columns.state)?,
            noise_std: per(table, "noise_std_", &columns.state)?,
        })
    }
}

/// One output of a map along lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineOutput {
    /// Component of the next state, or `reward`.
    pub name: String,
    /// Predicted mean.
    pub mean: Vec<f64>,
    /// Standard deviation of the latent function.
    pub latent_std: Vec<f64>,
    /// Standard deviation of the noise.
    pub noise_std: Vec<f64>,
}

/// A map along each of its inputs in turn, as `figures/data/lines-<iteration>.csv` holds it. All columns
/// are equally long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineGrid {
    /// Which input varies along the line of each row: states first, then actions.
    pub along: Vec<usize>,
    /// One column per input.
    pub inputs: Vec<Vec<f64>>,
    /// The outputs.
    pub outputs: Vec<LineOutput>,
}

impl LineGrid {
    pub(crate) fn read(table: &Table, columns: &Columns) -> Result<Self, RecordError> {
        let mut inputs = per(table, "", &columns.state)?;
        inputs.extend(per(table, "", &columns.action)?);
        let outputs = table.header.iter().filter_map(|h| h.strip_prefix("mean_"));
        let outputs = outputs.map(|name| {
            Ok(LineOutput {
                name: name.to_owned(),
                mean: table.numbers(&format!("mean_{name}"))?,
                latent_std: table.numbers(&format!("latent_std_{name}"))?,
                noise_std: table.numbers(&format!("noise_std_{name}"))?,
            })
        });
        Ok(Self { along: table.counts("along")?, inputs, outputs: outputs.collect::<Result<_, RecordError>>()? })
    }
}
