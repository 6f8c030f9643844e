//! The one loop in which strides are made: on the robot, in its map, in exact maps.

use rand_chacha::ChaCha8Rng;

use crate::process::{Action, ProcessError, Situation, Stride, StrideEnd, StrideProcess};

/// What comes after a stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// The next stride; after a reset where this one did not reach the section.
    Go,
    /// The next stride after a reset.
    Restart,
    /// No more strides.
    Stop,
}

/// A stride that was made.
#[derive(Clone, Copy, Debug)]
pub struct Made<'a> {
    /// Episode, from 0: one more after each reset but the first.
    pub episode: usize,
    /// Stride of its episode, from 0.
    pub k: usize,
    /// Where it began.
    pub at: &'a Situation,
    /// What came of it.
    pub stride: &'a Stride,
}

/// Whoever chooses actions and sees what comes of them: a learner, a policy, an experiment.
pub trait Actor<P: StrideProcess + ?Sized, E: From<ProcessError>> {
    /// An episode begins, after a reset. [`Next::Stop`] ends the roll-out here.
    ///
    /// # Errors
    ///
    /// Whatever ends the roll-out.
    fn begin(&mut self, _process: &mut P, _at: &Situation) -> Result<Next, E> {
        Ok(Next::Go)
    }

    /// The action wanted for the next stride.
    ///
    /// # Errors
    ///
    /// As [`begin`](Self::begin).
    fn act(&mut self, process: &mut P, at: &Situation, rng: &mut ChaCha8Rng) -> Result<Action, E>;

    /// A stride ended.
    ///
    /// # Errors
    ///
    /// As [`begin`](Self::begin).
    fn saw(&mut self, process: &mut P, made: Made<'_>) -> Result<Next, E>;
}

/// Makes strides, from a reset on, and starts anew after each that did not reach the next section.
///
/// # Arguments
///
/// - `strides` – most strides, of all episodes together; fewer where the actor stops.
///
/// # Errors
///
/// Of the process or of the actor.
pub fn roll_out<P: StrideProcess + ?Sized, E: From<ProcessError>>(
    process: &mut P,
    strides: usize,
    actor: &mut (impl Actor<P, E> + ?Sized),
    rng: &mut ChaCha8Rng,
) -> Result<(), E> {
    let (mut episode, mut k) = (0, 0);
    let (mut at, mut at_section) = (Situation::default(), false);
    for _ in 0..strides {
        if !at_section {
            at = process.reset(rng)?;
            if actor.begin(process, &at)? == Next::Stop {
                return Ok(());
            }
        }
        let action = actor.act(process, &at, rng)?;
        let stride = process.stride(&action, rng)?;
        let next = actor.saw(process, Made { episode, k, at: &at, stride: &stride })?;
        if next == Next::Stop {
            return Ok(());
        }
        at_section = next == Next::Go && stride.end == StrideEnd::Crossing;
        if at_section {
            at = stride.next;
            k += 1;
        } else {
            (episode, k) = (episode + 1, 0);
        }
    }
    Ok(())
}

/// [`roll_out`] with the actor as two functions: the action at a situation, and what follows a stride.
///
/// # Errors
///
/// [`ProcessError`] of the process.
///
/// # Example
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use stridemap_process::{Action, Next, ProcessError, StrideProcess, walk};
///
/// # fn example(process: &mut dyn StrideProcess) -> Result<(), ProcessError> {
/// let (mut rng, mut sum) = (ChaCha8Rng::seed_from_u64(1), 0.0);
/// walk(process, 100, &mut rng, |_| Action::from_slice(&[1.0]), |_, made| {
///     sum += made.stride.reward;
///     Next::Go
/// })
/// # }
/// ```
pub fn walk<P: StrideProcess + ?Sized>(
    process: &mut P,
    strides: usize,
    rng: &mut ChaCha8Rng,
    act: impl FnMut(&Situation) -> Action,
    saw: impl FnMut(&mut P, Made<'_>) -> Next,
) -> Result<(), ProcessError> {
    struct Functions<A, S>(A, S);
    impl<P: StrideProcess + ?Sized, A: FnMut(&Situation) -> Action, S: FnMut(&mut P, Made<'_>) -> Next>
        Actor<P, ProcessError> for Functions<A, S>
    {
        fn act(&mut self, _: &mut P, at: &Situation, _: &mut ChaCha8Rng) -> Result<Action, ProcessError> {
            Ok((self.0)(at))
        }
        fn saw(&mut self, process: &mut P, made: Made<'_>) -> Result<Next, ProcessError> {
            Ok((self.1)(process, made))
        }
    }
    roll_out(process, strides, &mut Functions(act, saw), rng)
}
