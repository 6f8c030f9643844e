//! Nominal gaits that a task may name.

use stridemap_gait::{Gait, OscillatorGait};
use stridemap_robot::RobotDescription;

use crate::error::LabError;
use crate::registry::{Part, Registry};
use crate::task::Task;

/// Builds a task's gait for a robot.
pub type BuildGait = fn(&Task, &RobotDescription) -> Result<Box<dyn Gait>, LabError>;

/// A nominal gait, by the name in `gait.kind`.
pub struct GaitPart {
    /// The name in task files.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// Builds it from a task, for a robot: `task.gait` has its parameters, those of a gait of one's own in `own`. When a
    /// task is read, the robot is an outline with nothing but its leg joints.
    pub build: BuildGait,
}

impl Part for GaitPart {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

/// The registry of gaits.
#[must_use]
pub fn gaits() -> &'static Registry<GaitPart> {
    static OSCILLATOR: GaitPart = GaitPart {
        name: "oscillator",
        about: "four oscillators phase-locked to the robot's centre of pressure (MA09, sec. 2)",
        build: |task, robot| Ok(Box::new(OscillatorGait::new(task.gait.clone(), robot)?)),
    };
    static GAITS: Registry<GaitPart> = Registry::new("gait", &[&OSCILLATOR]);
    &GAITS
}
