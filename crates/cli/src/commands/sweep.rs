//! `sweep`: the runs of a study in shards, and their results together.

use std::path::Path;
use std::time::Instant;

use serde_json::Value;
use stridemap_lab::sweep::{Cell, Merged, RunLine, Shard, Study, merge as merge_lines, run_shard};
use stridemap_report::figures::{SweepMean, sweep as draw};

use crate::failure::Failure;
use crate::output;
use crate::progress::duration;
use crate::stop::stop_flag;

/// Makes the runs of a shard that are not made yet.
pub fn sweep(study: &Path, shard: Shard, out: &Path, json: bool) -> Result<(), Failure> {
    let loaded = Study::load(study)?;
    let (started, mut first) = (Instant::now(), None);
    let mut told = |done: u64, all: u64, line: Option<&RunLine>| {
        let began = *first.get_or_insert(done);
        let (seconds, made) = (started.elapsed().as_secs_f64(), done - began);
        let rest = (all - done) as f64 * seconds / made.max(1) as f64;
        let error = line.and_then(|line| line.error.as_deref()).map_or_else(String::new, |e| format!(", {e}"));
        if made > 0 {
            let each = seconds / made as f64;
            output::status(format!("{done} of {all} runs, {each:.2} s each, {} to go{error}", duration(rest)));
        }
    };
    let result = run_shard(&loaded, shard, out, &stop_flag(), &mut told);
    output::clear_status();
    let made = result.map_err(|error| match error {
        stridemap_lab::LabError::Interrupted { .. } => {
            Failure::working("stopped; the same command goes on from here".to_owned())
        }
        other => other.into(),
    })?;
    if json {
        return output::json(&serde_json::json!({ "made": made, "planned": loaded.0.runs(), "out": out }));
    }
    output::line(format!(
        "{made} runs made of {} in the study\n  next: stridemap sweep merge {}",
        loaded.0.runs(),
        out.display()
    ));
    Ok(())
}

/// The value that a sweep is about: the speed where it walks, else the reward.
fn watched(merged: &Merged) -> &'static str {
    let walks = merged.lines.iter().any(|line| line.values.contains_key("speed_m_s"));
    if walks { "speed_m_s" } else { "mean_reward" }
}

/// Draws the watched value against every setting.
fn figures(merged: &Merged, out: &Path) -> Result<Vec<String>, Failure> {
    let name = watched(merged);
    let mut keys: Vec<&String> = merged.rows.iter().flat_map(|row| row.set.keys()).collect();
    keys.sort();
    keys.dedup();
    let mut stems = Vec::new();
    for key in keys {
        let (lines, all): (Vec<&RunLine>, Vec<f64>) =
            merged.lines.iter().filter_map(|line| Some((line, *line.values.get(name)?))).unzip();
        let own: Vec<&Value> = lines.iter().filter_map(|line| line.set.get(key)).collect();
        let mut values: Vec<&Value> = Vec::new();
        own.iter().for_each(|v| {
            if !values.contains(v) {
                values.push(v)
            }
        });
        /// More values than this were drawn, not chosen.
        const CHOSEN: usize = 16;
        let chosen = values.len() <= CHOSEN;
        let place = |v: &Value| v.as_f64().or_else(|| Some(values.iter().position(|w| *w == v)? as f64));
        let runs: Vec<(f64, f64)> = own.iter().zip(&all).filter_map(|(v, y)| Some((place(v)?, *y))).collect();
        let mean = |v: &&Value| {
            let of = own.iter().zip(&all).filter(|(w, _)| *w == v).map(|(_, y)| *y).collect();
            let cell = Cell::of(of)?;
            Some(SweepMean { at: place(v)?, mean: cell.mean, interval_95: cell.interval_95 })
        };
        let means: Vec<SweepMean> = if chosen { values.iter().filter_map(mean).collect() } else { Vec::new() };
        let label = |v: &&Value| Some((place(v)?, v.as_str().map_or_else(|| v.to_string(), str::to_owned)));
        let ticks: Vec<_> = if chosen { values.iter().filter_map(label).collect() } else { Vec::new() };
        // Without a result there is nothing to draw; the table says so.
        if let Ok(figure) = draw(key, name, &ticks, &runs, &means) {
            figure.write(&out.join("figures"))?;
            stems.push(figure.stem);
        }
    }
    Ok(stems)
}

/// Puts the results of all shards together.
pub fn merge(out: &Path, json: bool) -> Result<(), Failure> {
    let merged = merge_lines(out)?;
    let stems = figures(&merged, out)?;
    if json {
        output::json(&merged)?;
    } else {
        let name = watched(&merged);
        output::line(format!(
            "{}: {} of {} runs; {name}, mean and 95 % interval",
            merged.study, merged.made, merged.planned
        ));
        const SHOWN: usize = 40;
        for row in merged.rows.iter().take(SHOWN) {
            let set: Vec<String> = row.set.iter().map(|(key, value)| format!("{key}={value}")).collect();
            let value = row.values.get(name).map_or_else(
                || "no result".to_owned(),
                |c| match c.interval_95 {
                    Some(half) => format!("{:+.5} +- {half:.5}, n = {}", c.mean, c.n),
                    None => format!("{:+.5}, n = {}", c.mean, c.n),
                },
            );
            let failed = if row.failed > 0 { format!(", {} failed", row.failed) } else { String::new() };
            output::line(format!("  {:<50} {value}{failed}", set.join(" ")));
        }
        if let more @ 1.. = merged.rows.len().saturating_sub(SHOWN) {
            output::line(format!("  and {more} rows more, in table.csv"));
        }
        let figures: Vec<String> = stems.iter().map(|stem| format!("figures/{stem}.svg")).collect();
        output::line(format!("  {}: table.csv, results.csv, {}", out.display(), figures.join(", ")));
    }
    match merged.missing.first() {
        None => Ok(()),
        Some(first) => Err(Failure::working(format!(
            "{} runs are not made yet, run {first} the first of them; the shards go on where they ended",
            merged.planned - merged.made
        ))),
    }
}
