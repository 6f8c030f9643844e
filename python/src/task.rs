//! Tasks: built in, from files, with overrides.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyList, PyString, PyTuple};
use stridemap_lab::LabError;
use stridemap_lab::builtin::{self, LoadedTask, TASKS};

use crate::error::{of_lab, request};
use crate::policy::Policy;

/// A task: what a TOML file says of robot, gait, section, reward, map and learner, every value known.
///
/// >>> task = Task.builtin("stepping").set({"robot.friction": 0.6})
/// >>> task.action_names
/// ['step_amplitude_deg']
#[pyclass(module = "stridemap", frozen, from_py_object)]
#[derive(Clone)]
pub struct Task {
    /// As the user named it.
    pub named: String,
    /// Overrides, `key=value`.
    pub sets: Vec<String>,
    is_file: bool,
    pub loaded: LoadedTask,
}

impl Task {
    fn load(named: String, is_file: bool, sets: Vec<String>) -> Result<Self, LabError> {
        let loaded = if is_file { builtin::load_file(named.as_ref(), &sets) } else { builtin::load(&named, &sets) }?;
        Ok(Self { named, sets, is_file, loaded })
    }

    /// The same task with more overrides.
    pub fn with(&self, more: Vec<String>) -> Result<Self, LabError> {
        if more.is_empty() {
            return Ok(self.clone());
        }
        let sets = self.sets.iter().cloned().chain(more).collect();
        Self::load(self.named.clone(), self.is_file, sets)
    }

    /// The task of a run, as it stands in the run's directory.
    pub fn of_run(config: PathBuf, task: stridemap_lab::Task) -> Self {
        let loaded = LoadedTask { task, resolved: String::new(), file: Some(config.clone()) };
        Self { named: config.display().to_string(), sets: Vec::new(), is_file: true, loaded }
    }

    /// The task as its robot for a seed tells what the file leaves to it.
    pub fn ready(&self, seed: u64) -> Result<LoadedTask, LabError> {
        let mut loaded = self.loaded.clone().on(None, seed)?;
        loaded.task.tell()?;
        loaded.resolved = loaded.task.to_toml()?;
        Ok(loaded)
    }
}

#[pymethods]
impl Task {
    /// Reads a task file.
    ///
    /// Raises:
    ///     RequestError: with file, line and key of the fault.
    #[staticmethod]
    #[pyo3(signature = (path, set=None))]
    fn from_file(path: PathBuf, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let named = path.to_str().ok_or_else(|| request("a task file is named by text (UTF-8)"))?;
        Self::load(named.into(), true, settings(set)?).map_err(of_lab)
    }

    /// A built-in task by name, or a task file by path.
    #[staticmethod]
    #[pyo3(signature = (task, set=None), name = "load")]
    fn load_any(task: TaskLike, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        task.load(set)
    }

    /// A built-in task; `Task.builtins()` names them.
    #[staticmethod]
    #[pyo3(signature = (name, set=None))]
    fn builtin(name: &str, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let names = TASKS.map(|(name, _)| name);
        if !names.contains(&name) {
            return Err(request(format!("there is no built-in task {name:?} (there are: {})", names.join(", "))));
        }
        Self::load(name.into(), false, settings(set)?).map_err(of_lab)
    }

