//! Built-in tasks, and tasks from files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

use stridemap_config::{ConfigError, Document, Format, nearest, to_toml};
use stridemap_mujoco::{ModelSource, MujocoError};

use crate::error::{Invalid, LabError};
pub use crate::task::Written;
use crate::task::{COMPONENTS, Task};

/// Name and text of every built-in task.
pub const TASKS: [(&str, &str); 17] = [
    ("stepping", include_str!("../../../experiments/stepping.toml")),
    ("stepping-auto", include_str!("../../../experiments/stepping-auto.toml")),
    ("stepping-paper", include_str!("../../../experiments/stepping-paper.toml")),
    ("walking", include_str!("../../../experiments/walking.toml")),
    ("walking-auto", include_str!("../../../experiments/walking-auto.toml")),
    ("walking-goals", include_str!("../../../experiments/walking-goals.toml")),
    ("walking-single", include_str!("../../../experiments/walking-single.toml")),
    ("walking-paper", include_str!("../../../experiments/walking-paper.toml")),
    ("small-stepping", include_str!("../../../experiments/small-stepping.toml")),
    ("small-walking", include_str!("../../../experiments/small-walking.toml")),
    ("g1-velocity", include_str!("../../../experiments/g1-velocity.toml")),
    ("g1-fastsac-velocity", include_str!("../../../experiments/g1-fastsac-velocity.toml")),
    ("t1-velocity", include_str!("../../../experiments/t1-velocity.toml")),
    ("t1-fastsac-velocity", include_str!("../../../experiments/t1-fastsac-velocity.toml")),
    ("go2-velocity", include_str!("../../../experiments/go2-velocity.toml")),
    ("zmp-stepping", include_str!("../../../experiments/zmp-stepping.toml")),
    ("zmp-walking", include_str!("../../../experiments/zmp-walking.toml")),
];

/// What a file says instead of a value that the robot is to tell.
pub(crate) const WORD: &str = "auto";
/// Keys that may say so, and what stands there until then.
pub(crate) const KEYS: [(&str, &str); 17] = [
    ("action.0.bounds", "[-0.001, 0.001]"),
    ("reward.0.weight", "0.1"),
    ("reward.0.target_deg", "0.0"),
    ("failure.psi_roll_below_deg", "-90.0"),
    ("action.0.explore.center", "[-0.001, 0.001]"),
    ("action.0.explore.std", "0.0001"),
    ("failure.com_height_below", "0.5"),
    ("failure.tilt_above_deg", "60.0"),
    ("failure.no_section_s", "10.0"),
    ("collect.strides", "[20, 16]"),
    ("algorithm.evaluation_strides", "12"),
    ("map.state_range", "[[-90.0, 90.0]]"),
    ("map.start_range", "[[-1.0, 1.0]]"),
    ("action.0.unit", "1.0"),
    ("action.0.output_unit", "1.0"),
    ("learner.actor_critic.basis_widths", "[1.0]"),
    ("success.psi_roll_within_deg", "1.0"),
];

/// What a task file is.
const FORMAT: Format<'_> = Format { built_in: &TASKS, components: Some(COMPONENTS) };

/// Who is told what a task file says in the words of an earlier version.
static LISTENER: OnceLock<fn(&str)> = OnceLock::new();
static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// Has each key that a task file has where an earlier version had it told, with file, line and new place, once; without this,
/// such keys are read in silence. Only the first call counts.
pub fn on_moved(listener: fn(&str)) {
    _ = LISTENER.set(listener);
}

/// The same, with the exploration of every action.
fn keys() -> Vec<(String, &'static str)> {
    const MOST_ACTIONS: usize = 20;
    let explored = [("center", "[-0.001, 0.001]"), ("std", "0.0001")];
    let further =
        (1..MOST_ACTIONS).flat_map(|i| explored.map(|(key, value)| (format!("action.{i}.explore.{key}"), value)));
    KEYS.into_iter().map(|(key, value)| (key.to_owned(), value)).chain(further).collect()
}

