//! Random streams named by what they are for, so that results do not depend on the order, or the
//! number of threads, in which they are drawn.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// What a stream of random numbers is for.
///
/// Numbers are part of the recorded experiment: add at the end, never reuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Role {
    /// Collecting on the robot: start and exploration.
    Collect = 0,
    /// Starts of the hyperparameter search.
    Fit = 1,
    /// Learning: draws of the policy and of the map.
    Improve = 2,
    /// Evaluation strides on the robot, which choose.
    Evaluate = 3,
    /// Strides run only to report.
    Record = 4,
    /// Pushes.
    Push = 5,
    /// Applying a policy by `run`.
    Run = 6,
    /// Learning directly on the robot, for comparison.
    FullModel = 7,
    /// The frozen policies of a comparison, measured on the robot.
    Compare = 8,
    /// Looking at a robot before anything is learned.
    Check = 9,
    /// Generations of an evolution strategy on the robot.
    RobotSearch = 10,
    /// Goals by which policies are measured.
    Goals = 11,
    /// Strides in simulation that come before those of the robot.
    Prior = 12,
    /// Walks by which a policy is judged.
    Verdict = 20,
}

/// A generator in a state that it was in before.
///
/// # Arguments
///
/// - `stream`, `word` – what [`ChaCha8Rng::get_stream`] and [`ChaCha8Rng::get_word_pos`] said then.
#[must_use]
pub fn resumed(root: u64, stream: u64, word: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(root);
    rng.set_stream(stream);
    rng.set_word_pos(u128::from(word));
    rng
}

/// The random stream of one episode in one role.
///
/// `root` is the experiment's single seed. Streams of different `(role, episode)` are disjoint.
/// `episode` uses its low 56 bits.
///
/// # Example
///
/// ```
/// use rand_chacha::rand_core::RngCore;
/// use stridemap_lab::seed::{Role, stream};
///
/// let alone = stream(7, Role::Collect, 3).next_u64();
/// let _other_episodes = [0, 1, 2].map(|e| stream(7, Role::Collect, e).next_u64());
/// assert_eq!(stream(7, Role::Collect, 3).next_u64(), alone);
/// assert_ne!(stream(7, Role::Improve, 3).next_u64(), alone);
/// ```
#[must_use]
pub fn stream(root: u64, role: Role, episode: u64) -> ChaCha8Rng {
    const EPISODE_BITS: u32 = 56;
    let mut rng = ChaCha8Rng::seed_from_u64(root);
    rng.set_stream((u64::from(role as u8) << EPISODE_BITS) | (episode & ((1 << EPISODE_BITS) - 1)));
    rng
}
