//! Reading a network and checking that it, its file and the robot fit together.

use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use stridemap_onnx::Model;
use stridemap_robot::{JointCommand, JointTargets, RobotDescription};

use super::config::{ClockConfig, Each, PolicyConfig, Source, TermConfig};
use crate::gait::GaitError;

/// A fault of the tables, by its key under `gait`.
pub(super) fn fault(key: impl Into<String>, what: impl Into<String>) -> GaitError {
    GaitError::Policy { key: key.into(), what: what.into() }
}

/// A network and what it means for one robot.
#[derive(Clone, Debug)]
pub(super) struct Loaded {
    pub net: Model,
    /// The robot's joint of each of the policy's.
    pub order: Vec<usize>,
    pub kp: Vec<f64>,
    pub kd: Vec<f64>,
    pub rest_rad: Vec<f64>,
    pub scale: Vec<f64>,
    /// Terms of the observation, and the factor on each of their numbers.
    pub terms: Vec<(TermConfig, Vec<f64>)>,
    pub rest: JointTargets,
}

/// Reads the network of a policy.
///
/// # Errors
///
/// [`GaitError::Policy`]: a file that is not there or is another one, a network that cannot be run.
pub fn read_network(policy: &PolicyConfig) -> Result<Model, GaitError> {
    let path = &policy.onnx;
    let bytes = std::fs::read(path).map_err(|error| {
        let hint = stridemap_files::fetch_hint(path).unwrap_or_else(|| error.to_string());
        fault("policy.onnx", format!("{}: {hint}", path.display()))
    })?;
    if let Some(expected) = &policy.sha256 {
        let found: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        if !found.eq_ignore_ascii_case(expected) {
            let what = format!(
                "is not the SHA-256 of {}, which is {found}: another network, or a broken file",
                path.display()
            );
            return Err(fault("policy.sha256", what));
        }
    }
    Model::parse(&bytes).map_err(|error| fault("policy.onnx", format!("{}: {error}", path.display())))
}

/// The value of a key of the policy's, from the file or from the network's metadata.
fn value<T: DeserializeOwned + Clone>(source: &Source<T>, key: &str, net: &Model) -> Result<T, GaitError> {
    let metadata = match source {
        Source::Here(value) => return Ok(value.clone()),
        Source::Metadata { metadata } => metadata,
    };
    let text = net.metadata(metadata).ok_or_else(|| {
        let known = net.metadata_keys().join(", ");
        fault(key, format!("the network has no metadata {metadata:?} (it has: {known})"))
    })?;
    // JSON, or a list with commas, of numbers or names.
    serde_json::from_str(text)
        .or_else(|_| {
            let entries = text.split(',').map(|word| match word.trim().parse::<f64>() {
                Ok(number) => serde_json::Value::from(number),
                Err(_) => serde_json::Value::from(word.trim()),
            });
            serde_json::from_value(entries.collect())
        })
        .map_err(|error| fault(key, format!("metadata {metadata:?}: {error}")))
}

/// The joints of a policy, in its order.
///
/// # Errors
///
/// [`GaitError::Policy`] for metadata that are not there.
pub fn joints_of(policy: &PolicyConfig, net: &Model) -> Result<Vec<String>, GaitError> {
    value(&policy.joints, "policy.joints", net)
}

/// A number of each of `count` joints, such as `kd`, for the key by which a fault is told.
///
/// # Errors
///
/// [`GaitError::Policy`] for metadata that are not there, or another number of numbers.
pub fn numbers_of(source: &Source<Each>, key: &str, count: usize, net: &Model) -> Result<Vec<f64>, GaitError> {
    each(&value(source, key, net)?, key, count)
}

fn each(numbers: &Each, key: &str, count: usize) -> Result<Vec<f64>, GaitError> {
    numbers.of(count).map_err(|found| fault(key, format!("has {found} numbers for {count} joints")))
}

/// What can be said of the tables without network and robot.
pub(super) fn validate(policy: &PolicyConfig, clock: Option<&ClockConfig>, command: [f64; 3]) -> Result<(), GaitError> {
    if !(1.0..=2000.0).contains(&policy.rate_hz) {
        return Err(fault("policy.rate_hz", format!("is {}, must lie in [1, 2000]", policy.rate_hz)));
    }
    if policy.observation.is_empty() {
        return Err(fault("policy.observation", "needs at least one term"));
    }
    for (i, term) in policy.observation.iter().enumerate() {
        let key = format!("policy.observation.{i}");
        if !(1..=1000).contains(&term.history) {
            return Err(fault(key + ".history", format!("is {}, must lie in [1, 1000]", term.history)));
        }
        if clock.is_none() && matches!(term.term, super::TermKind::ClockCos | super::TermKind::ClockSin) {
            return Err(fault(key, format!("{} needs the table [gait.clock]", term.term.name())));
        }
        if term.clip.is_some_and(|clip| clip.is_nan() || clip <= 0.0) {
            return Err(fault(key + ".clip", "must be positive"));
        }
    }
    for (key, clip) in [("action_clip", policy.action_clip), ("observation_clip", policy.observation_clip)] {
        if clip.is_some_and(|clip| clip.is_nan() || clip <= 0.0) {
            return Err(fault(format!("policy.{key}"), "must be positive"));
        }
    }
    if policy.gyro_frame.as_ref().is_some_and(|frame| frame != "base") {
        let what = "is not supported: angular velocity and gravity are seen in the base's axes (\"base\")";
        return Err(fault("policy.gyro_frame", what));
    }
    for (range, command) in policy.command_range.unwrap_or([[-1.0, 1.0]; 3]).into_iter().zip(command) {
        if !(range[0] < range[1] && (range[0]..=range[1]).contains(&command)) {
            let what = format!(
                "[{}, {}] must be in order and hold the nominal command {command} (gait.command)",
                range[0], range[1]
            );
            return Err(fault("policy.command_range", what));
        }
    }
    if let Some(clock) = clock {
        if !(0.05..=60.0).contains(&clock.period_s) {
            return Err(fault("clock.period_s", format!("is {}, must lie in [0.05, 60] s", clock.period_s)));
        }
        if clock.start_rad.is_empty() || clock.start_rad.len() > 16 {
            return Err(fault("clock.start_rad", "needs a phase for each foot"));
        }
    }
    Ok(())
}

