//! What a user sees, word for word; then properties over random documents.

mod layers;
mod messages;
mod properties;
mod round_trip;

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{ConfigError, Document, ResolveError, TaskText};

/// A configuration with one field of every shape that a task file uses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Task {
    robot: Robot,
    map: Map,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    action: Vec<Action>,
    #[serde(default)]
    strides: u32,
    seed: Option<u64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Robot {
    friction: f64,
    #[serde(default = "one")]
    mass_scale: f64,
    model: Option<PathBuf>,
    #[serde(default)]
    rest_deg: BTreeMap<Joint, f64>,
    #[serde(default)]
    mirrored: bool,
}

fn one() -> f64 {
    1.0
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Joint {
    HipPitch,
    Knee,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Map {
    Gp {
        #[serde(default)]
        sample: Sample,
        samples: u8,
    },
    Linear(Linear),
    Scaled(f64),
    Pair(f64, f64),
    Exact,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Linear {
    ridge: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Sample {
    #[default]
    Full,
    Latent,
    Mean,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Action {
    modulates: String,
    bounds: [f64; 2],
}

const GOOD: &str = r#"
strides = 60

[robot]
friction = 0.7
mass_scale = 1
rest_deg = { hip_pitch = 15, knee = -30.5 }

[map]
kind = "gp"
sample = "latent"
samples = 60

[[action]]
modulates = "walk_amplitude_deg"
bounds = [0, 12]

[[action]]
modulates = "phase_rad"
bounds = [-1.0, 1.0]
"#;

/// The task with one line, given by its start, replaced.
fn with(line: &str, by: &str) -> Result<Task, ConfigError> {
    let mut lines: Vec<&str> = GOOD.lines().collect();
    let at = lines.iter().position(|l| l.starts_with(line)).unwrap();
    lines[at] = by;
    Document::parse("my-robot.toml", &lines.join("\n"))?.deserialize()
}

fn message<T: std::fmt::Debug>(result: Result<T, ConfigError>) -> String {
    result.unwrap_err().to_string()
}

/// A resolver over texts in one directory.
fn files<'t>(
    files: &'t [(&'t str, &'t str)],
) -> impl FnMut(&str, Option<&std::path::Path>) -> Result<TaskText, ResolveError> + 't {
    move |name, _| {
        let (name, text) =
            files
                .iter()
                .find(|(file, _)| *file == name)
                .ok_or(ResolveError::Unknown {
                    built_in: files.iter().map(|(name, _)| (*name).to_owned()).collect(),
                })?;
        Ok(TaskText {
            source_name: (*name).to_owned(),
            text: (*text).to_owned(),
            base_dir: Some(PathBuf::from(format!("dir-of-{name}"))),
        })
    }
}

fn sets(arguments: &[&str]) -> Vec<String> {
    arguments.iter().map(|text| (*text).to_owned()).collect()
}
