//! A run directory, read as far as it goes.

mod formats;
mod table;

use std::fs;
use std::path::{Path, PathBuf};

pub use formats::{
    Columns, Fall, Frame, IterationSummary, LearningRow, LeaveOneOut, MapCard, MapOutput, Measured,
    Pose, Proof, Provenance, PushSummary, Recording, Region, ReturnLine, RobotFall, Seconds, Shape,
    ShapeKind, StrideCounts, StrideEnd, StrideRow, Summary, Warning,
};
use serde::de::DeserializeOwned;
use table::Table;

use crate::error::{ReportError, Result};
use crate::figures::{LineGrid, LineOutput, MapGrid, PolicyGrid, ReturnPair};

/// Everything that a report shows of a run. What is missing is `None` or empty, and named in
/// [`missing`](Run::missing); what cannot be read is named in [`problems`](Run::problems).
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Where it lies.
    pub dir: PathBuf,
    /// Name of the directory.
    pub name: String,
    /// `config.toml` as it stands.
    pub config: Option<String>,
    /// `provenance.json`.
    pub provenance: Option<Provenance>,
    /// `summary.json`.
    pub summary: Option<Summary>,
    /// `columns.json`.
    pub columns: Columns,
    /// `transitions.csv`.
    pub transitions: Vec<StrideRow>,
    /// `record.csv`.
    pub record: Vec<StrideRow>,
    /// `learning.csv`.
    pub learning: Vec<LearningRow>,
    /// `map/<iteration>.json`, ascending.
    pub maps: Vec<MapCard>,
    /// `figures/data/policy-<iteration>.csv`, ascending.
    pub policies: Vec<(u32, PolicyGrid)>,
    /// `figures/data/map-<iteration>.csv`, ascending.
    pub grids: Vec<(u32, MapGrid)>,
    /// `figures/data/lines-<iteration>.csv`, ascending.
    pub lines: Vec<(u32, LineGrid)>,
    /// `poses/<what>.json`: nominal, iterations, final, and under pushes.
    pub recordings: Vec<(String, Recording)>,
    /// `lapse/<what>.json`: a picture now and then for a minute, nominal first, final last.
    pub lapses: Vec<(String, Recording)>,
    /// `push.csv` with `push.json`: the learned policy under pushes.
    pub push: Option<Pushed>,
    /// `push-nominal.csv` with `push-nominal.json`: the nominal gait under the same pushes.
    pub push_nominal: Option<Pushed>,
    /// Why the run stopped before its end, and when, as `events.ndjson` says; `None` if it does not.
    pub stopped: Option<Stop>,
    /// Files that are not there.
    pub missing: Vec<String>,
    /// Files that are there and cannot be read, and why.
    pub problems: Vec<String>,
}

/// What pushes showed.
#[derive(Clone, Debug, Default)]
pub struct Pushed {
    /// Pairs of states two strides apart.
    pub pairs: Vec<ReturnPair>,
    /// The same pushes one stride apart: the state at section k + 1 of each pair, degrees; empty if unknown.
    pub after_1_deg: Vec<f64>,
    /// Lines, falls, setting.
    pub summary: PushSummary,
}

/// Why a run stopped before its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stop {
    /// Wall-clock time (RFC 3339).
    pub time: String,
    /// In the words of the command that stopped.
    pub reason: String,
}

/// The reason in the last `stopped` of a run's events, unless the run went on or ended after it. Lines that
/// cannot be read are passed over: a run may have been killed while it wrote one.
fn stopped(events: &[u8]) -> Option<Stop> {
    let mut stop = None;
    for line in String::from_utf8_lossy(events).lines() {
        let Ok(event) = serde_json::from_str::<serde_json::Value>(line) else {
            continue;
        };
        let word = |key: &str| event.get(key).and_then(serde_json::Value::as_str);
        match (word("event"), word("reason")) {
            (Some("stopped"), Some(reason)) => {
                stop = Some(Stop {
                    time: word("time").unwrap_or_default().to_owned(),
                    reason: reason.to_owned(),
                });
            }
            (Some("resumed" | "end"), _) => stop = None,
            _ => {}
        }
    }
    stop
}

