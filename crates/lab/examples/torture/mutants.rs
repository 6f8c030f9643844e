//! Files that somebody damaged: nothing panics or hangs, and a refusal names the file and the place.

use std::path::Path;

use stridemap_mutate::Corpus;

use crate::program::Program;
use crate::{Found, Outcome, SHORT};

/// One mutant after another, put in the place of its file and given to a command. `at`: where a refusal must
/// name it (the mutant's own name without it), `placed`: with its line.
struct Feed<'a> {
    program: &'a Program,
    dir: &'a Path,
    words: &'a [&'a str],
    at: Option<&'a str>,
    placed: bool,
}

impl Feed<'_> {
    fn run(&self, corpus: &Corpus, count: usize, seed: u64) -> Outcome<Found> {
        let mut found = Found::default();
        let mut refused = 0;
        for (name, bytes) in corpus.mutants(seed).take(count) {
            let at = self.at.unwrap_or(&name);
            let path = self.dir.join(at);
            let valid = std::fs::read(&path).ok();
            std::fs::write(&path, &bytes)?;
            let end = self.program.run(self.dir, self.words)?;
            found.done += 1;
            refused += usize::from(end.code == Some(2));
            let has_line = |text: &str| {
                let after = text.split_once(':').map(|(_, after)| after);
                after.is_some_and(|after| after.starts_with(|c: char| c.is_ascii_digit()))
            };
            let after = |what| end.said.split_once(what).map(|(_, after)| after);
            // A file that extends a built-in task may be at odds with a line of that.
            let in_builtin = after("built-in task ").is_some_and(has_line);
            let in_file = end.said.contains(at)
                && (!self.placed || after(at).is_some_and(has_line) || end.said.contains("missing key"));
            let silent = end.code == Some(2) && !in_file && !in_builtin;
            if let Some(fault) = end.fault().or_else(|| silent.then(|| format!("no place: {}", end.said))) {
                let number = found.faults.len();
                let kept = std::env::temp_dir().join(format!("torture-{number}-{}", at.replace('/', "-")));
                std::fs::write(&kept, &bytes)?;
                found.faults.push(format!("{}: {fault}", kept.display()));
            }
            if let Some(valid) = valid {
                std::fs::write(&path, valid)?;
            }
        }
        found.remark = format!("{refused} refused");
        Ok(found)
    }
}

/// A short walk of the nominal gait of `task.toml`.
const WALK: [&str; 5] = ["run", "--nominal", "task.toml", "--seconds", "0.2"];

/// Task files.
pub fn tasks(program: &Program, dir: &Path, count: usize, seed: u64) -> Outcome<Found> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments");
    let at = Some("task.toml");
    let feed = Feed { program, dir, words: &WALK, at, placed: true };
    // Networks of others are not on every machine, and a mutant of their hash is told by the network's file.
    let mut corpus = Corpus::default();
    for (name, bytes) in Corpus::read(&folder)?.files().iter().filter(|(name, _)| !name.contains("velocity")) {
        corpus = corpus.with(name, bytes.clone());
    }
    feed.run(&corpus, count, seed)
}

/// Tables of strides.
pub fn tables(program: &Program, dir: &Path, count: usize, seed: u64) -> Outcome<Found> {
    short_run(program, dir)?;
    let bytes = std::fs::read(dir.join("run/transitions.csv"))?;
    let feed = Feed { program, dir, words: &["fit", "table.csv"], at: None, placed: true };
    feed.run(&Corpus::from([("table.csv", bytes)]), count, seed)
}

/// What a run wrote, read to go on with it and to draw it; and a robot's log.
pub fn logs(program: &Program, dir: &Path, count: usize, seed: u64) -> Outcome<Found> {
    short_run(program, dir)?;
    let mut corpus = Corpus::default();
    for name in [
        "run/transitions.csv",
        "run/record.csv",
        "run/learning.csv",
        "run/events.ndjson",
        "run/checkpoint.json",
        "run/provenance.json",
        "run/config.toml",
        "run/policy/1.json",
        "run/policy/final.json",
        "run/map/1.json",
        "run/summary.json",
    ] {
        corpus = corpus.with(name, std::fs::read(dir.join(name))?);
    }
    let third = count.div_ceil(3);
    let mut found = Found::default();
    let mut add = |more: Found| {
        found.done += more.done;
        found.faults.extend(more.faults);
        found.remark += &format!("{} of {}; ", more.remark, more.done);
    };
    for words in [&["evaluate", "run", "--strides=1"][..], &["report", "run"]] {
        let feed = Feed { program, dir, words, at: None, placed: false };
        add(feed.run(&corpus, third, seed)?);
    }
    let logged = ["collect", "small-stepping", "--robot=op3", "--log", "--out=linked", "--set=collect.strides=[4]"];
    let end = program.run(dir, &logged)?;
    if end.code != Some(0) {
        return Err(format!("a log: {}", end.said).into());
    }
    let log = Corpus::from([("log.mcap", std::fs::read(dir.join("linked/log.mcap"))?)]);
    let words = ["collect", "small-stepping", "--from", "log.mcap"];
    let feed = Feed { program, dir, words: &words, at: None, placed: false };
    add(feed.run(&log, count.saturating_sub(2 * third), seed)?);
    Ok(found)
}

/// Models of robots.
pub fn models(program: &Program, dir: &Path, count: usize, seed: u64) -> Outcome<Found> {
    let task = "extends = \"stepping\"\nname = \"mine\"\nrobot.model = \"robot.xml\"\n";
    std::fs::write(dir.join("task.toml"), task)?;
    let corpus = Corpus::from([("robot.xml", stridemap_mujoco::BIPED_XML.into())]);
    let feed = Feed { program, dir, words: &WALK, at: None, placed: false };
    feed.run(&corpus, count, seed)
}

fn short_run(program: &Program, dir: &Path) -> Outcome<()> {
    let words = [&["learn", "stepping", "--out", "run"][..], &SHORT].concat();
    let end = program.run(dir, &words)?;
    if end.code == Some(0) { Ok(()) } else { Err(format!("a short run: {}", end.said).into()) }
}
