//! A node on the ROS 2 network.

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::thread::JoinHandle;
use std::time::Duration;

use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder, QosPolicies, RTPSEntity};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::{
    Context, MessageInfo, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Subscription,
};
use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::messages::RosMessage;
use crate::ros2::interface::Interface;

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
    participant: DomainParticipant,
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

/// The ROS 2 name of a DDS topic; `None` for what is no ROS 2 topic.
fn ros_name(dds: &str) -> Option<String> {
    dds.strip_prefix("rt").map(ToOwned::to_owned)
}

fn dds_type((package, name): (&str, &str)) -> String {
    format!("{package}::msg::dds_::{name}_")
}

/// Hears reliable publishers and those of best effort, as sensors often are.
fn sensed() -> QosProfile {
    newest(8).reliability_best_effort()
}

impl LinkNode {
    /// Joins the network, on the configured interface only.
    pub fn open(config: &Ros2Config, name: &str) -> Result<Self, LinkError> {
        let interface = Interface::of(config)?;
        let participant = interface.keep(|| {
            DomainParticipantBuilder::new(config.domain)
                .with_only_networks([IpAddr::from(interface.address)])
                .same_host_loopback(interface.address.is_loopback())
                .build()
                .map_err(network)
        })?;
        let context = Context::from_domain_participant(participant.clone()).map_err(network)?;
        let name = NodeName::new("/", name).map_err(network)?;
        let mut node = context.new_node(name, NodeOptions::new()).map_err(network)?;
        let spinner = node.spinner().map_err(network)?;
        let spinner = std::thread::Builder::new()
            .name("ros2-spinner".into())
            .spawn(move || {
                // It ends when the node does.
                let _ = futures::executor::block_on(spinner.spin());
            })
            .map_err(network)?;
        Ok(Self { node, participant, spinner: Some(spinner) })
    }

    fn topic<M: RosMessage>(
        &self,
        name: &str,
        quality: &QosProfile,
    ) -> Result<ros2_client::dds::rustdds::Topic, LinkError> {
        let parsed = Name::parse(name).map_err(|e| LinkError::Config {
            field: "topic",
            value: name.to_owned(),
            problem: format!("{e:?}"),
        })?;
        let (package, kind) = M::TYPE;
        self.node.create_topic(&parsed, MessageTypeName::new(package, kind), quality).map_err(network)
    }

    pub fn publisher<M: RosMessage>(&mut self, name: &str) -> Result<Publisher<M>, LinkError> {
        let topic = self.topic::<M>(name, &newest(1))?;
        self.node.create_publisher(&topic, None).map_err(network)
    }

    pub fn subscription<M: RosMessage>(&mut self, name: &str) -> Result<Subscription<M>, LinkError> {
        let topic = self.topic::<M>(name, &newest(8))?;
        self.node.create_subscription(&topic, None).map_err(network)
    }

    /// A subscription that hears reliable publishers and those of best effort, as sensors often are.
    pub fn sensor<M: RosMessage>(&mut self, name: &str) -> Result<Subscription<M>, LinkError> {
        let topic = self.topic::<M>(name, &sensed())?;
        self.node.create_subscription(&topic, None).map_err(network)
    }

    /// What keeps this end from hearing a topic that somebody offers, in words; nothing if it hears it.
    pub fn offer(&self, topic: &str, kind: (&str, &str), matched: usize) -> String {
        let writers = self.participant.discovered_writers();
        let offers = writers.iter().map(|w| &w.publication_topic_data);
        let mut offers = offers.filter(|o| ros_name(&o.topic_name).as_deref() == Some(topic));
        let Some(offer) = offers.next() else {
            return format!("; nobody publishes {topic}");
        };
        let wanted = dds_type(kind);
        if offer.type_name != wanted {
            let found = &offer.type_name;
            return format!("; {topic} is offered as {found}, not as {wanted}");
        }
        let misfit = offer.qos().compliance_failure_wrt(&QosPolicies::from(sensed()));
        misfit.filter(|_| matched == 0).map_or_else(String::new, |policy| {
            format!("; the quality of service in which {topic} is offered does not fit: {policy:?}")
        })
    }

    /// What keeps somebody who asks for a topic from hearing this end, in words.
    pub fn asks(&self, topic: &str, kind: (&str, &str), matched: usize) -> String {
        if matched > 0 {
            return String::new();
        }
        let readers = self.participant.discovered_readers();
        let asked = readers.iter().map(|r| &r.subscription_topic_data);
        let own = self.participant.guid().prefix;
        let mut asked = asked.filter(|r| ros_name(r.topic_name()).as_deref() == Some(topic) && r.key().prefix != own);
        let Some(reader) = asked.next() else {
            return format!("; nobody subscribes to {topic}");
        };
        let (found, wanted) = (reader.type_name(), dds_type(kind));
        if *found != wanted {
            return format!("; {topic} is asked for as {found}, not as {wanted}");
        }
        let misfit = QosPolicies::from(newest(1)).compliance_failure_wrt(&reader.qos());
        misfit.map_or_else(String::new, |policy| {
            format!(
                "; {topic} is offered as reliable and volatile, and asked for in another quality of service: \
                 {policy:?}"
            )
        })
    }

    /// The topics that others publish and that the configuration does not name, in words.
    pub fn others(&self, config: &Ros2Config) -> String {
        const MOST: usize = 12;
        let known = [&config.joint_states, &config.imu, &config.left_foot, &config.right_foot];
        let own = self.participant.guid().prefix;
        let writers = self.participant.discovered_writers();
        let topics: BTreeSet<String> = writers
            .iter()
            .map(|w| &w.publication_topic_data)
            .filter(|offer| offer.key.prefix != own)
            .filter_map(|offer| ros_name(&offer.topic_name))
            .filter(|topic| !known.contains(&topic) && !topic.starts_with("/stridemap/"))
            .take(MOST)
            .collect();
        if topics.is_empty() {
            return String::new();
        }
        let topics: Vec<String> = topics.into_iter().collect();
        format!("; others publish {}", topics.join(", "))
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
pub(crate) fn drain<M: RosMessage>(subscription: &Subscription<M>, unreadable: &mut u64) -> Vec<(M, MessageInfo)> {
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
