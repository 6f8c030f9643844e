//! The paper's learner: TD(0) critic, policy gradient with eligibility traces \[MA09, sec. 5\].

mod config;

pub use config::{ActorCriticConfig, Output};

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use smallvec::SmallVec;
use stridemap_process::{Action, Actor, Made, Next, ProcessSpec, Situation, StrideEnd, StrideProcess, roll_out};

use crate::error::{LearnError, Place};
use crate::gaussian_policy::{GaussianPolicy, Outputs, Score};
use crate::learner::{LearnOutcome, Learner, TrialReport, TrialSummary};
use crate::network::Activations;
use crate::saved::{KeptPolicy, SavedPolicy, check_same_components};

/// The actor-critic of \[KK98\] as used in \[MA09, sec. 5\].
///
/// After every stride, with `x = x(k)`, `x′ = x(k+1)`, `r = r(k+1)` and the sampled output `o`,
///
/// ```text
/// δ  = r + γ V̂(x′) − V̂(x)                                        [MA09, eq. (18)]
/// wᵛ ← wᵛ + α δ b(x)                                             [MA09, eq. (19)]
/// e  ← η e + ∂ ln π_w(x, o)/∂w                                   [MA09, eq. (21)]
/// w  ← w + β δ e                                                 [MA09, eq. (22)]
/// ```
///
/// The trace is updated before the weights, so that δ credits the action that led to it. Read
/// literally, the indices of eqs. (21) and (22) would credit only the actions before; \[KK98\], from
/// which they are taken, has the order above.
///
/// # How an episode ends
///
/// | the stride | target of V̂(x) | then |
/// |---|---|---|
/// | crossed | r + γ V̂(x′) | goes on |
/// | crossed, and was the last of its episode or trial (*truncated*) | r + γ V̂(x′) | reset, traces zeroed |
/// | fell or stalled (*terminal*) | r | reset, traces zeroed |
/// | was aborted | none: nothing is learned | reset, traces zeroed |
///
/// # Bases
///
/// A base is added at a state from which an action is taken, if no base is active there. It takes
/// over the outputs, so that mean, σ and V̂ at the state do not change. With averaging, it is added
/// to the averaged policy in the same way, with that policy's outputs: as if it had been there, and
/// inherited, from the beginning.
///
/// # References
///
/// \[KK98\], \[Doya00\], \[MD01\], \[PJ92\]: see the [crate](crate) documentation.
#[derive(Clone, Debug)]
pub struct ActorCritic {
    /// The parameters.
    pub config: ActorCriticConfig,
}

impl Learner for ActorCritic {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let mut run = ActorCriticRun::new(&self.config, process.spec(), initial)?;
        for _ in 0..self.config.trials {
            let summary = run.run_trial(process, rng)?;
            observer(&TrialReport { summary: &summary, policy: run.policy() });
        }
        Ok(run.finish())
    }
}

/// A run of the actor-critic, one trial at a time.
///
/// # Example
///
/// ```
/// # use stridemap_learn::{ActorCriticConfig, ActorCriticRun, LearnError, Policy};
/// # use stridemap_process::StrideProcess;
/// # fn example(process: &mut dyn StrideProcess, rng: &mut rand_chacha::ChaCha8Rng) -> Result<(), LearnError> {
/// let config = ActorCriticConfig::paper(&[0.5], &[1.0]);
/// let mut run = ActorCriticRun::new(&config, process.spec(), None)?;
/// let mut frozen = vec![run.policy().clone()]; // before any learning
/// for _ in 0..config.trials {
///     run.run_trial(process, rng)?;
///     frozen.push(run.policy().clone());
/// }
/// let outcome = run.finish();
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct ActorCriticRun {
    config: ActorCriticConfig,
    policy: GaussianPolicy,
    /// The policies after the last trials, averaged: weights as in `policy`, and how many.
    average: Option<(GaussianPolicy, usize)>,
    /// e, rows as in the network without the value.
    traces: Vec<f64>,
    /// Bases at x(k) and at x(k+1).
    here: Activations,
    there: Activations,
    trials: Vec<TrialSummary>,
    strides: usize,
}

