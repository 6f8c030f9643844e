//! What can go wrong, and the checks at the door that find it.

/// What can go wrong when a Gaussian process is fitted, queried, changed or read from a file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpError {
    /// Two arrays that must agree in a dimension do not.
    #[error("{what}: expected {expected}, found {found}")]
    Shape {
        /// The array and the dimension at fault, e.g. `"length of y"`.
        what: &'static str,
        /// The size required.
        expected: usize,
        /// The size given.
        found: usize,
    },
    /// There is nothing where at least one entry is needed.
    #[error("{what} is empty")]
    Empty {
        /// The array at fault.
        what: &'static str,
    },
    /// An entry is NaN or infinite.
    #[error("{array}[({row}, {column})] = {value} is not finite")]
    NotFinite {
        /// The array at fault.
        array: &'static str,
        /// Zero-based row.
        row: usize,
        /// Zero-based column.
        column: usize,
        /// The offending value.
        value: f64,
    },
    /// A parameter lies outside its domain.
    #[error("{name} must be {requirement}, got {value:e}")]
    Parameter {
        /// The parameter's name.
        name: &'static str,
        /// Its domain, e.g. `"positive and finite"`.
        requirement: &'static str,
        /// The value given.
        value: f64,
    },
    /// The lower end of a range lies above its upper end.
    #[error("range of {name}: lower {lower:e} is above upper {upper:e}")]
    Range {
        /// The parameter's name.
        name: &'static str,
        /// Lower end given.
        lower: f64,
        /// Upper end given.
        upper: f64,
    },
    /// `K + σₙ² I` has no Cholesky factor in double precision.
    #[error(
        "covariance of {points} points is not positive definite at row {row} with signal variance \
         {signal_variance:e} and noise variance {noise_variance:e}; look for repeated inputs or \
         raise the noise"
    )]
    NotPositiveDefinite {
        /// Number of training points `N`.
        points: usize,
        /// Zero-based row at which the factorisation met a pivot that is not positive.
        row: usize,
        /// The signal variance `σ_f²` in use.
        signal_variance: f64,
        /// The noise variance `σₙ²` in use.
        noise_variance: f64,
    },
    /// No start of the search had a covariance that can be factorised.
    #[error("none of {starts} starts gave a positive-definite covariance of {points} points")]
    NoStartSucceeded {
        /// Starts tried.
        starts: usize,
        /// Number of training points `N`.
        points: usize,
    },
    /// The data cannot determine the coefficients of the mean function.
    #[error(
        "{points} points do not determine the {coefficients} coefficients of the mean (too few \
         points, or an input that is constant or a combination of others)"
    )]
    MeanNotIdentifiable {
        /// Number of training points `N`.
        points: usize,
        /// Number of coefficients of the mean.
        coefficients: usize,
    },
    /// The matrices of a model are larger than what this machine has left.
    #[error(
        "a Gaussian process of {points} points needs {needed_gb:.1} GB of memory for this and the process may \
         have {available_gb:.1} GB: it has room for an exact model of about {0:.0} points; take fewer (the \
         library's sparse model holds more)",
        *points as f64 * (available_gb / needed_gb).sqrt()
    )]
    Memory {
        /// Number of training points `N`.
        points: usize,
        /// Memory needed, in 10⁹ bytes.
        needed_gb: f64,
        /// Memory left, in 10⁹ bytes.
        available_gb: f64,
    },
    /// What was asked for does not exist for this kind of model.
    #[error("{model} has no {feature}")]
    Unsupported {
        /// The kind of model.
        model: &'static str,
        /// What it does not have.
        feature: &'static str,
    },
    /// A predictive variance is not finite, or negative by more than rounding explains.
    #[error("predictive variance at row {row} is {variance:e}")]
    Variance {
        /// Zero-based row of the query.
        row: usize,
        /// The variance computed.
        variance: f64,
    },
    /// An index lies outside the training set.
    #[error("index {index} is outside a training set of {points} points")]
    Index {
        /// The index given.
        index: usize,
        /// Number of training points `N`.
        points: usize,
    },
    /// A saved model is not readable as JSON of the expected form.
    #[error("saved model, line {line}, column {column}: {reason}")]
    Parse {
        /// One-based line.
        line: usize,
        /// One-based column.
        column: usize,
        /// What the reader expected or met there.
        reason: String,
    },
    /// A saved model is of a format or version that this build does not read.
    #[error("saved model: expected {expected}, found {found}")]
    Format {
        /// Format and version that can be read.
        expected: String,
        /// Format and version found.
        found: String,
    },
    /// A saved model reads well, but its parts contradict each other.
    #[error("saved model is corrupt: {what} should be {expected}, is {found}")]
    Corrupt {
        /// The part at fault.
        what: &'static str,
        /// What it should be.
        expected: String,
        /// What it is.
        found: String,
    },
}

/// Result of this crate's fallible functions.
pub type Result<T> = std::result::Result<T, GpError>;

/// Requires `value` to be positive and finite.
pub(crate) fn check_positive(name: &'static str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(GpError::Parameter { name, requirement: "positive and finite", value })
    }
}

/// Requires two sizes to agree.
pub(crate) fn check_len(what: &'static str, expected: usize, found: usize) -> Result<()> {
    if expected == found { Ok(()) } else { Err(GpError::Shape { what, expected, found }) }
}

/// Requires every entry of a row-major array with `columns` columns to be finite.
pub(crate) fn check_finite(array: &'static str, values: &[f64], columns: usize) -> Result<()> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(at) => Err(GpError::NotFinite { array, row: at / columns, column: at % columns, value: values[at] }),
    }
}
