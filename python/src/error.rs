//! Errors of the rooms as Python exceptions: `stridemap.errors`.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use stridemap_lab::LabError;
use stridemap_record::RecordError;
use stridemap_report::ReportError;

/// Why a call failed: a fault of the lab, or an exception that was raised in a callback.
#[derive(Debug)]
pub enum Fault {
    /// Of a room.
    Lab(LabError),
    /// Of a figure or page.
    Report(ReportError),
    /// Of Python code that was called.
    Python(PyErr),
}

impl<E: Into<LabError>> From<E> for Fault {
    fn from(error: E) -> Self {
        Self::Lab(error.into())
    }
}

/// The exception of a class of `stridemap.errors` with the place of the fault.
fn raised(class: &str, message: String, file: Option<String>, line: Option<usize>, key: Option<String>) -> PyErr {
    let made = Python::attach(|py| -> PyResult<PyErr> {
        let class = py.import("stridemap.errors")?.getattr(class)?;
        let place = PyDict::new(py);
        place.set_item("file", file)?;
        place.set_item("line", line)?;
        place.set_item("key", key)?;
        Ok(PyErr::from_value(class.call((message,), Some(&place))?))
    });
    made.unwrap_or_else(|error| error)
}

/// A wrong request, in words.
pub fn request(message: impl Into<String>) -> PyErr {
    raised("RequestError", message.into(), None, None, None)
}

impl From<Fault> for PyErr {
    fn from(fault: Fault) -> Self {
        let error = match fault {
            Fault::Python(error) => return error,
            Fault::Report(error) => return raised("WorkingError", error.to_string(), None, None, None),
            Fault::Lab(error) => error,
        };
        let class = if error.is_request() { "RequestError" } else { "WorkingError" };
        let text = error.to_string();
        let some = |key: &str| (!key.is_empty()).then(|| key.to_owned());
        match &error {
            LabError::Config(fault) => {
                raised(class, text, fault.file().map(Into::into), fault.line(), some(fault.key()))
            }
            LabError::Invalid(fault) => raised(class, text, None, None, some(&fault.key)),
            LabError::Record(RecordError::Content { path, line, .. }) => {
                raised(class, text, Some(path.display().to_string()), *line, None)
            }
            LabError::Record(RecordError::File { path, .. } | RecordError::Unwritable { path, .. })
            | LabError::RunDirectory { path, .. } => raised(class, text, Some(path.display().to_string()), None, None),
            _ => raised(class, text, None, None, None),
        }
    }
}

/// A fault of the lab as an exception.
pub fn of_lab(error: impl Into<LabError>) -> PyErr {
    Fault::Lab(error.into()).into()
}

/// Any other fault as an exception of the working kind.
pub fn working(error: impl std::fmt::Display) -> PyErr {
    raised("WorkingError", error.to_string(), None, None, None)
}
