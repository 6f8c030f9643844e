//! How fast a walk forgets a kick: the flip multiplier, measured the same way on the robot and in its
//! map.
//!
//! From a steady walk under a constant action, one stride is made with another action. What the kick
//! does to one component of the state, the difference from a twin without it, shrinks by the same factor
//! every stride once it is small. A negative factor alternates (a flip); below −1 it grows to a fall.

use rand_chacha::ChaCha8Rng;

use stridemap_process::{Action, Next, ProcessError, Situation, StrideEnd, StrideProcess, walk};

/// Strides of the ramp from the nominal gait to the constant action.
const RAMP_STRIDES: f64 = 20.0;
/// Strides before the kick.
const SETTLE_STRIDES: usize = 50;
/// Strides after the kick over which its decay is fitted.
const DECAY_STRIDES: usize = 8;

/// What is kicked, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kick<'a> {
    /// The constant action.
    pub action: &'a [f64],
    /// The action of the nominal gait, from which the walk begins.
    pub neutral: &'a [f64],
    /// The component of the action that kicks.
    pub component: usize,
    /// The kick, in the component's unit; it is given both ways.
    pub size: f64,
    /// The component of the state that is watched.
    pub watched: usize,
}

/// The watched component after each stride from the kick on; `None` if the walk ended before.
fn kicked(
    process: &mut dyn StrideProcess,
    kick: &Kick<'_>,
    size: f64,
    rng: &mut ChaCha8Rng,
) -> Result<Option<Vec<f64>>, ProcessError> {
    let mut watched = Vec::with_capacity(DECAY_STRIDES + 1);
    let mut k = 0;
    let action = |_: &Situation| {
        let share = ((k + 1) as f64 / RAMP_STRIDES).min(1.0);
        let way = kick.action.iter().zip(kick.neutral);
        let mut action: Action = way.map(|(u, n)| n + share * (u - n)).collect();
        if k == SETTLE_STRIDES {
            action[kick.component] += size;
        }
        k += 1;
        action
    };
    walk(process, SETTLE_STRIDES + 2 + DECAY_STRIDES, rng, action, |_, made| {
        if made.stride.end != StrideEnd::Crossing {
            return Next::Stop;
        }
        if made.k > SETTLE_STRIDES {
            watched.push(made.stride.next.state[kick.watched]);
        }
        Next::Go
    })?;
    Ok((watched.len() > DECAY_STRIDES).then_some(watched))
}

/// The factor from stride to stride by which kicks both ways decay, by least squares over the strides
/// after the kick; `None` if the process does not walk that long, or if the kick leaves no trace.
///
/// # Arguments
///
/// - `process` – the robot, or a map of it that draws its mean; without limits on the action's rate, or
///   the kick would last longer than a stride.
/// - `rng` – the state of the random stream with which each of the three walks begins.
///
/// # Errors
///
/// [`ProcessError`] of the process.
///
/// # Example
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use stridemap_map::{Kick, decay_after_kick};
/// use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters};
///
/// // x' = -0.8 x + u without noise: a kick decays by -0.8 from stride to stride.
/// let mut process = LinearGaussianMap::new(LinearGaussianParameters {
///     a: vec![vec![-0.8]],
///     b: vec![vec![1.0]],
///     offset: vec![0.0],
///     noise_std: vec![0.0],
///     ..LinearGaussianParameters::stepping()
/// })?;
/// let kick = Kick { action: &[2.0], neutral: &[0.0], component: 0, size: 1.0, watched: 0 };
/// let factor = decay_after_kick(&mut process, &kick, &ChaCha8Rng::seed_from_u64(1))?;
/// assert!((factor.unwrap() + 0.8).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn decay_after_kick(
    process: &mut dyn StrideProcess,
    kick: &Kick<'_>,
    rng: &ChaCha8Rng,
) -> Result<Option<f64>, ProcessError> {
    let Some(twin) = kicked(process, kick, 0.0, &mut rng.clone())? else {
        return Ok(None);
    };
    let (mut xy, mut xx) = (0.0, 0.0);
    for size in [kick.size, -kick.size] {
        let Some(walked) = kicked(process, kick, size, &mut rng.clone())? else {
            return Ok(None);
        };
        let off: Vec<f64> = walked.iter().zip(&twin).map(|(a, b)| a - b).collect();
        for pair in off.windows(2) {
            xy += pair[0] * pair[1];
            xx += pair[0] * pair[0];
        }
    }
    Ok((xx > 0.0).then(|| xy / xx))
}
