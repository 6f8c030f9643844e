//! docs/files.md names every key and column of a run's files, and nothing else.
#![allow(clippy::unwrap_used, reason = "a test of its own")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

const PAGE: &str = include_str!("../../../docs/files.md");

/// Keys whose values are no part of this schema: a task, and a model with its data.
const OPAQUE: [&str; 4] = ["task", "config", "card", "gp"];

/// The names in the first column of a section's tables, whether they may be left out, and the sections it has as well.
fn section(title: &str) -> BTreeMap<String, bool> {
    let mut names = BTreeMap::new();
    let text = PAGE.split("\n## ").find(|text| text.starts_with(title));
    let text = text.ok_or(title).unwrap();
    for row in text.lines().filter(|line| line.starts_with("| `")) {
        let first = row.split(" | ").next().unwrap();
        for name in first.split('`').skip(1).step_by(2) {
            let optional = row.contains("optional");
            names.entry(name.to_owned()).and_modify(|o| *o &= optional).or_insert(optional);
        }
    }
    let more = text.lines().filter(|line| !line.starts_with('|'));
    for link in more.flat_map(|line| line.split("](#").skip(1)) {
        let anchor = link.split(')').next().unwrap();
        let title = anchor.replace("transitionscsv", "transitions.csv");
        for (name, optional) in section(&title) {
            names.entry(name).or_insert(optional);
        }
    }
    names
}

fn keys(value: &serde_json::Value, found: &mut BTreeSet<String>) {
    match value {
        serde_json::Value::Object(map) => {
            for (key, value) in map {
                found.insert(key.clone());
                if !OPAQUE.contains(&key.as_str()) {
                    keys(value, found);
                }
            }
        }
        serde_json::Value::Array(items) => items.iter().for_each(|item| keys(item, found)),
        _ => {}
    }
}

/// The columns of a table, those of components as `<state>` and `<action>`.
fn columns(run: &Path, header: &str) -> BTreeSet<String> {
    let text = std::fs::read_to_string(run.join("columns.json")).unwrap();
    let names: BTreeMap<String, Vec<String>> = serde_json::from_str(&text).unwrap();
    let general = |column: &str| {
        if header.contains("psi_roll_after_") {
            return column.to_owned(); // Pushes are told by ψ_roll, whatever the state is.
        }
        let prefixes = ["", "last_", "next_", "mean_", "std_", "latent_std_", "noise_std_"];
        for (kind, prefix) in names.keys().flat_map(|kind| prefixes.map(|p| (kind, p))) {
            let component = column.strip_prefix(prefix);
            if component.is_some_and(|c| names[kind].iter().any(|name| name == c)) {
                return format!("{prefix}<{kind}>");
            }
        }
        column.to_owned()
    };
    header.split(',').map(general).collect()
}

fn stridemap(dir: &Path, args: &str) {
    let output = Command::new(env!("CARGO_BIN_EXE_stridemap")).current_dir(dir).args(args.split(' ')).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args}: {said}");
}

#[test]
fn the_page_of_files_names_what_real_runs_hold() {
    let dir = tempfile::tempdir().unwrap();
    let short = "--set record.strides=4 --set record.iteration_strides=3 --set record.pose_seconds=0.5";
    stridemap(dir.path(), &format!("learn stepping --out stepping {short}"));
    stridemap(dir.path(), "push stepping --strides 20");
    stridemap(dir.path(), "push stepping --atlas --phases 1 --directions 2");
    let mut verdict = Command::new(env!("CARGO_BIN_EXE_stridemap"));
    let args = "verdict stepping --walks 2 --probe 40 --set verdict.survived_push_m_s_at_least=0";
    let ended = verdict.current_dir(dir.path()).args(args.split(' ')).output().unwrap();
    assert_eq!(ended.status.code(), Some(3), "two walks tell little: {}", String::from_utf8_lossy(&ended.stderr));
    stridemap(
        dir.path(),
        &format!(
            "learn walking --out walking {short} --set record.walk_s=4.0 --set record.speed_s=4.0 \
             --set algorithm.strides_at_most=75 --set collect.strides=[40,0]"
        ),
    );
    let titles = PAGE.split("\n## ").skip(1).map(|text| text.lines().next().unwrap());
    for file in titles.filter(|title| title.contains('.')) {
        let mut held = BTreeSet::new();
        for run in ["stepping", "walking"].map(|name| dir.path().join(name)) {
            let Ok(text) = std::fs::read_to_string(run.join(file)) else {
                continue;
            };
            match file.rsplit('.').next().unwrap() {
                "csv" => held.extend(columns(&run, text.lines().next().unwrap())),
                "ndjson" => text.lines().for_each(|line| keys(&serde_json::from_str(line).unwrap(), &mut held)),
                _ => keys(&serde_json::from_str(&text).unwrap(), &mut held),
            }
        }
        assert!(!held.is_empty(), "no run has a {file}");
        let named = section(file);
        let unnamed: Vec<_> = held.iter().filter(|key| !named.contains_key(*key)).collect();
        assert!(unnamed.is_empty(), "{file}: not in docs/files.md: {unnamed:?}");
        let promised = named.iter().filter(|(name, optional)| !**optional && !held.contains(*name));
        let promised: Vec<_> = promised.map(|(name, _)| name).collect();
        assert!(promised.is_empty(), "{file}: only in docs/files.md: {promised:?}");
    }
}
