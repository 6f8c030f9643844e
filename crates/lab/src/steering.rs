//! Controls for tasks that steer `ψ_roll` to a target with one action: integral action, a deadbeat
//! line, a constant. They see as many strides as the first iteration of the learner.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use stridemap_process::{Made, Next, Situation, StrideEnd, walk};
use stridemap_record::{Performance, StridePhase, StrideRole};

use crate::algorithm::Algorithm;
use crate::error::{Invalid, LabError};
use crate::plant::Batch;
use crate::plant::Plant;
use crate::recorder::NoRecorder;
use crate::seed::{Role, stream};
use crate::state::StateComponent;
use crate::strides::{ActionSource, make_strides};
use crate::task::Task;

/// Integral action while it is given strides to settle: action per degree of error and stride.
const SETTLING_GAIN: f64 = 0.3;
/// Integral action that goes on while it is measured.
const ONLINE_GAIN: f64 = 0.2;
/// Share of the settling strides whose mean action is held afterwards: the last ones.
const HELD_SHARE: f64 = 0.75;

/// How one way of choosing actions did, from a fresh start, its first strides left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Steered {
    /// Which way.
    pub name: String,
    /// Strides on the robot before it was measured.
    pub strides: usize,
    /// Falls in them.
    pub falls: usize,
    /// As measured.
    pub performance: Performance,
    /// `|mean ψ_roll − target|`, as the robot estimates it.
    pub error_deg: f64,
    /// The same, as a simulator knows it.
    pub true_error_deg: Option<f64>,
}

/// An action that follows from a state, and may learn from it.
type Law<'a> = dyn FnMut(f64) -> f64 + 'a;

struct Bench<'a> {
    task: &'a Task,
    plant: Plant,
    seed: u64,
    target_deg: f64,
}

impl Bench<'_> {
    fn steered(&self, name: &str, strides: usize, falls: usize, performance: Performance) -> Steered {
        let truth = performance.true_mean_psi_roll_deg;
        Steered {
            name: name.into(),
            strides,
            falls,
            performance,
            // Without a stride that reached the section it is as wrong as can be.
            error_deg: (performance.mean_psi_roll_deg).map_or(f64::INFINITY, |mean| (mean - self.target_deg).abs()),
            true_error_deg: truth.map(|t| (t - self.target_deg).abs()),
        }
    }

    /// Runs a law from a fresh start; its states, what was measured after `discard` strides, and the falls.
    fn run(
        &mut self,
        law: &mut Law<'_>,
        strides: usize,
        discard: usize,
        episode: u64,
    ) -> Result<Performance, LabError> {
        let mut rng = stream(self.seed, Role::Compare, episode);
        let (mut sum, mut true_sum, mut sum_reward, mut kept) = (0.0, Some(0.0), 0.0, 0_usize);
        let mut result = Performance::default();
        let mut k = 0;
        let act = |at: &Situation| std::iter::once(law(at.state[0])).collect();
        walk(&mut self.plant, strides, &mut rng, act, |plant, Made { stride, .. }| {
            result.falls += usize::from(stride.end == StrideEnd::Fell);
            result.stalls += usize::from(stride.end == StrideEnd::NoCrossing);
            if k >= discard {
                result.strides += 1;
                sum_reward += stride.reward;
                if stride.end == StrideEnd::Crossing {
                    kept += 1;
                    sum += stride.next.state[0];
                    true_sum = true_sum.zip(plant.true_psi_roll_deg()).map(|(s, t)| s + t);
                }
            }
            k += 1;
            Next::Go
        })?;
        result.mean_reward = sum_reward / result.strides.max(1) as f64;
        if kept > 0 {
            result.mean_psi_roll_deg = Some(sum / kept as f64);
            result.true_mean_psi_roll_deg = true_sum.map(|s| s / kept as f64);
        }
        Ok(result)
    }

    fn measure(&mut self, law: &mut Law<'_>, episode: u64) -> Result<Performance, LabError> {
        let record = &self.task.record;
        self.run(law, record.strides + record.discard, record.discard, episode)
    }
}

/// Whether [`steer`] can compare on this task: one state `ψ_roll` with a target, one action.
#[must_use]
pub fn can_steer(task: &Task) -> bool {
    task.state == [StateComponent::PSI_ROLL_DEG] && task.action.len() == 1 && task.target_deg().is_some()
}