impl ActorCriticRun {
    /// Prepares a run.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] or [`LearnError::Length`] if the configuration is not valid or does
    /// not fit the process; [`LearnError::InitialPolicy`] if `initial` is not a network policy;
    /// [`LearnError::OtherProcess`] if it is for other components.
    pub fn new(
        config: &ActorCriticConfig,
        spec: &ProcessSpec,
        initial: Option<&SavedPolicy>,
    ) -> Result<Self, LearnError> {
        config.validate()?;
        let units = config.units();
        let scratch = GaussianPolicy::new(spec.clone(), &config.basis_widths, &units, config.std_scale)?;
        let policy = match initial {
            None => scratch,
            Some(SavedPolicy::GaussianNetwork(policy)) => warm_start(policy, &scratch, config)?,
            Some(other) => {
                let found = other.kind();
                return Err(LearnError::InitialPolicy { expected: "gaussian_network", found });
            }
        };
        let traces = vec![0.0; policy.network().len() * 2 * spec.action.len()];
        Ok(Self {
            config: config.clone(),
            policy,
            average: None,
            traces,
            here: Activations::default(),
            there: Activations::default(),
            trials: Vec::with_capacity(config.trials),
            strides: 0,
        })
    }

    /// The policy as it stands, not averaged.
    #[must_use]
    pub const fn policy(&self) -> &GaussianPolicy {
        &self.policy
    }

    /// The learning curve so far.
    #[must_use]
    pub fn trials(&self) -> &[TrialSummary] {
        &self.trials
    }

    /// Ends the run: the averaged policy if there is one, otherwise the last.
    #[must_use]
    pub fn finish(self) -> LearnOutcome {
        let policy = self.average.map_or(self.policy, |(policy, _)| policy);
        LearnOutcome { policy: policy.to_saved(), trials: self.trials, strides: self.strides }
    }

    /// Learns for one more trial.
    ///
    /// # Errors
    ///
    /// [`LearnError::Process`] if the process fails, [`LearnError::NotFinite`] or
    /// [`LearnError::StateLength`] if it answers nonsense, [`LearnError::Diverged`] if the weights
    /// grow beyond all bounds, [`LearnError::AllAborted`] if nothing could be learned.
    ///
    /// # Cost
    ///
    /// One evaluation of the bases a stride, O(bases × (2 actions + 1)); memory is allocated only
    /// when a base is.
    pub fn run_trial(
        &mut self,
        process: &mut dyn StrideProcess,
        rng: &mut ChaCha8Rng,
    ) -> Result<TrialSummary, LearnError> {
        let trial = self.trials.len();
        let factor = self.config.step_factor(trial);
        let m = self.policy.spec().action.len();
        let strides = self.config.strides_per_trial;
        let mut learning = Trial {
            alpha: factor * self.config.critic_step,
            beta: factor * self.config.actor_step,
            at: Place { trial: trial + 1, stride: 1 },
            outputs: Outputs::from_elem(0.0, 2 * m + 1),
            scores: Outputs::from_elem(0.0, 2 * m),
            tally: Tally::default(),
            run: self,
        };
        roll_out(process, strides, &mut learning, rng)?;
        let tally = learning.tally;
        if tally.strides == 0 {
            return Err(LearnError::AllAborted { trial: trial + 1 });
        }
        if self.policy.network().all_weights().iter().any(|w| !w.is_finite()) {
            return Err(Place { trial: trial + 1, stride: strides }.diverged());
        }
        self.average_policy(trial);
        let summary = tally.summary(trial + 1, self.policy.network().len());
        self.trials.push(summary);
        Ok(summary)
    }

