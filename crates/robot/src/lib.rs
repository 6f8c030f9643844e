//! What a legged robot is to Stridemap: ten leg joints, a base, two feet, a centre of mass.
//!
//! A [`Robot`] takes [`JointTargets`] once per control period and answers with a [`RobotState`].
//! Simulated, networked and real robots implement the same trait, and a [`Robot`] can be wrapped
//! by another that guards it.
//!
//! Frames and units follow REP-103: x forward, y left, z up; radians, metres, seconds, newtons.
//! Joint angles carry Stridemap's own signs: hip pitch + swings the thigh forward, knee flexion is
//! negative, ankle pitch + lifts the toes, rolls turn about +x.

pub mod contract;
mod error;
mod estimator;
mod guard;
pub mod kinematics;
mod legs;
mod limit;
mod machine;
mod remote;
mod robot;
mod shape;
mod state;

pub use error::RobotError;
pub use estimator::{EstimatedRobot, Estimator};
pub use guard::{GuardCounts, GuardLimits, Guarded};
pub use kinematics::{Body, BodyPoint, Hinge, KinematicModel, Placement};
pub use legs::{JointTargets, LEG_JOINTS, LegJoint, Legs, Side};
pub use limit::{LimitCounts, hold_to_limits};
pub use machine::{JointMap, Machine, MachineDescription, MappedJoint, SensorFrame, check_command};
pub use remote::{AngleUnit, Ros2Config, TighterLimits};
pub use robot::{JointLimits, Robot, RobotDescription};
pub use shape::{Pose, Shape, ShapeKind};
pub use state::{BaseState, CentreOfMass, FootState, JointState, RobotState};
