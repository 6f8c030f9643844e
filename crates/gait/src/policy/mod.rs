//! A pretrained velocity policy as a nominal gait: a network that turns what a robot senses, and a velocity command, into
//! joint targets.

mod config;
mod load;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use stridemap_onnx::Model;
use stridemap_robot::kinematics::{inverse, rotate};
use stridemap_robot::{JointCommand, JointTargets, RobotDescription, RobotState, Side};

pub use config::{ClockConfig, Each, HeldJoint, HistoryFill, ModelConfig, PolicyConfig, Source, TermConfig, TermKind};
pub use load::{joints_of, numbers_of, read_network};

use crate::gait::{Gait, GaitError, Modulation};
use load::Loaded;

// Positions in the list of modulations.
const FORWARD: usize = 0;
const LATERAL: usize = 1;
const YAW: usize = 2;
const STIFFNESS: usize = 3;
const TILT: usize = 4;
const GAIN: usize = 5;
const CLOCK_RATE: usize = 6;
const COUNT: usize = 7;
/// Change of the stiffness per unit of its modulation.
const STIFFNESS_UNIT: f64 = 0.2;
/// Seconds until a robot that starts from rest walks as it will: the first 3 s were left out of every average (docs/pretrained.md).
const START_UP_S: f64 = 3.0;

fn modulations(command: [f64; 3], range: [[f64; 2]; 3]) -> [Modulation; COUNT] {
    let m = |name, neutral, lower, upper, about| Modulation { name, neutral, lower, upper, about };
    let [x, y, z] = range;
    [
        m("command_forward_m_s", command[0], x[0], x[1], "commanded speed forward"),
        m("command_lateral_m_s", command[1], y[0], y[1], "commanded speed to the left"),
        m("command_yaw_rate_rad_s", command[2], z[0], z[1], "commanded yaw rate, + to the left"),
        m("stiffness", 0.0, -2.5, 2.5, "k: the joints' stiffness is 1 + 0.2 k times the policy's"),
        m("sensed_tilt_rad", 0.0, -0.2, 0.2, "the policy senses itself pitched forward by this much more than it is"),
        m("action_gain", 1.0, 0.5, 1.5, "factor on the policy's answer, that is on joint targets from rest"),
        m("clock_rate", 1.0, 0.5, 1.5, "factor on the rate of the policy's clock; nothing without a clock"),
    ]
}

/// A pretrained velocity policy.
///
/// ```text
/// a = net(terms of the observation, in order)      a ← clip(a, ± action_clip)
/// position = rest + action_gain · action_scale · a     kp ← (1 + 0.2 k) kp     kd as it is
/// ```
///
/// A clock advances before each observation. While the command is zero, and the file says so, the phases that the network
/// sees rest; the clock by which sections are found goes on.
#[derive(Clone, Debug)]
pub struct PolicyGait {
    policy: PolicyConfig,
    clock: Option<ClockConfig>,
    modulations: [Modulation; COUNT],
    values: [f64; COUNT],
    rest: JointTargets,
    /// `None` for an outline: a task that was only read.
    loaded: Option<Loaded>,
    cycles: f64,
    standing: bool,
    last: Vec<f64>,
    past: Vec<VecDeque<Vec<f32>>>,
    observed: Vec<f32>,
}

impl PolicyGait {
    /// A policy for a robot, with its nominal command: speed forward and to the left (m/s) and yaw rate (rad/s). For an outline of a robot, which has no mass, nothing is read, so that a task can be read where
    /// its network is not.
    ///
    /// # Errors
    ///
    /// [`GaitError::Policy`] with the key at fault: a table or a file that is missing, another file than `sha256` says, terms
    /// that do not add up to what the network takes, joints that the robot lacks or that nobody drives, another rate.
    pub fn new(
        policy: PolicyConfig,
        clock: Option<ClockConfig>,
        command: [f64; 3],
        robot: &RobotDescription,
    ) -> Result<Self, GaitError> {
        load::validate(&policy, clock.as_ref(), command)?;
        let modulations = modulations(command, policy.command_range.unwrap_or([[-1.0, 1.0]; 3]));
        let loaded = match robot.mass_kg > 0.0 {
            true => Some(Loaded::new(&policy, clock.as_ref(), robot)?),
            false => None,
        };
        let rest = loaded.as_ref().map_or_else(|| robot.rest(), |loaded| loaded.rest.clone());
        let mut gait = Self {
            values: [0; COUNT].map(|_| 0.0),
            modulations,
            rest,
            loaded,
            cycles: 0.0,
            standing: false,
            last: Vec::new(),
            past: Vec::new(),
            observed: Vec::new(),
            policy,
            clock,
        };
        gait.reset();
        Ok(gait)
    }

    /// The network; `None` for an outline.
    #[must_use]
    pub fn network(&self) -> Option<&Model> {
        self.loaded.as_ref().map(|loaded| &loaded.net)
    }

    /// What the network saw last.
    #[must_use]
    pub fn observed(&self) -> &[f32] {
        &self.observed
    }

    /// What the network answered last, clipped: one number per joint, in the policy's order.
    #[must_use]
    pub fn answered(&self) -> &[f64] {
        &self.last
    }

    fn phase(&self, foot: usize) -> Option<f64> {
        let start = *self.clock.as_ref()?.start_rad.get(foot)?;
        let phase = (start + TAU * self.cycles + PI).rem_euclid(TAU) - PI;
        // The sum of fifty fiftieths is one.
        Some(if phase.abs() < 1e-9 { 0.0 } else { phase })
    }

