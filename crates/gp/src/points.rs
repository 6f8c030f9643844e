//! A borrowed row-major matrix of inputs.

use crate::error::{GpError, Result, check_finite};

/// Inputs, one row a point: a borrowed row-major matrix of shape `(N, D)`.
///
/// # Example
///
/// ```
/// use stridemap_gp::Points;
///
/// let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
/// let points = Points::new(&values, 2)?;
/// assert_eq!((points.len(), points.dims()), (3, 2));
/// assert_eq!(points.row(1), [2.0, 3.0]);
/// # Ok::<(), stridemap_gp::GpError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Points<'a> {
    values: &'a [f64],
    dims: usize,
}

impl<'a> Points<'a> {
    /// Views `values` as rows of `dims` entries.
    ///
    /// # Errors
    ///
    /// - [`GpError::Empty`] if `dims` is zero.
    /// - [`GpError::Shape`] if `values` is not a whole number of rows.
    /// - [`GpError::NotFinite`] if an entry is NaN or infinite; it names row and column.
    pub fn new(values: &'a [f64], dims: usize) -> Result<Self> {
        if dims == 0 {
            return Err(GpError::Empty { what: "columns of points" });
        }
        let whole = values.len() / dims * dims;
        if whole != values.len() {
            return Err(GpError::Shape {
                what: "entries of points (whole rows)",
                expected: whole + dims,
                found: values.len(),
            });
        }
        check_finite("points", values, dims)?;
        Ok(Self { values, dims })
    }

    /// Number of points `N`.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len() / self.dims
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Number of input dimensions `D`.
    #[must_use]
    pub fn dims(&self) -> usize {
        self.dims
    }

    /// The entries, row by row.
    #[must_use]
    pub fn values(&self) -> &'a [f64] {
        self.values
    }

    /// Point `i`, shape `(D,)`.
    #[must_use]
    pub fn row(&self, i: usize) -> &'a [f64] {
        &self.values[i * self.dims..(i + 1) * self.dims]
    }

    /// The points, one slice of `D` entries each.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &'a [f64]> {
        self.values.chunks_exact(self.dims)
    }
}
