//! Kills at random times, second commands thrown in, and every file compared in the end.

use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::program::{Program, differences, ended, strides};
use crate::{Found, Outcome, SHORT};

/// Overrides of a small run of `walking`.
pub const WALKING: [&str; 5] = [
    "--set=collect.strides=[40, 0]",
    "--set=algorithm.strides_at_most=110",
    "--set=learner.search.generations=10",
    "--set=record.walk_s=12",
    "--set=record.pose_seconds=0.5",
];
/// Kills of one run, at most; then it goes on to its end.
const KILLS_A_RUN: usize = 8;

/// What was lost on the way to the end of runs.
#[derive(Default)]
struct Tally {
    kills: usize,
    runs: usize,
    refused_on_live_runs: usize,
    strides_lost: usize,
    faults: Vec<String>,
}

impl Tally {
    fn found(self) -> Found {
        Found {
            done: self.kills,
            remark: format!(
                "{} runs; strides lost {}; second commands refused on a live run {}",
                self.runs, self.strides_lost, self.refused_on_live_runs
            ),
            faults: self.faults,
        }
    }

    /// Waits, and kills what still lives; returns whether it ended by itself.
    fn kill(&mut self, mut child: Child, after: Duration) -> Outcome<bool> {
        let started = Instant::now();
        while started.elapsed() < after {
            if child.try_wait()?.is_some() {
                let end = ended(child)?;
                if end.code != Some(0) {
                    self.faults.push(format!("refused or failed: {:?} {}", end.code, end.said));
                }
                return Ok(true);
            }
            std::thread::sleep(Duration::from_micros(500));
        }
        child.kill()?;
        child.wait()?;
        self.kills += 1;
        Ok(false)
    }

    /// Throws a second command at a run, which lives or not.
    fn throw(&mut self, program: &Program, dir: &Path, rng: &mut ChaCha8Rng, live: Option<u32>) -> Outcome<()> {
        let words: &[&str] = [
            &["improve", "run"][..],
            &["collect", "run"],
            &["learn", "--resume", "run"],
            &["report", "run"],
            &["evaluate", "run", "--strides=1"],
        ]
        .choose(rng)
        .copied()
        .unwrap_or(&["report", "run"]);
        let writes = matches!(words[0], "improve" | "collect" | "learn");
        let end = match live {
            None if writes && rng.random_bool(0.5) => {
                let after = Duration::from_millis(rng.random_range(0..500));
                let mut child = program.start(dir, words)?;
                std::thread::sleep(after);
                child.kill()?;
                child.wait()?;
                return Ok(());
            }
            _ => program.run(dir, words)?,
        };
        self.faults.extend(end.fault().map(|fault| format!("{words:?}: {fault}")));
        if let (Some(pid), true) = (live, writes) {
            let named = end.said.contains(&format!("process {pid}"));
            // It may have ended meanwhile, or not have begun.
            if named && end.code == Some(2) {
                self.refused_on_live_runs += 1;
            }
        }
        Ok(())
    }

    fn keep(&mut self, dir: &Path, before: usize, when: &str) -> usize {
        let now = strides(&dir.join("run"));
        if now < before {
            self.strides_lost += before - now;
            self.faults.push(format!("{when}: {} strides lost", before - now));
        }
        now
    }
}

/// Kills `learn` until it was killed so often; second commands are thrown at dead and live runs.
pub fn learn(program: &Program, dir: &Path, task: &str, sets: &[&str], kills: usize, seed: u64) -> Outcome<Found> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let begin = [&["learn", task, "--out", "run"][..], sets].concat();
    let whole = dir.join("whole");
    let began = Instant::now();
    unbroken(program, &whole, &[&begin])?;
    let whole_ms = began.elapsed().as_millis() as u64;
    let mut tally = Tally::default();
    while tally.kills < kills {
        let own = dir.join(format!("{}", tally.runs));
        std::fs::create_dir(&own)?;
        tally.runs += 1;
        let (mut made, mut killed) = (0, 0);
        loop {
            let resumes = own.join("run").exists();
            let words = if resumes { &["learn", "--resume", "run"][..] } else { &begin };
            let child = program.start(&own, words)?;
            if killed == KILLS_A_RUN || tally.kills == kills {
                let end = ended(child)?;
                if end.code != Some(0) {
                    tally.faults.push(format!("refused or failed: {:?} {}", end.code, end.said));
                }
                break;
            }
            let mut after = Duration::from_millis(rng.random_range(0..whole_ms));
            if rng.random_bool(0.3) {
                std::thread::sleep(after / 2);
                after /= 2;
                tally.throw(program, &own, &mut rng, Some(child.id()))?;
            }
            if tally.kill(child, after)? {
                break;
            }
            killed += 1;
            made = tally.keep(&own, made, "after a kill");
            if resumes && rng.random_bool(0.3) {
                tally.throw(program, &own, &mut rng, None)?;
                made = tally.keep(&own, made, "after a second command");
            }
        }
        compare(&mut tally, &own, &whole)?;
    }
    Ok(tally.found())
}

