//! A run directory, read as far as it goes.

use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use stridemap_learn::SavedPolicy;
use stridemap_map::SavedMap;
use stridemap_process::StrideEnd;

use crate::atlas::{PushAtlas, cells};
use crate::columns::Columns;
use crate::error::RecordError;
use crate::events::{Stop, stopped};
use crate::files::{parse_json, read_json};
use crate::grid::{LineGrid, MapGrid, PolicyGrid};
use crate::learning::LearningRow;
use crate::poses::Recording;
use crate::provenance::Provenance;
use crate::push::{PushOutcome, pairs};
use crate::stride::{StridePhase, StrideRole, Transition};
use crate::summary::Summary;
use crate::table::{Rows, Table};

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
    pub transitions: Vec<Transition>,
    /// `record.csv`, each stride with the measured policy: `nominal`, `iteration-1`, ..., `final`.
    pub record: Vec<(String, Transition)>,
    /// `learning.csv`.
    pub learning: Vec<LearningRow>,
    /// `map/<iteration>.json`, ascending.
    pub maps: Vec<SavedMap>,
    /// `figures/data/policy-<iteration>.csv`, ascending.
    pub policies: Vec<(usize, PolicyGrid)>,
    /// `figures/data/map-<iteration>.csv`, ascending.
    pub grids: Vec<(usize, MapGrid)>,
    /// `figures/data/lines-<iteration>.csv`, ascending.
    pub lines: Vec<(usize, LineGrid)>,
    /// `poses/<what>.json`: nominal, iterations, final, and under pushes.
    pub recordings: Vec<(String, Recording)>,
    /// `lapse/<what>.json`: a picture now and then for a minute, nominal first, final last.
    pub lapses: Vec<(String, Recording)>,
    /// `push.csv` with `push.json`: the learned policy under pushes.
    pub push: Option<PushOutcome>,
    /// `push-nominal.csv` with `push-nominal.json`: the nominal gait under the same pushes.
    pub push_nominal: Option<PushOutcome>,
    /// `push-atlas.csv` with `push-atlas.json`, and the nominal gait's.
    pub atlases: Vec<PushAtlas>,
    /// Why the run stopped before its end, and when, as `events.ndjson` says; `None` if it does not.
    pub stopped: Option<Stop>,
    /// Files that are not there.
    pub missing: Vec<String>,
    /// Files that are there and cannot be read, and why.
    pub problems: Vec<String>,
}