/// A task, read and checked.
#[derive(Clone, Debug)]
pub struct LoadedTask {
    /// The task.
    pub task: Task,
    /// The resolved task as TOML: every value, and nothing that it `extends`.
    pub resolved: String,
    /// The file it was read from, absolute; `None` if it is built in.
    pub file: Option<PathBuf>,
}

impl Task {
    /// A fault that was found after the task was read, at the key at fault in the file where that was written.
    #[must_use]
    pub fn located(&self, error: impl Into<LabError>) -> LabError {
        match &self.written.0 {
            Some(document) => located(document, &self.robot.model, error.into()),
            None => error.into(),
        }
    }
}

/// Loads a built-in task by name, or a task file, with `key=value` overrides.
///
/// # Errors
///
/// [`LabError::Config`] that names file, line and key.
///
/// # Example
///
/// ```
/// let task = stridemap_lab::builtin::load("stepping", &["robot.mass_scale=1.05".into()])?.task;
/// assert_eq!(task.robot.mass_scale, 1.05);
/// let error = stridemap_lab::builtin::load("stepping", &["robot.frictoin=1".into()]).unwrap_err();
/// assert!(error.to_string().contains("did you mean `friction`?"), "{error}");
/// # Ok::<(), stridemap_lab::LabError>(())
/// ```
pub fn load(name_or_path: &str, sets: &[String]) -> Result<LoadedTask, LabError> {
    finish(Document::load(name_or_path, sets, FORMAT).map_err(config)?)
}

/// Loads a task file by its path, even where a built-in task has the same name.
///
/// # Errors
///
/// As [`load`].
pub fn load_file(path: &Path, sets: &[String]) -> Result<LoadedTask, LabError> {
    finish(Document::load_file(path, sets, FORMAT).map_err(config)?)
}

impl Task {
    /// The task as TOML text, every value written out.
    ///
    /// # Errors
    ///
    /// [`LabError::Config`] for what TOML cannot hold.
    pub fn to_toml(&self) -> Result<String, LabError> {
        to_toml(self).map_err(config)
    }
}

/// A task as an earlier version recorded it, in the words of this one; as it is, where it is none.
pub(crate) fn in_words_of_now(task: serde_json::Value) -> serde_json::Value {
    let read = || {
        let text = to_toml(&task).ok()?;
        let built_in: &[(&str, &str)] = &[("provenance.json", &text)];
        let document = Document::load("provenance.json", &[], Format { built_in, ..FORMAT }).ok()?;
        serde_json::to_value(document.deserialize::<Task>().ok()?).ok()
    };
    read().unwrap_or(task)
}

fn config(error: ConfigError) -> LabError {
    LabError::Config(Box::new(error))
}

fn finish(mut document: Document) -> Result<LoadedTask, LabError> {
    if let (Some(listener), Ok(mut told)) = (LISTENER.get(), TOLD.lock()) {
        document.moved().into_iter().filter(|line| told.insert(line.clone())).for_each(|line| listener(&line));
    }
    let keys = keys();
    let found_later =
        document.stand_in(WORD, &keys.iter().map(|(key, value)| (key.as_str(), *value)).collect::<Vec<_>>());
    let mut task: Task = document.deserialize().map_err(config)?;
    task.auto.extend(found_later);
    if let Some(key) = task.auto.iter().find(|key| keys.iter().all(|(known, _)| known != *key)) {
        return Err(config(document.located("auto", format!("{key:?} is nothing that a robot can tell"))));
    }
    crate::pretrained::adopt(&mut task.gait, &mut task.robot, &mut task.failure.base_below_m, &document)
        .map_err(|error| located(&document, &ModelSource::Biped, error))?;
    task.rescale();
    task.fit_stand_ins();
    // From the file that names it; absolute, since the resolved task is saved elsewhere.
    if let (ModelSource::File(path), Some(base)) = (&mut task.robot.model, document.base_dir("robot.model"))
        && let Ok(absolute) = std::path::absolute(base.join(&*path))
    {
        *path = absolute;
    }
    task.validate().map_err(|error| located(&document, &task.robot.model, error))?;
    let resolved = task.to_toml()?;
    let file = document.file().and_then(|file| std::path::absolute(file).ok());
    task.written = Written(Some(Arc::new(document)));
    Ok(LoadedTask { task, resolved, file })
}

