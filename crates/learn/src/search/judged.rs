//! How a candidate fares in episodes of a process.

use rand_chacha::ChaCha8Rng;
use stridemap_process::{Action, Actor, Made, Next, Situation, Stride, StrideEnd, StrideProcess, roll_out};

use crate::error::{LearnError, Place};
use crate::learner::TrialSummary;

/// The episodes by which candidates are judged.
#[derive(Clone, Copy)]
pub(crate) struct Episodes {
    /// How many.
    pub episodes: usize,
    /// Strides of each.
    pub strides: usize,
    /// First strides of each that do not count, except where they fall.
    pub unscored: usize,
    /// Values an episode by its discounted reward, to its end or a fall; `None`: strides by their mean reward, and after
    /// a fall the episode goes on from a new start.
    pub discount: Option<f64>,
}

impl Episodes {
    /// Runs the episodes of one candidate: what it does at a situation.
    pub fn score(
        self,
        process: &mut dyn StrideProcess,
        act: &dyn Fn(&Situation) -> Action,
        rng: &mut ChaCha8Rng,
        trial: usize,
    ) -> Result<Score, LearnError> {
        let mut score = Score::default();
        for _ in 0..self.episodes {
            let mut judged = Judged {
                act,
                unscored: self.unscored,
                discount: self.discount,
                weight: 1.0,
                at: Place { trial, stride: 1 },
                score,
            };
            roll_out(process, self.strides, &mut judged, rng)?;
            score = judged.score;
        }
        if score.scored == 0 {
            return Err(LearnError::AllAborted { trial });
        }
        Ok(score)
    }
}

/// A candidate in one of its episodes.
struct Judged<'a> {
    act: &'a dyn Fn(&Situation) -> Action,
    unscored: usize,
    discount: Option<f64>,
    weight: f64,
    at: Place,
    score: Score,
}

impl<P: StrideProcess + ?Sized> Actor<P, LearnError> for Judged<'_> {
    fn begin(&mut self, process: &mut P, at: &Situation) -> Result<Next, LearnError> {
        self.at.check_state(&at.state, process.spec())?;
        Ok(Next::Go)
    }

    fn act(&mut self, _: &mut P, at: &Situation, _: &mut ChaCha8Rng) -> Result<Action, LearnError> {
        Ok((self.act)(at))
    }

    fn saw(&mut self, process: &mut P, made: Made<'_>) -> Result<Next, LearnError> {
        let (at, stride) = (self.at, made.stride);
        self.at.stride += 1;
        if stride.end == StrideEnd::Aborted {
            self.score.aborted += 1;
            return Ok(Next::Go);
        }
        at.check_state(&stride.next.state, process.spec())?;
        at.check_finite("reward", stride.reward)?;
        self.score.count(stride);
        let (ended, scored) = (stride.end.is_terminal(), at.stride > self.unscored);
        let Some(discount) = self.discount else {
            if scored || ended {
                self.score.scored += 1;
                self.score.reward += stride.reward;
            }
            return Ok(Next::Go);
        };
        self.score.scored += usize::from(at.stride == 1);
        self.score.reward += self.weight * stride.reward;
        self.weight *= discount;
        Ok(if ended { Next::Stop } else { Next::Go })
    }
}

/// How a candidate, or a generation, fared.
#[derive(Default)]
pub(crate) struct Score {
    scored: usize,
    reward: f64,
    pub strides_made: usize,
    all_rewards: f64,
    falls: usize,
    stalls: usize,
    pub aborted: usize,
}

impl Score {
    fn count(&mut self, stride: &Stride) {
        self.strides_made += 1;
        self.all_rewards += stride.reward;
        self.falls += usize::from(stride.end == StrideEnd::Fell);
        self.stalls += usize::from(stride.end == StrideEnd::NoCrossing);
    }

    pub fn add(&mut self, other: &Self) {
        self.strides_made += other.strides_made;
        self.all_rewards += other.all_rewards;
        self.falls += other.falls;
        self.stalls += other.stalls;
        self.aborted += other.aborted;
    }

    pub fn value(&self) -> f64 {
        self.reward / self.scored as f64
    }

    pub fn summary(&self, trial: usize) -> TrialSummary {
        let strides = self.strides_made - self.aborted;
        TrialSummary {
            trial,
            strides,
            mean_reward: self.all_rewards / strides as f64,
            falls: self.falls,
            stalls: self.stalls,
            aborted: self.aborted,
            mean_td_error: 0.0,
            rms_td_error: 0.0,
            bases: 0,
        }
    }
}
