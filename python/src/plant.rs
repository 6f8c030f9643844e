//! The robot of a task, simulated in this process, stride by stride: what `StrideEnv` steps.

use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::PyArray1;
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use stridemap_lab::seed::{Role, stream};
use stridemap_process::{Situation, StrideEnd, StrideProcess};

use crate::error::{of_lab, working};
use crate::parts::blamed;
use crate::policy::python;
use crate::task::TaskLike;

struct Inner {
    plant: stridemap_lab::Plant,
    rng: ChaCha8Rng,
    at: Situation,
}

/// The robot of a task with its gait, seen once per stride.
#[pyclass(module = "stridemap", frozen)]
pub struct Plant(Mutex<Inner>);

impl Plant {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Plant {
    #[new]
    #[pyo3(signature = (task, seed=1))]
    fn new(py: Python<'_>, task: TaskLike, seed: u64) -> PyResult<Self> {
        let task = task.load(None)?;
        let built = py.detach(|| task.ready(seed)?.task.plant());
        let (plant, rng) = (built.map_err(of_lab)?, stream(seed, Role::Run, 0));
        Ok(Self(Mutex::new(Inner { plant, rng, at: Situation::default() })))
    }

    /// Begins the random stream anew.
    fn seed(&self, seed: u64) {
        self.inner().rng = stream(seed, Role::Run, 0);
    }

    /// Starts the robot afresh and walks it to the section; returns the state there.
    fn reset<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let state = py.detach(|| {
            blamed((|| {
                let mut inner = self.inner();
                let Inner { plant, rng, at } = &mut *inner;
                *at = plant.reset(rng)?;
                Ok(at.state.clone())
            })())
        })?;
        Ok(PyArray1::from_slice(py, &state))
    }

    /// A stride with an action. Returns state, reward, and how it ended: "crossing", "fell" or "no_crossing".
    ///
    /// Raises:
    ///     WorkingError: if the stride was aborted, or the robot was not reset.
    fn step<'py>(&self, py: Python<'py>, action: Vec<f64>) -> PyResult<(Bound<'py, PyArray1<f64>>, f64, &'static str)> {
        let (stride, reason) = py.detach(|| {
            blamed((|| {
                let mut inner = self.inner();
                let Inner { plant, rng, at } = &mut *inner;
                let stride = plant.stride(&action, rng)?;
                at.clone_from(&stride.next);
                Ok((stride, plant.abort_reason().map(ToString::to_string)))
            })())
        })?;
        if stride.end == StrideEnd::Aborted {
            return Err(working(format!("the stride was aborted: {}", reason.unwrap_or_default())));
        }
        Ok((PyArray1::from_slice(py, &stride.next.state), stride.reward, stride.end.name()))
    }

    /// The action applied last, after bounds and rate limits.
    fn last_action<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner().at.last_action)
    }

    /// What the next stride is asked to do; empty in tasks with one purpose.
    fn goal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner().at.goal)
    }

    /// What was measured of the last stride, by name.
    fn measures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let measures = *self.inner().plant.last_measures();
        python(py, &measures)
    }

    /// Why the last stride was a fall or a stall, if it was.
    fn fall(&self) -> Option<String> {
        self.inner().plant.last_fall().map(|fall| fall.to_string())
    }
}