impl Run {
    /// Reads a run directory. Only a directory that is none is an error: a run may have been killed
    /// half-way, and the report of it says what is there.
    ///
    /// # Errors
    ///
    /// [`ReportError::Io`] if the directory cannot be read.
    pub fn read(dir: &Path) -> Result<Run> {
        fs::read_dir(dir).map_err(|source| ReportError::Io {
            path: dir.to_owned(),
            source,
        })?;
        let name = dir
            .canonicalize()
            .ok()
            .and_then(|d| d.file_name().map(|n| n.to_string_lossy().into_owned()))
            .unwrap_or_else(|| dir.display().to_string());
        let mut run = Run {
            dir: dir.to_owned(),
            name,
            ..Run::default()
        };
        run.config = run.text("config.toml");
        run.provenance = run.json("provenance.json");
        run.summary = run.json("summary.json");
        run.columns = run.json("columns.json").unwrap_or_default();
        let columns = run.columns.clone();
        run.transitions = run
            .csv("transitions.csv", |t| strides(t, &columns))
            .unwrap_or_default();
        run.record = run
            .csv("record.csv", |t| strides(t, &columns))
            .unwrap_or_default();
        run.count_strides();
        // A policy that was rejected as final was measured before the one that is.
        let begins = |s: &StrideRow| s.what == "final" && (s.episode, s.k) == (0, 0);
        if let Some(last) = run.record.iter().rposition(begins) {
            let mut row = 0;
            run.record.retain(|s| {
                row += 1;
                s.what != "final" || row > last
            });
        }
        run.learning = run.csv("learning.csv", learning).unwrap_or_default();
        run.read_iterations(&columns);
        run.recordings = run.read_poses("poses");
        if run.recordings.is_empty() {
            run.missing.push("poses/".to_owned());
        }
        run.lapses = run.read_poses("lapse"); // Runs of earlier versions have none.
        run.stopped = fs::read(run.dir.join("events.ndjson"))
            .ok()
            .and_then(|events| stopped(&events));
        if run.dir.join("push.csv").exists() {
            run.push = run.read_push("push");
        }
        if run.dir.join("push-nominal.csv").exists() {
            run.push_nominal = run.read_push("push-nominal");
        }
        Ok(run)
    }

    /// The desired roll of the pendulum, degrees, if the task names one.
    #[must_use]
    pub fn target_deg(&self) -> Option<f64> {
        let table: toml::Table = self.config.as_deref()?.parse().ok()?;
        let number = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
        table.get("reward")?.as_array()?.iter().find_map(|r| {
            let quantity = r.get("quantity")?.as_str()?;
            quantity
                .starts_with("psi_roll")
                .then(|| r.get("target_deg").and_then(number))?
        })
    }

    /// How many first strides of a measured policy are not averaged, if the task says so.
    #[must_use]
    pub fn record_discard(&self) -> Option<usize> {
        let table: toml::Table = self.config.as_deref()?.parse().ok()?;
        let discard = table.get("record")?.get("discard")?.as_integer()?;
        usize::try_from(discard).ok()
    }

    /// The training strides that the map of an iteration was fitted to: those made before it. (An iteration's
    /// policy is tried after that; its strides train the next map.)
    pub fn map_strides(&self, iteration: u32) -> impl Iterator<Item = &StrideRow> {
        self.transitions.iter().filter(move |s| {
            let before = s.iteration < iteration || s.phase != "evaluate";
            s.role == "training" && s.iteration <= iteration && before
        })
    }

    /// The speed of a measured policy as the run recorded it: of `nominal`, `iteration-1`, ..., `final`.
    #[must_use]
    pub fn speed_m_s(&self, what: &str) -> Option<f64> {
        let summary = self.summary.as_ref()?;
        match what {
            "nominal" => summary.nominal?.speed_m_s,
            "final" => summary.final_policy?.speed_m_s,
            other => {
                let number: u32 = other.strip_prefix("iteration-")?.parse().ok()?;
                let iterations = &summary.iterations;
                iterations.iter().find(|i| i.iteration == number)?.speed_m_s
            }
        }
    }

    /// The quantity that the task rewards, if it is a single one rewarded as it is: `speed_m_s`.
    #[must_use]
    pub fn reward_quantity(&self) -> Option<String> {
        let table: toml::Table = self.config.as_deref()?.parse().ok()?;
        let number = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
        let [only] = table.get("reward")?.as_array()?.as_slice() else {
            return None;
        };
        let weight = only.get("weight").and_then(number)?;
        let quantity = only.get("quantity")?.as_str()?;
        ((weight - 1.0).abs() < 1e-12 && !quantity.ends_with("_error")).then(|| quantity.to_owned())
    }