/// The learner after its first iteration and its final policy, and every control, on one seed's robot.
///
/// The action is taken to lower `ψ_roll` as it grows (both stepping tasks).
///
/// # Errors
///
/// [`LabError::Invalid`] if [`can_steer`] says no; [`LabError`] of the room at fault.
pub fn steer(task: &Task, seed: u64) -> Result<Vec<Steered>, LabError> {
    let (true, Some(target_deg)) = (can_steer(task), task.target_deg()) else {
        return Err(LabError::Invalid(Invalid {
            key: "state".into(),
            requirement: "must be psi_roll_deg alone, with a target and one action".into(),
        }));
    };
    let n = task.collect.strides[0];
    let [lower, upper] = task.action[0].bounds;
    let neutral = task.action_limits()?[0].neutral;
    let mut bench = Bench { task, plant: task.plant()?, seed, target_deg };
    let mut rows = Vec::new();

    let mut algorithm = Algorithm::new(task, seed)?.however_often_it_falls();
    algorithm.learn(&mut NoRecorder)?;
    let progress = &algorithm.progress;
    let made = |n: usize| {
        let first = progress.iterations.iter().take(n);
        first.fold((0, 0), |(s, f), i| (s + i.strides, f + i.falls))
    };
    let first = progress.iterations.first().and_then(|i| i.record);
    let last = progress.final_performance;
    for (name, n, measured) in
        [("learned in the map, iteration 1", 1, first), ("final policy", progress.iterations.len(), last)]
    {
        let (strides, falls) = made(n);
        rows.extend(measured.map(|p| bench.steered(name, strides, falls, p)));
    }
    if let Some(nominal) = progress.nominal {
        rows.push(bench.steered("nominal gait", 0, 0, nominal));
    }

    let mut plant = task.plant()?;
    let batch = Batch { iteration: 1, phase: StridePhase::Collect, role: StrideRole::Training, strides: n };
    let explored = make_strides(
        &mut plant,
        &ActionSource::Explore(task.exploration()),
        batch,
        // The very strides that the learner's first map was fitted to.
        &mut stream(seed, Role::Collect, 0),
        &mut |_, _| {},
        &mut |_| Ok(()),
    )?;
    let explored_falls = explored.iter().filter(|t| t.end == StrideEnd::Fell).count();
    let samples: Vec<[f64; 3]> = explored
        .iter()
        .filter(|t| t.end == StrideEnd::Crossing)
        .map(|t| [t.state[0], t.action[0], t.next_state[0]])
        .collect();
    if let Some([a, b, c]) = line(&samples) {
        let mut deadbeat = |psi: f64| ((target_deg - a - b * psi) / c).clamp(lower, upper);
        let measured = bench.measure(&mut deadbeat, 1)?;
        rows.push(bench.steered("deadbeat line", n, explored_falls, measured));
        let held = ((target_deg - a - b * target_deg) / c).clamp(lower, upper);
        let measured = bench.measure(&mut |_| held, 2)?;
        rows.push(bench.steered("constant from the line", n, explored_falls, measured));
    }

    let mut action = neutral.clamp(lower, upper);
    let mut tried = Vec::with_capacity(n);
    let settling = bench.run(
        &mut |psi| {
            action = (action + SETTLING_GAIN * (psi - target_deg)).clamp(lower, upper);
            tried.push(action);
            action
        },
        n,
        0,
        3,
    )?;
    let held = &tried[tried.len() - (HELD_SHARE * tried.len() as f64).round() as usize..];
    let mean = held.iter().sum::<f64>() / held.len().max(1) as f64;
    let measured = bench.measure(&mut |_| mean, 4)?;
    rows.push(bench.steered("integral action, then its mean held", n, settling.falls, measured));

    let mut online = neutral.clamp(lower, upper);
    let measured = bench.measure(
        &mut |psi| {
            online = (online + ONLINE_GAIN * (psi - target_deg)).clamp(lower, upper);
            online
        },
        5,
    )?;
    rows.push(bench.steered("integral action online", 0, 0, measured));
    Ok(rows)
}

/// Least squares of `next = a + b state + c action`; `None` if the samples do not determine it.
fn line(samples: &[[f64; 3]]) -> Option<[f64; 3]> {
    let (mut gram, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for [state, action, next] in samples {
        let row = Vector3::new(1.0, *state, *action);
        gram += row * row.transpose();
        right += row * *next;
    }
    let [a, b, c]: [f64; 3] = (gram.try_inverse()? * right).into();
    (samples.len() > 3 && c.abs() > 1e-6).then_some([a, b, c])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_finds_an_exact_law() {
        let samples: Vec<[f64; 3]> = (0..8)
            .map(|k| {
                let (x, u) = (f64::from(k), f64::from(k * k % 5));
                [x, u, 5.0 - 0.1 * x - 1.7 * u]
            })
            .collect();
        let [a, b, c] = line(&samples).unwrap();
        assert!((a - 5.0).abs() < 1e-9 && (b + 0.1).abs() < 1e-9 && (c + 1.7).abs() < 1e-9);
        assert_eq!(line(&samples[..3]), None);
    }
}
