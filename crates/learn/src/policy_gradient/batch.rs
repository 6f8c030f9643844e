//! A batch of strides by a stochastic policy, with what a gradient needs of each.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use smallvec::SmallVec;
use stridemap_process::{Action, Actor, Made, Next, Situation, StrideEnd, StrideProcess, roll_out};

use super::PolicyGradientConfig;
use crate::actor_critic::{ActorCriticConfig, Tally};
use crate::error::{LearnError, Place};
use crate::gaussian_policy::{GaussianPolicy, Score};
use crate::network::Activations;

/// bᵢ(x).
pub(super) type Bases = SmallVec<[f64; 32]>;

/// A stride as a gradient sees it.
pub(super) struct Seen {
    /// Bases at x(k).
    pub here: Bases,
    /// ∂ ln π by the outputs: m means, then m logits.
    pub scores: SmallVec<[f64; 16]>,
    /// r(k+1).
    pub reward: f64,
    /// Bases at x(k+1); `None` after a fall or stall.
    pub next: Option<Bases>,
    /// Whether its episode ended with it.
    pub is_last: bool,
}

/// Strides of one policy.
pub(super) struct Batch {
    pub strides: Vec<Seen>,
    pub tally: Tally,
    /// Aborted ones included.
    pub strides_made: usize,
    /// Whether the policy was given bases on the way.
    pub has_new_bases: bool,
    /// Bases of the policy.
    pub bases: usize,
    /// Scores of a stride: twice the components of the action.
    pub outputs: usize,
}

impl Batch {
    /// Weights of mean and logit in all.
    pub fn parameters(&self) -> usize {
        self.bases * self.outputs
    }

    /// ∇ ln π of a stride by all weights, base by base, added to `sum`.
    pub fn add_gradient(&self, stride: &Seen, sum: &mut [f64]) {
        for (row, b) in sum.chunks_exact_mut(self.outputs).zip(&stride.here) {
            for (s, score) in row.iter_mut().zip(&stride.scores) {
                *s += b * score;
            }
        }
    }

    /// The mean over strides of `(∇ ln π · direction)²`.
    pub fn mean_square_along(&self, direction: &[f64]) -> f64 {
        let along = |stride: &Seen| -> f64 {
            let rows = direction.chunks_exact(self.outputs).zip(&stride.here);
            rows.map(|(row, b)| b * row.iter().zip(&stride.scores).map(|(d, s)| d * s).sum::<f64>()).sum()
        };
        self.strides.iter().map(|s| along(s).powi(2)).sum::<f64>() / self.strides.len().max(1) as f64
    }

    /// Its episodes.
    pub fn episodes(&self) -> impl Iterator<Item = &[Seen]> {
        self.strides.split_inclusive(|s| s.is_last)
    }
}

/// Makes a batch. Bases are added where none is active, as the actor-critic does.
pub(super) fn collect(
    network: &ActorCriticConfig,
    config: &PolicyGradientConfig,
    policy: &mut GaussianPolicy,
    process: &mut dyn StrideProcess,
    trial: usize,
    rng: &mut ChaCha8Rng,
) -> Result<Batch, LearnError> {
    let most = config.max_bases.min(network.max_bases);
    let mut collecting = Collecting {
        policy,
        threshold: network.activation_threshold,
        most,
        episode_strides: config.episode_strides,
        here: Activations::default(),
        scores: SmallVec::new(),
        at: Place { trial, stride: 1 },
        strides: Vec::with_capacity(config.strides_per_trial),
        tally: Tally::default(),
        has_new_bases: false,
    };
    roll_out(process, config.strides_per_trial, &mut collecting, rng)?;
    let Collecting { mut strides, tally, has_new_bases, at, policy, .. } = collecting;
    if tally.strides == 0 {
        return Err(LearnError::AllAborted { trial });
    }
    if let Some(last) = strides.last_mut() {
        last.is_last = true;
    }
    let (bases, outputs) = (policy.network().len(), 2 * policy.spec().action.len());
    Ok(Batch { strides, tally, strides_made: at.stride - 1, has_new_bases, bases, outputs })
}

struct Collecting<'a> {
    policy: &'a mut GaussianPolicy,
    threshold: f64,
    most: usize,
    episode_strides: usize,
    here: Activations,
    scores: SmallVec<[f64; 16]>,
    at: Place,
    strides: Vec<Seen>,
    tally: Tally,
    has_new_bases: bool,
}

impl Collecting<'_> {
    fn look(&mut self, state: &[f64]) {
        self.policy.network().activate(state, &mut self.here);
        if self.here.largest() < self.threshold && self.policy.network().len() < self.most {
            self.policy.network_mut().allocate(state);
            self.policy.network().activate(state, &mut self.here);
            self.has_new_bases = true;
        }
    }
}

impl<P: StrideProcess + ?Sized> Actor<P, LearnError> for Collecting<'_> {
    fn begin(&mut self, _: &mut P, at: &Situation) -> Result<Next, LearnError> {
        self.at.check_state(&at.state, self.policy.spec())?;
        self.look(&at.state);
        Ok(Next::Go)
    }

    fn act(&mut self, _: &mut P, _: &Situation, rng: &mut ChaCha8Rng) -> Result<Action, LearnError> {
        let m = self.policy.spec().action.len();
        let mut outputs: SmallVec<[f64; 16]> = SmallVec::from_elem(0.0, 2 * m + 1);
        self.policy.network().outputs_into(&self.here, &mut outputs);
        self.scores = SmallVec::from_elem(0.0, 2 * m);
        let mut action = Action::from_elem(0.0, m);
        for j in 0..m {
            let z: f64 = StandardNormal.sample(rng);
            let score = Score::drawn(z, outputs[m + j], self.policy.std_scale());
            (self.scores[j], self.scores[m + j]) = (score.mean, score.std_logit);
            action[j] = self.policy.clip(outputs[j] + score.std * z, j);
            if !(action[j].is_finite() && score.mean.is_finite()) {
                return Err(self.at.diverged());
            }
        }
        Ok(action)
    }

    fn saw(&mut self, _: &mut P, made: Made<'_>) -> Result<Next, LearnError> {
        let (at, stride) = (self.at, made.stride);
        self.at.stride += 1;
        if stride.end == StrideEnd::Aborted {
            self.tally.aborted += 1;
            if let Some(last) = self.strides.last_mut() {
                last.is_last = true;
            }
            return Ok(Next::Restart);
        }
        at.check_finite("reward", stride.reward)?;
        self.tally.count(stride.end, stride.reward, 0.0);
        let (here, scores) = (Bases::from_slice(self.here.normalized()), self.scores.clone());
        let mut seen = Seen { here, scores, reward: stride.reward, next: None, is_last: true };
        if !stride.end.is_terminal() {
            at.check_state(&stride.next.state, self.policy.spec())?;
            self.look(&stride.next.state);
            seen.next = Some(Bases::from_slice(self.here.normalized()));
            seen.is_last = made.k + 1 >= self.episode_strides;
        }
        let next = if seen.is_last { Next::Restart } else { Next::Go };
        self.strides.push(seen);
        Ok(next)
    }
}
