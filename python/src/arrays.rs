//! numpy arrays in and out.

use numpy::ndarray::{Array, Dimension, IxDyn};
use numpy::{AllowTypeChange, IntoPyArray, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::error::request;

/// Anything that numpy turns into an array of numbers.
pub type Numbers<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

/// Rows of numbers, and whether a single one was given as such.
#[derive(Clone, Debug)]
pub struct Matrix {
    /// Row by row.
    pub values: Vec<f64>,
    /// Numbers in a row.
    pub width: usize,
    /// Whether it was one row without an axis of rows.
    pub is_single: bool,
}

impl Matrix {
    /// Reads `(width,)` or `(N, width)`.
    pub fn read(given: &Numbers<'_>, width: usize, what: &str) -> PyResult<Self> {
        let view = given.as_array();
        let is_single = view.ndim() == 1;
        let found = view.shape().last().copied().unwrap_or(0);
        if view.ndim() == 0 || view.ndim() > 2 || found != width {
            return Err(request(format!("{what} has shape {:?}; it needs (N, {width}) or ({width},)", view.shape())));
        }
        let values: Vec<f64> = view.iter().copied().collect();
        if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
            return Err(request(format!("{what} holds {bad}; it needs finite numbers")));
        }
        Ok(Self { values, width, is_single })
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.values.len() / self.width.max(1)
    }

    /// Row `i`, or the only one.
    pub fn row(&self, i: usize) -> &[f64] {
        let i = if self.is_single { 0 } else { i };
        &self.values[i * self.width..(i + 1) * self.width]
    }
}

/// How many rows several arguments have together; single ones go with every row.
pub fn rows_together(all: &[(&str, &Matrix)]) -> PyResult<(usize, bool)> {
    let mut rows: Option<(usize, &str)> = None;
    for (what, matrix) in all.iter().filter(|(_, m)| !m.is_single) {
        match rows {
            Some((n, first)) if n != matrix.len() => {
                return Err(request(format!("{what} has {} rows where {first} has {n}", matrix.len())));
            }
            _ => rows = Some((matrix.len(), what)),
        }
    }
    Ok((rows.map_or(1, |r| r.0), rows.is_none()))
}

/// An array of a shape, as numpy's.
pub fn array<'py, D: Dimension>(py: Python<'py>, shape: D, values: Vec<f64>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let array = Array::from_shape_vec(shape, values).map_err(crate::error::working)?;
    Ok(array.into_dyn().into_pyarray(py))
}

/// An array of rows of this shape; without the axis of rows where a single one was asked for.
pub fn shaped<'py>(
    py: Python<'py>,
    is_single: bool,
    rows: usize,
    shape: &[usize],
    values: Vec<f64>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let whole: Vec<usize> = (!is_single).then_some(rows).into_iter().chain(shape.iter().copied()).collect();
    array(py, IxDyn(&whole), values)
}

/// What a Python function answered, as numbers of a shape.
pub fn answered(answer: &Bound<'_, PyAny>, shape: &[usize], what: &str) -> PyResult<Vec<f64>> {
    let numbers: Numbers<'_> = answer.extract()?;
    let view = numbers.as_array();
    let count: usize = shape.iter().product();
    if view.len() != count {
        return Err(request(format!("{what} answered shape {:?}; it needs {shape:?}", view.shape())));
    }
    let _ = numbers.readonly();
    Ok(view.iter().copied().collect())
}
