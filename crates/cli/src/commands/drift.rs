//! The drift alarm while a policy is applied, a robot that is changed meanwhile, and the table of what is found.

use std::path::Path;

use serde::Serialize;
use stridemap_lab::builtin::{self, LoadedTask};
use stridemap_lab::run::FinishedRun;
use stridemap_lab::{Detectable, DriftAlarm, DriftMonitor, FALSE_ALARMS_PER_1000, LabError, Plant, drift_monitor};
use stridemap_record::Transition;
use stridemap_robot::Robot;

use super::on_robot;
use crate::args::{Change, Common};
use crate::failure::Failure;
use crate::output;

/// What the alarm finds within so many strides on average is said.
const WITHIN_STRIDES: f64 = 15.0;

/// What is told of drift.
#[derive(Serialize)]
pub struct DriftShown {
    /// Strides of the policy that told what the robot does by itself.
    learned_strides: usize,
    /// Strides looked at.
    strides: usize,
    /// For which the threshold is set.
    false_alarms_per_1000_strides: f64,
    /// What is found.
    detectable: Vec<Detectable>,
    /// The first one.
    pub alarm: Option<DriftAlarm>,
}

/// Watches whether the robot that walks is still the one that was learned.
pub struct Drift {
    monitor: Option<DriftMonitor>,
    shown: Option<DriftShown>,
}

impl Drift {
    /// A watch by the map of a run; none, with a word, where the run has no map or too few strides.
    pub fn of(path: Option<&Path>) -> Self {
        let made = path.map(|path| FinishedRun::open(path, &[]).and_then(|run| drift_monitor(&run)));
        match made {
            Some(Ok(monitor)) => {
                let shown = DriftShown {
                    learned_strides: monitor.learned(),
                    strides: 0,
                    false_alarms_per_1000_strides: FALSE_ALARMS_PER_1000,
                    detectable: monitor.detectable(WITHIN_STRIDES),
                    alarm: None,
                };
                Self { monitor: Some(monitor), shown: Some(shown) }
            }
            Some(Err(error)) => {
                output::note(format!("no drift alarm: {error}"));
                Self { monitor: None, shown: None }
            }
            None => Self { monitor: None, shown: None },
        }
    }

    /// Takes a stride; says it at once when the robot is no longer the one that was learned.
    pub fn saw(&mut self, t: &Transition) -> Result<(), LabError> {
        let (Some(monitor), Some(shown)) = (&mut self.monitor, &mut self.shown) else { return Ok(()) };
        shown.strides += 1;
        if let Some(alarm) = monitor.saw(t)?
            && shown.alarm.is_none()
        {
            output::note(words(&alarm));
            shown.alarm = Some(alarm);
        }
        Ok(())
    }

    /// What is told at the end.
    pub fn shown(self) -> Option<DriftShown> {
        self.shown
    }
}

fn words(alarm: &DriftAlarm) -> String {
    let how = if alarm.larger { "larger" } else { "smaller" };
    format!(
        "DRIFT at stride {}: the robot is no longer the one that was learned; {} is {how} than its map says (sum {:.1}, threshold \
         {:.1}); `stridemap learn --adapt RUN` learns anew around its policy",
        alarm.stride, alarm.component, alarm.sum, alarm.threshold
    )
}

/// A number with two significant digits.
fn two_digits(x: f64) -> String {
    let digits = 1 - x.abs().max(1e-12).log10().floor() as i32;
    format!("{x:.0$}", digits.clamp(0, 9) as usize)
}

/// Prints what is told of drift.
pub fn show(shown: &DriftShown) {
    match &shown.alarm {
        Some(alarm) => output::line(format!("  {}", words(alarm))),
        None => output::line(format!("  no drift in {} strides", shown.strides)),
    }
    let found: Vec<String> =
        shown.detectable.iter().map(|d| format!("{} by {}", d.component, two_digits(d.shift))).collect();
    output::line(format!(
        "  at {} false alarms in 1,000 strides a lasting shift of {} is found within {} strides on average",
        shown.false_alarms_per_1000_strides,
        found.join(", or "),
        WITHIN_STRIDES
    ));
}

/// A robot that takes the place of the one that walks, before a stride.
pub struct Changed {
    at: usize,
    robot: Option<Box<dyn Robot>>,
    failed: Option<LabError>,
}

impl Changed {
    /// Of a run's robot, or of that of a task's nominal gait, with what is set then.
    pub fn of(
        path: Option<&Path>,
        nominal: Option<&str>,
        change: &Change,
        common: &Common,
    ) -> Result<Option<Self>, Failure> {
        let Some(at) = change.change_at else { return Ok(None) };
        let sets: Vec<String> = common.sets.iter().chain(&change.set_then).cloned().collect();
        let loaded = match (path, nominal) {
            (Some(path), _) => {
                LoadedTask { task: FinishedRun::open(path, &sets)?.task, resolved: String::new(), file: None }
            }
            (None, Some(name)) => builtin::load(name, &sets)?,
            (None, None) => return Err(Failure::request("run needs a RUN or --nominal TASK")),
        };
        let task = on_robot(loaded, common)?.task;
        if task.link.is_some() {
            return Err(Failure::request("--change-at changes a robot that is simulated here, none behind a link"));
        }
        let robot = task.robot.build().map_err(|error| task.located(error))?;
        Ok(Some(Self { at, robot: Some(robot), failed: None }))
    }

    /// Changes the robot if its time has come.
    pub fn before(&mut self, plant: &mut Plant, stride: usize) {
        if stride == self.at
            && let Some(robot) = self.robot.take()
            && let Err(error) = plant.change_robot(robot)
        {
            self.failed = Some(error.into());
        }
    }

    /// Whether the robot could not be changed.
    pub fn failed(&mut self) -> Option<LabError> {
        self.failed.take()
    }
}
