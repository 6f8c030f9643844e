//! The program under torture, and runs compared.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::Outcome;

/// Longer than any command here takes, on a busy machine as well.
const HANGS_AFTER: Duration = Duration::from_secs(120);

/// How a command ended.
pub struct Ended {
    /// Its exit code; `None` if a signal or the torture ended it.
    pub code: Option<i32>,
    /// What it said on stderr.
    pub said: String,
    /// Whether it had to be ended.
    pub hung: bool,
}

impl Ended {
    /// What no command may do, whatever it is given.
    pub fn fault(&self) -> Option<String> {
        if self.hung {
            return Some(format!("hung: {}", self.said));
        }
        let bad = self.said.contains("panicked") || !matches!(self.code, Some(0..=2));
        bad.then(|| format!("exit {:?}: {}", self.code, self.said))
    }
}

/// The program.
pub struct Program(PathBuf);

impl Program {
    /// The binary given, or the one of this build, which is made if need be.
    pub fn find(given: Option<PathBuf>) -> Outcome<Self> {
        if let Some(given) = given {
            return Ok(Self(fs::canonicalize(given)?));
        }
        let example = std::env::current_exe()?;
        let folder = example.ancestors().nth(2).ok_or("no folder of the build")?;
        let mut build = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
        build.args(["build", "--quiet", "-p", "stridemap"]);
        if folder.ends_with("release") {
            build.arg("--release");
        }
        if !build.current_dir(env!("CARGO_MANIFEST_DIR")).status()?.success() {
            return Err("cannot build stridemap".into());
        }
        Ok(Self(folder.join("stridemap")))
    }

    /// A command in a directory; stderr goes into a file there.
    pub fn command<S: AsRef<OsStr>>(&self, dir: &Path, arguments: &[S]) -> Command {
        let mut command = Command::new(&self.0);
        command.args(arguments).current_dir(dir);
        command
    }

    /// Starts a command.
    pub fn start(&self, dir: &Path, arguments: &[&str]) -> Outcome<Child> {
        let mut command = self.command(dir, arguments);
        Ok(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?)
    }

    /// Runs a command to its end.
    pub fn run(&self, dir: &Path, arguments: &[&str]) -> Outcome<Ended> {
        ended(self.start(dir, arguments)?)
    }
}

/// Waits for a command, but not for ever.
pub fn ended(mut child: Child) -> Outcome<Ended> {
    // A pipe that nobody reads would stop it.
    let reader = child.stderr.take().map(|mut pipe| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            let _ = std::io::Read::read_to_end(&mut pipe, &mut bytes);
            String::from_utf8_lossy(&bytes).into_owned()
        })
    });
    let started = Instant::now();
    let mut hung = false;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if started.elapsed() > HANGS_AFTER {
            hung = true;
            child.kill()?;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let said = reader.and_then(|r| r.join().ok()).unwrap_or_default();
    Ok(Ended { code: status.code(), said, hung })
}

/// Every file of a run without what differs between two runs of one command: times.
fn contents(run: &Path) -> Outcome<BTreeMap<String, Vec<u8>>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![run.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(run)?.to_string_lossy().into_owned();
            let bytes = fs::read(&path)?;
            files.insert(name.clone(), timeless(&name, bytes)?);
        }
    }
    Ok(files)
}

fn timeless(name: &str, bytes: Vec<u8>) -> Outcome<Vec<u8>> {
    let times: &[&str] = match name {
        "summary.json" | "checkpoint.json" => &["seconds"],
        "provenance.json" => &["start", "end"],
        "events.ndjson" => {
            // What happened when is not the same; that every line can be read is.
            for line in String::from_utf8(bytes)?.lines() {
                serde_json::from_str::<serde_json::Value>(line)?;
            }
            return Ok(Vec::new());
        }
        "report.html" => return Ok(page(&String::from_utf8(bytes)?)),
        _ => return Ok(bytes),
    };
    let mut value: serde_json::Value = serde_json::from_slice(&bytes)?;
    if let Some(object) = value.as_object_mut() {
        times.iter().for_each(|key| drop(object.remove(*key)));
    }
    Ok(value.to_string().into_bytes())
}

/// A page without its lines that tell times of the clock and name the directory.
fn page(text: &str) -> Vec<u8> {
    let timeless = |line: &&str| !["seconds", "started", "ended", " s:", "Time"].iter().any(|w| line.contains(w));
    text.lines().filter(timeless).collect::<Vec<_>>().join("\n").into_bytes()
}

/// What differs between two runs, file by file.
pub fn differences(run: &Path, whole: &Path) -> Outcome<Vec<String>> {
    let (mut run, whole) = (contents(run)?, contents(whole)?);
    let mut found = Vec::new();
    for (name, bytes) in whole {
        match run.remove(&name) {
            None => found.push(format!("{name} is missing")),
            Some(other) if other != bytes => {
                let line = other.split(|b| *b == b'\n').zip(bytes.split(|b| *b == b'\n')).position(|(a, b)| a != b);
                found.push(format!("{name} differs in line {:?}", line.map(|l| l + 1)));
            }
            Some(_) => {}
        }
    }
    found.extend(run.into_keys().map(|name| format!("{name} is one too many")));
    Ok(found)
}

/// Strides of a run that its checkpoint counts.
pub fn strides(run: &Path) -> usize {
    let read = || -> Option<u64> {
        let text = fs::read_to_string(run.join("checkpoint.json")).ok()?;
        serde_json::from_str::<serde_json::Value>(&text).ok()?["transition_rows"].as_u64()
    };
    read().unwrap_or(0) as usize
}
