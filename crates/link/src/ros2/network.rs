//! A network that can be made bad: carries the link's messages between two domains.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ros2_client::{Publisher, Subscription};
use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::messages::{Clock, Float64MultiArray, Imu, JointState, RosMessage, Text, UInt64MultiArray, WrenchStamped};
use crate::ros2::node::{LinkNode, NAP, Topics, drain};

/// What the network does to messages, in both directions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkConditions {
    /// Nothing passes.
    pub cut: bool,
    /// Every message is late by this.
    pub delay_s: f64,
    /// One of so many messages of each topic is lost.
    pub lose_one_of: Option<u64>,
    /// Every message comes twice.
    pub twice: bool,
    /// One of so many messages of each topic is overtaken by the next.
    pub overtake_one_of: Option<u64>,
}

/// Carries everything that a robot and a controller say to one another, from the robot's domain to the
/// controller's and back, through the [`NetworkConditions`] of the moment.
pub struct BadNetwork {
    conditions: Arc<Mutex<NetworkConditions>>,
    stop: Arc<AtomicBool>,
    carrier: Option<JoinHandle<()>>,
}

/// One topic, in one direction.
struct Pipe<M: RosMessage> {
    from: Subscription<M>,
    to: Publisher<M>,
    under_way: VecDeque<(Instant, M)>,
    overtaken: Option<M>,
    taken: u64,
}

trait Carry: Send {
    fn carry(&mut self, conditions: &NetworkConditions);
}

impl<M: RosMessage> Pipe<M> {
    fn open(from: &mut LinkNode, to: &mut LinkNode, topic: &str) -> Result<Box<dyn Carry>, LinkError> {
        Ok(Box::new(Self {
            from: from.subscription(topic)?,
            to: to.publisher(topic)?,
            under_way: VecDeque::new(),
            overtaken: None,
            taken: 0,
        }))
    }

    fn send(&mut self, message: M, conditions: &NetworkConditions) {
        let at = Instant::now() + Duration::from_secs_f64(conditions.delay_s);
        if conditions.twice {
            self.under_way.push_back((at, message.clone()));
        }
        self.under_way.push_back((at, message));
    }
}

impl<M: RosMessage> Carry for Pipe<M> {
    fn carry(&mut self, conditions: &NetworkConditions) {
        let one_of = |n: Option<u64>, k: u64| n.is_some_and(|n| k.is_multiple_of(n.max(2)));
        for (message, _) in drain(&self.from, &mut 0) {
            self.taken += 1;
            if conditions.cut || one_of(conditions.lose_one_of, self.taken) {
                continue;
            }
            if one_of(conditions.overtake_one_of, self.taken) {
                self.overtaken = Some(message);
                continue;
            }
            self.send(message, conditions);
            if let Some(late) = self.overtaken.take() {
                self.send(late, conditions);
            }
        }
        if conditions.cut {
            self.under_way.clear();
        }
        while self.under_way.front().is_some_and(|(at, _)| *at <= Instant::now()) {
            if let Some((_, message)) = self.under_way.pop_front() {
                let _ = self.to.publish(message);
            }
        }
    }
}

impl BadNetwork {
    /// Joins the robot's network and the controller's.
    ///
    /// # Errors
    ///
    /// [`LinkError`] if a network cannot be joined.
    pub fn between(robot: &Ros2Config, controller: &Ros2Config) -> Result<Self, LinkError> {
        let mut there = LinkNode::open(robot, "network_robot_side")?;
        let mut here = LinkNode::open(controller, "network_controller_side")?;
        let (r, c) = (&mut there, &mut here);
        let mut pipes: Vec<Box<dyn Carry>> = vec![
            Pipe::<Clock>::open(r, c, &robot.clock)?,
            Pipe::<WrenchStamped>::open(r, c, &robot.left_foot)?,
            Pipe::<WrenchStamped>::open(r, c, &robot.right_foot)?,
            Pipe::<Imu>::open(r, c, &robot.imu)?,
            Pipe::<JointState>::open(r, c, &robot.joint_states)?,
            Pipe::<Text>::open(r, c, Topics::STATUS)?,
            Pipe::<Float64MultiArray>::open(c, r, &robot.commands)?,
            Pipe::<UInt64MultiArray>::open(c, r, Topics::HEARTBEAT)?,
            Pipe::<Text>::open(c, r, Topics::SET_UP)?,
            Pipe::<Text>::open(c, r, Topics::STOP)?,
            Pipe::<Text>::open(c, r, Topics::REARM)?,
        ];
        let conditions = Arc::new(Mutex::new(NetworkConditions::default()));
        let stop = Arc::new(AtomicBool::new(false));
        let (sky, until) = (Arc::clone(&conditions), Arc::clone(&stop));
        let carrier = std::thread::Builder::new()
            .name("bad-network".into())
            .spawn(move || {
                // The nodes live as long as their pipes.
                let _nodes = (there, here);
                while !until.load(Ordering::Relaxed) {
                    let conditions = sky.lock().map(|w| *w).unwrap_or_default();
                    for pipe in &mut pipes {
                        pipe.carry(&conditions);
                    }
                    std::thread::sleep(NAP);
                }
            })
            .map_err(|e| LinkError::Network(format!("a network cannot be made: {e}")))?;
        Ok(Self { conditions, stop, carrier: Some(carrier) })
    }

    /// Changes the conditions.
    pub fn set(&self, conditions: NetworkConditions) {
        if let Ok(mut now) = self.conditions.lock() {
            *now = conditions;
        }
    }
}

impl Drop for BadNetwork {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(carrier) = self.carrier.take() {
            let _ = carrier.join();
        }
    }
}
