//! What the robot says: subscriptions to its sensors, and the whole readings that come of them.

use ros2_client::Subscription;
use stridemap_robot::{Ros2Config, SensorFrame};

use crate::assemble::LinkCounts;
use crate::assemble::{Assembler, Part};
use crate::error::LinkError;
use crate::messages::{Imu, JointState, RosMessage, Text, WrenchStamped};
use crate::ros2::node::{LinkNode, Topics, drain, writer_of};
use crate::served::Status;
use crate::stream::Unusable;
use crate::wiring::Wiring;

/// Subscriptions to the robot's sensors, and what has come of each reading.
pub(crate) struct Readings {
    states: Subscription<JointState>,
    imu: Subscription<Imu>,
    feet: [Subscription<WrenchStamped>; 2],
    status: Subscription<Text>,
    pub assembler: Assembler,
    /// What the robot last said of itself.
    pub newest_status: Option<Status>,
    /// Statuses heard so far.
    pub statuses: u64,
}

impl Readings {
    pub fn open(node: &mut LinkNode, config: &Ros2Config, mut assembler: Assembler) -> Result<Self, LinkError> {
        assembler.begin_anew();
        Ok(Self {
            states: node.sensor(&config.joint_states)?,
            imu: node.sensor(&config.imu)?,
            feet: [node.sensor(&config.left_foot)?, node.sensor(&config.right_foot)?],
            status: node.subscription(Topics::STATUS)?,
            assembler,
            newest_status: None,
            statuses: 0,
        })
    }

    pub const fn wiring(&self) -> &Wiring {
        self.assembler.wiring()
    }

    /// Stamp of the newest whole reading.
    pub const fn last_stamp_ns(&self) -> Option<u64> {
        self.assembler.last_ns
    }

    /// Whether anybody tells the robot's status: a real robot need not.
    pub fn status_is_told(&self, node: &LinkNode) -> bool {
        self.status.get_publisher_count(node.node()) > 0
    }

    /// What was heard, and what is offered but cannot be.
    pub fn heard(&self, node: &LinkNode, config: &Ros2Config) -> String {
        let (heard, misfits) = (self.assembler.heard(), self.misfits(node, config));
        format!("heard: {heard}{misfits}{}", node.others(config))
    }

    /// What keeps this end from hearing the sensors, in words.
    pub fn misfits(&self, node: &LinkNode, config: &Ros2Config) -> String {
        let here = node.node();
        let [left, right] = &self.feet;
        [
            (&config.joint_states, JointState::TYPE, self.states.get_publisher_count(here)),
            (&config.imu, Imu::TYPE, self.imu.get_publisher_count(here)),
            (&config.left_foot, WrenchStamped::TYPE, left.get_publisher_count(here)),
            (&config.right_foot, WrenchStamped::TYPE, right.get_publisher_count(here)),
        ]
        .map(|(topic, kind, matched)| node.offer(topic, kind, matched))
        .concat()
    }

    fn take_status(&mut self, counts: &mut LinkCounts) {
        for (message, _) in drain(&self.status, &mut counts.unreadable) {
            match serde_json::from_str(&message.data) {
                Ok(status) => {
                    self.newest_status = Some(status);
                    self.statuses += 1;
                }
                Err(_) => counts.unreadable += 1,
            }
        }
    }

    /// Takes in what has arrived; the newest whole reading that is newer than the last, if one has come of it.
    pub fn gather(&mut self, counts: &mut LinkCounts) -> Result<Option<SensorFrame>, Unusable> {
        self.take_status(counts);
        let bad = &mut counts.unreadable;
        let mut parts = Vec::new();
        for (message, info) in drain(&self.states, bad) {
            parts.push((Part::Joints(message), info));
        }
        for (message, info) in drain(&self.imu, bad) {
            parts.push((Part::Imu(message), info));
        }
        for (side, foot) in self.feet.iter().enumerate() {
            for (message, info) in drain(foot, bad) {
                parts.push((Part::Foot(side, message), info));
            }
        }
        for (part, info) in parts {
            self.assembler.push(part, writer_of(&info), counts)?;
        }
        let mut newest = None;
        while let Some(frame) = self.assembler.next(true, counts) {
            newest = Some(frame);
        }
        Ok(newest)
    }
}
