//! The link of a program that was built without ROS 2: whoever asks for a robot behind it is told so.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rand_chacha::ChaCha8Rng;
use stridemap_robot::{JointLimits, Machine, MachineDescription, RobotError, Ros2Config, SensorFrame};

use crate::error::LinkError;
use crate::operator::Operator;
use crate::served::{Serve, ServerReport};

/// Joins no network.
///
/// # Errors
///
/// [`LinkError::NotBuilt`], always.
pub fn check_network(_: &Ros2Config) -> Result<(), LinkError> {
    Err(LinkError::NotBuilt)
}

/// Stops no robot.
///
/// # Errors
///
/// [`LinkError::NotBuilt`], always.
pub fn send_stop(_: &Ros2Config, _: &str, _: bool) -> Result<bool, LinkError> {
    Err(LinkError::NotBuilt)
}

/// Serves no machine.
///
/// # Errors
///
/// [`LinkError::NotBuilt`], always.
pub fn serve<M: Machine>(
    _: &mut M,
    _: &[f64],
    _: &Serve,
    _: &AtomicBool,
    _: &mut dyn FnMut(),
) -> Result<ServerReport, LinkError> {
    Err(LinkError::NotBuilt)
}

/// A machine behind ROS 2, of which there is none here.
pub enum RemoteMachine {}

impl RemoteMachine {
    /// Joins no network.
    ///
    /// # Errors
    ///
    /// [`LinkError::NotBuilt`], always.
    pub fn open(
        _: &Ros2Config,
        _: Vec<String>,
        _: Vec<JointLimits>,
        _: f64,
        _: Box<dyn Operator>,
    ) -> Result<Self, LinkError> {
        Err(LinkError::NotBuilt)
    }

    /// As with ROS 2.
    pub fn halt_on(&mut self, _: Arc<AtomicBool>) {
        match *self {}
    }
}

impl Machine for RemoteMachine {
    fn description(&self) -> &MachineDescription {
        match *self {}
    }

    fn reset(&mut self, _: &[f64], _: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        match *self {}
    }

    fn frame(&self) -> &SensorFrame {
        match *self {}
    }

    fn step(&mut self, _: &[f64]) -> Result<&SensorFrame, RobotError> {
        match *self {}
    }
}
