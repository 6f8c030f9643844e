//! What can go wrong in the link.

use std::path::PathBuf;

/// What can go wrong in the link.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// An address or a topic name makes no sense.
    #[error("link.{field} = {value:?}: {problem}")]
    Config {
        /// The key.
        field: &'static str,
        /// Its value.
        value: String,
        /// What is wrong with it.
        problem: String,
    },
    /// The network cannot be joined.
    #[error("cannot join the ROS 2 network: {0}")]
    Network(String),
    /// What was asked for needs the feature `ros2`.
    #[error("this program was built without ROS 2")]
    NotBuilt,
    /// The machine at this end fails.
    #[error(transparent)]
    Machine(#[from] stridemap_robot::RobotError),
    /// A log cannot be read or written.
    #[error("{path}: {problem}")]
    Log {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}