impl Run {
    /// Reads a run directory. Only a directory that is none is an error: a run may have been killed
    /// half-way, and the report of it says what is there.
    ///
    /// # Errors
    ///
    /// [`RecordError::File`] if the directory cannot be read.
    pub fn read(dir: &Path) -> Result<Run, RecordError> {
        fs::read_dir(dir).map_err(RecordError::file(dir, "read"))?;
        let name = dir
            .canonicalize()
            .ok()
            .and_then(|d| d.file_name().map(|n| n.to_string_lossy().into_owned()))
            .unwrap_or_else(|| dir.display().to_string());
        let mut run = Run { dir: dir.to_owned(), name, ..Run::default() };
        run.config = run.text("config.toml");
        run.provenance = run.json("provenance.json");
        run.summary = run.json("summary.json");
        run.columns = run.json("columns.json").unwrap_or_default();
        let columns = run.columns.clone();
        let strides = run.csv("transitions.csv", |t| columns.strides(t, Rows::Whole));
        run.transitions = strides.unwrap_or_default();
        let recorded = run.csv("record.csv", |t| columns.recorded(t));
        run.record = recorded.unwrap_or_default();
        run.count_strides();
        // A policy that was rejected as final was measured before the one that is.
        let begins = |(what, s): &(String, Transition)| what == "final" && (s.episode, s.k) == (0, 0);
        if let Some(last) = run.record.iter().rposition(begins) {
            let mut row = 0;
            run.record.retain(|(what, _)| {
                row += 1;
                what != "final" || row > last
            });
        }
        run.learning = run.csv("learning.csv", LearningRow::read).unwrap_or_default();
        run.read_iterations(&columns);
        run.recordings = run.read_poses("poses");
        if run.recordings.is_empty() {
            run.missing.push("poses/".to_owned());
        }
        run.lapses = run.read_poses("lapse"); // Runs of earlier versions have none.
        run.stopped = stopped(&run.dir);
        if run.dir.join("push.csv").exists() {
            run.push = run.read_push("push");
        }
        run.atlases = ["push-atlas", "push-atlas-nominal"].iter().filter_map(|stem| run.read_atlas(stem)).collect();
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
            quantity.starts_with("psi_roll").then(|| r.get("target_deg").and_then(number))?
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
    pub fn map_strides(&self, iteration: usize) -> impl Iterator<Item = &Transition> {
        self.transitions.iter().filter(move |s| {
            let before = s.iteration < iteration || s.phase != StridePhase::Evaluate;
            s.role == StrideRole::Training && s.iteration <= iteration && before
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
                let number: usize = other.strip_prefix("iteration-")?.parse().ok()?;
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
        self.summary.as_ref().is_some_and(|s| s.final_policy.is_some())
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
        let role = |role: StrideRole| {
            let made = self.transitions.iter();
            let made = made.chain(self.record.iter().map(|(_, stride)| stride));
            made.filter(|t| t.end != StrideEnd::Aborted && t.role == role).count()
        };
        let [training, evaluation, record] = StrideRole::ALL.map(role);
        let strides = &mut self.summary.get_or_insert_default().strides;
        (strides.training, strides.evaluation, strides.record) = (training, evaluation, record);
    }

    fn text(&mut self, file: &str) -> Option<String> {
        let text = String::from_utf8(self.bytes(file)?);
        text.map_err(|e| self.problems.push(format!("{file}: {}", e.utf8_error()))).ok()
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
        self.known(parse_json(Path::new(file), &text))
    }

    /// What was read; its problem is named, if there is one.
    fn known<T>(&mut self, read: Result<T, RecordError>) -> Option<T> {
        read.map_err(|e| self.problems.push(e.to_string())).ok()
    }

    fn csv<T>(&mut self, file: &str, read: impl Fn(&Table) -> Result<T, RecordError>) -> Option<T> {
        let text = self.lines(file)?;
        let table = Table::parse(Path::new(file), &text, Rows::Whole);
        let (torn, value) = self.known(table.and_then(|t| Ok((t.torn, read(&t)?))))?;
        if torn {
            let problem = format!("{file}: the last line was cut off and is left out");
            self.problems.push(problem);
        }
        Some(value)
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
            let Some(mut grid) = self.csv(&file, |t| PolicyGrid::read(t, columns)) else {
                continue;
            };
            let policy = self.dir.join(format!("policy/{iteration}.json"));
            if let Ok(SavedPolicy::GaussianNetwork(policy)) = read_json(&policy) {
                grid.centres = policy.centres();
            }
            self.policies.push((iteration, grid));
        }
        if self.policies.is_empty() {
            self.missing.push("figures/data/policy-*.csv".to_owned());
        }
        for iteration in numbered(&data, "map-", ".csv") {
            let file = format!("figures/data/map-{iteration}.csv");
            if let Some(grid) = self.csv(&file, |t| MapGrid::read(t, columns)) {
                self.grids.push((iteration, grid));
            }
        }
        if self.grids.is_empty() {
            self.missing.push("figures/data/map-*.csv".to_owned());
        }
        for iteration in numbered(&data, "lines-", ".csv") {
            let file = format!("figures/data/lines-{iteration}.csv");
            if let Some(grid) = self.csv(&file, |t| LineGrid::read(t, columns)) {
                self.lines.push((iteration, grid));
            }
        }
    }

    fn read_poses(&mut self, folder: &str) -> Vec<(String, Recording)> {
        let mut names: Vec<String> = fs::read_dir(self.dir.join(folder))
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|e| e.file_name().to_str()?.strip_suffix(".json").map(str::to_owned))
            .collect();
        let rank = |n: &str| match n {
            "nominal" => (0, 0),
            "final" => (2, 0),
            "push-nominal" => (3, 0),
            "push" => (4, 0),
            other => (1, other.trim_start_matches("iteration-").parse().unwrap_or(usize::MAX)),
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

    fn read_push(&mut self, stem: &str) -> Option<PushOutcome> {
        let data = self.csv(&format!("{stem}.csv"), pairs)?;
        let outcome = self.json(&format!("{stem}.json"))?;
        Some(PushOutcome { data, ..outcome })
    }
}

impl Run {
    fn read_atlas(&mut self, stem: &str) -> Option<PushAtlas> {
        if !self.dir.join(format!("{stem}.csv")).exists() {
            return None;
        }
        let cells = self.csv(&format!("{stem}.csv"), cells)?;
        let atlas: PushAtlas = self.json(&format!("{stem}.json"))?;
        Some(PushAtlas { cells, ..atlas })
    }
}

/// Why a recording cannot be shown, if so.
fn broken(r: &Recording) -> Option<String> {
    let bodies = r.frames.first()?.poses.len();
    if let Some(i) = r.frames.iter().position(|f| f.poses.len() != bodies) {
        return Some(format!("frame {i} has {} bodies, the first {bodies}", r.frames[i].poses.len()));
    }
    if let Some(s) = r.shapes.iter().find(|s| s.body >= bodies) {
        return Some(format!("a shape on body {} of {bodies}", s.body));
    }
    let finite = r.frames.iter().flat_map(|f| f.poses.iter().flatten()).all(|v| v.is_finite());
    (!finite).then(|| "a pose that is not finite".to_owned())
}

/// The numbers `n` of the files `<prefix>n<suffix>` of a directory, ascending.
fn numbered(dir: &Path, prefix: &str, suffix: &str) -> Vec<usize> {
    let mut numbers: Vec<usize> = fs::read_dir(dir)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|e| e.file_name().to_str()?.strip_prefix(prefix)?.strip_suffix(suffix)?.parse().ok())
        .collect();
    numbers.sort_unstable();
    numbers
}
