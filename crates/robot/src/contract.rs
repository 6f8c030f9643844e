//! The contract of [`Robot`], checked: every robot of the house passes it.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::command::{JointCommand, JointTargets};
use crate::robot::Robot;
use crate::state::RobotState;
use crate::{RobotError, ShapeKind};

/// Periods of a replay.
const PERIODS: usize = 200;
/// Largest error of the clock, per period: rounding only.
const CLOCK_ERROR_S: f64 = 1e-9;

/// How a robot broke its contract.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a robot must {rule}; {found}")]
pub struct Breach {
    /// The rule.
    pub rule: &'static str,
    /// What was found instead.
    pub found: String,
}

/// Whether two resets of a robot with different generators may begin alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The robot disturbs its start at random: two resets must differ.
    Disturbed,
    /// It starts where it is told: two resets must be equal.
    Exact,
}

/// Checks a simulated robot against the contract of [`Robot`].
///
/// `make` builds one and the same robot each time, which can stand in its rest posture; `start` says whether its
/// configuration disturbs the start.
///
/// # Errors
///
/// The first [`Breach`].
pub fn check<R: Robot>(mut make: impl FnMut() -> Result<R, RobotError>, start: Start) -> Result<(), Breach> {
    let mut robot = made(&mut make)?;
    let posture = &robot.description().rest();
    clock(&mut robot, posture)?;
    refusal(&mut robot, posture)?;
    beyond_position(&mut robot, posture)?;
    let mut other = made(&mut make)?;
    replay(&mut robot, &mut other, posture)?;
    starts(&mut robot, posture, start)?;
    drawing(&robot)
}

fn breach(rule: &'static str, found: impl Into<String>) -> Breach {
    Breach { rule, found: found.into() }
}

fn made<R: Robot>(make: &mut impl FnMut() -> Result<R, RobotError>) -> Result<R, Breach> {
    make().map_err(|e| breach("be built", e.to_string()))
}

fn reset<R: Robot>(robot: &mut R, posture: &JointTargets, seed: u64) -> Result<RobotState, Breach> {
    robot
        .reset(posture, &mut ChaCha8Rng::seed_from_u64(seed))
        .cloned()
        .map_err(|e| breach("accept a reset to a posture it can stand in", e.to_string()))
}

/// A small movement of every joint, slow enough for any rate limit.
fn movement(posture: &JointTargets, period: usize) -> JointTargets {
    #[expect(clippy::cast_precision_loss)] // A few hundred periods.
    let sway = 0.02 * (0.05 * period as f64).sin();
    JointTargets::positions(posture.joints.iter().map(|c| c.position_rad + sway))
}

/// Reset sets the clock to 0; each step advances it by the control period.
fn clock<R: Robot>(robot: &mut R, posture: &JointTargets) -> Result<(), Breach> {
    let rule = "start its clock at 0 and advance it by the control period";
    let first = reset(robot, posture, 1)?;
    let period_s = robot.description().control_period_s;
    if first.time_s.abs() > 0.0 {
        return Err(breach(rule, format!("it starts at {} s", first.time_s)));
    }
    let mut before_s = 0.0;
    for period in 0..10 {
        let state = robot.step(&movement(posture, period)).map_err(|e| breach(rule, e.to_string()))?;
        if (state.time_s - before_s - period_s).abs() > CLOCK_ERROR_S {
            let found = format!("it went from {before_s} s to {} s", state.time_s);
            return Err(breach(rule, found));
        }
        if let Some(field) = state.first_not_finite() {
            return Err(breach("report finite states", format!("{field} is not")));
        }
        before_s = state.time_s;
    }
    Ok(())
}

/// Targets that are not one per joint, or not finite, are refused before anything moves.
fn refusal<R: Robot>(robot: &mut R, posture: &JointTargets) -> Result<(), Breach> {
    let rule = "refuse targets that are not one finite command per joint, its state unchanged";
    let before = reset(robot, posture, 1)?;
    let last = robot.description().joints.last();
    let last = last.map(|joint| joint.name.clone()).unwrap_or_default();
    let mut bad = vec![JointTargets::default(), posture.clone()];
    bad[1].joints.push(JointCommand::default());
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let spoils: [fn(&mut JointCommand, f64); 5] = [
            |command, value| command.position_rad = value,
            |command, value| command.velocity_rad_s = value,
            |command, value| command.kp = Some(value),
            |command, value| command.kd = Some(value),
            |command, value| command.torque_nm = value,
        ];
        for spoil in spoils {
            let mut targets = posture.clone();
            if let Some(command) = targets.joints.last_mut() {
                spoil(command, value);
            }
            bad.push(targets);
        }
    }
    for (at, bad) in bad.iter().enumerate() {
        let answers = [robot.step(bad).err(), robot.reset(bad, &mut ChaCha8Rng::seed_from_u64(1)).err()];
        for answer in answers {
            match answer {
                Some(RobotError::CommandLength { .. }) if at < 2 => {}
                Some(RobotError::BadCommand { joint, .. }) if at >= 2 && joint == last => {}
                other => {
                    let asked = bad.joints.last();
                    return Err(breach(rule, format!("its answer to {asked:?} was {other:?}")));
                }
            }
        }
        if *robot.state() != before {
            return Err(breach(rule, "its state changed"));
        }
    }
    Ok(())
}

