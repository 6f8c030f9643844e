//! The person beside a robot.

/// The person beside the robot, or whoever stands in for him.
pub trait Operator: Send {
    /// Asks that the robot be set on its feet, ready to move; `why` says what happened. `false`: do not go on.
    fn set_up(&mut self, why: &str) -> bool;

    /// Whether somebody is there who can mend what keeps the robot from starting, and is then asked again.
    fn can_mend(&self) -> bool {
        false
    }
}

/// An operator who always agrees: for robots that set themselves up, and for scripts.
#[derive(Clone, Copy, Debug, Default)]
pub struct AlwaysConfirms;

impl Operator for AlwaysConfirms {
    fn set_up(&mut self, _why: &str) -> bool {
        true
    }
}

/// What an operator is told before the first start.
pub const FIRST_START: &str = "before the first stride";
/// What an operator is told when nothing has happened that a person must look at: a batch begins.
pub const NEW_START: &str = "a new start";
