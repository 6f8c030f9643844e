//! On which robot a task runs: as its file says, or another of the same kind.

use stridemap_mujoco::{HardwareConfig, ModelSource};
use stridemap_robot::Ros2Config;

use crate::builtin::LoadedTask;
use crate::error::{Invalid, LabError};

/// A robot named on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RobotChoice {
    /// The small humanoid, simulated in this process with hardware effects.
    Op3,
    /// The same without hardware effects, its sensors perfect.
    Op3Ideal,
    /// A robot behind ROS 2: another process, or a real one.
    Ros2,
}

impl RobotChoice {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Op3, Self::Op3Ideal, Self::Ros2];

    /// What it is, in a line.
    #[must_use]
    pub const fn about(self) -> &'static str {
        match self {
            Self::Op3 => "the small humanoid, simulated in this process with hardware effects",
            Self::Op3Ideal => "the same without hardware effects, its sensors perfect",
            Self::Ros2 => "a robot behind ROS 2: another process, or a real one",
        }
    }

    /// The word used on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Op3 => "op3",
            Self::Op3Ideal => "op3-ideal",
            Self::Ros2 => "ros2",
        }
    }
}

impl LoadedTask {
    /// The task on another robot of its kind, and on this seed's individual where the file does not
    /// name one.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] if the task is not one for that robot; [`LabError::Config`] if the task
    /// cannot be written down.
    pub fn on(mut self, choice: Option<RobotChoice>, seed: u64) -> Result<Self, LabError> {
        let robot = &mut self.task.robot;
        if let Some(choice) = choice {
            if robot.model == ModelSource::Biped {
                return Err(LabError::Invalid(Invalid {
                    key: "robot.model".into(),
                    requirement: format!(
                        "must be a small humanoid for --robot {}; this task is for the {}",
                        choice.name(),
                        robot.model
                    ),
                }));
            }
            robot.estimated = true;
            match choice {
                RobotChoice::Op3 => {
                    robot.hardware.get_or_insert_with(HardwareConfig::default);
                    self.task.link = None;
                }
                RobotChoice::Op3Ideal => {
                    robot.hardware = None;
                    self.task.link = None;
                }
                RobotChoice::Ros2 => {
                    self.task.link.get_or_insert_with(Ros2Config::default);
                }
            }
        }
        if let Some(hardware) = &mut self.task.robot.hardware {
            let individual = *hardware.individual.get_or_insert(seed);
            if i64::try_from(individual).is_err() {
                return Err(LabError::Invalid(Invalid {
                    key: "robot.hardware.individual".into(),
                    requirement: format!("is {individual}, the seed; must be at most {}", i64::MAX),
                }));
            }
        }
        if let Some(changes) = &mut self.task.robot.changes {
            changes.individual.get_or_insert(seed);
        }
        self.resolved = self.task.to_toml()?;
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::load;

    #[test]
    fn hardware_effects_come_and_go_and_individuals_follow_the_seed() {
        let small = |choice, seed| load("small-stepping", &[]).unwrap().on(choice, seed).unwrap();
        let as_written = small(None, 7).task;
        assert_eq!(as_written.robot.hardware.as_ref().unwrap().individual, Some(7));
        assert_eq!(as_written, small(Some(RobotChoice::Op3), 7).task);
        let ideal = small(Some(RobotChoice::Op3Ideal), 7);
        assert!(ideal.task.robot.hardware.is_none() && ideal.task.robot.estimated);
        assert!(!ideal.resolved.contains("hardware"));
        let linked = small(Some(RobotChoice::Ros2), 7).task;
        assert_eq!(linked.link, Some(Ros2Config::default()));
        let named = load("small-stepping", &["robot.hardware.individual=3".into()]);
        let named = named.unwrap().on(None, 7).unwrap().task;
        assert_eq!(named.robot.hardware.unwrap().individual, Some(3));
    }

    #[test]
    fn the_big_biped_has_no_small_twin() {
        let error = load("stepping", &[]).unwrap().on(Some(RobotChoice::Op3), 1).unwrap_err();
        assert!(error.is_request() && error.to_string().contains("robot.model"), "{error}");
    }
}
