//! What a policy does in many walks of its own: falls, tracking, speed; and its multipliers, probed.
//!
//! A simulated robot whose starts are all alike walks the same walk again and again, and a hundred of those say no more than one.
//! So a robot without any disturbance of its starts is given a small one, and walks that came out alike count once.

use std::collections::BTreeSet;

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use statrs::distribution::{Beta, ContinuousCDF};
use stridemap_learn::Policy;
use stridemap_process::{Action, Situation, StrideEnd};
use stridemap_record::{StridePhase, StrideRole, Transition};
use stridemap_stability::{Bout, Options, Record, SensorKnowledge, analyse};

use crate::error::LabError;
use crate::plant::Batch;
use crate::seed::{Role, stream};
use crate::strides::{Act, drive};
use crate::task::Task;
use crate::walk::Walker;

/// How long a walk is.
pub const WALK_S: f64 = 60.0;
/// Strides of a walk that are not averaged: the policy takes over from the start.
const SETTLE: usize = 14;
/// Disturbances of every start, where the robot has none of its own.
const START_JOINT_NOISE_DEG: f64 = 0.5;
const START_VELOCITY_NOISE_M_S: f64 = 0.02;
/// Noise of a probing action, in ranges of its component.
const PROBE: f64 = 0.02;

/// A number with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The number.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// One walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walked {
    /// Whether it ended in a fall or a stall.
    pub fell: bool,
    /// Strides.
    pub strides: usize,
    /// Root mean square of what [`tracks`] says, where the task has it and the walk settled.
    pub tracking: Option<f64>,
    /// Speed along the robot's own heading, where the walk settled.
    pub speed_m_s: Option<f64>,
    /// Last clock and state, to the bit: walks that are alike have the same.
    trace: (u64, u64),
}

/// A task whose robot does not start the same way every time.
#[must_use]
pub fn disturbed(task: &Task) -> Task {
    let mut task = task.clone();
    let robot = &mut task.robot;
    let still = robot.start_joint_noise_deg <= 0.0 && robot.start_velocity_noise_m_s <= 0.0;
    if still && robot.hardware.is_none() {
        robot.start_joint_noise_deg = START_JOINT_NOISE_DEG;
        robot.start_velocity_noise_m_s = START_VELOCITY_NOISE_M_S;
    }
    task
}

/// What a task's policy is to track: goals in their units, or `ψ_roll` at its target; `None` where there is neither.
#[must_use]
pub fn tracks(task: &Task) -> Option<String> {
    match (task.goal.is_empty(), task.target_deg()) {
        (false, _) => Some("errors of the goals, in their units".into()),
        (true, Some(target)) => Some(format!("psi_roll from its target of {target} deg, in deg")),
        (true, None) => None,
    }
}

/// Square of what a stride missed of that.
fn squared_error(task: &Task, t: &Transition) -> Option<f64> {
    if task.goal.is_empty() {
        return Some((t.measures.psi_roll_deg - task.target_deg()?).powi(2));
    }
    Some(task.goal.iter().zip(&t.goal).map(|(goal, asked)| goal.error(&t.measures, *asked).powi(2)).sum())
}

/// Walks for a minute or to a fall; `index` names the start.
///
/// # Errors
///
/// As [`drive`].
pub fn walk_once(task: &Task, policy: &dyn Policy, seed: u64, index: usize) -> Result<Walked, LabError> {
    let mut plant = task.plant()?;
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: usize::MAX };
    let mut rng = stream(seed, Role::Verdict, index as u64);
    let made = drive(&mut plant, &mut Walker::new(policy, WALK_S), batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
    let settled: Vec<&Transition> = made.iter().filter(|t| t.k >= SETTLE && t.end == StrideEnd::Crossing).collect();
    let n = settled.len() as f64;
    let tracking = || {
        let squares: Option<f64> = settled.iter().map(|t| squared_error(task, t)).sum();
        squares.filter(|_| n > 0.0).map(|squares| (squares / n).sqrt())
    };
    let seconds: f64 = settled.iter().map(|t| t.measures.duration_s).sum();
    let ahead_m: f64 = settled.iter().map(|t| t.measures.ahead_m).sum();
    let last = made.last();
    let bits = |x: f64| x.to_bits();
    Ok(Walked {
        fell: last.is_some_and(|t| t.end != StrideEnd::Crossing),
        strides: made.len(),
        tracking: tracking(),
        speed_m_s: (seconds > 0.0).then(|| ahead_m / seconds),
        trace: last.map_or((0, 0), |t| (bits(t.time_s), bits(t.next_state.iter().sum()))),
    })
}

