//! Exploring under guard: after a warning the robot goes back towards the nominal gait for a while.

use rand_chacha::ChaCha8Rng;
use stridemap_process::{Action, Next, Situation, StrideEnd};
use stridemap_record::{Transition, Warning};

use crate::guard::{Guard, GuardConfig, GuardThresholds};
use crate::strides::{Act, ActionSource, Source};

/// Explores; after a warning asks for an action nearer to the nominal gait.
pub struct GuardedExplorer<'a> {
    explorer: Source<'a>,
    config: &'a GuardConfig,
    thresholds: Option<GuardThresholds>,
    guard: Option<Guard>,
    neutral: Vec<f64>,
    back_off_strides: usize,
    backing_off: Option<(usize, Action)>,
    strides: usize,
    warnings: Vec<(usize, Warning)>,
}

impl<'a> GuardedExplorer<'a> {
    /// An explorer that goes back half of the way to the neutral action for some strides after each
    /// warning.
    ///
    /// # Arguments
    ///
    /// - `thresholds` – `None`: no guard.
    #[must_use]
    pub fn new(
        source: &'a ActionSource<'a>,
        config: &'a GuardConfig,
        thresholds: Option<GuardThresholds>,
        neutral: Vec<f64>,
        back_off_strides: usize,
    ) -> Self {
        Self {
            explorer: Source::new(source),
            config,
            thresholds,
            guard: None,
            neutral,
            back_off_strides,
            backing_off: None,
            strides: 0,
            warnings: Vec::new(),
        }
    }

    /// The strides, from 1, at which the guard warned, and of what.
    #[must_use]
    pub fn warnings(&self) -> &[(usize, Warning)] {
        &self.warnings
    }
}

impl Act for GuardedExplorer<'_> {
    fn act(&mut self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        // The draws of the explorer do not depend on warnings: the same seed explores the same way.
        let wanted = self.explorer.act(at, rng);
        match &self.backing_off {
            Some((_, safe)) => safe.clone(),
            None => wanted,
        }
    }

    fn saw(&mut self, transition: &Transition) -> Next {
        self.strides += 1;
        if transition.end != StrideEnd::Crossing {
            (self.guard, self.backing_off) = (None, None);
            return Next::Go;
        }
        let Some(thresholds) = self.thresholds else {
            return Next::Go;
        };
        let guard = self.guard.get_or_insert_with(|| Guard::new(self.config, thresholds));
        let warning = guard.watch(&transition.measures);
        self.warnings.extend(warning.map(|w| (self.strides, w)));
        let warned = warning.is_some();
        self.backing_off = match self.backing_off.take() {
            Some((left, safe)) if left > 1 => Some((left - 1, safe)),
            Some(_) => None,
            None if warned && self.back_off_strides > 0 => {
                let half = transition.action.iter().zip(&self.neutral);
                let safe = half.map(|(u, n)| n + 0.5 * (u - n)).collect();
                Some((self.back_off_strides, safe))
            }
            None => None,
        };
        Next::Go
    }
}
