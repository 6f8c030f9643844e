//! `bench walk`: how pretrained networks walk, raw, on the commands that docs/pretrained.md tabulates.

use std::fmt::Write as _;

use serde::Serialize;
use stridemap_lab::{ActionSource, Batch, Task, builtin, make_strides, seed};
use stridemap_process::StrideEnd;
use stridemap_record::{StridePhase, StrideRole};

use crate::failure::Failure;
use crate::output;

/// Tasks whose gait is a network, and commands: speed forward and to the left, yaw rate.
const TASKS: [&str; 5] = ["g1-velocity", "g1-fastsac-velocity", "t1-velocity", "t1-fastsac-velocity", "go2-velocity"];
const COMMANDS: [[f64; 3]; 4] = [[0.5, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.5], [0.5, 0.2, 0.5]];
const GRAVITY_M_S2: f64 = 9.81;

/// A row of the table: what a command became.
#[derive(Serialize)]
struct Row {
    task: String,
    command: [f64; 3],
    /// As the simulator knows it, and as the robot measures it.
    truth: [f64; 3],
    measured: [f64; 3],
    /// Standard deviation of what is measured about the truth, by stride.
    noise: [f64; 3],
    cost_of_transport: f64,
    strides: usize,
    falls: usize,
}

/// Walks every network whose task's name holds `only`, on `seeds` seeds of a minute each, and prints the table.
pub fn walk(seeds: u64, only: Option<&str>, sets: &[String], json: bool) -> Result<(), Failure> {
    let mut rows = Vec::new();
    for name in TASKS.into_iter().filter(|name| only.is_none_or(|only| name.contains(only))) {
        let loaded = builtin::load(name, sets)?.on(None, 1)?;
        for command in COMMANDS {
            output::status(format!("{name} {command:?}"));
            rows.push(row(&loaded.task, command, seeds)?);
        }
    }
    if json {
        return output::json(&rows);
    }
    let mut table = String::from(
        "| task | command | true vx, vy, wz | measured less true, sd of a stride | cost of transport | strides, falls |\n\
         |---|---|---|---|---|---|\n",
    );
    for row in &rows {
        let three = |v: [f64; 3]| format!("{:+.3}, {:+.3}, {:+.3}", v[0], v[1], v[2]);
        let bias = [0, 1, 2].map(|i| row.measured[i] - row.truth[i]);
        let [x, y, z] = row.command;
        let _ = writeln!(
            table,
            "| {} | {x}, {y}, {z} | {} | {}; {:.3}, {:.3}, {:.3} | {:.3} | {}, {} |",
            row.task,
            three(row.truth),
            three(bias),
            row.noise[0],
            row.noise[1],
            row.noise[2],
            row.cost_of_transport,
            row.strides,
            row.falls
        );
    }
    output::line(table);
    Ok(())
}

fn row(task: &Task, command: [f64; 3], seeds: u64) -> Result<Row, Failure> {
    let mut task = task.clone();
    task.gait.command = command;
    let policy = task.nominal_policy()?;
    let (mut truth, mut measured, mut power, mut strides, mut falls) = ([0.0; 3], [0.0; 3], 0.0, 0, 0);
    let mut squares = [0.0; 3];
    let mut mass_kg = 0.0;
    for seed in 1..=seeds {
        let mut plant = task.plant()?;
        mass_kg = plant.robot().description().mass_kg;
        let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: 57 };
        let mut rng = seed::stream(seed, seed::Role::Check, 3);
        let source = ActionSource::Mean(&policy);
        // Who does not come to its first stride has no row of numbers.
        let Ok(made) = make_strides(&mut plant, &source, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(())) else {
            falls += 1;
            continue;
        };
        for t in made {
            if t.end != StrideEnd::Crossing {
                falls += 1;
                continue;
            }
            let of = |m: &stridemap_record::Motion| [m.forward_speed_m_s, m.lateral_speed_m_s, m.yaw_rate_rad_s];
            let (is, seen) = (of(&t.measures.true_motion), of(&t.measures.motion));
            for i in 0..3 {
                truth[i] += is[i];
                measured[i] += seen[i];
                squares[i] += (seen[i] - is[i]).powi(2);
            }
            power += t.measures.true_motion.power_w;
            strides += 1;
        }
    }
    let n = f64::from(u32::try_from(strides.max(1)).unwrap_or(u32::MAX));
    let [truth, measured] = [truth, measured].map(|sum| sum.map(|v| v / n));
    let noise = [0, 1, 2].map(|i| (squares[i] / n - (measured[i] - truth[i]).powi(2)).max(0.0).sqrt());
    Ok(Row {
        task: task.name.clone(),
        command,
        truth,
        measured,
        noise,
        cost_of_transport: power / n / (mass_kg * GRAVITY_M_S2 * truth[0].hypot(truth[1]).max(0.01)),
        strides,
        falls,
    })
}
