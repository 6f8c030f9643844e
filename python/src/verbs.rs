//! The verbs: learn, resume, collect, fit, improve, evaluate, analyse, push.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use stridemap_lab::run::{FinishedRun, NoWatcher, RunDirectory, Watcher};
use stridemap_lab::verbs::{self as lab, Request};
use stridemap_lab::{Algorithm, LabError, PushConfig, Task as LabTask, fit_map};
use stridemap_learn::Policy as LabPolicy;
use stridemap_record::{Columns, Fall, InPlace, Measured, Rows, files};

use crate::error::{Fault, of_lab, request};
use crate::interrupt::interruptible;
use crate::map::Map;
use crate::parts::PythonPolicy;
use crate::policy::{Policy, check_fits, python};
use crate::run::{Run, draw};
use crate::stride::{Caller, Raised, take};
use crate::task::{Task, TaskLike, settings};

/// Work on a run that Ctrl-C, a callback that answers `False`, and an exception in it stop.
struct Watched {
    stop: Arc<AtomicBool>,
    raised: Raised,
    watcher: Box<dyn Watcher + Send>,
}

impl Watched {
    fn by(on_stride: Option<Py<PyAny>>) -> Self {
        let (stop, raised) = (Arc::new(AtomicBool::new(false)), Raised::default());
        let watcher: Box<dyn Watcher + Send> = match on_stride {
            Some(on_stride) => Box::new(Caller { on_stride, stop: Arc::clone(&stop), raised: Arc::clone(&raised) }),
            None => Box::new(NoWatcher),
        };
        Self { stop, raised, watcher }
    }

    /// Does work on a run and returns the run; one that the callback stopped is as far as it came.
    fn work(
        self,
        py: Python<'_>,
        work: impl FnOnce(Arc<AtomicBool>, Box<dyn Watcher>) -> Result<PathBuf, Fault> + Send + 'static,
    ) -> PyResult<Run> {
        let Self { stop, raised, watcher } = self;
        let path = interruptible(py, &stop, {
            let stop = Arc::clone(&stop);
            move || match work(stop, watcher) {
                Err(Fault::Lab(LabError::Interrupted { path })) => match take(&raised) {
                    Some(error) => Err(Fault::Python(error)),
                    None => Ok(path),
                },
                other => other,
            }
        })?;
        Ok(Run { path })
    }
}

/// Learns a task on the robot that is simulated in this process, and returns the run.
///
/// Args:
///     task: a `Task`, the name of a built-in one, or the path of a file.
///     seed: the same seed gives the same bytes.
///     out: the run's directory; `runs/TASK-SEED` if left out.
///     set: other values, by dotted key.
///     on_stride: called with every stride on the robot, a dictionary; `False` ends the run there.
///     report: whether `report.html` is written at the end.
///
/// Raises:
///     RequestError: for a wrong task or an occupied directory, with file, line and key.
///     WorkingError: for what goes wrong on the way; what was gathered is in the directory.
#[pyfunction]
#[pyo3(signature = (task, seed=1, out=None, set=None, on_stride=None, report=true))]
pub fn learn(
    py: Python<'_>,
    task: TaskLike,
    seed: u64,
    out: Option<PathBuf>,
    set: Option<&Bound<'_, PyDict>>,
    on_stride: Option<Py<PyAny>>,
    report: bool,
) -> PyResult<Run> {
    let task = task.load(set)?;
    Watched::by(on_stride).work(py, move |stop, watcher| {
        let loaded = task.ready(seed)?;
        lab::refuse_misfit(&loaded.task, seed)?;
        let path = lab::run_path(out.as_deref(), &loaded.task, seed);
        let request = Request { name: &task.named, sets: &task.sets, robot: None, seed, revision: None };
        let record = request.provenance("learn", &loaded)?;
        let mut directory = RunDirectory::create(&path, &loaded.task, &record, stop, watcher)?;
        let mut algorithm = Algorithm::new(&loaded.task, seed)?;
        lab::finish(&mut algorithm, &mut directory)?;
        drop(directory);
        if report {
            draw(&path)?;
        }
        Ok(path)
    })
}

/// Goes on with a run that ended before its end, with the same result.
#[pyfunction]
#[pyo3(signature = (run, on_stride=None, report=true))]
pub fn resume(py: Python<'_>, run: RunLike, on_stride: Option<Py<PyAny>>, report: bool) -> PyResult<Run> {
    let path = run.path();
    Watched::by(on_stride).work(py, move |stop, watcher| {
        let run = FinishedRun::open(&path, &[])?;
        let (mut directory, progress) = RunDirectory::resume(&run, stop, watcher)?;
        if !run.is_complete() {
            let mut algorithm = Algorithm::resume(&run.task, run.provenance.seed, progress)?;
            directory.goes_on()?;
            lab::finish(&mut algorithm, &mut directory)?;
        }
        drop(directory);
        if report {
            draw(&path)?;
        }
        Ok(path)
    })
}

