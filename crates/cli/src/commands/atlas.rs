//! `push --atlas`: the largest push that is survived, by phase of the gait and direction.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

use serde::{Deserialize, Serialize};
use stridemap_lab::{AtlasSetting, LabError, Task, atlas_cell, for_pushes, push_atlas, unpushed};
use stridemap_learn::SavedPolicy;
use stridemap_mujoco::sha256;
use stridemap_record::files::{self, Keep, Log, lock};
use stridemap_record::{AtlasCell, AtlasHeadline, PushAtlas, direction_words};

use super::apply::task_and_policy;
use crate::args::Common;
use crate::failure::Failure;
use crate::stop::stop_flag;
use crate::{output, parallel};

/// A finished cell in the file of an atlas that is being made.
#[derive(Serialize, Deserialize)]
struct Done {
    at: usize,
    cell: AtlasCell,
}

/// Cells that an atlas of the very same task, policy, setting and seed has already, and where new ones go. Kept only
/// where the atlas goes into a directory.
struct Kept {
    cells: Vec<Option<AtlasCell>>,
    log: Option<Mutex<Log>>,
}

impl Kept {
    fn open(path: Option<&Path>, of: &str, count: usize) -> Result<Self, Failure> {
        let Some(path) = path else { return Ok(Self { cells: vec![None; count], log: None }) };
        let header = serde_json::json!({ "atlas_of": of }).to_string();
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let mut cells = vec![None; count];
        let same = text.lines().next() == Some(&header);
        for line in text.lines().skip(1).filter(|_| same) {
            // A line that was cut off is made again.
            if let Ok(Done { at, cell }) = serde_json::from_str(line)
                && let Some(place) = cells.get_mut(at)
            {
                *place = Some(cell);
            }
        }
        if !same && !text.is_empty() {
            output::note(format!("{}: of another task, policy, seed or version; begun anew", path.display()));
        }
        let keep = if same { Keep::Lines } else { Keep::Rows(0) };
        if !same && path.exists() {
            std::fs::remove_file(path).map_err(|e| Failure::working(format!("{}: {e}", path.display())))?;
        }
        Ok(Self { cells, log: Some(Mutex::new(Log::open(path, &header, keep)?)) })
    }

    fn add(&self, done: &Done) -> Result<(), Failure> {
        let Some(log) = &self.log else { return Ok(()) };
        let line = serde_json::to_string(done)?;
        let mut log = log.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        Ok(log.append(&line)?)
    }
}

/// What an atlas is made of, as one hash.
pub fn made_of(task: &Task, policy: &SavedPolicy, setting: &AtlasSetting, seed: u64) -> Result<String, Failure> {
    let policy = serde_json::to_string(policy)?;
    let version = env!("CARGO_PKG_VERSION");
    Ok(sha256(format!("{version}\n{seed}\n{setting:?}\n{}\n{policy}", task.to_toml()?).as_bytes()))
}

/// Makes the atlas of a policy on a simulated robot; cells that a killed command has made already are taken.
fn make(
    task: &Task,
    policy: &SavedPolicy,
    setting: &AtlasSetting,
    (name, part): (&str, Option<&Path>),
    common: &Common,
) -> Result<PushAtlas, Failure> {
    let seed = common.seed;
    let made_of = made_of(task, policy, setting, seed)?;
    let task = &for_pushes(task);
    let mut plant = task.plant()?;
    let mass_kg = plant.robot().description().mass_kg;
    let beside = unpushed(&mut plant, policy, setting, &task.state, seed)?;
    drop(plant);
    let cells = setting.cells();
    let kept = Kept::open(part, &made_of, cells.len())?;
    let missing: Vec<usize> = (0..cells.len()).filter(|&at| kept.cells[at].is_none()).collect();
    if missing.len() < cells.len() {
        output::note(format!("{} of {} cells are there already", cells.len() - missing.len(), cells.len()));
    }
    let stop = stop_flag();
    let told = |&at: &usize, made: &Result<AtlasCell, Failure>| {
        let (duration_s, phase, direction_deg) = cells[at];
        let came = made.as_ref().map_or("failed".into(), |c| format!("{:.3} m/s survived", c.survived_m_s));
        format!("{duration_s} s at phase {phase} {}: {came}", direction_words(direction_deg))
    };
    let made = parallel::each_of(&missing, common.threads, "cells", told, |&at| {
        if stop.load(Ordering::Relaxed) {
            return Err(Failure::working("stopped; the same command goes on from here"));
        }
        let mut plant = task.plant()?;
        let cell = atlas_cell(&mut plant, policy, setting, &beside, seed, cells[at])?;
        kept.add(&Done { at, cell }).map(|()| cell)
    })?;
    let mut all = kept.cells;
    for (at, cell) in missing.into_iter().zip(made) {
        all[at] = Some(cell);
    }
    Ok(push_atlas(setting, &beside, (name, made_of), mass_kg, seed, all.into_iter().flatten().collect()))
}

