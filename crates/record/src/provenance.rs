//! `provenance.json`: where a run's numbers come from.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::error::RecordError;

/// Where a run's numbers come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of Stridemap.
    pub version: String,
    /// Git revision of its source, where it was built from a checkout; with `-dirty` if that was
    /// changed.
    pub git_revision: Option<String>,
    /// Version of MuJoCo.
    pub mujoco_version: String,
    /// SHA-256 of the robot's model as compiled, with overrides.
    pub model_hash: String,
    /// SHA-256 of `model.mjb`, the run's copy of its model file; null where the model is part of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_copy_sha256: Option<String>,
    /// Root of every random stream.
    pub seed: u64,
    /// Operating system, architecture and number of processors.
    pub machine: String,
    /// The command that repeats the run.
    pub command: String,
    /// When it began.
    pub start: String,
    /// When it ended; null while it runs, or if it was killed.
    pub end: Option<String>,
    /// The task file from which the run was begun, absolute, and what was laid over it; null for a built-in task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<Asked>,
    /// The task with every value; null in runs of earlier versions.
    #[serde(default)]
    pub task: Option<serde_json::Value>,
}

/// A task file and what a command line laid over it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// The task file.
    pub file: PathBuf,
    /// Each `--set`.
    pub sets: Vec<String>,
    /// The value of `--robot`.
    pub robot: Option<String>,
}

impl Provenance {
    /// Says of a run's table that cannot be appended to by which version it was written, and what to do.
    #[must_use]
    pub fn blame(&self, error: RecordError) -> RecordError {
        let RecordError::Content { path, line, problem } = error else {
            return error;
        };
        let built = self.git_revision.as_deref().unwrap_or("unknown revision");
        let problem = format!(
            "{problem}; the run was written by Stridemap {} ({built}), and that version goes on with it; this one \
             reads it (fit, evaluate, report), or starts a run of its own with `stridemap learn` and another --out",
            self.version
        );
        RecordError::content(path, line, problem)
    }

    /// What of `now` differs from this record in a way that makes numbers another run's: model, MuJoCo, program,
    /// seed, values of the task. One sentence each.
    #[must_use]
    pub fn differences(&self, now: &Self) -> Vec<String> {
        let mut found = Vec::new();
        let mut compare = |what: &str, then: &str, now: &str| {
            if then != now {
                found.push(format!("{what} was {then}, is {now} now"));
            }
        };
        compare("Stridemap", &self.version, &now.version);
        compare("the simulator", &self.mujoco_version, &now.mujoco_version);
        compare("the seed", &self.seed.to_string(), &now.seed.to_string());
        compare("the robot's model (SHA-256 as compiled)", &self.model_hash, &now.model_hash);
        if let (Some(then), Some(now)) = (&self.task, &now.task) {
            found.extend(key_differences(then, now));
        }
        found
    }
}

/// The keys in which two tasks differ, with both values. The path of a model file is none of them: files move, and
/// the model's hash is compared.
#[must_use]
pub fn key_differences(then: &serde_json::Value, now: &serde_json::Value) -> Vec<String> {
    let mut found = Vec::new();
    differences_below(then, now, &mut String::new(), &mut found);
    found
}

/// Where a robot is reached is not what it is, and how often it may fall changes no number.
const MAY_DIFFER: [&str; 3] = ["link.domain", "link.interface", "algorithm.falls_at_most"];

fn differences_below(then: &serde_json::Value, now: &serde_json::Value, key: &mut String, found: &mut Vec<String>) {
    use serde_json::Value;
    let mut inner = |name: &str, then: Option<&Value>, now: Option<&Value>| {
        let before = key.len();
        if !key.is_empty() {
            key.push('.');
        }
        key.push_str(name);
        match (then, now) {
            (Some(then), Some(now)) => differences_below(then, now, key, found),
            (then, now) if !MAY_DIFFER.contains(&key.as_str()) => {
                let word = |v: Option<&Value>| v.map_or("left out".into(), Value::to_string);
                found.push(format!("{key} was {}, is {} now", word(then), word(now)));
            }
            _ => {}
        }
        key.truncate(before);
    };
    match (then, now) {
        (Value::Object(a), Value::Object(b)) => {
            let names: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for name in names {
                inner(name, a.get(name), b.get(name));
            }
        }
        (Value::Array(a), Value::Array(b)) if a.iter().chain(b).any(Value::is_object) => {
            for i in 0..a.len().max(b.len()) {
                inner(&i.to_string(), a.get(i), b.get(i));
            }
        }
        (then, now) => {
            let is_file = |v: &Value| v.as_str().is_some_and(|m| m != "biped" && m != "op3");
            let moved = key == "robot.model" && is_file(then) && is_file(now);
            if then != now && !moved && !MAY_DIFFER.contains(&key.as_str()) {
                found.push(format!("{key} was {then}, is {now} now"));
            }
        }
    }
}