    /// Whether the run reached its end.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.summary
            .as_ref()
            .is_some_and(|s| s.final_policy.is_some())
    }

    /// Falls and stalls on the robot in the budget (training and evaluation).
    #[must_use]
    pub fn falls(&self) -> (usize, usize) {
        let count = |end| self.transitions.iter().filter(|t| t.end == end).count();
        (count(StrideEnd::Fell), count(StrideEnd::NoCrossing))
    }

    /// A run that was broken off is counted by its tables: its summary is older than they, or was never written.
    fn count_strides(&mut self) {
        if self.finished() || self.transitions.is_empty() && self.record.is_empty() {
            return;
        }
        let role = |role: &str| {
            let made = self.transitions.iter().chain(&self.record);
            let made = made.filter(|t| t.end != StrideEnd::Aborted && t.role == role);
            made.count() as u64
        };
        let [training, evaluation, record] = ["training", "evaluation", "record"].map(role);
        let strides = &mut self.summary.get_or_insert_default().strides;
        (strides.training, strides.evaluation, strides.record) = (training, evaluation, record);
    }

    fn text(&mut self, file: &str) -> Option<String> {
        let text = String::from_utf8(self.bytes(file)?);
        text.map_err(|e| self.problems.push(format!("{file}: {}", e.utf8_error())))
            .ok()
    }

    /// A log of lines, of which one that is no text costs no other: it is named, and left blank.
    fn lines(&mut self, file: &str) -> Option<String> {
        let bytes = self.bytes(file)?;
        let mut text = String::with_capacity(bytes.len());
        for (at, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
            match std::str::from_utf8(line) {
                Ok(line) => text.push_str(line),
                Err(_) => {
                    let problem = format!("{file}, line {}: is no text and is left out", at + 1);
                    self.problems.push(problem);
                    text.push('\n');
                }
            }
        }
        Some(text)
    }

    fn bytes(&mut self, file: &str) -> Option<Vec<u8>> {
        match fs::read(self.dir.join(file)) {
            Ok(bytes) => Some(bytes),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                self.missing.push(file.to_owned());
                None
            }
            Err(e) => {
                self.problems.push(format!("{file}: {e}"));
                None
            }
        }
    }

    fn json<T: DeserializeOwned>(&mut self, file: &str) -> Option<T> {
        let text = self.text(file)?;
        match serde_json::from_str(&text) {
            Ok(value) => Some(value),
            Err(e) => {
                self.problems.push(format!("{file}: {e}"));
                None
            }
        }
    }

    fn csv<T>(&mut self, file: &str, read: impl Fn(&Table) -> Result<T>) -> Option<T> {
        let text = self.lines(file)?;
        let table = Table::parse(Path::new(file), &text);
        match table.and_then(|t| Ok((t.torn, read(&t)?))) {
            Ok((torn, value)) => {
                if torn {
                    self.problems
                        .push(format!("{file}: the last line was cut off and is left out"));
                }
                Some(value)
            }
            Err(e) => {
                self.problems.push(e.to_string());
                None
            }
        }
    }

    fn read_iterations(&mut self, columns: &Columns) {
        for iteration in numbered(&self.dir.join("map"), "", ".json") {
            if let Some(map) = self.json(&format!("map/{iteration}.json")) {
                self.maps.push(map);
            }
        }
        if self.maps.is_empty() {
            self.missing.push("map/".to_owned());
        }
        let data = self.dir.join("figures/data");
        for iteration in numbered(&data, "policy-", ".csv") {
            let file = format!("figures/data/policy-{iteration}.csv");
            let Some(mut grid) = self.csv(&file, |t| policy_grid(t, columns)) else {
                continue;
            };
            let policy = self.dir.join(format!("policy/{iteration}.json"));
            if let Ok(text) = fs::read_to_string(policy) {
                grid.centres = centres(&text, columns.state.len());
            }
            self.policies.push((iteration, grid));
        }
        if self.policies.is_empty() {
            self.missing.push("figures/data/policy-*.csv".to_owned());
        }
        for iteration in numbered(&data, "map-", ".csv") {
            let file = format!("figures/data/map-{iteration}.csv");
            if let Some(grid) = self.csv(&file, |t| map_grid(t, columns)) {
                self.grids.push((iteration, grid));
            }
        }
        if self.grids.is_empty() {
            self.missing.push("figures/data/map-*.csv".to_owned());
        }
        for iteration in numbered(&data, "lines-", ".csv") {
            let file = format!("figures/data/lines-{iteration}.csv");
            if let Some(grid) = self.csv(&file, |t| line_grid(t, columns)) {
                self.lines.push((iteration, grid));
            }
        }
    }

    fn read_poses(&mut self, folder: &str) -> Vec<(String, Recording)> {
        let mut names: Vec<String> = fs::read_dir(self.dir.join(folder))
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|e| {
                e.file_name()
                    .to_str()?
                    .strip_suffix(".json")
                    .map(str::to_owned)
            })
            .collect();
        let rank = |n: &str| match n {
            "nominal" => (0, 0),
            "final" => (2, 0),
            "push-nominal" => (3, 0),
            "push" => (4, 0),
            other => (
                1,
                other
                    .trim_start_matches("iteration-")
                    .parse()
                    .unwrap_or(u32::MAX),
            ),
        };
        names.sort_by(|a, b| rank(a).cmp(&rank(b)).then_with(|| a.cmp(b)));
        let mut recordings = Vec::new();
        for name in names {
            let file = format!("{folder}/{name}.json");
            let Some(recording) = self.json::<Recording>(&file) else {
                continue;
            };
            match broken(&recording) {
                Some(problem) => self.problems.push(format!("{file}: {problem}")),
                None => recordings.push((name, recording)),
            }
        }
        recordings
    }

    fn read_push(&mut self, stem: &str) -> Option<Pushed> {
        let (pairs, after_1_deg) = self.csv(&format!("{stem}.csv"), |t| {
            let (a, b) = (
                t.numbers("psi_roll_deg")?,
                t.numbers("psi_roll_after_2_deg")?,
            );
            let force = t.numbers("force_n")?;
            let pairs = a
                .into_iter()
                .zip(b)
                .zip(force)
                .map(|((a, b), f)| ReturnPair {
                    psi_roll_deg: a,
                    psi_roll_after_2_deg: b,
                    force_n: f.is_finite().then_some(f),
                });
            // Runs of an earlier version have no such column.
            let after_1 = t.find("psi_roll_after_1_deg");
            let after_1 = after_1.map(|_| t.numbers("psi_roll_after_1_deg"));
            Ok((
                pairs.collect::<Vec<_>>(),
                after_1.transpose()?.unwrap_or_default(),
            ))
        })?;
        Some(Pushed {
            pairs,
            after_1_deg,
            summary: self.json(&format!("{stem}.json"))?,
        })
    }
}