impl Loaded {
    pub fn new(
        policy: &PolicyConfig,
        clock: Option<&ClockConfig>,
        robot: &RobotDescription,
    ) -> Result<Self, GaitError> {
        let period_s = 1.0 / policy.rate_hz;
        if (robot.control_period_s - period_s).abs() > 1e-6 * period_s {
            let what = format!(
                "is {} Hz, and the robot takes a command every {} s: robot.control_period_s must be {period_s}",
                policy.rate_hz, robot.control_period_s
            );
            return Err(fault("policy.rate_hz", what));
        }
        let net = read_network(policy)?;
        let joints: Vec<String> = joints_of(policy, &net)?;
        let count = joints.len();
        let order = order(&joints, policy, robot)?;
        let terms = terms(policy, clock, count, &net)?;
        if net.outputs() != count {
            return Err(fault(
                "policy.joints",
                format!("names {count} joints; the network answers {} numbers", net.outputs()),
            ));
        }
        let kp = numbers_of(&policy.kp, "policy.kp", count, &net)?;
        let kd = numbers_of(&policy.kd, "policy.kd", count, &net)?;
        let rest_rad = each(&policy.rest_rad, "policy.rest_rad", count)?;
        let mut rest = robot.rest();
        let driven = order.iter().enumerate().map(|(k, &at)| (at, rest_rad[k], kp[k], kd[k]));
        let held =
            policy.held.iter().filter_map(|held| Some((place(robot, &held.joint)?, held.rest_rad, held.kp, held.kd)));
        for (at, position_rad, kp, kd) in driven.chain(held) {
            rest.joints[at] = JointCommand { position_rad, kp: Some(kp), kd: Some(kd), ..JointCommand::default() };
        }
        Ok(Self {
            scale: each(&policy.action_scale, "policy.action_scale", count)?,
            order,
            kp,
            kd,
            rest_rad,
            terms,
            rest,
            net,
        })
    }
}

fn place(robot: &RobotDescription, name: &str) -> Option<usize> {
    robot.joints.iter().position(|joint| joint.name == name)
}

/// The robot's joint for each of the policy's; every joint of the robot is driven or held.
fn order(joints: &[String], policy: &PolicyConfig, robot: &RobotDescription) -> Result<Vec<usize>, GaitError> {
    let has = || robot.joints.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>().join(", ");
    let find = |key: &str, name: &String| {
        place(robot, name).ok_or_else(|| fault(key, format!("the robot has no joint {name:?} (it has: {})", has())))
    };
    let order: Vec<usize> = joints.iter().map(|name| find("policy.joints", name)).collect::<Result<_, _>>()?;
    let held = policy.held.iter().map(|held| find("policy.held", &held.joint)).collect::<Result<Vec<_>, _>>()?;
    let mut times = vec![0_usize; robot.joints.len()];
    order.iter().chain(&held).for_each(|&at| times[at] += 1);
    for (joint, times) in robot.joints.iter().zip(times) {
        let name = &joint.name;
        match times {
            1 => {}
            0 => {
                let what = format!(
                    "{name:?} is neither among policy.joints nor held: add {{ joint = {name:?}, kp = .., kd = .. }}"
                );
                return Err(fault("policy.held", what));
            }
            _ => return Err(fault("policy.joints", format!("{name:?} is named {times} times"))),
        }
    }
    Ok(order)
}

/// The terms with a factor for each number; their widths add up to what the network takes.
fn terms(
    policy: &PolicyConfig,
    clock: Option<&ClockConfig>,
    joints: usize,
    net: &Model,
) -> Result<Vec<(TermConfig, Vec<f64>)>, GaitError> {
    let feet = clock.map_or(0, |clock| clock.start_rad.len());
    let mut terms = Vec::new();
    let mut said = Vec::new();
    let mut sum = 0;
    for (i, term) in policy.observation.iter().enumerate() {
        let width = term.term.width(joints, feet);
        let name = term.term.name();
        let scale = term.scale.of(width).map_err(|found| {
            fault(format!("policy.observation.{i}.scale"), format!("has {found} numbers; {name} has {width}"))
        })?;
        sum += width * term.history;
        said.push(match term.history {
            1 => format!("{name} {width}"),
            history => format!("{name} {history} x {width}"),
        });
        terms.push((term.clone(), scale));
    }
    if sum == net.inputs() {
        return Ok(terms);
    }
    let what = format!("adds up to {sum} numbers ({}); the network takes {}", said.join(", "), net.inputs());
    Err(fault("policy.observation", what))
}