/// Makes the next batch of strides on the robot: of a run, or of a task whose run begins with it.
#[pyfunction]
#[pyo3(signature = (task, seed=1, out=None, set=None, on_stride=None))]
pub fn collect(
    py: Python<'_>,
    task: TaskOrRun,
    seed: u64,
    out: Option<PathBuf>,
    set: Option<&Bound<'_, PyDict>>,
    on_stride: Option<Py<PyAny>>,
) -> PyResult<Run> {
    let watched = Watched::by(on_stride);
    let task = match task.run_path() {
        Ok(path) => {
            if out.is_some() || set.is_some() {
                return Err(request("a run goes on in its own directory with its own task"));
            }
            return watched.work(py, move |stop, watcher| {
                let run = FinishedRun::open(&path, &[])?;
                let (mut directory, progress) = RunDirectory::resume(&run, stop, watcher)?;
                lab::refuse_batch(&run, &progress)?;
                let mut algorithm = Algorithm::resume(&run.task, run.provenance.seed, progress)?;
                lab::next_batch(&run, &mut algorithm, &mut directory)?;
                Ok(path)
            });
        }
        Err(task) => task.load(set)?,
    };
    watched.work(py, move |stop, watcher| {
        let loaded = task.ready(seed)?;
        lab::refuse_misfit(&loaded.task, seed)?;
        let path = lab::run_path(out.as_deref(), &loaded.task, seed);
        let request = Request { name: &task.named, sets: &task.sets, robot: None, seed, revision: None };
        let record = request.provenance("collect", &loaded)?;
        let mut directory = RunDirectory::create(&path, &loaded.task, &record, stop, watcher)?;
        let mut algorithm = Algorithm::new(&loaded.task, seed)?;
        algorithm.collect(&mut directory)?;
        directory.write_summary(&algorithm.progress)?;
        Ok(path)
    })
}

/// Fits the map to all training strides of a run, or of a CSV file of strides of a task.
#[pyfunction]
#[pyo3(signature = (source, task=None, seed=1, set=None))]
pub fn fit(
    py: Python<'_>,
    source: RunLike,
    task: Option<TaskLike>,
    seed: u64,
    set: Option<&Bound<'_, PyDict>>,
) -> PyResult<Map> {
    let path = source.path();
    let stop = Arc::default();
    if path.is_dir() {
        let sets = settings(set)?;
        return interruptible(py, &stop, move || {
            let run = FinishedRun::open(&path, &sets)?;
            let (seed, iteration) = (run.provenance.seed, run.progress.iterations.len());
            let map = fit_map(&run.task, &run.progress.transitions, &run.progress.in_place(), seed, iteration)?;
            Ok(Map::of(map, Arc::new(run.task)))
        });
    }
    let task = task.ok_or_else(|| request("a table of strides needs its task"))?.load(set)?;
    interruptible(py, &stop, move || {
        let task = task.loaded.task;
        let strides = Columns::new(&task.process_spec()?).read(&path, Rows::All)?;
        let map = fit_map(&task, &strides, &InPlace::default(), seed, 1)?;
        Ok(Map::of(map, Arc::new(task)))
    })
}

/// Improves the policy of a run in the map of its strides.
#[pyfunction]
pub fn improve(py: Python<'_>, run: RunLike) -> PyResult<Run> {
    let path = run.path();
    Watched::by(None).work(py, move |stop, watcher| {
        let run = FinishedRun::open(&path, &[])?;
        let (mut directory, progress) = RunDirectory::resume(&run, stop, watcher)?;
        let here = LabTask { link: None, ..run.task.clone() };
        let mut algorithm = Algorithm::resume(&here, run.provenance.seed, progress)?;
        lab::improve(&mut algorithm, &mut directory)?;
        Ok(path)
    })
}

/// The task and the policy that a verb applies.
fn applied(
    run: RunLike,
    policy: Option<PolicyLike>,
    nominal: bool,
    set: Option<&Bound<'_, PyDict>>,
) -> PyResult<(LabTask, Box<dyn LabPolicy>)> {
    let run = FinishedRun::open(&run.path(), &settings(set)?).map_err(of_lab)?;
    let seed = run.provenance.seed;
    let task = Task::of_run(run.path.clone(), run.task.clone()).ready(seed).map_err(of_lab)?.task;
    let policy = match policy {
        Some(PolicyLike::Own(policy)) => {
            let actions = task.action.len();
            return Ok((task, Box::new(PythonPolicy { policy, actions })));
        }
        Some(PolicyLike::Policy(policy)) => (*policy.0).clone(),
        None if nominal => task.nominal_policy().map_err(of_lab)?,
        None => run.policy().map_err(of_lab)?,
    };
    check_fits(&policy, &task).map_err(of_lab)?;
    Ok((task, Box::new(policy)))
}

