//! Algorithm 1 of \[MA09\]: collect, fit, improve, evaluate, until the policy no longer improves.
//!
//! ```text
//!            ┌──────────────────────────────────────────────────────────┐
//!            ▼                                                          │
//! collect (robot) ──▶ transitions ──▶ fit ──▶ map ──▶ improve ──▶ policy ──▶ evaluate (robot)
//! ```
//!
//! Each verb starts the robot afresh and draws from a random stream of its own, so that a run that
//! was killed goes on from its last finished phase and ends with the same bytes.

mod goals;
mod measured;
mod prior;

use std::cell::Cell;
use std::time::Instant;

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_map::{LearnedMap, MapError, MapSample, MapWorld, StateReward};
use stridemap_process::{StrideEnd, StrideProcess};

use crate::error::LabError;
use crate::learner::{FEWEST, Known};
use crate::plant::{Batch, Plant, PlantCounters};
use crate::recorder::{Progress, Recorder};
use crate::reward::reward_of_state;
use crate::seed::{Role, stream};
use crate::state::StateComponent;
use crate::strides::{Act, ActionSource, Source, drive};
use crate::task::Task;
use stridemap_record::{
    GuardWarning, InPlace, Iteration, Performance, Phase, RobotFall, StridePhase, StrideRole, Transition,
};

/// A run of Algorithm 1: a task, a robot and what has been achieved so far.
pub struct Algorithm<'a> {
    pub(crate) task: &'a Task,
    pub(crate) seed: u64,
    pub(crate) plant: Plant,
    /// What has been achieved so far.
    pub progress: Progress,
    /// Strides explored under guard in the iteration that begins, and the warnings among them.
    pub(crate) explored: (usize, Vec<GuardWarning>),
    /// Falls of the plant that are in the progress.
    falls_noted: usize,
    stops_falling: bool,
}

impl<'a> Algorithm<'a> {
    /// A run from the start.
    ///
    /// # Errors
    ///
    /// [`LabError`] if the robot or the gait cannot be built.
    pub fn new(task: &'a Task, seed: u64) -> Result<Self, LabError> {
        Self::resume(task, seed, Progress::default())
    }

    /// A run that goes on from what was achieved before.
    ///
    /// # Errors
    ///
    /// [`LabError`] if the robot or the gait cannot be built.
    pub fn resume(task: &'a Task, seed: u64, progress: Progress) -> Result<Self, LabError> {
        Ok(Self::on(task, seed, task.plant()?, progress))
    }

    /// The same on a plant that was built elsewhere: one whose robot is behind a link.
    #[must_use]
    pub fn on(task: &'a Task, seed: u64, mut plant: Plant, mut progress: Progress) -> Self {
        plant.recall(std::mem::take(&mut progress.unfinished));
        Self { task, seed, plant, progress, explored: Default::default(), falls_noted: 0, stops_falling: true }
    }

    /// The same however often the robot falls: for experiments in simulation that set learners beside one
    /// another, those that fall as well.
    #[must_use]
    pub fn however_often_it_falls(mut self) -> Self {
        self.stops_falling = false;
        self
    }