    /// Draws outputs, leaves ∂ ln π by mean and logit in `scores`, and answers with the action.
    fn draw(&self, outputs: &[f64], scores: &mut [f64], rng: &mut ChaCha8Rng, at: Place) -> Result<Action, LearnError> {
        let m = scores.len() / 2;
        let mut action = Action::from_elem(0.0, m);
        for j in 0..m {
            let z: f64 = StandardNormal.sample(rng);
            let score = Score::drawn(z, outputs[m + j], self.policy.std_scale());
            let output = outputs[j] + score.std * z;
            let scale = if self.config.scale_gradient_by_variance { score.std * score.std } else { 1.0 };
            scores[j] = score.mean * scale;
            scores[m + j] = score.std_logit * scale;
            action[j] = self.policy.clip(output, j);
            if !(action[j].is_finite() && scores[j].is_finite() && scores[m + j].is_finite()) {
                return Err(at.diverged());
            }
        }
        Ok(action)
    }

    /// Eqs. (19), (21) and (22), and the bounds on the weights.
    fn update(&mut self, td_error: f64, alpha: f64, beta: f64, scores: &[f64]) {
        let (m, eta) = (scores.len() / 2, self.config.trace_decay);
        let logit_bounds = self.config.std_logit_bounds;
        let mean_bounds = self.mean_weight_bounds();
        let rows = self.policy.network_mut().all_weights_mut().chunks_exact_mut(2 * m + 1);
        let traces = self.traces.chunks_exact_mut(2 * m);
        for ((row, trace), b) in rows.zip(traces).zip(self.here.normalized()) {
            for ((w, e), g) in row.iter_mut().zip(trace).zip(scores) {
                *e = eta * *e + g * b;
                *w += beta * td_error * *e;
            }
            for (w, [low, high]) in row.iter_mut().zip(&mean_bounds) {
                *w = w.clamp(*low, *high);
            }
            if let Some([low, high]) = logit_bounds {
                for w in &mut row[m..2 * m] {
                    *w = w.clamp(low, high);
                }
            }
            row[2 * m] += alpha * td_error * b;
        }
    }

    /// Bounds of the mean weights per component, in outputs; empty if there are none.
    fn mean_weight_bounds(&self) -> SmallVec<[[f64; 2]; 8]> {
        self.config.mean_weight_bounds(self.policy.spec())
    }

    /// Adds a base at the state whose bases are in `here`, if none is active there.
    fn allocate_at(&mut self, state: &[f64]) {
        if self.here.largest() >= self.config.activation_threshold
            || self.policy.network().len() >= self.config.max_bases
        {
            return;
        }
        self.policy.network_mut().allocate(state);
        if let Some((average, _)) = &mut self.average {
            average.network_mut().allocate(state);
        }
        let m = self.policy.spec().action.len();
        self.traces.resize(self.policy.network().len() * 2 * m, 0.0);
        self.policy.network().activate(state, &mut self.here);
    }

    /// Takes the policy after a trial (from 0) into the average, if it is one of the last.
    fn average_policy(&mut self, trial: usize) {
        if trial + self.config.averaged_trials() < self.config.trials {
            return;
        }
        match &mut self.average {
            None => self.average = Some((self.policy.clone(), 1)),
            Some((average, count)) => {
                *count += 1;
                let share = 1.0 / *count as f64;
                let now = self.policy.network().all_weights();
                for (mean, w) in average.network_mut().all_weights_mut().iter_mut().zip(now) {
                    *mean += share * (w - *mean);
                }
            }
        }
    }
}

/// A trial while it runs.
struct Trial<'a> {
    run: &'a mut ActorCriticRun,
    alpha: f64,
    beta: f64,
    at: Place,
    outputs: Outputs,
    scores: Outputs,
    tally: Tally,
}

