//! What `analyse` takes.

use std::path::PathBuf;

use clap::Args;

use super::{Common, count, within};

/// What `analyse` takes.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  stridemap analyse strides.csv --state roll_deg,pitch_rate_deg_s --fall \
    \"roll_deg < -12\"\n  stridemap analyse runs/walking-1 --brute 1000\n  stridemap analyse imu.csv --section roll_rate \
    --state pitch_rate")]
pub struct AnalyseArgs {
    /// A run directory; a table of strides (CSV, one row a stride, or as PhysioNet writes them); an MCAP log; or a
    /// table of IMU readings (--section).
    #[arg(value_name = "LOG")]
    pub record: PathBuf,
    /// Columns that are the state, 1 to 5. Default: of a run the first three that it has; of a table the only one.
    #[arg(long, value_delimiter = ',', value_name = "A,B,C")]
    pub state: Vec<String>,
    /// Columns that are actions which somebody varied at random: probes.
    #[arg(long, value_delimiter = ',', value_name = "U")]
    pub action: Vec<String>,
    /// What a fall is, e.g. "roll_deg < -12". Default: of a run the task's.
    #[arg(long, value_name = "RULE")]
    pub fall: Option<String>,
    /// Standard deviation of the sensor's noise: none, a=0.2,b=0.1, or two-looks (columns a_2, b_2). Default: estimated.
    #[arg(long, value_name = "NOISE")]
    pub sensor_noise: Option<String>,
    /// Duration of a stride, where there is no column time_s.
    #[arg(long, value_parser = within(1e-3, 1e3))]
    pub stride_s: Option<f64>,
    /// The log is a series in time, and strides begin where this column passes zero upward (a rate: roll_rate), or a
    /// threshold ("left_load_n > 50": touchdown).
    #[arg(long, value_name = "COLUMN")]
    pub section: Option<String>,
    /// The task that describes the robot of an MCAP log.
    #[arg(long)]
    pub task: Option<PathBuf>,
    /// Whose strides of a run: final, nominal, iteration-1, ...
    #[arg(long, default_value = "final")]
    pub what: String,
    /// Beside the bounds: so many walks of 60 s of the run's policy on its simulated robot, counted.
    #[arg(long, value_name = "WALKS", value_parser = count::<usize>(1_000_000))]
    pub brute: Option<usize>,
    /// Instead: what a walking run's map must see (held-out residuals with and without the last action, the flip of the
    /// map beside the robot's own).
    #[arg(long)]
    pub map: bool,
    /// Where figures and analysis.json go. Default: into the run; runs/analyse-LOG of a table.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Options shared by most commands.
    #[command(flatten)]
    pub common: Common,
}

/// What `bench coverage` and `bench time-to-fall` take.
#[derive(Clone, Debug, Args)]
pub struct StudyArgs {
    /// Coverage: random systems of each kind of sensor.
    #[arg(long, default_value_t = 800, value_parser = count::<usize>(1_000_000))]
    pub systems: usize,
    /// Time to fall: records of each system.
    #[arg(long, default_value_t = 60, value_parser = count::<usize>(1_000_000))]
    pub records: usize,
    /// Coverage, time to fall: root of every random stream.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}
