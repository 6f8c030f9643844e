//! How a machine is served over ROS 2, and what its server says of itself.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::guard::{GuardBounds, Refusals};

/// How a machine is served.
#[derive(Clone, Debug)]
pub struct Serve {
    /// Where.
    pub link: Ros2Config,
    /// Bounds of the robot's own guard.
    pub bounds: GuardBounds,
    /// How much faster than real time its clock runs; 0: in lock step, each period as soon as the
    /// controller has answered the last state (for tests on machines that cannot keep time).
    pub realtime_factor: f64,
    /// Root of the machine's own noise.
    pub seed: u64,
    /// Ends by itself after this much robot time.
    pub most_s: Option<f64>,
    /// Names this robot's node.
    pub node: String,
}

impl Serve {
    /// Real time of a control period; `None` in lock step.
    pub(crate) fn period(&self, period_s: f64) -> Result<Option<Duration>, LinkError> {
        /// The slowest clock: a person would take the robot for dead.
        const LONGEST_S: f64 = 60.0;
        let refused = |field, value: f64, problem: &str| LinkError::Config {
            field,
            value: format!("{value:?}"),
            problem: problem.into(),
        };
        if let Some(most_s) = self.most_s.filter(|s| !(s.is_finite() && *s >= 0.0)) {
            return Err(refused("most_s", most_s, "must be finite, at least 0"));
        }
        if self.realtime_factor.abs() <= 0.0 {
            return Ok(None);
        }
        let period = Duration::try_from_secs_f64(period_s / self.realtime_factor);
        match period {
            Ok(period) if period.as_secs_f64() <= LONGEST_S && !period.is_zero() => Ok(Some(period)),
            _ => Err(refused(
                "realtime_factor",
                self.realtime_factor,
                "must be 0, or such that a period takes more than 0 and at most 60 s",
            )),
        }
    }
}

/// What the robot says of itself, as JSON on `/stridemap/status`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Robot time.
    pub time_s: f64,
    /// How often it was set on its feet.
    pub set_ups: u64,
    /// Why the emergency stop is latched, if it is.
    pub stopped: Option<String>,
    /// Whether somebody commands it.
    pub commanded: bool,
    /// Follows, holds or gives way.
    pub act: String,
    /// Robot time since the last command that it accepted.
    pub silence_s: Option<f64>,
    /// How often its guard stepped in.
    pub refusals: Refusals,
}

/// What a server did in its life.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ServerReport {
    /// Control periods.
    pub periods: u64,
    /// Periods that began late by more than half a period, of those that were paced.
    pub late: u64,
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Periods in which somebody commanded the robot.
    pub commanded: u64,
    /// Of those, periods whose state was not answered before their end.
    pub unanswered: u64,
    /// From telling a state to having its answer, milliseconds: median.
    pub round_trip_p50_ms: f64,
    /// The same: 99 of 100 are faster.
    pub round_trip_p99_ms: f64,
    /// The same: the slowest.
    pub round_trip_max_ms: f64,
    /// What the guard did.
    pub refusals: Refusals,
}
