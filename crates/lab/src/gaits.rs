//! Nominal gaits that a task may name.

use stridemap_gait::{Gait, OscillatorGait, PolicyGait, ZmpGait};
use stridemap_robot::RobotDescription;

use crate::driven::driven;
use crate::error::{Invalid, LabError};
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
    static ONNX: GaitPart = GaitPart {
        name: "onnx",
        about: "a pretrained network that follows a velocity command (gait.policy, or gait.policy_file)",
        build: |task, robot| {
            let gait = &task.gait;
            let policy = gait.policy.clone().ok_or_else(|| {
                let requirement = "is needed by gait.kind = \"onnx\" (or gait.policy_file, a file that has it)";
                LabError::Invalid(Invalid { key: "gait.policy".into(), requirement: requirement.into() })
            })?;
            Ok(Box::new(PolicyGait::new(policy, gait.clock.clone(), gait.command, robot)?))
        },
    };
    static ZMP: GaitPart = GaitPart {
        name: "zmp",
        about: "footsteps, preview control of the centre of mass (Kajita 2003), DCM feedback; parameters in [gait.zmp]",
        build: |task, robot| {
            let missing = || Invalid { key: "gait.zmp".into(), requirement: "is needed by gait.kind = \"zmp\"".into() };
            let config = task.gait.zmp.ok_or_else(|| LabError::Invalid(missing()))?;
            Ok(Box::new(ZmpGait::new(config, robot)?))
        },
    };
    static GAITS: Registry<GaitPart> = Registry::new("gait", &[&OSCILLATOR, &ONNX, &ZMP]);
    &GAITS
}

impl Task {
    /// Builds the nominal gait for a robot.
    ///
    /// # Errors
    ///
    /// [`LabError::Gait`] for a configuration outside its domain, or a robot that lacks a joint which the gait
    /// moves; [`LabError::Invalid`] for a kind that is not in the registry.
    pub fn gait(&self, robot: &RobotDescription) -> Result<Box<dyn Gait>, LabError> {
        (gaits().find(&self.gait.kind))
            .ok_or_else(|| {
                let names: Vec<&str> = gaits().all().iter().map(|g| g.name).collect();
                let near = stridemap_config::nearest(&self.gait.kind, &names);
                let hint = near.map_or_else(String::new, |n| format!(" did you mean \"{n}\"?"));
                LabError::Invalid(Invalid {
                    key: "gait.kind".into(),
                    requirement: format!(
                        "there is no gait {:?};{hint} (allowed: {})",
                        self.gait.kind,
                        names.join(", ")
                    ),
                })
            })
            .and_then(|part| (part.build)(self, robot))
            .map(|gait| driven(&self.robot.posture, robot, gait))
    }
}