/// What is asked of a joint beyond an angle acts, or is refused by the joint's name: a joint without stiffness and
/// damping has the torque that it is given.
fn beyond_position<R: Robot>(robot: &mut R, posture: &JointTargets) -> Result<(), Breach> {
    let rule = "give a joint the gains and torque that are asked for, or refuse them by its name";
    for (at, joint) in robot.description().joints.clone().iter().enumerate() {
        let torque_nm = 0.25 * joint.limits.torque_nm.min(4.0);
        let asked = |kp, kd, velocity_rad_s, torque_nm| JointCommand {
            kp,
            kd,
            velocity_rad_s,
            torque_nm,
            ..posture.joints[at]
        };
        let zero = Some(0.0);
        let limp = asked(zero, zero, 0.0, torque_nm);
        let alone = [
            asked(zero, None, 0.0, 0.0),
            asked(None, zero, 0.0, 0.0),
            asked(None, None, 0.1, 0.0),
            asked(None, None, 0.0, torque_nm),
        ];
        let mut taken = None;
        for command in std::iter::once(limp).chain(alone) {
            let before = reset(robot, posture, 1)?;
            let mut targets = posture.clone();
            targets.joints[at] = command;
            let answer = robot.step(&targets).map(|s| s.joints[at].torque_nm);
            let good = match &answer {
                Ok(nm) => taken.is_some() || (nm - torque_nm).abs() < 1e-9,
                Err(RobotError::JointCannot { joint: named, .. }) => *named == joint.name && *robot.state() == before,
                Err(_) => false,
            };
            if !good || *taken.get_or_insert(answer.is_ok()) != answer.is_ok() {
                let name = &joint.name;
                let found = format!("its answer to {command:?} of {name} was {answer:?}");
                return Err(breach(rule, found));
            }
        }
    }
    Ok(())
}

/// Equal generators and equal targets give equal states.
fn replay<R: Robot>(one: &mut R, two: &mut R, posture: &JointTargets) -> Result<(), Breach> {
    let rule = "pass through equal states for equal seeds and targets";
    // The first robot has a past, the second none: it must not matter.
    if reset(one, posture, 7)? != reset(two, posture, 7)? {
        return Err(breach(rule, "they differ after the reset"));
    }
    for period in 0..PERIODS {
        let targets = movement(posture, period);
        let step = |robot: &mut R| {
            let stepped = robot.step(&targets).cloned();
            stepped.map_err(|e| breach(rule, e.to_string()))
        };
        if step(one)? != step(two)? {
            return Err(breach(rule, format!("they differ after {} periods", period + 1)));
        }
    }
    Ok(())
}

/// Resets with different generators differ if and only if the configuration disturbs the start.
fn starts<R: Robot>(robot: &mut R, posture: &JointTargets, start: Start) -> Result<(), Breach> {
    let equal = reset(robot, posture, 1)? == reset(robot, posture, 2)?;
    match (start, equal) {
        (Start::Disturbed, true) => {
            Err(breach("start differently for different seeds where its start is disturbed", "two resets are equal"))
        }
        (Start::Exact, false) => {
            Err(breach("start alike for different seeds where its start is not disturbed", "two resets differ"))
        }
        _ => Ok(()),
    }
}

/// Shapes are finite and belong to bodies that have poses.
fn drawing<R: Robot>(robot: &R) -> Result<(), Breach> {
    let rule = "have finite shapes on bodies with poses";
    let mut poses = Vec::new();
    robot.poses(&mut poses);
    let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
    for shape in robot.geometry() {
        let sizes = match &shape.kind {
            ShapeKind::Sphere { radius_m } => [*radius_m, 1.0, 1.0],
            ShapeKind::Capsule { radius_m, half_length_m } | ShapeKind::Cylinder { radius_m, half_length_m } => {
                [*radius_m, *half_length_m, 1.0]
            }
            ShapeKind::Ellipsoid { semi_axes_m } => *semi_axes_m,
            ShapeKind::Box { half_extents_m } => *half_extents_m,
            ShapeKind::Mesh { vertices_m, triangles } => {
                let whole = triangles.iter().flatten().all(|corner| (*corner as usize) < vertices_m.len());
                let placed = vertices_m.iter().flatten().all(|v| v.is_finite());
                [if whole && placed { 1.0 } else { f64::NAN }; 3]
            }
        };
        let placed = finite(&shape.pose.position_m) && finite(&shape.pose.orientation);
        if !finite(&sizes) || sizes.iter().any(|s| *s < 0.0) || !placed {
            return Err(breach(rule, format!("{shape:?} is not")));
        }
        if shape.body >= poses.len() {
            return Err(breach(rule, format!("{:?} is on no body", shape.name)));
        }
    }
    let bad = |p: &crate::Pose| !finite(&p.position_m) || !finite(&p.orientation);
    match poses.iter().position(bad) {
        Some(body) => Err(breach(rule, format!("the pose of body {body} is not"))),
        None => Ok(()),
    }
}
