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

mod assemble;
mod error;
mod faults;
mod guard;
mod interface;
mod journal;
mod listener;
mod log;
mod mcap_file;
mod messages;
mod network;
mod node;
mod readings;
mod remote;
mod replay;
mod server;
mod stop;
mod stream;
mod trajectory;
mod watch;
mod wiring;

pub use error::LinkError;
pub use faults::{FAULT_DOMAINS, FaultRow, fault_table};
pub use guard::{Act, CommandGuard, GuardBounds, Refusals};
pub use interface::check_network;
pub use journal::{Journal, LoggedMachine, SharedJournal};
pub use listener::StatusListener;
pub use log::{LogReport, LoggedAction, LoggedEpisode, read_log};
pub use messages::{Clock, Float64MultiArray, Header, Imu, JointState, JointTrajectory, RosTime, WrenchStamped};
pub use network::{BadNetwork, NetworkConditions};
pub use node::Topics;
pub use remote::{AlwaysConfirms, LinkCounts, Operator, RemoteMachine};
pub use replay::{Repeated, ReplayMachine};
pub use server::{Serve, ServerReport, Status, serve};
pub use stop::send_stop;
pub use trajectory::{Trajectory, TrajectoryFault};
