//! Policies.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_lab::LabError;
use stridemap_learn::{ConstantPolicy, LinearPolicy, Policy as _, SavedPolicy};
use stridemap_process::{Action, Situation, State};
use stridemap_record::files;

use crate::arrays::{Matrix, Numbers, rows_together, shaped};
use crate::error::{of_lab, request, working};
use crate::task::TaskLike;

/// A policy: what action a stride is asked for, given the state at the section.
///
/// >>> policy = Policy.constant("stepping", [2.0])
/// >>> policy([1.5])
/// array([2.])
#[pyclass(module = "stridemap", frozen, from_py_object)]
#[derive(Clone)]
pub struct Policy(pub Arc<SavedPolicy>);

/// A situation of a state, and of a last action where that is known.
pub fn situation(state: &[f64], last_action: Option<&[f64]>) -> Situation {
    let last_action = last_action.map(Action::from_slice).unwrap_or_default();
    Situation { state: State::from_slice(state), last_action, ..Situation::default() }
}

/// The generator of a row.
pub fn row_rng(seed: u64, row: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(row as u64);
    rng
}

/// A seed: a whole number, or drawn from a numpy generator.
pub fn seed_of(rng: &Bound<'_, PyAny>) -> PyResult<u64> {
    match rng.extract::<u64>() {
        Ok(seed) => Ok(seed),
        Err(_) => rng.call_method1("integers", (1_u64 << 63,))?.extract(),
    }
}

/// A value of Rust's as Python's, by way of JSON.
pub fn python<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(working)?;
    py.import("json")?.call_method1("loads", (text,))
}

impl Policy {
    /// A policy of the lab's.
    pub fn of(policy: SavedPolicy) -> Self {
        Self(Arc::new(policy))
    }

    fn each<'py>(
        &self,
        py: Python<'py>,
        state: &Numbers<'py>,
        last_action: Option<&Numbers<'py>>,
        goal: Option<&Numbers<'py>>,
        of: impl Fn(&SavedPolicy, &Situation, usize) -> Action,
    ) -> PyResult<Bound<'py, PyAny>> {
        let spec = self.0.spec();
        let (n, m, goals) = (spec.state.len(), spec.action.len(), spec.goal.len());
        if goals > 0 && goal.is_none() {
            let names: Vec<&str> = spec.goal.iter().map(|d| d.name.as_str()).collect();
            return Err(request(format!("the policy is asked with goal = [{}]", names.join(", "))));
        }
        let state = Matrix::read(state, n, "state")?;
        let last = last_action.map(|u| Matrix::read(u, m, "last_action")).transpose()?;
        let goal = goal.map(|g| Matrix::read(g, goals, "goal")).transpose()?;
        let mut all = vec![("state", &state)];
        all.extend(last.as_ref().map(|u| ("last_action", u)));
        all.extend(goal.as_ref().map(|g| ("goal", g)));
        let (rows, single) = rows_together(&all)?;
        let mut values = Vec::with_capacity(rows * m);
        for i in 0..rows {
            let mut at = situation(state.row(i), last.as_ref().map(|u| u.row(i)));
            at.goal.extend(goal.iter().flat_map(|g| g.row(i)).copied());
            values.extend(of(&self.0, &at, i));
        }
        Ok(shaped(py, single, rows, &[m], values)?.into_any())
    }
}

#[pymethods]
impl Policy {
    /// The policy that always takes this action.
    #[staticmethod]
    fn constant(task: TaskLike, action: Vec<f64>) -> PyResult<Self> {
        let spec = task.load(None)?.loaded.task.process_spec().map_err(of_lab)?;
        let policy = ConstantPolicy::new(spec, &action).map_err(of_lab)?;
        Ok(Self::of(SavedPolicy::Constant(policy)))
    }

    /// Linear feedback, `action + gain (x - state)`; `gain` has a row per component of the action.
    #[staticmethod]
    fn linear(task: TaskLike, action: Vec<f64>, gain: Vec<Vec<f64>>, state: Vec<f64>) -> PyResult<Self> {
        let spec = task.load(None)?.loaded.task.process_spec().map_err(of_lab)?;
        let policy = LinearPolicy::new(spec, &action, &gain, &state).map_err(of_lab)?;
        Ok(Self::of(SavedPolicy::Linear(policy)))
    }

    /// Reads a policy from a file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        files::read_json(&path).map(Self::of).map_err(of_lab)
    }

    /// Writes the policy into a file.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        files::write_json(&path, &*self.0).map_err(of_lab)
    }

    /// `"constant"`, `"linear"` or `"gaussian_network"`.
    #[getter]
    fn kind(&self) -> &'static str {
        self.0.kind()
    }

    /// The mean action at states of shape `(n,)` or `(N, n)`; of tasks with goals, at goals too.
    #[pyo3(signature = (state, last_action=None, goal=None))]
    fn mean<'py>(
        &self,
        py: Python<'py>,
        state: Numbers<'py>,
        last_action: Option<Numbers<'py>>,
        goal: Option<Numbers<'py>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, &state, last_action.as_ref(), goal.as_ref(), |policy, at, _| policy.mean(at))
    }

    #[pyo3(signature = (state, last_action=None, goal=None))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        state: Numbers<'py>,
        last_action: Option<Numbers<'py>>,
        goal: Option<Numbers<'py>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.mean(py, state, last_action, goal)
    }

    /// The standard deviation of the action.
    #[pyo3(signature = (state, last_action=None, goal=None))]
    fn std<'py>(
        &self,
        py: Python<'py>,
        state: Numbers<'py>,
        last_action: Option<Numbers<'py>>,
        goal: Option<Numbers<'py>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.each(py, &state, last_action.as_ref(), goal.as_ref(), |policy, at, _| policy.std(at))
    }

    /// Draws actions: row i from stream i of the seed `rng` (a number, or a numpy generator that draws one).
    #[pyo3(signature = (state, rng, last_action=None, goal=None))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        state: Numbers<'py>,
        rng: &Bound<'py, PyAny>,
        last_action: Option<Numbers<'py>>,
        goal: Option<Numbers<'py>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let seed = seed_of(rng)?;
        self.each(py, &state, last_action.as_ref(), goal.as_ref(), |policy, at, i| {
            policy.sample(at, &mut row_rng(seed, i))
        })
    }

    /// The policy as it stands in a file.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        python(py, &*self.0)
    }

    /// What it consists of, as numpy arrays by the names in its file.
    #[getter]
    fn arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let numpy = py.import("numpy")?;
        let arrays = PyDict::new(py);
        for (name, value) in self.to_dict(py)?.cast_into::<PyDict>()?.iter() {
            let array = numpy.call_method1("asarray", (value,));
            if let Ok(array) = array
                && array.getattr("dtype")?.getattr("kind")?.extract::<String>()? == "f"
            {
                arrays.set_item(name, array)?;
            }
        }
        Ok(arrays)
    }

    fn __repr__(&self) -> String {
        format!("<stridemap.Policy {}>", self.0.kind())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        let text = serde_json::to_string(&*self.0).map_err(working)?;
        Ok((py.get_type::<Self>().getattr("_rebuild")?, (text,)))
    }

    #[staticmethod]
    fn _rebuild(text: &str) -> PyResult<Self> {
        serde_json::from_str(text).map(Self::of).map_err(working)
    }
}

/// Refuses a policy that was made for another process.
pub fn check_fits(policy: &SavedPolicy, task: &stridemap_lab::Task) -> Result<(), LabError> {
    Ok(policy.check_fits(&task.process_spec()?)?)
}
