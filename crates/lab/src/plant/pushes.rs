//! Forces on a walking robot.

use stridemap_robot::{Robot, RobotError, Side};

use super::Plant;

/// When a push begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PushBegins {
    /// When the load passes from one foot to the other.
    ChangeOfStance,
    /// So long after the section.
    AfterSection {
        /// Seconds.
        seconds: f64,
    },
}

/// A disturbance: a horizontal force for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// Along the robot's heading when it begins.
    pub forward_n: f64,
    /// Across it, + to the robot's left.
    pub left_n: f64,
    /// For how long.
    pub duration_s: f64,
    /// From when.
    pub begins: PushBegins,
}

impl Push {
    /// A push to the robot's left (+), from the change of stance on.
    #[must_use]
    pub const fn sideways(left_n: f64, duration_s: f64) -> Self {
        Self { forward_n: 0.0, left_n, duration_s, begins: PushBegins::ChangeOfStance }
    }
}

/// The push that is waited for, and the one that acts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pushes {
    pending: Option<Push>,
    /// The force in the world, and when it ends.
    acting: Option<([f64; 3], f64)>,
    section_s: f64,
}

impl Pushes {
    /// The force that acts, in the world.
    pub(super) fn force_n(&self) -> Option<[f64; 3]> {
        self.acting.map(|(force_n, _)| force_n)
    }
}

/// Rounding of the robot's clock.
const ROUNDING_S: f64 = 1e-9;

impl Plant {
    /// Pushes the torso, or the body that [`Self::push_on`] named, once: in the next stride.
    pub fn push_in_next_stride(&mut self, push: Push) {
        self.pushes.pending = Some(push);
    }

    /// Names the body that is pushed; the torso where none was named.
    ///
    /// # Errors
    ///
    /// [`RobotError::NoBody`], [`RobotError::Unsupported`].
    pub fn push_on(&mut self, body: &str) -> Result<(), RobotError> {
        self.robot.push_on(body)
    }

    /// Puts another robot into the place of this one in the middle of the walk: of the same shape, with other masses,
    /// gains or friction. The next reset is the new one's.
    ///
    /// # Errors
    ///
    /// [`RobotError::Unsupported`] where it cannot take over.
    pub fn change_robot(&mut self, mut robot: Box<dyn Robot>) -> Result<(), RobotError> {
        robot.take_over(self.robot.as_ref())?;
        self.robot = robot;
        Ok(())
    }

    /// A stride begins at a section.
    pub(super) fn begin_stride_of_pushes(&mut self) -> Result<(), RobotError> {
        self.pushes.section_s = self.robot_time_s();
        self.update_push(self.detector.stance())
    }

    /// Starts a pending push when its time has come, and ends one whose time is over.
    pub(super) fn update_push(&mut self, stance_before: Option<Side>) -> Result<(), RobotError> {
        let now_s = self.robot_time_s();
        if self.pushes.acting.is_some_and(|(_, until_s)| now_s >= until_s - ROUNDING_S) {
            self.pushes.acting = None;
            self.robot.set_push([0.0; 3])?;
        }
        let Some(push) = self.pushes.pending else { return Ok(()) };
        let due = match push.begins {
            PushBegins::ChangeOfStance => stance_before.is_some() && self.detector.stance() != stance_before,
            PushBegins::AfterSection { seconds } => now_s >= self.pushes.section_s + seconds - ROUNDING_S,
        };
        if due {
            let (sin, cos) = self.robot.state().base.heading_rad().sin_cos();
            let (ahead, left) = (push.forward_n, push.left_n);
            let force_n = [cos * ahead - sin * left, sin * ahead + cos * left, 0.0];
            self.robot.set_push(force_n)?;
            self.pushes.pending = None;
            self.pushes.acting = Some((force_n, now_s + push.duration_s));
        }
        Ok(())
    }
}
