//! Breaks Stridemap on purpose: kills it, fills its disk, mutates what it reads. After each kill the run goes on to
//! its end and every file is compared with an unbroken run's.
//!
//! ```sh
//! cargo run --release -p stridemap-lab --example torture -- --kills 200
//! cargo run --release -p stridemap-lab --example torture -- --kills 20 --only walking,disk
//! ```
//!
//! N kills of `learn stepping`, N/5 of `learn walking`, 3N/10 within 15 ms of birth, N/5 of `collect`; the disk full at
//! up to 12 sizes; 10 N mutated task files, 7.5 N tables, 2.5 N logs, N models. Exit code 1 if anything was lost, differs,
//! was refused, panicked or hung.

#![allow(clippy::print_stdout, reason = "a table is what it is for")]

mod full_disk;
mod kills;
mod mutants;
mod program;

use std::error::Error;
use std::path::PathBuf;

use program::Program;

/// Whatever goes wrong with the torture itself.
pub type Outcome<T> = Result<T, Box<dyn Error>>;

/// Overrides of a short run of `stepping`, for what needs many.
pub const SHORT: [&str; 7] = [
    "--set=collect.strides=[6]",
    "--set=algorithm.evaluation_strides=4",
    "--set=algorithm.evaluation_discard=1",
    "--set=learner.actor_critic.trials=10",
    "--set=record.strides=6",
    "--set=record.iteration_strides=3",
    "--set=record.pose_seconds=0.5",
];

/// What one kind of torture did.
#[derive(Default)]
pub struct Found {
    /// Kills, sizes or files.
    pub done: usize,
    /// Everything that should not have happened, in words.
    pub faults: Vec<String>,
    /// What is worth saying beside that.
    pub remark: String,
}

fn main() -> Outcome<()> {
    let (mut kills, mut seed, mut only, mut bin) = (20_usize, 1_u64, String::new(), None::<PathBuf>);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("{word} needs a value"))?;
        match word.as_str() {
            "--kills" => kills = value.parse()?,
            "--seed" => seed = value.parse()?,
            "--only" => only = value,
            "--bin" => bin = Some(value.into()),
            _ => return Err(format!("{word}: know --kills, --seed, --only, --bin").into()),
        }
    }
    let program = Program::find(bin)?;
    let scratch = tempfile::tempdir()?;
    println!("| torture | done | faults | |\n|---|---:|---:|---|");
    let mut faults = Vec::new();
    let part = |share: usize, of: usize| (kills * share).div_ceil(of);
    type Kind<'a> = (&'a str, usize, &'a dyn Fn(usize, &std::path::Path) -> Outcome<Found>);
    let kinds: [Kind<'_>; 9] = [
        ("stepping", kills, &|n, dir| kills::learn(&program, dir, "stepping", &[], n, seed)),
        ("walking", part(1, 5), &|n, dir| kills::learn(&program, dir, "walking", &kills::WALKING, n, seed)),
        ("birth", part(3, 10), &|n, dir| kills::at_birth(&program, dir, n, seed)),
        ("collect", part(1, 5), &|n, dir| kills::collect(&program, dir, n, seed)),
        ("disk", kills.clamp(1, 12), &|n, dir| full_disk::fill(&program, dir, n)),
        ("tasks", part(10, 1), &|n, dir| mutants::tasks(&program, dir, n, seed)),
        ("tables", part(15, 2), &|n, dir| mutants::tables(&program, dir, n, seed)),
        ("logs", part(5, 2), &|n, dir| mutants::logs(&program, dir, n, seed)),
        ("models", part(1, 1), &|n, dir| mutants::models(&program, dir, n, seed)),
    ];
    for (name, count, torture) in kinds {
        if !only.is_empty() && !only.split(',').any(|o| o == name) {
            continue;
        }
        let dir = scratch.path().join(name);
        std::fs::create_dir(&dir)?;
        let found = torture(count, &dir)?;
        println!("| {name} | {} | {} | {} |", found.done, found.faults.len(), found.remark);
        faults.extend(found.faults.into_iter().map(|fault| format!("{name}: {fault}")));
        std::fs::remove_dir_all(&dir)?;
    }
    for fault in &faults {
        println!("{fault}");
    }
    if faults.is_empty() { Ok(()) } else { Err(format!("{} faults", faults.len()).into()) }
}