/// A policy as an argument: a `Policy`, or a function from the state to an action.
#[derive(FromPyObject)]
pub enum PolicyLike {
    /// Stridemap's own.
    Policy(Policy),
    /// A function.
    Own(Py<PyAny>),
}

/// Measures a run's policy, another one, or the nominal gait on the robot, or on one with other values.
#[pyfunction]
#[pyo3(signature = (run, strides=100, seed=1, set=None, policy=None, nominal=false))]
pub fn evaluate<'py>(
    py: Python<'py>,
    run: RunLike,
    strides: usize,
    seed: u64,
    set: Option<&Bound<'py, PyDict>>,
    policy: Option<PolicyLike>,
    nominal: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let (task, policy) = applied(run, policy, nominal, set)?;
    let (measured, falls) = interruptible(py, &Arc::default(), move || {
        let mut plant = task.plant()?;
        let performance = lab::evaluate(&task, &mut plant, &*policy, strides, seed)?;
        let falls: Vec<Fall> = plant.falls().iter().map(|fall| fall.1).collect();
        Ok((Measured::from(performance), falls))
    })?;
    let shown = python(py, &measured)?;
    shown.set_item("causes", python(py, &falls)?)?;
    Ok(shown)
}

/// Says what a run's data and map are worth, and how stable its policy is: as `stridemap analyse RUN --json`.
#[pyfunction]
#[pyo3(signature = (run, set=None))]
pub fn analyse<'py>(py: Python<'py>, run: RunLike, set: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
    let run = FinishedRun::open(&run.path(), &settings(set)?).map_err(of_lab)?;
    let found = interruptible(py, &Arc::default(), move || {
        Ok(stridemap_lab::analyse(&run.task, &run.progress, run.provenance.seed)?)
    })?;
    python(py, &found)
}

/// Pushes the robot under a run's policy, or its nominal gait, and fits its return map. The result goes into the
/// run's directory too, unless other values were set.
#[pyfunction]
#[pyo3(signature = (run, force=None, duration=0.2, strides=160, seed=1, nominal=false, set=None, out=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub fn push<'py>(
    py: Python<'py>,
    run: RunLike,
    force: Option<f64>,
    duration: f64,
    strides: usize,
    seed: u64,
    nominal: bool,
    set: Option<&Bound<'py, PyDict>>,
    out: Option<PathBuf>,
) -> PyResult<Bound<'py, PyAny>> {
    let path = run.path();
    let dir = out.or_else(|| set.is_none().then(|| path.clone()));
    let (task, policy) = applied(run, None, nominal, set)?;
    let outcome = interruptible(py, &Arc::default(), move || {
        let mut plant = task.plant()?;
        let config = PushConfig::of(force, plant.robot().description().mass_kg, duration, strides);
        let outcome = stridemap_lab::push(&mut plant, &*policy, config, seed, &mut |_| Ok(()))?;
        if let Some(dir) = dir {
            let stem = if nominal { "push-nominal" } else { "push" };
            files::create_dir(&dir)?;
            files::write_whole(&dir.join(format!("{stem}.csv")), outcome.table().as_bytes())?;
            files::write_json(&dir.join(format!("{stem}.json")), &outcome)?;
        }
        Ok(outcome)
    })?;
    python(py, &outcome)
}

/// A run as an argument: a `Run`, or the path of its directory.
#[derive(FromPyObject)]
pub enum RunLike<'py> {
    /// Opened.
    Run(PyRef<'py, Run>),
    /// By path.
    Path(PathBuf),
}

impl RunLike<'_> {
    /// Where it lies.
    pub fn path(&self) -> PathBuf {
        match self {
            Self::Run(run) => run.path.clone(),
            Self::Path(path) => path.clone(),
        }
    }
}

/// A run or a task as an argument.
#[derive(FromPyObject)]
pub enum TaskOrRun<'py> {
    /// A run.
    Run(PyRef<'py, Run>),
    /// A task, or the path of either.
    Task(TaskLike),
}

impl TaskOrRun<'_> {
    /// The path of a run, or else the task.
    fn run_path(self) -> Result<PathBuf, TaskLike> {
        match self {
            Self::Run(run) => Ok(run.path.clone()),
            Self::Task(TaskLike::Path(path)) if path.join("config.toml").exists() => Ok(path),
            Self::Task(task) => Err(task),
        }
    }
}
