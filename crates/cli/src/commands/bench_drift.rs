//! `bench drift`: how fast the drift alarm finds a robot that was changed in the middle of a walk, and how often it errs.

use serde::Serialize;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{
    ActionSource, Algorithm, Batch, DriftMonitor, LabError, Recorder, Task, builtin, disturbed, fit_map, make_strides,
    share_of,
};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_map::LearnedMap;
use stridemap_process::StrideEnd;
use stridemap_record::{Pace, Phase, Recording, StridePhase, StrideRole, Transition};

use super::learn::median;
use crate::failure::Failure;
use crate::{output, parallel};

/// Tasks whose robots are changed.
const TASKS: [&str; 2] = ["stepping", "walking"];
/// What changes, in words, and the keys that are set then.
const CHANGES: [(&str, &str); 5] = [
    ("payload +5 kg", "robot.changes.payload_kg=5.0"),
    ("payload +2 kg", "robot.changes.payload_kg=2.0"),
    ("friction 0.5", "robot.friction=0.5"),
    ("servo gains -10 %", "robot.kp_nm_rad=2700.0"),
    ("servo gains -20 %", "robot.kp_nm_rad=2400.0"),
];
/// Strides before the change, and how many after it are watched.
const BEFORE: usize = 40;
const AFTER: usize = 60;
/// Strides within which a change is to be found.
const WITHIN: usize = 15;
/// Strides of the robot that was learned, each seed: 20 seeds are 2,000.
const UNCHANGED: usize = 114;

/// Keeps the strides by which the final policy was measured, as a run does.
#[derive(Default)]
struct Final(Vec<Transition>);

impl Recorder for Final {
    fn stride(&mut self, t: &Transition, what: Option<&str>) -> Result<(), LabError> {
        if what == Some("final") {
            if (t.episode, t.k) == (0, 0) {
                self.0.clear();
            }
            self.0.push(t.clone());
        }
        Ok(())
    }
    fn map(&mut self, _: usize, _: &LearnedMap) -> Result<(), LabError> {
        Ok(())
    }
    fn trial(&mut self, _: usize, _: &TrialSummary) -> Result<(), LabError> {
        Ok(())
    }
    fn policy(&mut self, _: usize, _: &SavedPolicy) -> Result<(), LabError> {
        Ok(())
    }
    fn poses(&mut self, _: &str, _: Pace, _: &Recording) -> Result<(), LabError> {
        Ok(())
    }
    fn checkpoint(&mut self, _: Phase, _: &stridemap_lab::Progress) -> Result<(), LabError> {
        Ok(())
    }
}

/// What became of one walk.
#[derive(Clone, Copy)]
struct Watched {
    /// Settled strides that were looked at.
    strides: usize,
    alarms: usize,
    /// Strides after the change until the first alarm.
    delay: Option<usize>,
    fell: bool,
}

/// One seed: unchanged, then each change.
struct Seed {
    unchanged: Watched,
    changed: Vec<Watched>,
}

fn walk(
    task: &Task,
    policy: &SavedPolicy,
    monitor: &mut DriftMonitor,
    seed: u64,
    change: Option<(usize, &Task)>,
    strides: usize,
) -> Result<Watched, LabError> {
    let mut plant = task.plant()?;
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides };
    // Walks that are changed start alike, whatever is changed.
    let index = (1 << 33) + u64::from(change.is_some());
    let mut rng = stream(seed, Role::Verdict, index);
    let mut watched = Watched { strides: 0, alarms: 0, delay: None, fell: false };
    let mut made = 0;
    let mut failed = None;
    let done = make_strides(
        &mut plant,
        &ActionSource::Mean(policy),
        batch,
        &mut rng,
        &mut |plant, stride| {
            let due = change.filter(|(at, _)| *at == stride);
            failed = due.and_then(|(_, to)| {
                let robot = to.robot.build().map_err(LabError::from);
                robot.and_then(|robot| Ok(plant.change_robot(robot)?)).err()
            });
        },
        &mut |t| {
            made += 1;
            watched.strides += usize::from(t.k >= stridemap_lab::DRIFT_SETTLE_STRIDES);
            if monitor.saw(t)?.is_some() {
                let after = change.map_or(0, |(at, _)| made - at.min(made));
                match change {
                    Some(_) if after > 0 => watched.delay = watched.delay.or(Some(after)),
                    _ => watched.alarms += 1,
                }
            }
            watched.fell |= t.end != StrideEnd::Crossing;
            if change.is_some() && (watched.delay.is_some() || watched.fell) {
                return Err(LabError::Interrupted { path: "bench".into() });
            }
            Ok(())
        },
    );
    match done {
        Ok(_) | Err(LabError::Interrupted { .. }) => Ok(watched),
        Err(error) => Err(error),
    }
}