    /// The robot.
    pub fn plant_mut(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// Runs every phase that is still missing.
    ///
    /// # Errors
    ///
    /// [`LabError`] of the room at fault, or of the recorder. What was recorded stays.
    pub fn learn(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let started = Instant::now();
        let before = self.progress.total_seconds;
        let result = self.run_missing_phases(recorder);
        self.progress.total_seconds = before + started.elapsed().as_secs_f64();
        result
    }

    fn run_missing_phases(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        if self.progress.nominal.is_none() {
            self.measure_nominal(recorder)?;
        }
        if let Some(nominal) = &self.progress.nominal {
            self.task.failure.refuse_price(nominal.mean_reward)?;
        }
        self.take_prior()?;
        loop {
            let (begun, improved) = (self.progress.iterations.len(), self.progress.policies.len());
            if improved < begun && !self.task.learner.kind.uses_map() {
                self.improve_on(None, recorder)?;
            } else if improved < begun {
                match self.fit(recorder) {
                    Ok(map) => self.improve(&map, recorder)?,
                    // Nothing can be learned of so few strides, and so nothing beats the nominal gait.
                    Err(error) if error.is_of_too_few_strides() => break,
                    Err(error) => return Err(error),
                }
            } else if self.catch_up(recorder)? {
                self.collect(recorder)?;
            } else {
                break;
            }
        }
        while self.progress.final_performance.is_none() {
            self.measure_final(recorder)?;
        }
        Ok(())
    }

    /// Makes what comes before the next batch: the nominal gait is measured, and the newest policy evaluated and
    /// measured. Returns whether there is a next batch.
    ///
    /// # Errors
    ///
    /// As [`Self::learn`].
    pub fn catch_up(&mut self, recorder: &mut dyn Recorder) -> Result<bool, LabError> {
        if self.progress.nominal.is_none() {
            self.measure_nominal(recorder)?;
        }
        let evaluates = self.task.algorithm.evaluation_strides > 0 || self.task.caution.is_some();
        let last = self.progress.iterations.last();
        if evaluates && last.is_some_and(|i| i.evaluation.is_none()) {
            self.evaluate(recorder)?;
        }
        let last = self.progress.iterations.last();
        if last.is_some_and(|i| i.record.is_none()) {
            self.record_iteration(recorder)?;
        }
        Ok(!self.is_finished())
    }

    /// Step 5: whether the loop has ended, once its last iteration is complete.
    fn is_finished(&self) -> bool {
        let progress = &self.progress;
        let done = progress.iterations.len();
        if done >= self.task.algorithm.iterations {
            return true;
        }
        let trial = self.task.caution.as_ref().map_or(1, |c| c.proof.trial_strides);
        if done > 0 && self.strides_left() < trial {
            return true;
        }
        let Some(least) = self.task.algorithm.stop_below_improvement else {
            return false;
        };
        let rewards: Vec<f64> =
            progress.iterations.iter().filter_map(|i| i.evaluation.map(|e| e.mean_reward)).collect();
        match rewards.split_last() {
            Some((last, before)) if !before.is_empty() => {
                let best = before.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                *last <= best + least
            }
            _ => false,
        }
    }

    /// Makes strides and keeps the books: time, falls, warm-up.
    fn strides_on_robot(
        &mut self,
        policy: Option<&SavedPolicy>,
        batch: Batch,
        what: Option<&str>,
        stream_of: (Role, u64),
        recorder: &mut dyn Recorder,
    ) -> Result<(Vec<Transition>, PlantCounters), LabError> {
        let mut rng = stream(self.seed, stream_of.0, stream_of.1);
        let source = match (policy, batch.phase) {
            (None, _) => self.task.first_exploration(),
            (Some(p), StridePhase::Collect) => ActionSource::Sample(p, self.task.of_each(|a| a.later_noise_std)),
            (Some(p), _) => ActionSource::Mean(p),
        };
        self.make(&mut Source::new(&source), batch, what, &mut rng, recorder)
    }

    /// Makes strides by an actor and keeps the books: time, falls, warm-up.
    ///
    /// # Errors
    ///
    /// [`LabError::FallBudget`] if the robot has fallen too often; as [`drive`].
    pub(crate) fn make(
        &mut self,
        actor: &mut dyn Act,
        batch: Batch,
        what: Option<&str>,
        rng: &mut ChaCha8Rng,
        recorder: &mut dyn Recorder,
    ) -> Result<(Vec<Transition>, PlantCounters), LabError> {
        let (before, started) = (self.plant.counters(), Instant::now());
        self.note_falls(batch, what, before.strides);
        let limited = self.stops_falling && self.task.counts_falls_in(batch.phase);
        let falls = self.progress.falls.iter();
        let counted = falls.filter(|f| self.task.counts_falls_in(f.phase)).count();
        let left = self.task.algorithm.falls_at_most.saturating_sub(counted);
        self.plant.allow_falls(limited.then_some(left));
        let began_at = Cell::new((0, 0));
        let made =
            drive(&mut self.plant, actor, batch, rng, &mut |plant, _| began_at.set(plant.began_at()), &mut |t| {
                if t.k == 0 {
                    recorder.episode(began_at.get(), what)?;
                }
                recorder.stride(t, what)
            });
        self.plant.allow_falls(None);
        self.progress.seconds.simulation += started.elapsed().as_secs_f64();
        self.note_falls(batch, what, before.strides);
        let made = made?;
        if limited {
            self.task.check_fall_budget(&self.progress.falls)?;
        }
        Ok((made, self.plant.counters().since(before)))
    }

    /// Takes the plant's new falls into the progress, as those of a batch that began after some strides.
    fn note_falls(&mut self, batch: Batch, what: Option<&str>, strides_before: usize) {
        let new = self.plant.falls().iter().skip(self.falls_noted);
        self.progress.falls.extend(new.map(|(stride, fall)| RobotFall {
            iteration: batch.iteration,
            phase: batch.phase,
            what: what.map(Into::into),
            stride: stride.map(|s| s.saturating_sub(strides_before)),
            fall: *fall,
        }));
        self.falls_noted = self.plant.falls().len();
    }

    /// Step 2: strides for the map: exploration in the first iteration, the stochastic policy later.
    ///
    /// # Errors
    ///
    /// As [`Self::learn`].
    pub fn collect(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let index = self.progress.iterations.len();
        let batch = Batch {
            iteration: index + 1,
            phase: StridePhase::Collect,
            role: StrideRole::Training,
            strides: if self.task.learner.kind.explores() { self.batch_strides(index) } else { 0 },
        };
        let batch = self.within_budget(batch);
        let policy = self.progress.best_policy().cloned();
        let filming = self.film(index == 0 && batch.strides > 0, false);
        let collected = match (policy, self.task.collect.until_error) {
            (None, Some(error)) if index == 0 && batch.strides > 0 => self.collect_until(error, batch, recorder),
            (policy, _) => self.collect_batch(policy.as_ref(), batch, 0, recorder),
        };
        let takes = filming.end(&mut self.plant);
        let (transitions, mut counted) = collected?;
        takes.keep("exploration", &transitions, recorder)?;
        if self.task.caution.is_some() && index == 0 && batch.strides == 0 {
            // Nothing was explored, but thresholds need to know how the robot steps in place.
            let before = self.plant.counters();
            self.plant.reset(&mut stream(self.seed, Role::Collect, index as u64))?;
            counted = self.plant.counters().since(before);
        }
        let relative = self.task.caution.is_some() || self.task.failure.psi_roll_relative;
        let relative = relative && self.plant.in_place().sections > 0;
        let made = transitions.len();
        self.progress.transitions.extend(transitions);
        self.progress.iterations.push(Iteration {
            iteration: index + 1,
            strides: made,
            falls: counted.falls,
            stalls: counted.stalls,
            warm_up: counted.warm_up,
            in_place: relative.then(|| self.plant.in_place()),
            warnings: std::mem::take(&mut self.explored).1,
            ..Iteration::default()
        });
        recorder.checkpoint(Phase::Collect, &self.progress)
    }

    /// One batch for the map; `part` tells the parts of a batch in parts from one another.
    pub(crate) fn collect_batch(
        &mut self,
        policy: Option<&SavedPolicy>,
        batch: Batch,
        part: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<(Vec<Transition>, PlantCounters), LabError> {
        /// Parts of a batch in parts draw from streams far above those of any iteration.
        const PARTS: u32 = 32;
        let index = (batch.iteration as u64 - 1) | (part << PARTS);
        if self.task.learner.kind.follows_goals() {
            return self.explore_about_goals(policy, batch, index, recorder);
        }
        match (&self.task.caution, policy) {
            (Some(caution), None) => self.explore_under_guard(caution, batch, index, recorder),
            _ => self.strides_on_robot(policy, batch, None, (Role::Collect, index), recorder),
        }
    }

    /// Step 3: fits the map to every training stride so far.
    ///
    /// # Errors
    ///
    /// [`LabError::TooFewStrides`] or [`LabError::Map`].
    pub fn fit(&mut self, recorder: &mut dyn Recorder) -> Result<LearnedMap, LabError> {
        let iteration = self.progress.iterations.len();
        let started = Instant::now();
        let (strides, in_place) = (&self.progress.transitions, self.progress.in_place());
        let map = fit_map(self.task, strides, &in_place, self.seed, iteration)?;
        self.progress.seconds.fit += started.elapsed().as_secs_f64();
        if let Some(last) = self.progress.iterations.last_mut() {
            last.log_marginal_likelihood = map.log_marginal_likelihoods();
            let pitch_rate = self
                .task
                .state
                .iter()
                .position(|c| *c == StateComponent::PSI_PITCH_RATE_DEG_S)
                .filter(|_| self.task.caution.is_some());
            if let Some(i) = pitch_rate {
                let scores = map.outputs()[i].leave_one_out();
                let residuals = scores.map_err(MapError::from)?.residuals;
                last.pitch_rate_residual_deg_s = Some(robust_std(&residuals));
            }
        }
        recorder.map(iteration, &map)?;
        Ok(map)
    }

    /// Step 4: improves the policy in the map.
    ///
    /// # Errors
    ///
    /// [`LabError::Learn`], or of the recorder.
    pub fn improve(&mut self, map: &LearnedMap, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        self.improve_on(Some(map), recorder)
    }

    /// Step 4 in the map, or by a control that needs none.
    fn improve_on(&mut self, map: Option<&LearnedMap>, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let iteration = self.progress.policies.len() + 1;
        let started = Instant::now();
        let mut rng = stream(self.seed, Role::Improve, iteration as u64);
        let mut written: Result<(), LabError> = Ok(());
        let mut observe = |trial: &TrialSummary| {
            if written.is_ok() {
                written = recorder.trial(iteration, trial);
            }
        };
        let known = Known::of(self.task, self.seed, &self.progress, map)?;
        let policy = self.task.learner.kind.propose(&known, &mut rng, &mut observe)?;
        let region = known.region;
        written?;
        if let Some(last) = self.progress.iterations.last_mut() {
            last.trust_region = region;
        }
        self.progress.seconds.improve += started.elapsed().as_secs_f64();
        recorder.policy(iteration, &policy)?;
        self.progress.policies.push(policy);
        recorder.checkpoint(Phase::Improve, &self.progress)
    }

    /// Runs the newest policy's mean on the robot to see whether it is better.
    ///
    /// # Errors
    ///
    /// As [`Self::learn`].
    pub fn evaluate(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let config = &self.task.algorithm;
        if let Some(caution) = &self.task.caution {
            self.prove(caution, recorder)?;
            return recorder.checkpoint(Phase::Evaluate, &self.progress);
        }
        let Some(policy) = self.progress.policies.last().cloned() else {
            return Ok(());
        };
        let index = self.progress.policies.len() - 1;
        let role = if config.evaluation_trains { StrideRole::Training } else { StrideRole::Evaluation };
        let (strides, discard) = (config.evaluation_strides, config.evaluation_discard);
        let batch = Batch { iteration: index + 1, phase: StridePhase::Evaluate, role, strides };
        let (transitions, counted) =
            self.strides_on_robot(Some(&policy), batch, None, (Role::Evaluate, index as u64), recorder)?;
        let iteration = &mut self.progress.iterations[index];
        iteration.strides += strides;
        iteration.falls += counted.falls;
        iteration.stalls += counted.stalls;
        iteration.warm_up += counted.warm_up;
        iteration.evaluation = Some(Performance::of(&transitions, discard));
        self.progress.transitions.extend(transitions);
        recorder.checkpoint(Phase::Evaluate, &self.progress)
    }
}

/// Standard deviation of residuals by their median magnitude, as if they were normal: a few large ones
/// do not count.
pub(crate) fn robust_std(residuals: &[f64]) -> f64 {
    /// Of a normal distribution: standard deviation over median magnitude.
    const NORMAL: f64 = 1.482_602_218_505_602;
    let mut magnitudes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
    magnitudes.sort_by(f64::total_cmp);
    magnitudes.get(residuals.len() / 2).map_or(0.0, |m| NORMAL * m)
}

/// Fits the map of a task to strides: those with the training role that reached the next section.
/// `in_place` says how the robot steps in place, where a relative threshold counts from.
///
/// # Errors
///
/// [`LabError::TooFewStrides`], or [`LabError::Map`] if the Gaussian process cannot be fitted.
pub fn fit_map(
    task: &Task,
    transitions: &[Transition],
    in_place: &InPlace,
    seed: u64,
    iteration: usize,
) -> Result<LearnedMap, LabError> {
    let samples: Vec<MapSample> = transitions
        .iter()
        .filter(|t| t.role == StrideRole::Training && t.end == StrideEnd::Crossing)
        .map(|t| MapSample {
            at: t.situation(),
            action: t.action.clone(),
            next_state: t.next_state.clone(),
            reward: t.reward,
        })
        .collect();
    if samples.len() < FEWEST {
        return Err(LabError::TooFewStrides { found: samples.len(), needed: FEWEST });
    }
    let mut rng = stream(seed, Role::Fit, iteration as u64);
    let world = MapWorld {
        spec: task.process_spec()?,
        limits: task.action_limits()?,
        failure: task.failure.in_map(&task.state, in_place),
        reward: reward_of_state(&task.reward, &task.state).map(|reward| std::sync::Arc::new(reward) as StateReward),
    };
    Ok(LearnedMap::fit(task.map_config(), world, &samples, &mut rng)?)
}
