//! Words that the command line takes in one place of a command.

use clap::ValueEnum;

/// What `bench` looks at instead of times.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BenchOf {
    /// Public robots.
    Robots,
    /// Whether intervals of multipliers hold the truth, on random linear systems.
    Coverage,
    /// Whether bounds on falls hold the truth, on systems whose falls can be counted.
    TimeToFall,
    /// The drift alarm: robots that change in the middle of a walk.
    Drift,
    /// Learners and controls side by side, from seed 4201 on.
    Learners,
    /// How pretrained networks walk, raw.
    Walk,
    /// Whether faults of the wiring are named before anything is learned.
    Preflight,
}

/// A robot whose pretrained networks and model can be fetched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FetchedRobot {
    /// Unitree G1, 29 joints.
    G1,
    /// Booster T1, 29 joints.
    T1,
    /// Unitree Go2, a quadruped.
    Go2,
}

impl FetchedRobot {
    /// The name of its folder in the cache.
    pub const fn name(self) -> &'static str {
        match self {
            Self::G1 => "g1",
            Self::T1 => "t1",
            Self::Go2 => "go2",
        }
    }
}

/// A robot on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RobotName {
    /// The small humanoid, simulated in this process with hardware effects.
    Op3,
    /// The same without hardware effects.
    Op3Ideal,
    /// A robot behind ROS 2.
    Ros2,
}

impl From<RobotName> for stridemap_lab::RobotChoice {
    fn from(name: RobotName) -> Self {
        match name {
            RobotName::Op3 => Self::Op3,
            RobotName::Op3Ideal => Self::Op3Ideal,
            RobotName::Ros2 => Self::Ros2,
        }
    }
}

/// What may be listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PartKind {
    /// Nominal gaits: gait.kind of a task.
    Gaits,
    /// Learners: learner.kind.
    Learners,
    /// Quantities of reward terms: reward.quantity.
    Rewards,
    /// Components of the state at the section: state.
    States,
    /// Events that make a section: section.event.
    Events,
    /// Robots that --robot names.
    Robots,
}

/// A figure of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum FigureName {
    /// Gaussian-process regression of a sine.
    Fig7,
    /// Learning curves: map against full model.
    Fig8,
    /// Policies: map against full model.
    Fig9,
    /// Return map under pushes.
    Fig10,
    /// The biped before learning to walk: time lapse.
    Fig11,
    /// The biped after learning to walk: time lapse.
    Fig12,
    /// The small humanoid's map of stepping, a surface.
    Fig13,
    /// Its roll at the section over 40 steps of the acquired policy.
    Fig14,
    /// Its acquired stepping: time lapse.
    Fig15,
    /// The small humanoid before learning to walk: time lapse.
    Fig16,
    /// After the first iteration: time lapse.
    Fig17,
    /// After the second iteration: time lapse.
    Fig18,
    /// Walking: speed and prediction error against the number of samples (sec. 8.1).
    Samples,
    /// Figs. 7 to 18, and a table: paper beside ours.
    All,
}

/// A robot that can be simulated behind ROS 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ServedRobot {
    /// The small humanoid ROBOTIS OP3.
    Op3,
}