/// Puts a fault that a room found in its configuration at its place in the file.
fn located(document: &Document, model: &ModelSource, error: LabError) -> LabError {
    use stridemap_gait::GaitError;
    use stridemap_learn::LearnError;
    use stridemap_process::ProcessError;
    use stridemap_section::SectionError;

    let at = |key: &str, message: String| config(document.located(key, message));
    match error {
        LabError::Invalid(Invalid { key, requirement }) => at(&key, requirement),
        LabError::UnknownModulation { key, found, allowed } => {
            let near = nearest(&found, &allowed);
            let hint = near.map(|n| format!(" did you mean \"{n}\"?")).unwrap_or_default();
            at(&key, format!("the gait has no {found:?};{hint} (allowed: {})", allowed.join(", ")))
        }
        LabError::Gait(GaitError::Parameter { name, value, requirement }) => {
            at(&format!("gait.{name}"), format!("{value}: {requirement}"))
        }
        LabError::Gait(GaitError::Policy { key, what }) => at(&format!("gait.{key}"), what),
        LabError::Gait(GaitError::NoJoint { side, .. }) => {
            let (key, text) = (format!("robot.{side}"), error.to_string());
            at(&key, text.trim_start_matches(&format!("{key}: ")).to_owned())
        }
        LabError::Section(SectionError::Parameter { name, value, requirement }) => {
            at(&format!("section.{name}"), format!("{value}: {requirement}"))
        }
        LabError::Process(ProcessError::Parameter { name, value, requirement }) => {
            at(name, format!("{value}: {requirement}"))
        }
        LabError::Learn(LearnError::Parameter { field, value, domain }) => {
            at(&format!("learner.actor_critic.{field}"), format!("{value}: must be {domain}"))
        }
        LabError::Learn(LearnError::Length { field, expected, found }) => {
            at(&format!("learner.actor_critic.{field}"), format!("has {found} entries, needs {expected}"))
        }
        LabError::Mujoco(MujocoError::BadValue { field, value, allowed }) => {
            at(&format!("robot.{field}"), format!("{value}: must be {allowed}"))
        }
        LabError::Mujoco(error) => {
            let key = error.key();
            let text = error.to_string();
            let said = text.strip_prefix(&format!("{key}: ")).unwrap_or(&text);
            let model = match &error {
                MujocoError::Load { .. } | MujocoError::NotABiped { .. } => String::new(),
                _ => format!(" (model {model})"),
            };
            at(&format!("robot.{key}"), format!("{said}{model}"))
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learner::LearnerKind;

    #[test]
    fn every_built_in_task_is_valid_and_its_resolved_text_is_the_same_task() {
        for (name, _) in TASKS {
            let loaded = load(name, &[]).unwrap();
            assert_eq!(loaded.task.name, name);
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("config.toml");
            std::fs::write(&path, &loaded.resolved).unwrap();
            assert!(load_file(&path, &[]).unwrap().task == loaded.task, "{name}");
        }
    }

    #[test]
    fn another_learner_keeps_everything_else_and_is_written_down() {
        let walking = load("walking", &[]).unwrap().task;
        for kind in LearnerKind::CONTROLS {
            let other = load("walking", &[format!("learner.kind={}", kind.name())]).unwrap();
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("config.toml");
            std::fs::write(&path, &other.resolved).unwrap();
            let mut read = load_file(&path, &[]).unwrap().task;
            assert_eq!(read.learner.kind, kind);
            read.learner.kind = walking.learner.kind;
            assert_eq!(read, walking);
        }
        let error = load("stepping", &["learner.kind=linear".into()]).unwrap_err();
        assert!(error.is_request() && error.to_string().contains("--controls"), "{error}");
    }

    /// A run of an earlier version, and a file with its keys, mean what they meant.
    #[test]
    fn lists_with_a_value_per_component_are_read_from_where_they_were() {
        let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mutate/corpus");
        for (file, name) in [("stepping", "stepping"), ("walking", "walking"), ("small-walking", "small-walking")] {
            let old = load_file(&corpus.join(format!("task/{file}-resolved.toml")), &[]).unwrap().task;
            let now = load(name, &[]).unwrap().task;
            // Thresholds that are not asked for were beyond any robot there, and are left out here.
            let moved = |task: &Task| {
                let caution = task.caution.as_ref().map(|c| (c.trust.clone(), c.proof.clone()));
                (task.action.clone(), caution, task.collect.explore)
            };
            assert_eq!(moved(&old), moved(&now), "{name}");
        }
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("old.toml");
        let read = |text: &str, sets: &[&str]| {
            std::fs::write(&file, format!("extends = \"walking-single\"\nname = \"old\"\n{text}")).unwrap();
            load_file(&file, &sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>())
        };
        let action = "[[action]]\nmodulates = \"walk_amplitude_deg\"\nbounds = [0, 9]\n";
        let task = read(&format!("{action}[collect.explore]\ncenter = [[0, 4]]\n"), &["caution.proof.back_off.0=3"]);
        let task = task.unwrap().task;
        let [a] = &task.action[..] else { panic!() };
        assert_eq!((a.bounds, a.rate_per_stride, a.gain), ([0.0, 9.0], None, 1.0));
        assert_eq!((a.explore.center, a.explore.std, a.unit, a.output_unit), ([0.0, 4.0], 0.4, 1.0, 4.0));
        assert_eq!((a.back_off, a.dither_std), (3.0, Some(0.0)));
        let moved = task.written.0.as_ref().unwrap().moved().join("\n");
        assert!(
            moved.contains("old.toml:7: collect.explore.center is now `explore.center` in each [[action]]"),
            "{moved}"
        );
        let error = read("[caution.trust]\nunit = [1, 2]", &[]).unwrap_err().to_string();
        let expected = "old.toml:4: caution.trust.unit: has 2 entries, needs one per component of the action: 1";
        assert!(error.contains(expected), "{error}");
        let error = read("[collect.explore]\nstd = [-1]", &[]).unwrap_err().to_string();
        assert!(error.ends_with("old.toml:4: action.0.explore.std: is -1, must be not negative"), "{error}");
    }

    #[test]
    fn unused_learners_are_not_checked() {
        // Another state needs other widths of the actor-critic, where that is the learner.
        let sets = |kind: &str| {
            let state = "state=[\"psi_roll_deg\", \"gait_phase_deg\"]";
            let map = ["map.state_range=[[-9, 9], [-180, 180]]", "map.start_range=[[0, 1], [0, 1]]"];
            let sees = "learner.search.feedback.sees=[[\"psi_roll_deg\"], [\"gait_phase_deg\"]]";
            let kind = format!("learner.kind={kind}");
            [state, map[0], map[1], sees, &kind].map(String::from)
        };
        load("walking", &sets("search")).unwrap();
        let error = load("walking", &sets("actor_critic")).unwrap_err().to_string();
        assert!(error.contains("learner.actor_critic.basis_widths"), "{error}");
    }

    #[test]
    fn a_gait_outside_of_the_bounds_of_its_own_action_is_refused() {
        let error = load("walking", &["gait.amplitude_deg.pitch=3".into()]).unwrap_err();
        let text = error.to_string();
        assert!(error.is_request(), "{error:?}");
        assert!(text.starts_with("--set gait.amplitude_deg.pitch=3"), "{text}");
        assert!(text.contains("action.3.bounds = [6, 11]"), "{text}");
    }

    #[test]
    fn what_a_task_cannot_say_of_a_robot_is_told_as_that() {
        let leg = r#"robot.left={ hip_roll = "a", hip_pitch = "b", ankle_pitch = "d", foot = "e" }"#;
        let rolls = ["left", "right"].map(|side| format!("robot.{side}.ankle_roll=\"\""));
        for (task, sets, says) in [
            ("stepping", &[leg.to_owned()][..], "robot.left: names no knee"),
            ("small-stepping", &rolls, "must lie in order within [0, 0]"),
        ] {
            let error = load(task, sets).unwrap_err();
            assert!(error.is_request() && error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn what_is_found_when_the_robot_is_built_is_placed_as_well() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("task.toml");
        let says = |robot: &str| {
            let text = format!("extends = \"stepping\"\nname = \"mine\"\n{robot}");
            std::fs::write(&file, text).unwrap();
            let error = load_file(&file, &[]).unwrap().task.plant().err().unwrap();
            assert!(error.is_request(), "{error:?}");
            error.to_string()
        };
        let at = |line: usize| format!("{}:{line}: ", file.display());
        let text = says("robot.rest_deg.failure = 3");
        assert!(text.starts_with(&(at(3) + "robot.rest_deg.failure: the model has no leg joint")), "{text}");
        let leg = |roll: &str| {
            format!(
                "\n[robot.right]\nfoot = \"right_foot\"\nhip_pitch = \"right_hip_pitch\"\nknee = \"right_knee\"\n\
             ankle_pitch = \"right_ankle_pitch\"\nankle_roll = \"right_ankle_roll\"\nhip_roll = \"{roll}\"\n"
            )
        };
        let text = says(&leg("b_hip_roll"));
        assert!(text.starts_with(&(at(10) + "robot.right.hip_roll: the model has no joint")), "{text}");
        // Where the model is at fault: the key that names it, and its path.
        let biped = stridemap_mujoco::BIPED_XML;
        let (before, after) = biped.split_once("<actuator>").unwrap();
        let (_, after) = after.split_once("</actuator>").unwrap();
        std::fs::write(dir.path().join("robot.xml"), format!("{before}{after}")).unwrap();
        let text = says("robot.model = \"robot.xml\"");
        assert!(text.starts_with(&(at(3) + "robot.model: the joint")), "{text}");
        assert!(text.contains("robot.xml"), "{text}");
        let error = load("stepping", &["robot.rest_deg.failure=3".into()]).unwrap();
        let text = error.task.plant().err().unwrap().to_string();
        assert!(text.starts_with("--set robot.rest_deg.failure=3: "), "{text}");
    }

    #[test]
    fn faults_are_placed() {
        for (set, expected) in [
            ("gait.coupling_rad_s=-1", "gait.coupling_rad_s"),
            ("section.stance.load_share=0.2", "section.stance.load_share"),
            ("robot.mass_scale=0", "robot.mass_scale"),
            ("map.starts=0", "map.starts"),
            ("learner.actor_critic.discount=1", "learner.actor_critic.discount"),
            ("action.0.bounds=[5, -5]", "action.0.bounds"),
            ("action.0.modulates=walk_amplitude", "walk_amplitude_deg"),
            ("collect.explore.std=[0.1, 0.2]", "collect.explore.std"),
            ("action.0.explore.std=-1", "action.0.explore.std"),
            ("failure.com_height_below=7", "failure.com_height_below"),
        ] {
            let error = load("stepping", &[set.into()]).unwrap_err();
            assert!(error.is_request(), "{error:?}");
            let text = error.to_string();
            assert!(text.contains(expected) && text.contains("--set"), "{set}: {text}");
        }
    }
}
