//! The order of the house: crates use only those before them, files do not use one another in a circle.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Circles that are still there: a circle must lie within one of these, and none may be added.
const OLD_CIRCLES: [(&str, &[&str]); 1] = [
    // A task names a learner, and a learner is asked with the task.
    ("lab", &["learner", "task"]),
];

fn crates() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The crates in the order in which DESIGN.md says that data flows.
fn order() -> Vec<String> {
    let design = std::fs::read_to_string(crates().join("../DESIGN.md")).unwrap();
    let (_, list) = design.split_once("Each crate uses only those above it: ").unwrap();
    let (list, _) = list.split_once('.').unwrap();
    list.split(',').map(|name| name.trim().to_owned()).collect()
}

#[test]
fn crates_use_only_those_before_them() {
    let order = order();
    let place = |name: &str| order.iter().position(|n| n == name);
    for entry in std::fs::read_dir(crates()).unwrap() {
        let dir = entry.unwrap().path();
        let Ok(manifest) = std::fs::read_to_string(dir.join("Cargo.toml")) else { continue };
        let name = dir.file_name().unwrap().to_str().unwrap().to_owned();
        let (_, needed) = manifest.split_once("[dependencies]").unwrap_or_default();
        let needed = needed.split("\n[").next().unwrap_or_default();
        for used in needed.lines().filter_map(|line| line.strip_prefix("stridemap-")) {
            let used = used.split([' ', '=', '.']).next().unwrap();
            // Rooms for tests use others, and none but tests use them.
            let before = place(used).is_some_and(|used| place(&name).is_none_or(|own| used < own));
            assert!(before, "{name} uses {used}; the order is {order:?}");
        }
    }
}

/// Source files of a crate by their path in it, as modules are named: `run/finished`.
fn sources(dir: &Path, prefix: &str, into: &mut BTreeMap<String, String>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap();
        if path.is_dir() {
            sources(&path, &format!("{prefix}{stem}/"), into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let name = if stem == "mod" { prefix.trim_end_matches('/').to_owned() } else { format!("{prefix}{stem}") };
            into.insert(name, std::fs::read_to_string(&path).unwrap());
        }
    }
}

/// The files that a file names by `crate::`, its tests left aside.
fn uses(name: &str, text: &str, all: &BTreeMap<String, String>) -> BTreeSet<String> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let code: String = code.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    // `crate::{a, b}` names both.
    let lists: String = (code.split("crate::{").skip(1).filter_map(|list| list.split_once('}')))
        .flat_map(|(list, _)| list.split(',').map(|name| format!("crate::{} ", name.trim())))
        .collect();
    let mut found = BTreeSet::new();
    for path in format!("{code} {lists}").split("crate::").skip(1) {
        let end = path.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).unwrap_or(path.len());
        let mut parts: Vec<&str> = path[..end].split("::").filter(|part| !part.is_empty()).collect();
        while !parts.is_empty() {
            let file = parts.join("/");
            if all.contains_key(&file) {
                if file != name {
                    found.insert(file);
                }
                break;
            }
            parts.pop();
        }
    }
    found
}

#[test]
fn files_do_not_use_one_another_in_a_circle() {
    for entry in std::fs::read_dir(crates()).unwrap() {
        let dir = entry.unwrap().path();
        let room = dir.file_name().unwrap().to_str().unwrap().to_owned();
        let mut all = BTreeMap::new();
        if dir.join("src").is_dir() {
            sources(&dir.join("src"), "", &mut all);
        }
        let direct: BTreeMap<&String, BTreeSet<String>> =
            all.iter().map(|(name, text)| (name, uses(name, text, &all))).collect();
        let mut reached = direct.clone();
        for via in all.keys() {
            let further = reached[via].clone();
            for set in reached.values_mut().filter(|set| set.contains(via)) {
                set.extend(further.iter().cloned());
            }
        }
        for name in all.keys().filter(|name| reached[name].contains(*name)) {
            let circle: Vec<&String> =
                all.keys().filter(|o| reached[name].contains(*o) && reached[o].contains(name)).collect();
            let old =
                OLD_CIRCLES.iter().any(|(r, files)| *r == room && circle.iter().all(|f| files.contains(&f.as_str())));
            assert!(old, "{room}: a new circle of files: {circle:?}");
        }
    }
}