    fn advance(&mut self) {
        let Some(clock) = &self.clock else { return };
        self.cycles += self.values[CLOCK_RATE] / (self.policy.rate_hz * clock.period_s);
        self.cycles -= self.cycles.floor();
        if (1.0 - self.cycles) < 1e-9 {
            self.cycles = 0.0;
        }
        let [vx, vy, yaw] = [FORWARD, LATERAL, YAW].map(|i| self.values[i]);
        let still = clock.still_below.is_some_and(|least| vx.hypot(vy) < least && yaw.abs() < least);
        if self.standing && !still {
            self.cycles = 0.0;
        }
        self.standing = still;
    }

    /// The numbers of a term, before its scale.
    fn term(&self, kind: TermKind, loaded: &Loaded, state: &RobotState) -> Vec<f64> {
        let [vx, vy, yaw] = [FORWARD, LATERAL, YAW].map(|i| self.values[i]);
        let (sin, cos) = self.values[TILT].sin_cos();
        let tilted = |[x, y, z]: [f64; 3]| vec![cos * x - sin * z, y, sin * x + cos * z];
        let to_base = inverse(state.base.orientation);
        let joints = loaded.order.iter().zip(&loaded.rest_rad);
        let phases = |of: fn(f64) -> f64| -> Vec<f64> {
            let feet = self.clock.as_ref().map_or(0, |clock| clock.start_rad.len());
            let still = self.clock.as_ref().and_then(|clock| clock.still_rad).filter(|_| self.standing);
            (0..feet).map(|foot| of(still.or_else(|| self.phase(foot)).unwrap_or(0.0))).collect()
        };
        match kind {
            TermKind::LastAction => self.last.clone(),
            TermKind::BaseAngularVelocity => tilted(state.base.angular_velocity_rad_s),
            TermKind::BaseLinearVelocity => tilted(rotate(to_base, state.com.velocity_m_s)),
            TermKind::Gravity => tilted(rotate(to_base, [0.0, 0.0, -1.0])),
            TermKind::CommandVelocity => vec![vx, vy],
            TermKind::CommandYawRate => vec![yaw],
            TermKind::Command => vec![vx, vy, yaw],
            TermKind::JointPosition => joints.map(|(at, rest)| state.joints[*at].position_rad - rest).collect(),
            TermKind::JointVelocity => joints.map(|(at, _)| state.joints[*at].velocity_rad_s).collect(),
            TermKind::ClockCos => phases(f64::cos),
            TermKind::ClockSin => phases(f64::sin),
        }
    }

    fn observe(&mut self, loaded: &Loaded, state: &RobotState) {
        let mut observed = std::mem::take(&mut self.observed);
        observed.clear();
        self.past.resize_with(loaded.terms.len(), VecDeque::new);
        for (i, (config, scale)) in loaded.terms.iter().enumerate() {
            let values = self.term(config.term, loaded, state);
            let most = config.clip.unwrap_or(f64::INFINITY).min(self.policy.observation_clip.unwrap_or(f64::INFINITY));
            #[expect(clippy::cast_possible_truncation)] // The network is in single precision.
            let now: Vec<f32> = values.iter().zip(scale).map(|(x, s)| (x * s).clamp(-most, most) as f32).collect();
            let past = &mut self.past[i];
            while past.len() < config.history {
                past.push_back(match self.policy.history_fill {
                    HistoryFill::First => now.clone(),
                    HistoryFill::Zero => vec![0.0; now.len()],
                });
            }
            past.pop_front();
            past.push_back(now);
            observed.extend(past.iter().flatten());
        }
        self.observed = observed;
    }
}

impl Gait for PolicyGait {
    fn modulations(&self) -> &[Modulation] {
        &self.modulations
    }

    fn rest(&self) -> &JointTargets {
        &self.rest
    }

    fn reset(&mut self) {
        self.values = std::array::from_fn(|i| self.modulations[i].neutral);
        self.cycles = 0.0;
        self.standing = false;
        self.past.clear();
        self.last = vec![0.0; self.loaded.as_ref().map_or(0, |loaded| loaded.order.len())];
    }

    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError> {
        let m = self.modulations.get(index).ok_or(GaitError::NoSuchModulation { index, count: COUNT })?;
        if !(m.lower..=m.upper).contains(&value) {
            return Err(GaitError::ModulationOutOfRange { name: m.name, value, lower: m.lower, upper: m.upper });
        }
        self.values[index] = value;
        Ok(())
    }

    fn targets(&mut self, state: &RobotState, _dt_s: f64, out: &mut JointTargets) {
        out.joints.clone_from(&self.rest.joints);
        let Some(loaded) = self.loaded.take() else { return };
        self.advance();
        self.observe(&loaded, state);
        let most = self.policy.action_clip.unwrap_or(f64::INFINITY);
        // The shapes were tried when the network was loaded.
        let answer = loaded.net.run(&self.observed).unwrap_or_default();
        self.last.clear();
        self.last.extend(answer.into_iter().map(|a| f64::from(a).clamp(-most, most)));
        let stiffness = 1.0 + STIFFNESS_UNIT * self.values[STIFFNESS];
        for (k, (&at, action)) in loaded.order.iter().zip(&self.last).enumerate() {
            out.joints[at] = JointCommand {
                position_rad: loaded.rest_rad[k] + self.values[GAIN] * loaded.scale[k] * action,
                kp: Some(stiffness * loaded.kp[k]),
                kd: Some(loaded.kd[k]),
                ..JointCommand::default()
            };
        }
        self.loaded = Some(loaded);
    }

    fn phase_rad(&self, leg: Side) -> Option<f64> {
        self.phase(leg.index())
    }

    fn start_up_s(&self) -> f64 {
        START_UP_S
    }
}
