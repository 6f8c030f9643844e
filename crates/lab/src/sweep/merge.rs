//! The results of all shards together: a line a run, a row a combination.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;
use statrs::distribution::{ContinuousCDF, StudentsT};
use stridemap_record::RecordError;
use stridemap_record::files::{read_json, write_json, write_whole};

use super::shard::{RunLine, STUDY, each_line, line_files};
use super::{Planned, Study};
use crate::error::LabError;

/// A mean with its interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// Runs that have it.
    pub n: usize,
    /// Mean.
    pub mean: f64,
    /// Half the width of the 95 % interval of the mean, by Student's t; null with fewer than two.
    pub interval_95: Option<f64>,
    /// Smallest.
    pub least: f64,
    /// Median.
    pub median: f64,
    /// Largest.
    pub most: f64,
}

impl Cell {
    /// Of some values.
    ///
    /// # Example
    ///
    /// 1, 2, 3: mean 2, standard error 1/√3, t(0.975, 2) = 4.303.
    ///
    /// ```
    /// let cell = stridemap_lab::sweep::Cell::of(vec![3.0, 1.0, 2.0]).unwrap();
    /// assert_eq!((cell.mean, cell.median, cell.n), (2.0, 2.0, 3));
    /// assert!((cell.interval_95.unwrap() - 4.302_65 / 3.0_f64.sqrt()).abs() < 1e-4);
    /// ```
    #[must_use]
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (n, least, most) = (values.len(), *values.first()?, *values.last()?);
        let mean = values.iter().sum::<f64>() / n as f64;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        let t = StudentsT::new(0.0, 1.0, n as f64 - 1.0).ok().map(|t| t.inverse_cdf(0.975));
        let interval_95 = t.map(|t| t * (squares / (n as f64 - 1.0) / n as f64).sqrt());
        let median = 0.5 * (values[(n - 1) / 2] + values[n / 2]);
        Some(Self { n, mean, interval_95, least, median, most })
    }
}

/// One combination of settings over its seeds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its values.
    pub set: BTreeMap<String, Value>,
    /// Runs that went wrong while working.
    pub failed: usize,
    /// What was measured, by name.
    pub values: BTreeMap<String, Cell>,
}

/// A study's results so far.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Merged {
    /// The study's name.
    pub study: String,
    /// Runs planned.
    pub planned: u64,
    /// Runs made.
    pub made: u64,
    /// The first runs that are not made, by number.
    pub missing: Vec<u64>,
    /// A row a combination, in the order of the runs.
    pub rows: Vec<Row>,
    /// Every run, in order.
    #[serde(skip)]
    pub lines: Vec<RunLine>,
}

fn quoted(cell: &str) -> String {
    match cell.contains([',', '"', '\n']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"")),
        false => cell.to_owned(),
    }
}

/// A value as a cell of a table.
fn cell(value: &Value) -> String {
    quoted(&value.as_str().map_or_else(|| value.to_string(), str::to_owned))
}

fn results_csv(keys: &[&str], names: &[String], lines: &[RunLine]) -> String {
    let header = ["run", "seed"].into_iter().chain(keys.iter().copied()).chain(names.iter().map(String::as_str));
    let mut text = header.collect::<Vec<_>>().join(",") + ",error\n";
    for line in lines {
        let own = keys.iter().map(|key| line.set.get(*key).map_or_else(String::new, cell));
        let values = names.iter().map(|name| line.values.get(name).map_or_else(String::new, ToString::to_string));
        let numbers = [line.run.to_string(), line.seed.to_string()];
        let error = quoted(line.error.as_deref().unwrap_or_default());
        text += &numbers.into_iter().chain(own).chain(values).chain([error]).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}

fn table_csv(keys: &[&str], rows: &[Row]) -> String {
    let mut text = keys.iter().map(|key| format!("{key},")).collect::<String>()
        + "value,n,failed,mean,interval_95,least,median,most\n";
    for row in rows {
        let own: String = keys.iter().map(|key| row.set.get(*key).map_or_else(String::new, cell) + ",").collect();
        for (name, c) in &row.values {
            let half = c.interval_95.map_or_else(String::new, |half| half.to_string());
            let (n, failed) = (c.n, row.failed);
            text += &format!("{own}{name},{n},{failed},{},{half},{},{},{}\n", c.mean, c.least, c.median, c.most);
        }
    }
    text
}

/// Puts the lines of all shards together, each run once, and writes `results.ndjson`, `results.csv`, `table.csv` and
/// `merged.json` beside them: the same bytes whatever the shards were.
///
/// # Errors
///
/// [`LabError::RunDirectory`] if the directory holds no study, or two lines of one run differ; [`LabError::Record`].
pub fn merge(out: &Path) -> Result<Merged, LabError> {
    let refuse = |problem: String| LabError::RunDirectory { path: out.into(), problem };
    if !out.join(STUDY).exists() {
        return Err(refuse(format!("holds no results of a sweep (there is no {STUDY} in it)")));
    }
    let study: Study = read_json(&out.join(STUDY))?;
    let mut by_run: BTreeMap<u64, RunLine> = BTreeMap::new();
    let mut differs = None;
    for file in line_files(out)? {
        each_line(&file, |line| match by_run.get(&line.run) {
            Some(other) if *other != line => differs = Some(line.run),
            _ => {
                by_run.insert(line.run, line);
            }
        })?;
    }
    if let Some(run) = differs {
        return Err(refuse(format!("run {run} was made twice, with two results: by two programs or machines?")));
    }
    const NAMED: usize = 20;
    let missing = (0..study.runs()).filter(|run| !by_run.contains_key(run)).take(NAMED).collect();
    let mut rows: Vec<Row> = Vec::new();
    let mut gathered: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    let settled = |rows: &mut Vec<Row>, gathered: &mut BTreeMap<String, Vec<f64>>| {
        if let Some(row) = rows.last_mut() {
            let cells = std::mem::take(gathered).into_iter();
            row.values = cells.filter_map(|(name, values)| Some((name, Cell::of(values)?))).collect();
        }
    };
    let (mut combination, mut lines) = (None, Vec::with_capacity(by_run.len()));
    for (run, line) in by_run {
        if combination != Some(run / study.seeds.count) {
            combination = Some(run / study.seeds.count);
            settled(&mut rows, &mut gathered);
            let Planned { set, .. } = study.planned(run);
            rows.push(Row { set, failed: 0, values: BTreeMap::new() });
        }
        if let (Some(row), true) = (rows.last_mut(), line.error.is_some()) {
            row.failed += 1;
        }
        line.values.iter().for_each(|(name, value)| gathered.entry(name.clone()).or_default().push(*value));
        lines.push(line);
    }
    settled(&mut rows, &mut gathered);
    let merged =
        Merged { study: study.name.clone(), planned: study.runs(), made: lines.len() as u64, missing, rows, lines };
    let mut names: Vec<String> = merged.rows.iter().flat_map(|row| row.values.keys().cloned()).collect();
    names.sort();
    names.dedup();
    let text: Result<Vec<String>, _> = merged.lines.iter().map(serde_json::to_string).collect();
    let text = text.map_err(|error| RecordError::content(out, None, error.to_string()))?;
    let text: String = text.into_iter().map(|line| line + "\n").collect();
    write_whole(&out.join("results.ndjson"), text.as_bytes())?;
    write_whole(&out.join("results.csv"), results_csv(&study.keys(), &names, &merged.lines).as_bytes())?;
    write_whole(&out.join("table.csv"), table_csv(&study.keys(), &merged.rows).as_bytes())?;
    write_json(&out.join("merged.json"), &merged)?;
    Ok(merged)
}