/// Walks that are not the same walk again.
#[must_use]
pub fn distinct(walks: &[Walked]) -> Vec<Walked> {
    let mut seen = BTreeSet::new();
    walks.iter().filter(|w| seen.insert(w.trace)).copied().collect()
}

/// The probability of which `events` of `n` are a sample, with the exact interval of Clopper and Pearson (1934).
///
/// # Example
///
/// No fall in 60 walks says at most 1 − 0.025^(1/60) = 6 %:
///
/// ```
/// let p = stridemap_lab::share_of(0, 60);
/// assert!(p.low == 0.0 && (p.high - (1.0 - 0.025_f64.powf(1.0 / 60.0))).abs() < 1e-9);
/// ```
#[must_use]
pub fn share_of(events: usize, n: usize) -> Interval {
    let (k, rest) = (events as f64, (n - events.min(n)) as f64);
    let beta = |a: f64, b: f64, q: f64| Beta::new(a, b).map_or(f64::NAN, |beta| beta.inverse_cdf(q));
    Interval {
        value: if n == 0 { 0.5 } else { k / n as f64 },
        low: if events == 0 { 0.0 } else { beta(k, rest + 1.0, 0.025) },
        high: if events >= n { 1.0 } else { beta(k + 1.0, rest, 0.975) },
    }
}

/// The policy's mean with a little noise, and what it was.
struct Probing<'a> {
    policy: &'a dyn Policy,
    std: Vec<f64>,
    wanted: Vec<Action>,
}

impl Act for Probing<'_> {
    fn act(&mut self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        let mean = self.policy.mean(at);
        let noise = |std: f64, rng: &mut ChaCha8Rng| {
            let z: f64 = StandardNormal.sample(rng);
            std * z
        };
        let asked = mean.iter().zip(&self.std).map(|(u, std)| u + noise(*std, rng)).collect();
        self.wanted.push(mean);
        asked
    }
}

/// Strides of a policy with a little noise on its actions, as a record whose probes are what was added; falls begin a new bout.
///
/// # Errors
///
/// As [`drive`].
pub fn probed(task: &Task, policy: &dyn Policy, strides: usize, seed: u64) -> Result<Record, LabError> {
    let mut plant = task.plant()?;
    let spec = task.process_spec()?;
    let std = spec.action.iter().map(|a| PROBE * (a.upper - a.lower)).collect();
    let mut probing = Probing { policy, std, wanted: Vec::new() };
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: strides + SETTLE };
    let mut rng = stream(seed, Role::Verdict, u64::from(u32::MAX));
    let made = drive(&mut plant, &mut probing, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
    // What nothing depends on says nothing of stability.
    let seen: Vec<usize> =
        (0..task.state.len()).filter(|&i| !task.state[i].invariant).take(stridemap_stability::MOST_STATES).collect();
    let mut bouts: Vec<Bout> = Vec::new();
    for (t, wanted) in made.iter().zip(&probing.wanted).filter(|(t, _)| t.k >= SETTLE) {
        if t.k == SETTLE || bouts.is_empty() {
            bouts.push(Bout::default());
        }
        let Some(bout) = bouts.last_mut() else { continue };
        bout.states.push(seen.iter().map(|&i| t.state[i]).collect());
        bout.actions.push(t.action.iter().zip(wanted).map(|(u, mean)| u - mean).collect());
        bout.fell = t.end != StrideEnd::Crossing;
    }
    let seconds: f64 = made.iter().map(|t| t.measures.duration_s).sum();
    Ok(Record {
        state: seen.iter().map(|&i| task.state[i].name().to_owned()).collect(),
        bouts,
        stride_s: (!made.is_empty()).then(|| seconds / made.len() as f64),
    })
}

/// The largest multiplier of a record, or why it is not known.
///
/// # Errors
///
/// In words.
pub fn largest_multiplier(record: &Record, exact: bool, seed: u64) -> Result<Interval, String> {
    let sensor = if exact { SensorKnowledge::Exact } else { SensorKnowledge::Estimated };
    let options = Options { sensor, seed, ..Options::default() };
    let found = analyse(record, &options).map_err(|error| error.to_string())?;
    let refused = || {
        let why = found.refused.iter().map(|r| format!("{}: {}", r.because, r.remedy));
        why.collect::<Vec<_>>().join("; ")
    };
    let largest = found.multipliers.as_ref().map(|m| m.largest).ok_or_else(refused)?;
    Ok(Interval { value: largest.value, low: largest.low, high: largest.high })
}
