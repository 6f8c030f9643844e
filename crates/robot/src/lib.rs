//! What a legged robot is to Stridemap: joints by name, a base, two feet, a centre of mass.
//!
//! A [`Robot`] takes [`JointTargets`] once per control period and answers with a [`RobotState`].
//! Simulated, networked and real robots implement the same trait.
//!
//! Frames and units follow REP-103: x forward, y left, z up; radians, metres, seconds, newtons.
//! Joints have the robot's own names, order and signs; [`RobotDescription::legs`] says which of them are leg joints,
//! and turns them to Stridemap's signs: hip pitch + swings the thigh forward, knee flexion is negative, ankle
//! pitch + lifts the toes, rolls turn about +x, yaws about +z.

mod command;
pub mod contract;
mod error;
mod estimator;
pub mod kinematics;
mod legs;
mod limit;
mod machine;
mod remote;
mod robot;
mod shape;
mod state;

pub use command::{JointCommand, JointTargets};
pub use error::RobotError;
pub use estimator::{EstimatedRobot, Estimator};
pub use kinematics::{Body, BodyPoint, Hinge, KinematicModel, Placement};
pub use legs::{LEG_JOINTS, LegJoint, LegRole, Legs, Side};
pub use limit::{LimitCounts, hold_to_limits};
pub use machine::{Machine, MachineDescription, SensorFrame, check_command};
pub use remote::{AngleUnit, Ros2Config, TighterLimits};
pub use robot::{Hold, JointDescription, JointLimits, Robot, RobotDescription};
pub use shape::{Pose, Shape, ShapeKind};
pub use state::{BaseState, CentreOfMass, FootState, JointState, RobotState};
