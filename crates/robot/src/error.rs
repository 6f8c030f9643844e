//! What can go wrong between a robot and its controller.

/// What can go wrong between a robot and its controller. A fall is not an error.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// A command or a reading does not have one number per joint; nothing was sent.
    #[error("{found} numbers for {expected} joints (nothing was sent)")]
    CommandLength {
        /// Joints of the machine.
        expected: usize,
        /// Numbers given.
        found: usize,
    },
    /// A command is NaN or infinite, or a gain below zero; it was not sent.
    #[error(
        "the command of {joint} has {what} = {value}; commands must be finite and gains not negative (nothing was sent)"
    )]
    BadCommand {
        /// The robot's name of the joint.
        joint: String,
        /// The field of [`JointCommand`](crate::JointCommand).
        what: &'static str,
        /// The value given.
        value: f64,
    },
    /// A joint cannot do what it was asked; nothing was sent.
    #[error("the joint {joint} takes no {what} of the controller's: its servo takes angles (nothing was sent)")]
    JointCannot {
        /// The robot's name of the joint.
        joint: String,
        /// What was asked.
        what: &'static str,
    },
    /// The joint map does not fit the machine.
    #[error("joint map: {joint:?} {why}")]
    JointMap {
        /// The name in the map.
        joint: String,
        /// What is wrong with it.
        why: &'static str,
    },
    /// A kinematic model makes no sense.
    #[error("the kinematic model has {what}")]
    Kinematics {
        /// What it has.
        what: &'static str,
    },
    /// The link to the robot failed, or a guard of the link stepped in.
    #[error("link at {time_s:.3} s: {what}")]
    Link {
        /// Robot time.
        time_s: f64,
        /// What happened.
        what: String,
    },
    /// The robot cannot do this.
    #[error("this robot does not support {what}")]
    Unsupported {
        /// What was asked.
        what: &'static str,
    },
    /// The robot has no body of this name.
    #[error("the robot has no body {body:?}; it has {}", known.join(", "))]
    NoBody {
        /// The name given.
        body: String,
        /// Its bodies.
        known: Vec<String>,
    },
    /// A simulator raised a warning (bad state, full buffers): its state can no longer be trusted.
    #[error("simulator warning at {time_s:.3} s: {warning}")]
    Simulator {
        /// Robot time.
        time_s: f64,
        /// The simulator's own words.
        warning: String,
    },
    /// The robot reported a state that is not finite.
    #[error("the robot's {field} is not finite at {time_s:.3} s")]
    BadState {
        /// Robot time.
        time_s: f64,
        /// The first field at fault.
        field: &'static str,
    },
    /// The emergency stop is latched; the robot moves again only after it was re-armed.
    #[error("emergency stop ({reason}); re-arm it by hand before the robot can move again")]
    EmergencyStop {
        /// Why it was pressed.
        reason: String,
    },
}
