//! A robot that is served, a network that can be made bad, and controllers of two kinds.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use ros2_client::{Publisher, Subscription};
use stridemap_robot::{Machine, RobotError, Ros2Config};

use super::stand_in::{JOINTS, PERIOD_S, StandIn, limits, names};
use crate::error::LinkError;
use crate::guard::GuardBounds;
use crate::messages::{Float64MultiArray, JointState, UInt64MultiArray};
use crate::operator::AlwaysConfirms;
use crate::ros2::listener::StatusListener;
use crate::ros2::network::BadNetwork;
use crate::ros2::node::{LinkNode, Topics, drain};
use crate::ros2::remote::RemoteMachine;
use crate::ros2::server::serve;
use crate::served::{Serve, ServerReport, Status};

/// A served stand-in, and an listener for what it says. The controller is behind a network of its own: a domain
/// above the robot's.
pub(super) struct Rig {
    pub robot_side: Ros2Config,
    pub controller_side: Ros2Config,
    pub network: BadNetwork,
    pub listener: StatusListener,
    stop: Arc<AtomicBool>,
    server: Option<JoinHandle<Result<ServerReport, LinkError>>>,
    node: LinkNode,
}

impl Rig {
    /// Uses the link's domain and the one above.
    pub fn start(link: &Ros2Config) -> Result<Self, LinkError> {
        let robot_side = Ros2Config { silence_s: 0.5, ..link.clone() };
        let controller_side = Ros2Config { domain: link.domain + 1, ..robot_side.clone() };
        let stop = Arc::new(AtomicBool::new(false));
        let config = Serve {
            link: robot_side.clone(),
            bounds: GuardBounds::default(),
            realtime_factor: 1.0,
            seed: 1,
            most_s: Some(60.0),
            node: "stand_in".into(),
        };
        let began = Instant::now();
        let rig = Self {
            listener: StatusListener::open(&robot_side)?,
            network: BadNetwork::between(&robot_side, &controller_side)?,
            node: LinkNode::open(&robot_side, "raw_controller")?,
            robot_side,
            controller_side,
            server: Some({
                let flag = Arc::clone(&stop);
                std::thread::spawn(move || serve(&mut StandIn::new(), &[0.0; JOINTS], &config, &flag, &mut || {}))
            }),
            stop,
        };
        rig.listener.wait(began, Duration::from_secs(10), |_| true);
        Ok(rig)
    }

    pub fn last(&self) -> Status {
        self.listener.last().unwrap_or_default()
    }

    /// A controller behind the network, standing and ready.
    pub fn controller(&self) -> Result<RemoteMachine, LinkError> {
        let link = &self.controller_side;
        let mut machine = RemoteMachine::open(link, names(), limits(), PERIOD_S, Box::new(AlwaysConfirms))?;
        machine.reset(&[0.0; JOINTS], &mut ChaCha8Rng::seed_from_u64(0))?;
        Ok(machine)
    }

    /// A controller on the robot's own network that may say anything.
    pub fn raw(&mut self) -> Result<Raw, LinkError> {
        let raw = Raw {
            commands: self.node.publisher(&self.robot_side.commands)?,
            heartbeat: self.node.publisher(Topics::HEARTBEAT)?,
            states: self.node.subscription(&self.robot_side.joint_states)?,
            seen: Mutex::default(),
        };
        let deadline = Instant::now() + Duration::from_secs(10);
        // The network's ears are one of each.
        while raw.commands.get_subscription_count(self.node.node()) < 1
            || raw.heartbeat.get_subscription_count(self.node.node()) < 1
        {
            if Instant::now() > deadline {
                return Err(LinkError::Network("the stand-in was not found".into()));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(raw)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(server) = self.server.take() {
            let _ = server.join();
        }
    }
}

/// A controller that may say anything.
pub(super) struct Raw {
    commands: Publisher<Float64MultiArray>,
    heartbeat: Publisher<UInt64MultiArray>,
    states: Subscription<JointState>,
    seen: Mutex<Seen>,
}

/// What a raw controller saw of the joints.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    stamp_ns: u64,
    angle_rad: f64,
    /// Farthest from zero, and fastest, of the first joint.
    pub farthest_rad: f64,
    pub fastest_rad_s: f64,
}

impl Raw {
    pub fn command(&self, data: Vec<f64>) {
        let _ = self.commands.publish(Float64MultiArray { data, ..Float64MultiArray::default() });
    }

    pub fn beat(&self, sequence: u64, stamp_ns: u64) {
        let _ =
            self.heartbeat.publish(UInt64MultiArray { data: vec![sequence, stamp_ns], ..UInt64MultiArray::default() });
    }

    /// Waits for the next state; its stamp.
    pub fn stamp(&self) -> u64 {
        let deadline = Instant::now() + Duration::from_millis(500);
        while Instant::now() < deadline {
            let new = drain(&self.states, &mut 0);
            for (state, _) in &new {
                self.look(state);
            }
            if let Some((state, _)) = new.last() {
                return state.header.stamp.nanoseconds();
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        0
    }

    fn memory(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn look(&self, state: &JointState) {
        let stamp_ns = state.header.stamp.nanoseconds();
        let angle_rad = state.position.first().copied().unwrap_or(f64::NAN);
        let mut seen = self.memory();
        let dt_s = stamp_ns.saturating_sub(seen.stamp_ns) as f64 * 1e-9;
        if seen.stamp_ns > 0 && dt_s > 0.0 {
            let rate = (angle_rad - seen.angle_rad).abs() / dt_s;
            seen.fastest_rad_s = seen.fastest_rad_s.max(rate);
        }
        seen.farthest_rad = seen.farthest_rad.max(angle_rad.abs());
        (seen.stamp_ns, seen.angle_rad) = (stamp_ns, angle_rad);
    }

    /// What was seen since this was last asked.
    pub fn seen(&self) -> Seen {
        let mut seen = self.memory();
        let before = *seen;
        (seen.farthest_rad, seen.fastest_rad_s) = (0.0, 0.0);
        before
    }
}

/// Steps for some periods, swaying every joint.
pub(super) fn walk(machine: &mut RemoteMachine, periods: usize) -> Result<(), RobotError> {
    for _ in 0..periods {
        let angle = 0.2 * (6.0 * machine.frame().time_s).sin();
        machine.step(&[angle; JOINTS])?;
    }
    Ok(())
}