/// Why a recording cannot be shown, if so.
fn broken(r: &Recording) -> Option<String> {
    let bodies = r.frames.first()?.poses.len();
    if let Some(i) = r.frames.iter().position(|f| f.poses.len() != bodies) {
        return Some(format!(
            "frame {i} has {} bodies, the first {bodies}",
            r.frames[i].poses.len()
        ));
    }
    if let Some(s) = r.shapes.iter().find(|s| s.body >= bodies) {
        return Some(format!("a shape on body {} of {bodies}", s.body));
    }
    let finite = r
        .frames
        .iter()
        .flat_map(|f| f.poses.iter().flatten())
        .all(|v| v.is_finite());
    (!finite).then(|| "a pose that is not finite".to_owned())
}

/// The numbers `n` of the files `<prefix>n<suffix>` of a directory, ascending.
fn numbered(dir: &Path, prefix: &str, suffix: &str) -> Vec<u32> {
    let mut numbers: Vec<u32> = fs::read_dir(dir)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|e| {
            e.file_name()
                .to_str()?
                .strip_prefix(prefix)?
                .strip_suffix(suffix)?
                .parse()
                .ok()
        })
        .collect();
    numbers.sort_unstable();
    numbers
}

fn strides(t: &Table, columns: &Columns) -> Result<Vec<StrideRow>> {
    let all = |prefix: &str, names: &[String]| -> Result<Vec<usize>> {
        names
            .iter()
            .map(|n| t.column(&format!("{prefix}{n}")))
            .collect()
    };
    let state = all("", &columns.state)?;
    let action = all("", &columns.action)?;
    let next = all("next_", &columns.state)?;
    let (iteration, role, episode, k) = (
        t.column("iteration")?,
        t.column("role")?,
        t.column("episode")?,
        t.column("k")?,
    );
    let (time, stance, reward, end) = (
        t.column("time_s")?,
        t.find("stance"),
        t.column("reward")?,
        t.column("end")?,
    );
    let (what, phase) = (t.find("what"), t.find("phase"));
    let fall_columns = t
        .find("fall_criterion")
        .zip(t.find("fall_value"))
        .zip(t.find("fall_threshold"));
    let fall = |row: usize| -> Result<Option<Fall>> {
        match fall_columns {
            Some(((criterion, value), threshold)) if !t.word(row, criterion).is_empty() => {
                Ok(Some(Fall {
                    criterion: t.word(row, criterion).to_owned(),
                    value: t.number(row, value)?,
                    threshold: t.number(row, threshold)?,
                }))
            }
            _ => Ok(None),
        }
    };
    let numbers = |row: usize, at: &[usize]| -> Result<Vec<f64>> {
        at.iter().map(|c| t.number(row, *c)).collect()
    };
    (0..t.rows.len())
        .map(|row| {
            Ok(StrideRow {
                what: what.map_or_else(String::new, |c| t.word(row, c).to_owned()),
                iteration: t.count(row, iteration)? as u32,
                phase: phase.map_or_else(String::new, |c| t.word(row, c).to_owned()),
                role: t.word(row, role).to_owned(),
                episode: t.count(row, episode)?,
                k: t.count(row, k)?,
                time_s: t.number(row, time)?,
                stance: stance.map_or_else(String::new, |c| t.word(row, c).to_owned()),
                state: numbers(row, &state)?,
                action: numbers(row, &action)?,
                next_state: numbers(row, &next)?,
                reward: t.number(row, reward)?,
                end: t.parsed(
                    row,
                    end,
                    "crossing, fell, no_crossing or aborted",
                    |w| match w {
                        "crossing" => Some(StrideEnd::Crossing),
                        "fell" => Some(StrideEnd::Fell),
                        "no_crossing" => Some(StrideEnd::NoCrossing),
                        "aborted" => Some(StrideEnd::Aborted),
                        _ => None,
                    },
                )?,
                fall: fall(row)?,
            })
        })
        .collect()
}

