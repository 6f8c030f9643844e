//! Whether the joint map of a model can be right: the kinematics of its reference posture, against Stridemap's
//! conventions. (Not of the rest posture: there one wrong sign would turn the axes of the joints below it.)

use mujoco_rs::prelude::MjData;
use serde::{Deserialize, Serialize};
use stridemap_robot::{LegJoint, LegRole, Robot, Side};

use crate::axis::Drive;
use crate::engine::allocation;
use crate::error::MujocoError;
use crate::robot::MujocoRobot;
use crate::rotation::{about_z, to_world, turn};

/// Angle of the finite difference: small against the posture, large against rounding.
const STEP_RAD: f64 = 1e-5;
/// Cosine below which an axis does not point where its name says.
const ALIGNED: f64 = 0.7;

/// Rest angle of a roll joint beyond which it is no trim but a lean.
const LEAN_DEG: f64 = 1.0;

/// How a joint is driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActuatorKind {
    /// The model's position servo.
    PositionServo,
    /// The model's torque motor under our PD law.
    TorqueMotor,
    /// No actuator in the model: our PD law applies the torque.
    None,
}

/// One joint of the map, and whether it does what its name says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointReport {
    /// Side of the leg.
    pub side: Side,
    /// What the joint is to Stridemap.
    pub joint: LegJoint,
    /// The model's name.
    pub model_joint: String,
    /// Whether the map turns the model's sign around.
    pub inverted: bool,
    /// How it is driven.
    pub actuator: ActuatorKind,
    /// Axis about which a growing angle turns the foot, in the world (unit vector), in the
    /// model's reference posture.
    pub axis: [f64; 3],
    /// How the centre of the sole moves with a growing angle, in the reference posture.
    pub sole_m_per_rad: [f64; 3],
    /// Range in Stridemap's sign.
    pub range_deg: [f64; 2],
    /// Angle at rest in Stridemap's sign.
    pub rest_deg: f64,
    /// What is wrong, and what to do; `None` if the joint is plausible.
    pub problem: Option<String>,
}

impl MujocoRobot {
    /// For each joint of the map: axis, range, actuator, and whether its sign is plausible, from finite differences
    /// of the kinematics in the model's reference posture. The robot's own state is not touched.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Load`] if MuJoCo cannot allocate a second state.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_mujoco::{MujocoConfig, MujocoRobot};
    ///
    /// let mut config = MujocoConfig::default();
    /// config.left.knee = Some("-left_knee".into());
    /// let report = MujocoRobot::new(config)?.joint_report()?;
    /// let wrong: Vec<_> = report.iter().filter(|joint| joint.problem.is_some()).collect();
    /// assert_eq!(wrong.len(), 1);
    /// assert_eq!(wrong[0].model_joint, "left_knee");
    /// # Ok::<(), stridemap_mujoco::MujocoError>(())
    /// ```
    pub fn joint_report(&self) -> Result<Vec<JointReport>, MujocoError> {
        let model = &self.model;
        let mut data = MjData::try_new(std::sync::Arc::clone(model)).map_err(allocation)?;
        let mut reports = Vec::new();
        // As if the robot looked along +x.
        let ahead = |v: [f64; 3]| match self.binding.heading_rad {
            heading if heading.abs() > 0.0 => turn(about_z(-heading), v),
            _ => v,
        };
        for (side, joint, LegRole { joint: at, sign }) in self.binding.legs.roles() {
            let axis = &self.binding.axes[at];
            let reference = model.qpos0()[axis.qpos];
            let mut pose_at = |angle: f64| {
                data.qpos_mut()[axis.qpos] = angle;
                data.kinematics();
                let foot = self.binding.feet[side.index()];
                let sole = to_world(&data.xmat()[foot], self.soles[side.index()].centre_m);
                let origin = data.xpos()[foot];
                ([0, 1, 2].map(|i| origin[i] + sole[i]), data.xmat()[foot])
            };
            let (after, turned) = pose_at(reference + sign * STEP_RAD);
            let (before, rotation) = pose_at(reference - sign * STEP_RAD);
            pose_at(reference);
            let turn_axis = ahead(turn_between(&rotation, &turned));
            let own = &self.description().joints[at];
            let [a, b] = [own.limits.lower_rad, own.limits.upper_rad].map(|end| sign * end);
            let range_deg = [a.min(b), a.max(b)].map(f64::to_degrees);
            let rest_deg = (sign * axis.rest_rad).to_degrees();
            reports.push(JointReport {
                side,
                joint,
                model_joint: own.name.clone(),
                inverted: sign < 0.0,
                actuator: match axis.drive {
                    Drive::Servo { .. } => ActuatorKind::PositionServo,
                    Drive::Motor { .. } => ActuatorKind::TorqueMotor,
                    Drive::Applied => ActuatorKind::None,
                },
                axis: turn_axis,
                sole_m_per_rad: ahead([0, 1, 2].map(|i| (after[i] - before[i]) / (2.0 * STEP_RAD))),
                range_deg,
                rest_deg,
                problem: problem(joint, turn_axis, rest_deg, range_deg),
            });
        }
        self.check_sides(&mut reports);
        check_lean(&mut reports);
        Ok(reports)
    }

