//! How fast a policy walks: distance over time on the ground.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::Policy;
use stridemap_process::{Action, Next, Situation, StrideEnd};
use stridemap_record::Transition;

use crate::strides::Act;

/// A policy's mean, until a time has passed or the robot is down.
pub struct Walker<'a> {
    policy: &'a dyn Policy,
    left_s: f64,
}

impl<'a> Walker<'a> {
    /// Walks for this long.
    #[must_use]
    pub const fn new(policy: &'a dyn Policy, seconds: f64) -> Self {
        Self { policy, left_s: seconds }
    }
}

impl Act for Walker<'_> {
    fn act(&mut self, at: &Situation, _rng: &mut ChaCha8Rng) -> Action {
        self.policy.mean(at)
    }

    fn saw(&mut self, transition: &Transition) -> Next {
        self.left_s -= transition.measures.duration_s;
        if self.left_s <= 0.0 || transition.end != StrideEnd::Crossing { Next::Stop } else { Next::Go }
    }
}