fn learning(t: &Table) -> Result<Vec<LearningRow>> {
    let (iteration, trial, world) = (
        t.column("iteration")?,
        t.column("trial")?,
        t.column("world")?,
    );
    let (reward, falls, strides) = (
        t.column("average_reward")?,
        t.column("falls")?,
        t.column("strides")?,
    );
    (0..t.rows.len())
        .map(|row| {
            Ok(LearningRow {
                iteration: t.count(row, iteration)? as u32,
                trial: t.count(row, trial)? as u32,
                world: t.word(row, world).to_owned(),
                average_reward: t.number(row, reward)?,
                falls: t.count(row, falls)? as u32,
                strides: t.count(row, strides)? as u32,
            })
        })
        .collect()
}

fn policy_grid(t: &Table, columns: &Columns) -> Result<PolicyGrid> {
    let per = |prefix: &str, names: &[String]| -> Result<Vec<Vec<f64>>> {
        names
            .iter()
            .map(|n| t.numbers(&format!("{prefix}{n}")))
            .collect()
    };
    Ok(PolicyGrid {
        along: match t.find("along") {
            Some(c) => (0..t.rows.len())
                .map(|r| Ok(t.count(r, c)? as usize))
                .collect::<Result<_>>()?,
            None => vec![0; t.rows.len()],
        },
        state: per("", &columns.state)?,
        mean: per("mean_", &columns.action)?,
        std: per("std_", &columns.action)?,
        value: t.find("value").map(|_| t.numbers("value")).transpose()?,
        centres: Vec::new(),
    })
}

