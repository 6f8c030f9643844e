//! `bench preflight`: does the pre-flight name every fault of the wiring, and leave healthy robots alone?

use std::fmt::Write as _;

use serde::Serialize;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Miswired, builtin, preflight};
use stridemap_mujoco::WiringFault;

use crate::failure::Failure;
use crate::output;

/// Robots that are wired well: as their model, and changed.
const HEALTHY: [&str; 5] = ["N", "A", "B", "C", "R"];

#[derive(Serialize)]
struct Row {
    /// The preset of the robot, or the fault injected.
    robot: String,
    /// The word by which it must be named; none for a healthy robot.
    expected: Option<&'static str>,
    seeds: u64,
    /// Seeds on which it was named, or a healthy robot left alone.
    right: u64,
    /// What the first seed was told.
    told: Vec<Miswired>,
}

/// Injects every fault, and looks at every healthy robot, on so many seeds each.
pub fn bench(task: &str, seeds: u64, sets: &[String], json: bool) -> Result<(), Failure> {
    let mut rows = Vec::new();
    let told = |set: String, seed: u64| -> Result<Vec<Miswired>, Failure> {
        let sets: Vec<String> = sets.iter().cloned().chain([set]).collect();
        let task = builtin::load(task, &sets)?.on(None, seed)?.task;
        Ok(preflight(&task, &mut stream(seed, Role::Check, 4))?)
    };
    let mut row = |robot: String, set: &str, expected: Option<&'static str>| -> Result<(), Failure> {
        let (mut right, mut first) = (0, Vec::new());
        for seed in 1..=seeds {
            output::status(format!("{robot}, seed {seed}"));
            let faults = told(set.to_owned(), seed)?;
            right += u64::from(match expected {
                None => faults.is_empty(),
                Some(kind) => faults.iter().any(|fault| fault.kind == kind),
            });
            if seed == 1 || first.is_empty() {
                first = faults;
            }
        }
        rows.push(Row { robot, expected, seeds, right, told: first });
        Ok(())
    };
    for preset in HEALTHY {
        row(preset.into(), &format!("robot.changes.preset={preset}"), None)?;
    }
    for (fault, expected) in WiringFault::ALL {
        let word = serde_json::to_value(fault)?;
        let word = word.as_str().unwrap_or_default().to_owned();
        row(word.clone(), &format!("robot.sensors.fault={word}"), Some(expected))?;
    }
    if json {
        return output::json(&rows);
    }
    let mut table = String::from("| robot or fault | right | told on the first seed |\n|---|---|---|\n");
    for row in &rows {
        let told = row.told.iter().map(|fault| format!("{}: {}", fault.kind, fault.found)).collect::<Vec<_>>();
        let told = if told.is_empty() { "nothing".into() } else { told.join("; ") };
        let _ = writeln!(table, "| {} | {} of {} | {told} |", row.robot, row.right, row.seeds);
    }
    output::line(table);
    Ok(())
}
