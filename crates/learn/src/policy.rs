//! What a policy is.

use rand_chacha::ChaCha8Rng;
use stridemap_process::{Action, Situation};

/// A stochastic policy `π_w(x, u) = p(u | x; w)` \[MA09, eq. (8)\] with a normal density of diagonal
/// covariance \[MA09, eq. (23)\], in the units of its process.
pub trait Policy: Send + Sync {
    /// The mean action at a situation.
    fn mean(&self, at: &Situation) -> Action;

    /// The standard deviation of each component of the action at a situation; zeros for a
    /// deterministic policy.
    fn std(&self, at: &Situation) -> Action;

    /// Draws an action at a situation.
    fn sample(&self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        use rand_distr::Distribution;
        self.mean(at)
            .iter()
            .zip(self.std(at))
            .map(|(m, s)| {
                let z: f64 = rand_distr::StandardNormal.sample(rng);
                m + s * z
            })
            .collect()
    }
}