fn map_grid(t: &Table, columns: &Columns) -> Result<MapGrid> {
    let per = |prefix: &str, names: &[String]| -> Result<Vec<Vec<f64>>> {
        names
            .iter()
            .map(|n| t.numbers(&format!("{prefix}{n}")))
            .collect()
    };
    let axis = |name: &str| -> Result<Vec<usize>> {
        match t.find(name) {
            Some(c) => (0..t.rows.len())
                .map(|r| Ok(t.count(r, c)? as usize))
                .collect(),
            None => Ok(vec![0; t.rows.len()]),
        }
    };
    Ok(MapGrid {
        state_axis: axis("state_axis")?,
        action_axis: axis("action_axis")?,
        state: per("", &columns.state)?,
        action: per("", &columns.action)?,
        mean: per("mean_", &columns.state)?,
        latent_std: per("latent_std_", &columns.state)?,
        noise_std: per("noise_std_", &columns.state)?,
    })
}

fn line_grid(t: &Table, columns: &Columns) -> Result<LineGrid> {
    let along = t.column("along")?;
    let outputs = t.header.iter().filter_map(|h| h.strip_prefix("mean_"));
    Ok(LineGrid {
        along: (0..t.rows.len())
            .map(|r| Ok(t.count(r, along)? as usize))
            .collect::<Result<_>>()?,
        inputs: columns
            .state
            .iter()
            .chain(&columns.action)
            .map(|name| t.numbers(name))
            .collect::<Result<_>>()?,
        outputs: outputs
            .map(|name| {
                Ok(LineOutput {
                    name: name.to_owned(),
                    mean: t.numbers(&format!("mean_{name}"))?,
                    latent_std: t.numbers(&format!("latent_std_{name}"))?,
                    noise_std: t.numbers(&format!("noise_std_{name}"))?,
                })
            })
            .collect::<Result<_>>()?,
    })
}

/// Centres of a policy's bases: the first `centres` in the file, flat or one array per base.
fn centres(text: &str, states: usize) -> Vec<Vec<f64>> {
    fn search(value: &serde_json::Value, out: &mut Vec<f64>) -> bool {
        match value {
            serde_json::Value::Object(map) => map.iter().any(|(key, inner)| {
                if key == "centres" || key == "centers" {
                    flatten(inner, out);
                    return !out.is_empty();
                }
                if key == "centre" || key == "center" {
                    flatten(inner, out);
                    return false;
                }
                search(inner, out)
            }),
            serde_json::Value::Array(items) => items.iter().any(|inner| search(inner, out)),
            _ => false,
        }
    }
    fn flatten(value: &serde_json::Value, out: &mut Vec<f64>) {
        match value {
            serde_json::Value::Array(items) => items.iter().for_each(|v| flatten(v, out)),
            other => out.extend(other.as_f64()),
        }
    }
    let mut flat = Vec::new();
    if let Ok(value) = serde_json::from_str::<serde_json::Value>(text) {
        search(&value, &mut flat);
    }
    flat.chunks_exact(states.max(1))
        .map(<[f64]>::to_vec)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_is_that_of_the_last_stop() {
        let first = r#"{"format":1}
{"time":"2026-01-01T00:00:00Z","event":"stopped","reason":"interrupted"}"#;
        let again = r#"{"time":"2026-01-01T00:00:01Z","event":"resumed","strides":3}"#;
        let last = r#"{"time":"2026-01-01T00:00:02Z","event":"stopped","reason":"the robot fell 4 times"}"#;
        let of = |lines: &[&str]| stopped(lines.join("\n").as_bytes());
        assert_eq!(of(&[first]).unwrap().reason, "interrupted");
        assert_eq!(of(&[first, again]), None);
        let torn = of(&[first, again, "\u{fffd}", last, "{\"time\":\"20"]);
        assert_eq!(
            torn,
            Some(Stop {
                time: "2026-01-01T00:00:02Z".into(),
                reason: "the robot fell 4 times".into()
            })
        );
    }

    #[test]
    fn centres_are_found_wherever_a_policy_keeps_them() {
        let flat = r#"{"kind":"g","network":{"widths":[1],"centres":[1.0,2.0,3.0,4.0]}}"#;
        assert_eq!(centres(flat, 2), [[1.0, 2.0], [3.0, 4.0]]);
        let bases = r#"{"bases":[{"centre":[0.5]},{"centre":[1.5]}]}"#;
        assert_eq!(centres(bases, 1), [[0.5], [1.5]]);
        assert!(centres("{}", 1).is_empty());
    }
}
