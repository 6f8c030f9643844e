//! Strides as a Python callback sees them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use pyo3::types::PyDict;
use stridemap_lab::run::Watcher;
use stridemap_record::Transition;

use crate::policy::python;

/// A stride as a dictionary.
pub fn stride<'py>(py: Python<'py>, t: &Transition, what: Option<&str>) -> PyResult<Bound<'py, PyDict>> {
    let shown = PyDict::new(py);
    shown.set_item("iteration", t.iteration)?;
    shown.set_item("phase", t.phase.name())?;
    shown.set_item("role", t.role.name())?;
    shown.set_item("what", what)?;
    shown.set_item("episode", t.episode)?;
    shown.set_item("k", t.k)?;
    shown.set_item("time_s", t.time_s)?;
    for (name, values) in
        [("state", &t.state), ("last_action", &t.last_action), ("action", &t.action), ("next_state", &t.next_state)]
    {
        shown.set_item(name, numpy::PyArray1::from_slice(py, values))?;
    }
    shown.set_item("reward", t.reward)?;
    shown.set_item("end", t.end.name())?;
    shown.set_item("fall", t.fall.map(|fall| fall.to_string()))?;
    shown.set_item("measures", python(py, &t.measures)?)?;
    Ok(shown)
}

/// An exception that was raised in a thread of the lab's, until the call that it belongs to ends.
pub type Raised = Arc<Mutex<Option<PyErr>>>;

/// Takes the exception, if there is one.
pub fn take(raised: &Raised) -> Option<PyErr> {
    raised.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// Calls a Python function with every stride. An exception stops the run, and so does `False`.
pub struct Caller {
    /// Who is called.
    pub on_stride: Py<PyAny>,
    /// Stops the run.
    pub stop: Arc<AtomicBool>,
    /// What was raised.
    pub raised: Raised,
}

impl Watcher for Caller {
    fn stride(&mut self, transition: &Transition, what: Option<&str>) {
        let answer = Python::attach(|py| {
            let answer = self.on_stride.call1(py, (stride(py, transition, what)?,))?;
            Ok(answer.extract::<bool>(py).unwrap_or(true))
        });
        match answer {
            Ok(true) => return,
            Ok(false) => {}
            Err(error) => *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error),
        }
        self.stop.store(true, Ordering::Relaxed);
    }
}