    /// The names of the built-in tasks.
    #[staticmethod]
    fn builtins() -> Vec<&'static str> {
        TASKS.map(|(name, _)| name).to_vec()
    }

    /// The same task with other values: a dictionary by dotted key, or keywords with `__` for a dot.
    ///
    /// >>> Task.builtin("stepping").set(robot__friction=0.6)
    /// Task('stepping', set=['robot.friction=0.6'])
    #[pyo3(signature = (settings=None, /, **keys))]
    fn set(&self, settings: Option<&Bound<'_, PyDict>>, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut more = self::settings(settings)?;
        more.extend(self::settings(keys)?.into_iter().map(|set| {
            let (key, value) = set.split_once('=').unwrap_or((&set, ""));
            format!("{}={value}", key.replace("__", "."))
        }));
        self.with(more).map_err(of_lab)
    }

    /// The experiment's name.
    #[getter]
    fn name(&self) -> &str {
        &self.loaded.task.name
    }

    /// What it is, in a sentence.
    #[getter]
    fn about(&self) -> &str {
        &self.loaded.task.about
    }

    /// Components of the state, with their units.
    #[getter]
    fn state_names(&self) -> Vec<&'static str> {
        self.loaded.task.state.iter().map(|c| c.name()).collect()
    }

    /// Components of the action, with their units.
    #[getter]
    fn action_names(&self) -> Vec<String> {
        self.loaded.task.action.iter().map(|a| a.modulates.clone()).collect()
    }

    /// Smallest and largest value of each component of the action.
    #[getter]
    fn action_bounds(&self) -> Vec<(f64, f64)> {
        self.loaded.task.action.iter().map(|a| (a.bounds[0], a.bounds[1])).collect()
    }

    /// The policy that leaves the nominal gait alone.
    fn nominal_policy(&self) -> PyResult<Policy> {
        self.loaded.task.nominal_policy().map(Policy::of).map_err(of_lab)
    }

    /// The task as TOML, every value written out.
    fn to_toml(&self) -> PyResult<String> {
        self.loaded.task.to_toml().map_err(of_lab)
    }

    fn __repr__(&self) -> String {
        match self.sets.as_slice() {
            [] => format!("Task({:?})", self.named).replace('"', "'"),
            sets => format!("Task({:?}, set={sets:?})", self.named).replace('"', "'"),
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String, bool, Vec<String>))> {
        let rebuild = py.get_type::<Self>().getattr("_rebuild")?;
        Ok((rebuild, (self.named.clone(), self.is_file, self.sets.clone())))
    }

    #[staticmethod]
    fn _rebuild(named: String, is_file: bool, sets: Vec<String>) -> PyResult<Self> {
        Self::load(named, is_file, sets).map_err(of_lab)
    }
}

/// A task as an argument: a `Task`, a name, or a path.
#[derive(FromPyObject)]
pub enum TaskLike {
    /// Loaded.
    Task(Task),
    /// A built-in name, or the path of a file.
    Path(PathBuf),
}

impl TaskLike {
    /// The task with overrides.
    pub fn load(self, set: Option<&Bound<'_, PyDict>>) -> PyResult<Task> {
        let more = settings(set)?;
        match self {
            Self::Task(task) => task.with(more),
            Self::Path(path) => {
                let named = path.to_str().ok_or_else(|| request("a task is named by text (UTF-8)"))?;
                Task::load(named.into(), false, more)
            }
        }
        .map_err(of_lab)
    }
}

/// Overrides as the command line has them: `key=value`, the value in TOML.
pub fn settings(given: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<String>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    given.iter().map(|(key, value)| Ok(format!("{}={}", key.extract::<String>()?, toml(&value)?))).collect()
}

/// A value in TOML.
fn toml(value: &Bound<'_, PyAny>) -> PyResult<String> {
    let list = |items: &mut dyn Iterator<Item = Bound<'_, PyAny>>| -> PyResult<String> {
        Ok(format!("[{}]", items.map(|item| toml(&item)).collect::<PyResult<Vec<_>>>()?.join(", ")))
    };
    if let Ok(text) = value.cast::<PyString>() {
        return serde_json::to_string(&text.to_cow()?).map_err(crate::error::working);
    }
    if let Ok(truth) = value.cast::<PyBool>() {
        return Ok(truth.is_true().to_string());
    }
    if let Ok(items) = value.cast::<PyList>() {
        return list(&mut items.iter());
    }
    if let Ok(items) = value.cast::<PyTuple>() {
        return list(&mut items.iter());
    }
    if let Ok(table) = value.cast::<PyDict>() {
        let entry = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| -> PyResult<String> {
            let key = serde_json::to_string(&key.extract::<String>()?).map_err(crate::error::working)?;
            Ok(format!("{key} = {}", toml(&value)?))
        };
        return Ok(format!("{{ {} }}", table.iter().map(entry).collect::<PyResult<Vec<_>>>()?.join(", ")));
    }
    // numpy's scalars and arrays.
    if let Ok(items) = value.call_method0("tolist") {
        return if items.is_instance_of::<PyList>() { toml(&items) } else { Ok(items.repr()?.to_string()) };
    }
    Ok(value.repr()?.to_string())
}
