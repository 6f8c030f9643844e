//! Arguments of the commands that judge a policy: push, verdict, compare-runs, and what changes a robot in the middle of a walk.

use std::path::PathBuf;

use clap::Args;

use super::{Common, STRIDES, count, within};

/// A robot that is changed while it walks.
#[derive(Clone, Debug, Args)]
pub struct Change {
    /// Before which stride, from 0, the robot is changed to one with --set-then: what the drift alarm is for.
    #[arg(long, value_name = "STRIDE", requires = "set_then")]
    pub change_at: Option<usize>,
    /// What is other then, e.g. `--set-then robot.mass_scale=1.05`; may be repeated.
    #[arg(long, value_name = "KEY=VALUE", requires = "change_at")]
    pub set_then: Vec<String>,
}

/// How many walks say what a policy does.
#[derive(Clone, Copy, Debug, Args)]
pub struct Walks {
    /// Walks of 60 s from starts of their own. Falls in them bound the probability of a fall in 60 s.
    #[arg(long, default_value_t = 60, value_parser = count::<usize>(STRIDES))]
    pub walks: usize,
    /// Strides with a little noise on the actions, for the multipliers.
    #[arg(long, default_value_t = 300, value_parser = count::<usize>(STRIDES))]
    pub probe: usize,
}

/// Arguments of `verdict`.
#[derive(Debug, Args)]
pub struct VerdictArgs {
    /// A run directory.
    pub run: PathBuf,
    /// Writes the verdict as JUnit XML, which CI servers show.
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Writes the verdict as Markdown.
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// How long it is looked at.
    #[command(flatten)]
    pub walks: Walks,
    /// Options shared by most commands.
    #[command(flatten)]
    pub common: Common,
}

/// Arguments of `compare-runs`.
#[derive(Debug, Args)]
pub struct CompareRunsArgs {
    /// The run that is the mark.
    pub a: PathBuf,
    /// The run that may be worse.
    pub b: PathBuf,
    /// Writes the comparison as JUnit XML.
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Writes the comparison as Markdown.
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// How long they are looked at.
    #[command(flatten)]
    pub walks: Walks,
    /// Options shared by most commands.
    #[command(flatten)]
    pub common: Common,
}

/// Arguments of `push`.
#[derive(Debug, Args)]
pub struct PushArgs {
    /// A run directory.
    pub run: PathBuf,
    /// Largest lateral force on the torso, newtons. Default: what gives the robot 0.04 m/s.
    #[arg(long, value_parser = within(1e-6, 1e6))]
    pub force: Option<f64>,
    /// Maps the largest push that is survived instead: 8 phases of the gait, 8 directions, 0.08 and 0.2 s long, up to 1.2
    /// m/s of the whole robot. The same command goes on where it was stopped.
    #[arg(long, conflicts_with_all = ["force", "duration", "strides"])]
    pub atlas: bool,
    /// Atlas: phases of the gait, evenly over a stride.
    #[arg(long, default_value_t = 8, requires = "atlas", value_parser = count::<usize>(64))]
    pub phases: usize,
    /// Atlas: directions, evenly over a turn.
    #[arg(long, default_value_t = 8, requires = "atlas", value_parser = count::<usize>(64))]
    pub directions: usize,
    /// The body that is pushed, by its name in the model. Default: the torso.
    #[arg(long, value_name = "NAME")]
    pub body: Option<String>,
    /// For how long each push acts, seconds.
    #[arg(long, default_value_t = 0.2, value_parser = within(1e-6, 60.0))]
    pub duration: f64,
    /// Strides in all.
    #[arg(long, default_value_t = 160, value_parser = count::<usize>(STRIDES))]
    pub strides: usize,
    /// Pushes the nominal gait instead.
    #[arg(long)]
    pub nominal: bool,
    /// Where push.csv and push.json go. Default: into the run; nowhere with --set.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Options shared by most commands.
    #[command(flatten)]
    pub common: Common,
}