fn one_seed(name: &str, seed: u64) -> Result<Seed, LabError> {
    let sets = ["record.pose_seconds=0".to_owned()];
    let task = builtin::load(name, &sets)?.task;
    let mut algorithm = Algorithm::new(&task, seed)?;
    let mut kept = Final::default();
    algorithm.learn(&mut kept)?;
    let progress = &algorithm.progress;
    let policy = progress.final_policy(&task)?;
    let map = fit_map(&task, &progress.transitions, &progress.in_place(), seed, progress.iterations.len())?;
    let monitor = || DriftMonitor::new(map.clone(), &kept.0);
    let moved = disturbed(&task);
    let unchanged = walk(&moved, &policy, &mut monitor()?, seed, None, UNCHANGED)?;
    let changed = CHANGES.map(|(_, set)| {
        let to = builtin::load(name, &[sets[0].clone(), set.to_owned()])?.task;
        walk(&moved, &policy, &mut monitor()?, seed, Some((BEFORE, &to)), BEFORE + AFTER)
    });
    Ok(Seed { unchanged, changed: changed.into_iter().collect::<Result<_, _>>()? })
}

/// A row of the table.
#[derive(Serialize)]
struct Row {
    task: &'static str,
    change: &'static str,
    seeds: usize,
    found_within_15: usize,
    found: usize,
    fell_first: usize,
    median_delay_strides: Option<f64>,
    alarms_before: usize,
}

/// The table, and false alarms.
#[derive(Serialize)]
struct Table {
    seed: u64,
    rows: Vec<Row>,
    unchanged_strides: usize,
    false_alarms: usize,
    false_alarms_per_1000_low: f64,
    false_alarms_per_1000_high: f64,
}

/// Learns policies, changes their robots in the middle of a walk, and prints what the alarm found.
pub fn drift(seed: u64, seeds: u64, only: Option<&str>, threads: Option<usize>, json: bool) -> Result<(), Failure> {
    let all = parallel::seeds(seed, seeds)?;
    let mut table = Table {
        seed,
        rows: Vec::new(),
        unchanged_strides: 0,
        false_alarms: 0,
        false_alarms_per_1000_low: 0.0,
        false_alarms_per_1000_high: 0.0,
    };
    for name in TASKS.into_iter().filter(|name| only.is_none_or(|only| name.contains(only))) {
        let told = |seed: &u64, done: &Result<Seed, LabError>| match done {
            Ok(_) => format!("{name}, seed {seed}"),
            Err(error) => format!("{name}, seed {seed}: {error}"),
        };
        let done = parallel::over(&all, threads, told, |&seed| one_seed(name, seed))?;
        table.unchanged_strides += done.iter().map(|d| d.unchanged.strides).sum::<usize>();
        table.false_alarms += done.iter().map(|d| d.unchanged.alarms).sum::<usize>();
        for (i, (change, _)) in CHANGES.into_iter().enumerate() {
            let of: Vec<Watched> = done.iter().map(|d| d.changed[i]).collect();
            let delays: Vec<f64> = of.iter().filter_map(|w| w.delay).map(|d| d as f64).collect();
            table.rows.push(Row {
                task: name,
                change,
                seeds: of.len(),
                found_within_15: delays.iter().filter(|d| **d <= WITHIN as f64).count(),
                found: delays.len(),
                fell_first: of.iter().filter(|w| w.delay.is_none() && w.fell).count(),
                median_delay_strides: (!delays.is_empty()).then(|| median(&delays)),
                alarms_before: of.iter().map(|w| w.alarms).sum(),
            });
        }
    }
    let rate = share_of(table.false_alarms, table.unchanged_strides);
    (table.false_alarms_per_1000_low, table.false_alarms_per_1000_high) = (1e3 * rate.low, 1e3 * rate.high);
    if json {
        return output::json(&table);
    }
    output::line(
        "| task | change | found within 15 strides | found | fell first | median strides to the alarm | alarms before |",
    );
    output::line("|---|---|---|---|---|---|---|");
    for r in &table.rows {
        let delay = r.median_delay_strides.map_or_else(|| "-".to_owned(), |d| format!("{d}"));
        output::line(format!(
            "| {} | {} | {} of {} | {} | {} | {delay} | {} |",
            r.task, r.change, r.found_within_15, r.seeds, r.found, r.fell_first, r.alarms_before
        ));
    }
    output::line(format!(
        "{} false alarms in {} strides of unchanged robots: {:.2} to {:.2} in 1,000 (95 %)",
        table.false_alarms, table.unchanged_strides, table.false_alarms_per_1000_low, table.false_alarms_per_1000_high
    ));
    Ok(())
}
