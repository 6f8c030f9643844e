//! Tables: numpy arrays by column, and Arrow without copies for pandas, polars and pyarrow.

use std::path::Path;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::types::{Float64Type, Int64Type};
use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, RecordBatchIterator, StringArray};
use arrow_schema::{DataType, Field, Schema};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict, PyList};
use stridemap_record::RecordError;

use crate::error::{of_lab, working};

/// A table of a run. `table["reward"]` is a numpy array; `pandas.DataFrame.from_arrow(table)`, `polars.DataFrame(table)`
/// and `pyarrow.table(table)` take it without copies (`__arrow_c_stream__`).
#[pyclass(module = "stridemap", frozen)]
pub struct Table(RecordBatch);

/// A column of cells: whole numbers, numbers (an empty cell is NaN), or words.
fn column(cells: &[&str]) -> (DataType, ArrayRef) {
    let whole: Option<Vec<i64>> = cells.iter().map(|c| c.parse().ok()).collect();
    if let Some(whole) = whole.filter(|w| !w.is_empty()) {
        return (DataType::Int64, Arc::new(Int64Array::from(whole)));
    }
    let number = |c: &&str| if c.is_empty() { Some(f64::NAN) } else { c.parse::<f64>().ok() };
    let numbers: Option<Vec<f64>> = cells.iter().map(number).collect();
    match numbers.filter(|_| cells.is_empty() || cells.iter().any(|c| !c.is_empty())) {
        Some(numbers) => (DataType::Float64, Arc::new(Float64Array::from(numbers))),
        None => (DataType::Utf8, Arc::new(StringArray::from(cells.to_vec()))),
    }
}

impl Table {
    /// Reads a CSV file of a run. A last line that was cut off is left out.
    pub fn read(path: &Path) -> PyResult<Self> {
        let fault = |why: String| of_lab(RecordError::content(path, None, why));
        let text = std::fs::read_to_string(path).map_err(|e| of_lab(RecordError::file(path, "read")(e)))?;
        let whole = text.rfind('\n').map_or(text.as_str(), |end| &text[..=end]);
        let mut reader = csv::Reader::from_reader(whole.as_bytes());
        let header = reader.headers().map_err(|e| fault(e.to_string()))?.clone();
        let rows: Vec<csv::StringRecord> =
            reader.records().collect::<Result<_, _>>().map_err(|e| fault(e.to_string()))?;
        let columns = header.iter().enumerate().map(|(i, name)| {
            let cells: Vec<&str> = rows.iter().map(|row| row.get(i).unwrap_or_default()).collect();
            let (kind, values) = column(&cells);
            (Field::new(name, kind, false), values)
        });
        let (fields, values): (Vec<Field>, Vec<ArrayRef>) = columns.unzip();
        RecordBatch::try_new(Arc::new(Schema::new(fields)), values).map(Self).map_err(working)
    }
}

#[pymethods]
impl Table {
    /// The names of the columns.
    #[getter]
    fn columns(&self) -> Vec<String> {
        self.0.schema().fields().iter().map(|field| field.name().clone()).collect()
    }

    fn __len__(&self) -> usize {
        self.0.num_rows()
    }

    /// A column as a numpy array: of floats, integers, or words.
    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let Some(values) = self.0.column_by_name(name) else {
            return Err(PyKeyError::new_err(format!("{name:?}; there are {}", self.columns().join(", "))));
        };
        Ok(match values.data_type() {
            DataType::Int64 => PyArray1::from_slice(py, values.as_primitive::<Int64Type>().values()).into_any(),
            DataType::Float64 => values.as_primitive::<Float64Type>().values().to_vec().into_pyarray(py).into_any(),
            _ => {
                let words = PyList::new(py, values.as_string::<i32>().iter().map(Option::unwrap_or_default))?;
                py.import("numpy")?.call_method1("array", (words,))?
            }
        })
    }

    /// Every column by name.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for name in self.columns() {
            all.set_item(&name, self.__getitem__(py, &name)?)?;
        }
        Ok(all)
    }

    /// The Arrow PyCapsule interface.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema; // A wish; the consumer casts.
        let batches = RecordBatchIterator::new([Ok(self.0.clone())], self.0.schema());
        let stream = FFI_ArrowArrayStream::new(Box::new(batches));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    fn __repr__(&self) -> String {
        format!("Table({} rows: {})", self.0.num_rows(), self.columns().join(", "))
    }
}