impl<P: StrideProcess + ?Sized> Actor<P, LearnError> for Trial<'_> {
    fn begin(&mut self, _: &mut P, at: &Situation) -> Result<Next, LearnError> {
        let run = &mut *self.run;
        self.at.check_state(&at.state, run.policy.spec())?;
        run.traces.fill(0.0);
        run.policy.network().activate(&at.state, &mut run.here);
        run.allocate_at(&at.state);
        Ok(Next::Go)
    }

    fn act(&mut self, _: &mut P, _: &Situation, rng: &mut ChaCha8Rng) -> Result<Action, LearnError> {
        self.run.policy.network().outputs_into(&self.run.here, &mut self.outputs);
        self.run.draw(&self.outputs, &mut self.scores, rng, self.at)
    }

    fn saw(&mut self, _: &mut P, made: Made<'_>) -> Result<Next, LearnError> {
        let (run, at, stride) = (&mut *self.run, self.at, made.stride);
        self.at.stride += 1;
        run.strides += 1;
        if stride.end == StrideEnd::Aborted {
            self.tally.aborted += 1;
            return Ok(Next::Restart);
        }
        at.check_finite("reward", stride.reward)?;
        let value = run.policy.value_column();
        let next_value = if stride.end.is_terminal() {
            0.0
        } else {
            at.check_state(&stride.next.state, run.policy.spec())?;
            run.policy.network().activate(&stride.next.state, &mut run.there);
            run.policy.network().output(&run.there, value)
        };
        let td_error = stride.reward + run.config.discount * next_value - self.outputs[value];
        if !td_error.is_finite() {
            return Err(at.diverged());
        }
        run.update(td_error, self.alpha, self.beta, &self.scores);
        self.tally.count(stride.end, stride.reward, td_error);
        let strides = run.config.strides_per_trial;
        let truncated = made.k + 1 >= run.config.restart_every.unwrap_or(strides) || at.stride >= strides;
        if stride.end.is_terminal() || truncated {
            return Ok(Next::Restart);
        }
        std::mem::swap(&mut run.here, &mut run.there);
        run.allocate_at(&stride.next.state);
        Ok(Next::Go)
    }
}

/// The given policy with the process's bounds; units, widths and σ₀ must be the configured ones.
pub(crate) fn warm_start(
    policy: &GaussianPolicy,
    scratch: &GaussianPolicy,
    config: &ActorCriticConfig,
) -> Result<GaussianPolicy, LearnError> {
    check_same_components(policy.spec(), scratch.spec())?;
    let same = |a: &[f64], b: &[f64]| a.iter().map(|v| v.to_bits()).eq(b.iter().map(|v| v.to_bits()));
    for (field, ours, theirs) in [
        ("basis_widths", config.basis_widths.as_slice(), policy.network().widths()),
        ("action_unit", scratch.action_unit(), policy.action_unit()),
        ("std_scale", &[config.std_scale], &[policy.std_scale()]),
    ] {
        if !same(ours, theirs) {
            let value = format!("{ours:?} (the initial policy has {theirs:?})");
            return Err(LearnError::parameter(field, value, "that of the initial policy"));
        }
    }
    let mut policy = policy.clone();
    policy.set_spec(scratch.spec().clone());
    if !config.keep_value {
        let column = policy.value_column();
        for base in 0..policy.network().len() {
            policy.network_mut().weights_mut(base)[column] = 0.0;
        }
    }
    Ok(policy)
}

/// A trial's numbers while it runs.
#[derive(Default)]
pub(crate) struct Tally {
    pub(crate) strides: usize,
    reward: f64,
    td_error: f64,
    td_error_square: f64,
    falls: usize,
    stalls: usize,
    pub(crate) aborted: usize,
}

impl Tally {
    pub(crate) fn count(&mut self, end: StrideEnd, reward: f64, td_error: f64) {
        self.strides += 1;
        self.reward += reward;
        self.td_error += td_error;
        self.td_error_square += td_error * td_error;
        self.falls += usize::from(end == StrideEnd::Fell);
        self.stalls += usize::from(end == StrideEnd::NoCrossing);
    }

    /// Strides that were not made one by one, with the sum of their rewards.
    pub(crate) fn add(&mut self, strides: usize, reward: f64, falls: usize) {
        self.strides += strides;
        self.reward += reward;
        self.falls += falls;
    }

    pub(crate) fn summary(&self, trial: usize, bases: usize) -> TrialSummary {
        let n = self.strides as f64;
        TrialSummary {
            trial,
            strides: self.strides,
            mean_reward: self.reward / n,
            falls: self.falls,
            stalls: self.stalls,
            aborted: self.aborted,
            mean_td_error: self.td_error / n,
            rms_td_error: (self.td_error_square / n).sqrt(),
            bases,
        }
    }
}

#[cfg(test)]
mod tests;