    /// Notes that left and right are exchanged, where they are.
    fn check_sides(&self, reports: &mut [JointReport]) {
        let model = &self.model;
        let Ok(mut data) = MjData::try_new(std::sync::Arc::clone(model)) else {
            return;
        };
        data.kinematics();
        let (sin, cos) = self.binding.heading_rad.sin_cos();
        let [left, right] = self.binding.feet.map(|foot| cos * data.xpos()[foot][1] - sin * data.xpos()[foot][0]);
        if left > right {
            return;
        }
        for report in reports {
            report.problem.get_or_insert_with(|| {
                "the left foot stands right of the right foot: exchange left and right, \
                 or turn the model so that it looks along +x"
                    .into()
            });
        }
    }
}

/// Notes rolls that rest the same way in both legs.
fn check_lean(reports: &mut [JointReport]) {
    for joint in [LegJoint::HipRoll, LegJoint::AnkleRoll] {
        let of = |side| reports.iter().find(|r| (r.side, r.joint) == (side, joint)).map(|r| r.rest_deg);
        let (Some(left), Some(right)) = (of(Side::Left), of(Side::Right)) else { continue };
        if left * right <= 0.0 || left.abs().min(right.abs()) < LEAN_DEG {
            continue;
        }
        let wider = left.abs();
        for report in reports.iter_mut().filter(|r| r.joint == joint) {
            report.problem.get_or_insert_with(|| {
                format!(
                    "its rest angle turns both legs the same way, about +x ({left:.1} and {right:.1} deg), and leans the \
                     robot to one side; a wider stance is robot.rest_deg.{} = {{ left = {wider:.1}, right = -{wider:.1} }}",
                    joint.name()
                )
            });
        }
    }
}

/// The axis of a small rotation from one matrix to another, in the world, of unit length (zero if there is none).
fn turn_between(from: &[f64; 9], to: &[f64; 9]) -> [f64; 3] {
    // The antisymmetric part of to * from^T is the axis times the sine of the angle.
    let row = |m: &[f64; 9], r: usize| [m[3 * r], m[3 * r + 1], m[3 * r + 2]];
    let entry = |r: usize, c: usize| -> f64 { row(to, r).iter().zip(row(from, c)).map(|(a, b)| a * b).sum() };
    let axis =
        [0.5 * (entry(2, 1) - entry(1, 2)), 0.5 * (entry(0, 2) - entry(2, 0)), 0.5 * (entry(1, 0) - entry(0, 1))];
    let length = axis.iter().map(|a| a * a).sum::<f64>().sqrt();
    if length < 0.1 * STEP_RAD {
        return [0.0; 3];
    }
    axis.map(|a| a / length)
}

/// What is implausible about one joint.
fn problem(joint: LegJoint, axis: [f64; 3], rest_deg: f64, range_deg: [f64; 2]) -> Option<String> {
    // Yaws turn about +z, rolls about +x; pitches about -y, which swings the foot forward and lifts the toes.
    let (along, meaning) = match joint {
        LegJoint::HipYaw => (axis[2], "turns about +z, the toes to the left"),
        LegJoint::HipRoll | LegJoint::AnkleRoll => (axis[0], "turns about +x"),
        LegJoint::HipPitch => (-axis[1], "swings the thigh forward"),
        LegJoint::Knee => (-axis[1], "stretches the knee (flexion is negative)"),
        LegJoint::AnklePitch => (-axis[1], "lifts the toes"),
    };
    if axis.iter().all(|a| a.abs() <= 0.0) {
        return Some("it does not move this leg's foot: is it on the other leg?".into());
    }
    if along < -ALIGNED {
        return Some(format!(
            "its sign is the other way round: a positive {} {meaning}; put or remove the minus before its name",
            joint.name()
        ));
    }
    if along < ALIGNED {
        return Some(format!(
            "its axis is ({:.2}, {:.2}, {:.2}): a positive {} {meaning}; is it another joint, or does the model not look along +x?",
            axis[0],
            axis[1],
            axis[2],
            joint.name()
        ));
    }
    let [lower, upper] = range_deg;
    (rest_deg < lower || rest_deg > upper)
        .then(|| format!("its rest angle of {rest_deg:.1} deg is outside its range, {lower:.1} to {upper:.1} deg"))
}
