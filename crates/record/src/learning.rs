//! `learning.csv`: the learning curve, one line per trial.

use serde::{Deserialize, Serialize};

use crate::error::RecordError;
use crate::table::Table;

/// Where a trial was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum World {
    /// In the map.
    #[default]
    Map,
    /// On the robot, to report.
    Robot,
    /// On the robot, to choose.
    RobotEvaluation,
}

impl World {
    const ALL: [Self; 3] = [Self::Map, Self::Robot, Self::RobotEvaluation];

    /// The word used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Map => "map",
            Self::Robot => "robot",
            Self::RobotEvaluation => "robot-evaluation",
        }
    }
}

/// A trial of learning, or a policy measured on the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LearningRow {
    /// Iteration, from 1.
    pub iteration: usize,
    /// Trial within the iteration; of a measured policy its iteration.
    pub trial: usize,
    /// Where it was made.
    pub world: World,
    /// Average reward of a stride.
    pub average_reward: f64,
    /// Falls in the trial.
    pub falls: usize,
    /// Strides of the trial.
    pub strides: usize,
}

impl LearningRow {
    /// The header line.
    pub const HEADER: &'static str = "iteration,trial,world,average_reward,falls,strides";

    /// One line.
    #[must_use]
    pub fn line(&self) -> String {
        format!(
            "{},{},{},{},{},{}",
            self.iteration,
            self.trial,
            self.world.name(),
            self.average_reward,
            self.falls,
            self.strides
        )
    }

    pub(crate) fn read(table: &Table) -> Result<Vec<Self>, RecordError> {
        let rows = table.rows().map(|row| {
            let row = row?;
            Ok(Self {
                iteration: row.count("iteration")?,
                trial: row.count("trial")?,
                world: row.word("world", &World::ALL, World::name)?,
                average_reward: row.number("average_reward")?,
                falls: row.count("falls")?,
                strides: row.count("strides")?,
            })
        });
        rows.collect()
    }
}
