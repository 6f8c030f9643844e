//! What the robot says: its messages gathered into whole readings.

use std::collections::BTreeMap;

use ros2_client::Subscription;
use stridemap_robot::{RobotError, Ros2Config, SensorFrame};

use crate::error::LinkError;
use crate::messages::{Imu, JointState, Text, WrenchStamped};
use crate::node::{LinkNode, Topics, drain};
use crate::remote::LinkCounts;
use crate::server::Status;
use crate::wiring::Wiring;

/// The parts of one reading, gathered by their stamp.
#[derive(Default)]
struct Parts {
    joints: Option<JointState>,
    imu: Option<Imu>,
    feet: [Option<f64>; 2],
}

impl Parts {
    const fn whole(&self) -> bool {
        self.joints.is_some()
            && self.imu.is_some()
            && self.feet[0].is_some()
            && self.feet[1].is_some()
    }
}

/// A clock that fell back by more than this is the robot's; less, and an old message arrived late.
const CLOCK_FELL_BACK_NS: u64 = 1_000_000_000;
/// Readings under way; more, and a sensor is silent.
const MOST_UNDER_WAY: usize = 64;

/// Subscriptions to the robot's sensors, and what has come of each reading.
pub(crate) struct Readings {
    states: Subscription<JointState>,
    imu: Subscription<Imu>,
    feet: [Subscription<WrenchStamped>; 2],
    status: Subscription<Text>,
    wiring: Wiring,
    period_s: f64,
    parts: BTreeMap<u64, Parts>,
    /// Stamp of the newest whole reading.
    pub last_stamp_ns: Option<u64>,
    /// Robot time that counts as 0.
    pub zero_ns: u64,
    /// What the robot last said of itself.
    pub newest_status: Option<Status>,
    /// Statuses heard so far.
    pub statuses: u64,
}

/// Why a reading cannot be used.
pub(crate) enum Unusable {
    /// In words.
    Said(String),
    /// The robot has other joints.
    Map(RobotError),
}

impl Readings {
    pub fn open(
        node: &mut LinkNode,
        config: &Ros2Config,
        wiring: Wiring,
        period_s: f64,
    ) -> Result<Self, LinkError> {
        Ok(Self {
            states: node.subscription(&config.joint_states)?,
            imu: node.subscription(&config.imu)?,
            feet: [
                node.subscription(&config.left_foot)?,
                node.subscription(&config.right_foot)?,
            ],
            status: node.subscription(Topics::STATUS)?,
            wiring,
            period_s,
            parts: BTreeMap::new(),
            last_stamp_ns: None,
            zero_ns: 0,
            newest_status: None,
            statuses: 0,
        })
    }

    pub const fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    /// Whether anybody tells the robot's status: a real robot need not.
    pub fn status_is_told(&self, node: &LinkNode) -> bool {
        self.status.get_publisher_count(node.node()) > 0
    }

    /// Forgets readings under way.
    pub fn clear(&mut self) {
        self.parts.clear();
    }

    /// What is missing of the newest reading under way; `None` if nothing has come at all.
    pub fn missing(&self) -> Option<String> {
        self.parts.values().next_back().map(|p| {
            let parts = [
                (p.joints.is_some(), "joint states"),
                (p.imu.is_some(), "inertial unit"),
                (p.feet[0].is_some(), "left foot's load"),
                (p.feet[1].is_some(), "right foot's load"),
            ];
            let missing = parts.iter().filter(|(there, _)| !there);
            missing
                .map(|(_, what)| *what)
                .collect::<Vec<_>>()
                .join(", ")
        })
    }

    /// Takes in what has arrived.
    fn take(&mut self, counts: &mut LinkCounts) {
        let bad = &mut counts.unreadable;
        for (message, _) in drain(&self.states, bad) {
            let stamp = message.header.stamp.nanoseconds();
            self.parts.entry(stamp).or_default().joints = Some(message);
        }
        for (message, _) in drain(&self.imu, bad) {
            let stamp = message.header.stamp.nanoseconds();
            self.parts.entry(stamp).or_default().imu = Some(message);
        }
        for side in 0..2 {
            for (message, _) in drain(&self.feet[side], bad) {
                let stamp = message.header.stamp.nanoseconds();
                self.parts.entry(stamp).or_default().feet[side] = Some(message.force.z);
            }
        }
        for (message, _) in drain(&self.status, bad) {
            match serde_json::from_str(&message.data) {
                Ok(status) => {
                    self.newest_status = Some(status);
                    self.statuses += 1;
                }
                Err(_) => *bad += 1,
            }
        }
    }

    /// The newest whole reading that is newer than the last, if one has arrived.
    pub fn gather(&mut self, counts: &mut LinkCounts) -> Result<Option<SensorFrame>, Unusable> {
        self.take(counts);
        let newest = self.parts.iter().rev().find(|(_, p)| p.whole());
        let Some(stamp) = newest.map(|(stamp, _)| *stamp) else {
            // A silent sensor must not fill the memory.
            while self.parts.len() > MOST_UNDER_WAY {
                self.parts.pop_first();
            }
            return Ok(None);
        };
        if let Some(last) = self.last_stamp_ns
            && stamp <= last
        {
            counts.out_of_order += 1;
            self.parts.remove(&stamp);
            if last - stamp > CLOCK_FELL_BACK_NS {
                self.last_stamp_ns = Some(stamp);
                return Err(Unusable::Said(format!(
                    "the robot's clock went back by {:.3} s",
                    (last - stamp) as f64 * 1e-9
                )));
            }
            return Ok(None);
        }
        let Some(parts) = self.parts.remove(&stamp) else {
            return Ok(None);
        };
        self.parts = self.parts.split_off(&stamp);
        let before = self.last_stamp_ns.replace(stamp);
        let frame = self
            .assemble(stamp, parts)
            .inspect_err(|_| counts.unusable += 1)?;
        counts.states += 1;
        if let Some(before) = before {
            let gap_s = (stamp - before) as f64 * 1e-9;
            let missed = (gap_s / self.period_s).round() - 1.0;
            counts.missed += missed.max(0.0) as u64;
        }
        Ok(Some(frame))
    }

    /// A reading from its parts, checked.
    fn assemble(&mut self, stamp: u64, parts: Parts) -> Result<SensorFrame, Unusable> {
        let said = |what: &str| Unusable::Said(what.to_owned());
        let (Some(joints), Some(imu), [Some(left), Some(right)]) =
            (parts.joints, parts.imu, parts.feet)
        else {
            return Err(said("a reading is not whole"));
        };
        let joints = self.wiring.read(&joints).map_err(|error| match error {
            RobotError::CommandLength { expected, found } => {
                Unusable::Said(format!("{found} angles for {expected} joints"))
            }
            other => Unusable::Map(other),
        })?;
        let q = imu.data.orientation;
        let frame = SensorFrame {
            time_s: stamp.saturating_sub(self.zero_ns) as f64 * 1e-9,
            joints,
            orientation: [q.w, q.x, q.y, q.z],
            angular_velocity_rad_s: imu.data.angular_velocity.into(),
            loads_n: [left, right],
        };
        if let Some(field) = frame.first_not_finite() {
            return Err(Unusable::Said(format!("the robot's {field} is not finite")));
        }
        let norm: f64 = frame.orientation.iter().map(|v| v * v).sum();
        if (norm - 1.0).abs() > 0.01 {
            return Err(said("the robot's orientation is no rotation"));
        }
        Ok(frame)
    }
}
