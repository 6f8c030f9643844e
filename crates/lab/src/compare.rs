//! Learning in the map against learning on the robot itself, the paper's "full model"
//! \[MA09, figs. 8 and 9\].

use rand_chacha::ChaCha8Rng;
use statrs::distribution::{ContinuousCDF, StudentsT};
use stridemap_learn::{ActorCriticRun, GaussianPolicy, KeptPolicy, SavedPolicy};
use stridemap_process::{ProcessError, ProcessSpec, Situation, State, Stride, StrideEnd, StrideProcess};
use stridemap_record::{ComparePoint, Iteration, Performance, Spread, StridePhase, StrideRole};

use crate::algorithm::Algorithm;
use crate::error::LabError;
use crate::learner::network;
use crate::plant::Batch;
use crate::plant::Plant;
use crate::recorder::NoRecorder;
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, make_strides};
use crate::task::Task;

/// Strides over which a frozen policy is measured on the robot.
pub const STRIDES_PER_POINT: usize = 20;

/// Both arms of one seed.
#[derive(Clone, Debug)]
pub struct CompareSeed {
    /// The seed.
    pub seed: u64,
    /// Mean reward on the robot of the frozen policy after each trial, learned in the map.
    pub gp: Vec<f64>,
    /// The same, learned on the robot.
    pub full: Vec<f64>,
    /// The last policy learned in the map.
    pub gp_policy: SavedPolicy,
    /// The last policy learned on the robot.
    pub full_policy: SavedPolicy,
    /// States of the strides that the map was fitted to.
    pub states: Vec<State>,
    /// States of the strides made by learning on the robot.
    pub full_states: Vec<State>,
    /// Strides on the robot for the map; learning in it needs no more.
    pub gp_strides: usize,
    /// Strides on the robot for learning on it.
    pub full_strides: usize,
    /// Falls on the robot while collecting for the map.
    pub gp_falls: usize,
    /// Falls on the robot while learning on it.
    pub full_falls: usize,
}

/// A process that remembers the states from which actions were taken.
struct Remembering<'a> {
    process: &'a mut dyn StrideProcess,
    state: Option<State>,
    visited: Vec<State>,
}

impl StrideProcess for Remembering<'_> {
    fn spec(&self) -> &ProcessSpec {
        self.process.spec()
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        let at = self.process.reset(rng)?;
        self.state = Some(at.state.clone());
        Ok(at)
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let stride = self.process.stride(action, rng)?;
        let next = (stride.end == StrideEnd::Crossing).then(|| stride.next.state.clone());
        self.visited.extend(std::mem::replace(&mut self.state, next));
        Ok(stride)
    }
}

