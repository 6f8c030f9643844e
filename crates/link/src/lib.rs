//! Robots behind ROS 2.
//!
//! ```text
//! controller process                                robot process, or a real robot
//! EstimatedRobot ─ RemoteMachine ══ DDS topics ══ serve ─ CommandGuard ─ Machine
//!                       │
//!                     Journal (MCAP)
//! ```
//!
//! [`RemoteMachine`] is a [`Machine`](stridemap_robot::Machine) over DDS, so that the estimator, the gait, the
//! section and the learner are the same code as on a simulated robot. [`serve`] is the other end: it publishes
//! the readings of any machine and obeys commands through a [`CommandGuard`]. Nothing but the
//! configured network interface is heard or spoken to: loopback, unless another is named.
//!
//! Logs are read and written in every build; what speaks DDS needs the feature `ros2`, without which asking for it is
//! [`LinkError::NotBuilt`].
// The reader of logs uses a part of what the reader of the wire does.
#![cfg_attr(not(feature = "ros2"), allow(dead_code))]

mod assemble;
mod error;
mod guard;
mod journal;
mod log;
mod mcap_file;
mod messages;
mod operator;
mod replay;
#[cfg_attr(not(feature = "ros2"), path = "without_ros2.rs")]
mod ros2;
mod served;
mod stream;
mod trajectory;
mod wiring;

pub use assemble::LinkCounts;
pub use error::LinkError;
pub use guard::{Act, CommandGuard, GuardBounds, Refusals};
pub use journal::{Journal, LoggedMachine, SharedJournal};
pub use log::{IMU_COLUMNS, LogReport, LoggedAction, LoggedEpisode, read_imu, read_log};
pub use messages::{Clock, Float64MultiArray, Header, Imu, JointState, JointTrajectory, RosTime, WrenchStamped};
pub use operator::{AlwaysConfirms, FIRST_START, NEW_START, Operator};
pub use replay::{Repeated, ReplayMachine};
pub use ros2::*;
pub use served::{Serve, ServerReport, Status};
pub use trajectory::{Trajectory, TrajectoryFault};