/// Kills within 15 ms of the first sign of a run on the disk; the same command, or `--resume`, makes the run.
pub fn at_birth(program: &Program, dir: &Path, kills: usize, seed: u64) -> Outcome<Found> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let begin = [&["learn", "stepping", "--out", "run"][..], &SHORT].concat();
    let whole = dir.join("whole");
    unbroken(program, &whole, &[&begin])?;
    let mut tally = Tally::default();
    while tally.kills < kills {
        let own = dir.join(format!("{}", tally.runs));
        std::fs::create_dir(&own)?;
        tally.runs += 1;
        if rng.random_bool(0.2) {
            std::fs::create_dir(own.join("run"))?; // A place that is there is filled, not made.
        }
        for _ in 0..rng.random_range(1..4) {
            let signs = std::fs::read_dir(&own)?.count();
            let child = program.start(&own, &begin)?;
            while signs == 0 && std::fs::read_dir(&own)?.next().is_none() {
                std::thread::yield_now();
            }
            let after = match signs {
                0 => Duration::from_micros(rng.random_range(0..15_000)),
                _ => Duration::from_millis(rng.random_range(0..100)),
            };
            if tally.kill(child, after)? || strides(&own.join("run")) > 0 {
                break;
            }
        }
        let run = own.join("run");
        let has_run = run.join("config.toml").exists();
        let words = if has_run { &["learn", "--resume", "run"][..] } else { &begin };
        let end = program.run(&own, words)?;
        if end.code != Some(0) {
            tally.faults.push(format!("{words:?} refused: {}", end.said));
            continue;
        }
        compare(&mut tally, &own, &whole)?;
    }
    Ok(tally.found())
}

/// Kills `collect` and `improve`, and goes on with them, one verb after another; `learn --resume` ends the run.
pub fn collect(program: &Program, dir: &Path, kills: usize, seed: u64) -> Outcome<Found> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let begin = ["collect", "stepping", "--out", "run", "--set=collect.strides=[60]"];
    let (next, improve) = (&["collect", "run"][..], &["improve", "run"][..]);
    let verbs: [&[&str]; 5] = [&begin, improve, next, improve, &["learn", "--resume", "run"]];
    let whole = dir.join("whole");
    let began = Instant::now();
    unbroken(program, &whole, &verbs)?;
    let verb_ms = began.elapsed().as_millis() as u64 / verbs.len() as u64;
    let mut tally = Tally::default();
    while tally.kills < kills {
        let own = dir.join(format!("{}", tally.runs));
        std::fs::create_dir(&own)?;
        tally.runs += 1;
        let (run, mut made) = (own.join("run"), 0);
        for (i, verb) in verbs.into_iter().enumerate() {
            let mut killed = 0;
            // Killed after its work was done, a verb is not said again.
            while i + 1 == verbs.len() || phases(&run) <= i as u64 {
                let words = if verb[0] == "collect" && run.exists() { next } else { verb };
                let child = program.start(&own, words)?;
                let after = if tally.kills < kills && killed < 3 {
                    Duration::from_millis(rng.random_range(0..verb_ms))
                } else {
                    Duration::MAX
                };
                let by_itself = tally.kill(child, after)?;
                made = tally.keep(&own, made, "after a kill");
                if by_itself {
                    break;
                }
                killed += 1;
            }
        }
        compare(&mut tally, &own, &whole)?;
    }
    Ok(tally.found())
}

/// Batches and policies of a run so far.
fn phases(run: &Path) -> u64 {
    let read = || -> Option<u64> {
        let text = std::fs::read_to_string(run.join("checkpoint.json")).ok()?;
        let value: serde_json::Value = serde_json::from_str(&text).ok()?;
        Some(value["iterations"].as_array()?.len() as u64 + value["policies"].as_u64()?)
    };
    read().unwrap_or(0)
}

/// Makes a run that nothing disturbs.
fn unbroken(program: &Program, whole: &Path, commands: &[&[&str]]) -> Outcome<()> {
    std::fs::create_dir(whole)?;
    for words in commands {
        let end = program.run(whole, words)?;
        if end.code != Some(0) {
            return Err(format!("{words:?}: {}", end.said).into());
        }
    }
    Ok(())
}

fn compare(tally: &mut Tally, own: &Path, whole: &Path) -> Outcome<()> {
    let found = differences(&own.join("run"), &whole.join("run"))?;
    tally.faults.extend(found.iter().map(|d| format!("run {}: {d}", tally.runs)));
    if found.is_empty() {
        std::fs::remove_dir_all(own)?;
    }
    Ok(())
}