/// Runs the actor-critic on a process and keeps a copy of the policy before and after each trial.
fn frozen_policies(
    task: &Task,
    process: &mut dyn StrideProcess,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<GaussianPolicy>, LabError> {
    let config = &network(task);
    let mut run = ActorCriticRun::new(config, process.spec(), None)?;
    let mut frozen = vec![run.policy().clone()];
    for _ in 0..config.trials {
        run.run_trial(process, rng)?;
        frozen.push(run.policy().clone());
    }
    Ok(frozen)
}

/// Mean reward on the robot of each frozen stochastic policy, every one from a fresh start and with
/// the same random stream in both arms.
fn measure(task: &Task, plant: &mut Plant, frozen: &[GaussianPolicy], seed: u64) -> Result<Vec<f64>, LabError> {
    let batch =
        Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: STRIDES_PER_POINT };
    let mut rewards = Vec::with_capacity(frozen.len());
    for (trial, policy) in frozen.iter().enumerate() {
        let mut rng = stream(seed, Role::Compare, trial as u64);
        let source = ActionSource::Sample(policy, vec![0.0; task.action.len()]);
        let transitions = make_strides(plant, &source, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
        rewards.push(Performance::of(&transitions, 0).mean_reward);
    }
    Ok(rewards)
}

/// Runs both arms of one seed: the same learner, once in the map of one batch of strides, once on the
/// robot.
///
/// # Errors
///
/// [`LabError`] of the room at fault.
pub fn compare_seed(task: &Task, seed: u64) -> Result<CompareSeed, LabError> {
    let mut algorithm = Algorithm::new(task, seed)?.however_often_it_falls();
    algorithm.collect(&mut NoRecorder)?;
    let mut map = algorithm.fit(&mut NoRecorder)?;
    let Iteration { strides: gp_strides, falls: gp_falls, .. } =
        algorithm.progress.iterations.first().cloned().unwrap_or_default();
    let in_map = frozen_policies(task, &mut map, &mut stream(seed, Role::Improve, 1))?;

    let plant = algorithm.plant_mut();
    let before = plant.counters();
    let mut robot = Remembering { process: plant, state: None, visited: Vec::new() };
    let on_robot = frozen_policies(task, &mut robot, &mut stream(seed, Role::FullModel, 0))?;
    let full_states = robot.visited;
    let counted = plant.counters().since(before);

    let gp = measure(task, plant, &in_map, seed)?;
    let full = measure(task, plant, &on_robot, seed)?;
    let last = |policies: &[GaussianPolicy]| {
        policies.last().map(KeptPolicy::to_saved).ok_or(LabError::TooFewStrides { found: 0, needed: 1 })
    };
    Ok(CompareSeed {
        seed,
        gp,
        full,
        gp_policy: last(&in_map)?,
        full_policy: last(&on_robot)?,
        states: algorithm.progress.transitions.iter().map(|t| t.state.clone()).collect(),
        full_states,
        gp_strides,
        full_strides: counted.strides,
        gp_falls,
        full_falls: counted.falls,
    })
}

/// The two learning curves over seeds.
#[must_use]
pub fn learning_curves(seeds: &[CompareSeed]) -> Vec<ComparePoint> {
    let trials = seeds.iter().map(|s| s.gp.len().min(s.full.len())).min().unwrap_or(0);
    (0..trials)
        .map(|trial| {
            let gp: Vec<f64> = seeds.iter().map(|s| s.gp[trial]).collect();
            let full: Vec<f64> = seeds.iter().map(|s| s.full[trial]).collect();
            ComparePoint { trial, gp: Spread::of(&gp), full: Spread::of(&full), p_value: students_t(&gp, &full) }
        })
        .collect()
}

/// Two-sided p-value of Student's t-test for equal means of two samples with pooled variance; `None`
/// with fewer than two values in one, or without any spread.
///
/// # Example
///
/// Means 2 and 4, both variances 1, n = 3: t = −2 / √(2/3) = −2.449, 4 degrees of freedom.
///
/// ```
/// let p = stridemap_lab::students_t(&[1.0, 2.0, 3.0], &[3.0, 4.0, 5.0]).unwrap();
/// assert!((p - 0.070_48).abs() < 1e-5);
/// assert_eq!(stridemap_lab::students_t(&[1.0], &[2.0, 3.0]), None);
/// ```
#[must_use]
pub fn students_t(a: &[f64], b: &[f64]) -> Option<f64> {
    let (Spread { mean: mean_a, sd: sd_a }, Spread { mean: mean_b, sd: sd_b }) = (Spread::of(a), Spread::of(b));
    let (n, m) = (a.len() as f64, b.len() as f64);
    let degrees = n + m - 2.0;
    let pooled = ((n - 1.0) * sd_a?.powi(2) + (m - 1.0) * sd_b?.powi(2)) / degrees;
    let standard_error = (pooled * (1.0 / n + 1.0 / m)).sqrt();
    if !(standard_error > 0.0 && standard_error.is_finite()) {
        return None;
    }
    let t = (mean_a - mean_b) / standard_error;
    let distribution = StudentsT::new(0.0, 1.0, degrees).ok()?;
    Some(2.0 * distribution.cdf(-t.abs()))
}
