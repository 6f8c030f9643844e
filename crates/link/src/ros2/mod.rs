//! What speaks DDS: both ends of the link, and the rig that tries its faults.

#[cfg(feature = "faults")]
mod faults;
mod interface;
mod listener;
#[cfg(feature = "faults")]
mod network;
mod node;
mod readings;
mod remote;
mod server;
mod stop;
mod watch;

#[cfg(feature = "faults")]
pub use faults::{FaultRow, fault_table};
pub use interface::check_network;
pub use listener::StatusListener;
#[cfg(feature = "faults")]
pub use network::{BadNetwork, NetworkConditions};
pub use node::Topics;
pub use remote::RemoteMachine;
pub use server::serve;
pub use stop::send_stop;
