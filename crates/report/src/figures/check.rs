//! Checks at the door of every figure: shapes and finiteness.

use crate::error::{ReportError, Result};

/// Refuses a column of another length or with a value that is not finite.
pub(crate) fn column(figure: &str, name: &str, values: &[f64], expected: usize) -> Result<()> {
    if values.len() != expected {
        return Err(ReportError::Shape {
            figure: figure.to_owned(),
            column: name.to_owned(),
            found: values.len(),
            expected,
        });
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(ReportError::NotFinite { figure: figure.to_owned(), column: name.to_owned(), index }),
        None => Ok(()),
    }
}

/// Refuses an empty figure.
pub(crate) fn some(figure: &str, what: &str, n: usize) -> Result<()> {
    present(figure, what, (n > 0).then_some(()))
}

/// What a figure is drawn of, or that there is none.
pub(crate) fn present<T>(figure: &str, what: &str, of: Option<T>) -> Result<T> {
    of.ok_or_else(|| ReportError::Empty { figure: figure.to_owned(), what: what.to_owned() })
}

/// Refuses a set of columns that has not one column per name.
pub(crate) fn named(figure: &str, what: &str, columns: usize, names: usize) -> Result<()> {
    some(figure, what, names)?;
    if columns != names {
        return Err(ReportError::Shape {
            figure: figure.to_owned(),
            column: format!("columns of {what}"),
            found: columns,
            expected: names,
        });
    }
    Ok(())
}
