//! A moment of a simulation: stored, gone back to, handed to another robot.

use mujoco_rs::wrappers::mj_data::MjtState;
use mujoco_rs::wrappers::mj_model::MjtObjBase;
use stridemap_robot::{RobotError, RobotState};

use crate::engine::{name_of, own_bodies};
use crate::error::MujocoError;
use crate::robot::MujocoRobot;

/// Everything that the engine needs to go on exactly as before.
const INTEGRATION: u32 = MjtState::mjSTATE_INTEGRATION as u32;

/// A moment of a simulation, to go back to. Only meaningful for robots of the same configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    pub(crate) numbers: Box<[f64]>,
    state: RobotState,
    periods: u64,
    failure: Option<RobotError>,
}

impl MujocoRobot {
    /// Stores this moment; [`restore`](Self::restore) goes back to it, to the bit.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            numbers: self.data.state(INTEGRATION),
            state: self.state.clone(),
            periods: self.periods,
            failure: self.failure.clone(),
        }
    }

    /// Goes back to a stored moment of this robot or of one of the same configuration. A push that acted
    /// then acts again.
    ///
    /// # Errors
    ///
    /// [`MujocoError::ForeignSnapshot`] if the snapshot belongs to a model with another number of states.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), MujocoError> {
        let (expected, found) = (self.model.state_size(INTEGRATION), snapshot.numbers.len());
        let foreign = MujocoError::ForeignSnapshot { expected, found };
        if found != expected {
            return Err(foreign);
        }
        self.data.set_state(&snapshot.numbers, INTEGRATION).map_err(|_| foreign)?;
        self.count_warnings();
        self.data.step1();
        self.state.clone_from(&snapshot.state);
        self.periods = snapshot.periods;
        self.failure.clone_from(&snapshot.failure);
        Ok(())
    }

    /// The robot's body of this name.
    pub(crate) fn body(&self, name: &str) -> Result<usize, RobotError> {
        let own = own_bodies(&self.model, self.binding.torso);
        let named = |body: usize| name_of(&self.model, MjtObjBase::mjOBJ_BODY, body);
        let found = own.iter().copied().find(|&body| named(body) == name);
        found.ok_or_else(|| RobotError::NoBody {
            body: name.into(),
            known: own.iter().map(|&body| named(body)).collect(),
        })
    }
}
