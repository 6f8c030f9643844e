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

    /// The policy at work, for one that remembers from stride to stride; `None`: its mean is all there is.
    fn acting(&self) -> Option<Box<dyn Acting>> {
        None
    }

    /// The measures of a stride that it wants to see while it works, by name.
    fn measures(&self) -> &[String] {
        &[]
    }

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

/// A stride that was made, as an acting policy sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// x(k).
    pub state: &'a [f64],
    /// u(k), as applied.
    pub action: &'a [f64],
    /// What it was asked to do.
    pub goal: &'a [f64],
    /// What was measured of it, in the order of [`Policy::measures`].
    pub measures: &'a [f64],
    /// Whether it did not reach the section.
    pub fell: bool,
}

/// A policy at work on one robot: it may remember from stride to stride.
pub trait Acting: Send {
    /// The action at a situation.
    fn act(&mut self, at: &Situation) -> Action;

    /// A stride ended.
    fn saw(&mut self, seen: &Seen<'_>);
}
