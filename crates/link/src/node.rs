//! A node on the ROS 2 network.

use std::net::IpAddr;
use std::thread::JoinHandle;
use std::time::Duration;

use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Context, MessageInfo, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher,
    QosProfile, Subscription,
};
use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::messages::RosMessage;

/// Names of the topics besides those that the configuration names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Topics;

impl Topics {
    /// `std_msgs/UInt64MultiArray`: `[sequence, stamp of the answered state in ns]`, before each command.
    pub const HEARTBEAT: &'static str = "/stridemap/heartbeat";
    /// `std_msgs/String`: presses the emergency stop; the text is the reason.
    pub const STOP: &'static str = "/stridemap/stop";
    /// `std_msgs/String`: re-arms after an emergency stop.
    pub const REARM: &'static str = "/stridemap/rearm";
    /// `std_msgs/String`: asks a simulated robot to put itself on its feet.
    pub const SET_UP: &'static str = "/stridemap/set_up";
    /// `std_msgs/String`: what the robot's guard did, as JSON, ten times a second of robot time.
    pub const STATUS: &'static str = "/stridemap/status";
    /// `trajectory_msgs/JointTrajectory`.
    pub const TRAJECTORY: &'static str = "/joint_trajectory_controller/joint_trajectory";
}

/// A node and the thread that serves it.
pub(crate) struct LinkNode {
    node: Node,
    spinner: Option<JoinHandle<()>>,
}

fn network(error: impl std::fmt::Debug) -> LinkError {
    LinkError::Network(format!("{error:?}"))
}

/// Commands and states must arrive, and only the newest matters.
fn newest(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth })
}

impl LinkNode {
    /// Joins the network.
    pub fn open(config: &Ros2Config, name: &str) -> Result<Self, LinkError> {
        let interface: IpAddr =
            config
                .interface
                .parse()
                .map_err(|e: std::net::AddrParseError| LinkError::Config {
                    field: "interface",
                    value: config.interface.clone(),
                    problem: e.to_string(),
                })?;
        if config.domain > 232 {
            return Err(LinkError::Config {
                field: "domain",
                value: config.domain.to_string(),
                problem: "domains are 0 to 232".into(),
            });
        }
        let participant = DomainParticipantBuilder::new(config.domain)
            .with_only_networks([interface])
            .build()
            .map_err(network)?;
        let context = Context::from_domain_participant(participant).map_err(network)?;
        let name = NodeName::new("/", name).map_err(network)?;
        let mut node = context
            .new_node(name, NodeOptions::new())
            .map_err(network)?;
        let spinner = node.spinner().map_err(network)?;
        let spinner = std::thread::Builder::new()
            .name("ros2-spinner".into())
            .spawn(move || {
                // It ends when the node does.
                let _ = futures::executor::block_on(spinner.spin());
            })
            .map_err(network)?;
        Ok(Self {
            node,
            spinner: Some(spinner),
        })
    }

    fn topic<M: RosMessage>(
        &self,
        name: &str,
        depth: usize,
    ) -> Result<ros2_client::dds::rustdds::Topic, LinkError> {
        let parsed = Name::parse(name).map_err(|e| LinkError::Config {
            field: "topic",
            value: name.to_owned(),
            problem: format!("{e:?}"),
        })?;
        let (package, kind) = M::TYPE;
        self.node
            .create_topic(&parsed, MessageTypeName::new(package, kind), &newest(depth))
            .map_err(network)
    }

    pub fn publisher<M: RosMessage>(&mut self, name: &str) -> Result<Publisher<M>, LinkError> {
        let topic = self.topic::<M>(name, 1)?;
        self.node.create_publisher(&topic, None).map_err(network)
    }

    pub fn subscription<M: RosMessage>(
        &mut self,
        name: &str,
    ) -> Result<Subscription<M>, LinkError> {
        let topic = self.topic::<M>(name, 8)?;
        self.node.create_subscription(&topic, None).map_err(network)
    }

    pub const fn node(&self) -> &Node {
        &self.node
    }
}

impl Drop for LinkNode {
    fn drop(&mut self) {
        self.node.stop_spinner();
        // The spinner ends on its own; waiting for it could hang on a broken network.
        drop(self.spinner.take());
    }
}

/// Every message that has arrived, oldest first; what cannot be read is passed over and counted.
pub(crate) fn drain<M: RosMessage>(
    subscription: &Subscription<M>,
    unreadable: &mut u64,
) -> Vec<(M, MessageInfo)> {
    const MOST: usize = 256;
    let mut messages = Vec::new();
    for _ in 0..MOST {
        match subscription.take() {
            Ok(Some(message)) => messages.push(message),
            Ok(None) => break,
            Err(_) => *unreadable += 1,
        }
    }
    messages
}

/// The writer of a message, as a number.
pub(crate) fn writer_of(info: &MessageInfo) -> u128 {
    u128::from_be_bytes(*info.publisher_gid().as_bytes())
}

/// Short enough not to matter at 125 Hz, long enough not to burn a core.
pub(crate) const NAP: Duration = Duration::from_micros(100);