/// Makes the atlas of a policy, called `learned` or `nominal`, and puts it with its figure into a directory, if one is named.
pub fn make_into(
    task: &Task,
    policy: &SavedPolicy,
    setting: &AtlasSetting,
    name: &str,
    dir: Option<&Path>,
    common: &Common,
) -> Result<PushAtlas, Failure> {
    let Some(dir) = dir else { return make(task, policy, setting, (name, None), common) };
    files::create_dir(dir)?;
    let stem = if name == "nominal" { "push-atlas-nominal" } else { "push-atlas" };
    let part = dir.join(format!("{stem}.part"));
    let atlas = make(task, policy, setting, (name, Some(&part)), common)?;
    files::write_whole(&dir.join(format!("{stem}.csv")), atlas.table().as_bytes())?;
    files::write_json(&dir.join(format!("{stem}.json")), &atlas)?;
    let _ = std::fs::remove_file(part); // Whole files stand beside it.
    stridemap_report::figures::push_atlas(&atlas)?.write(&dir.join("figures"))?;
    output::note(format!(
        "wrote {stem}.csv, {stem}.json and figures/{stem}.png into {0}; `stridemap report {0}` shows them",
        dir.display()
    ));
    Ok(atlas)
}

/// Makes the atlas of a run's policy, or of its nominal gait, and puts it into the run.
pub fn push_atlas_of_run(
    path: &Path,
    setting: AtlasSetting,
    nominal: bool,
    out: Option<&Path>,
    common: &Common,
) -> Result<(), Failure> {
    let (task, policy, _) = task_and_policy(path, nominal, common)?;
    if task.link.is_some() {
        return Err(LabError::NotHere.into());
    }
    let own = common.sets.is_empty() && common.robot.is_none();
    let into_run = (out.is_none() && own).then_some(path);
    let _writing = into_run.map(lock).transpose()?;
    let name = if nominal { "nominal" } else { "learned" };
    let atlas = make_into(&task, &policy, &setting, name, out.or(into_run), common)?;
    if common.json {
        return output::json(&atlas);
    }
    show(&atlas);
    Ok(())
}

/// Prints what holds for each duration.
fn show(atlas: &PushAtlas) {
    let body = if atlas.body.is_empty() { "torso" } else { &atlas.body };
    output::line(format!(
        "{} policy, pushes on the {body} of a robot of {:.1} kg: {} tried in {} strides; survived: not down in the stride pushed \
         and {} more; bisected to {} m/s, up to {} m/s (seed {})",
        atlas.policy,
        atlas.mass_kg,
        atlas.trials,
        atlas.strides,
        atlas.after_strides,
        atlas.tolerance_m_s,
        atlas.largest_m_s,
        atlas.seed
    ));
    for of in &atlas.durations {
        output::line(format!("  {} s long: {}", of.duration_s, headline(of)));
    }
}

/// The weakest spot, the median and the area, in words.
fn headline(of: &AtlasHeadline) -> String {
    let below = of.smallest_fallen_m_s.map_or_else(String::new, |v| format!(", falls at {v:.3}"));
    let recover = of.median_strides_to_recover.map_or_else(String::new, |n| format!(", {n} strides to recover"));
    format!(
        "smallest survived {:.3} m/s{below} ({:.2} N s, {:.1} N, {:.1} % of its weight; at phase {} {}); median {:.3} m/s{recover}; \
         {:.1} % of the area survived",
        of.smallest_m_s,
        of.smallest_n_s,
        of.smallest_n,
        100.0 * of.smallest_of_weight,
        of.smallest_phase,
        direction_words(of.smallest_direction_deg),
        of.median_m_s,
        100.0 * of.area_survived
    )
}
