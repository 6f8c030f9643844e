//! CSV files as tables of text, with errors that name file, line and column.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::error::RecordError;

/// Largest size of a number that one can reckon with, in whatever unit: products of a few of them are finite.
pub const LARGEST: f64 = 1e12;

/// Most that anything in a run counts to.
const MOST: usize = 1_000_000_000;

/// Which rows of a table are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// So many.
    First(usize),
    /// Every one.
    All,
    /// Every one but a last line that was cut off: a process was killed in the middle of it.
    Whole,
}

/// A CSV file as any program writes it: with a byte order mark, quotes, blank lines and whatever line ends;
/// columns in any order.
pub(crate) struct Table {
    path: PathBuf,
    pub(crate) header: csv::StringRecord,
    columns: HashMap<String, usize>,
    rows: Vec<csv::StringRecord>,
    /// Whether a last line was cut off and is left out.
    pub(crate) torn: bool,
}

impl Table {
    /// Parses the text of a file.
    pub(crate) fn parse(path: &Path, text: &str, rows: Rows) -> Result<Self, RecordError> {
        let fault = |error: csv::Error| {
            let line = error.position().map(|at| at.line() as usize);
            RecordError::content(path, line, format!("is no CSV: {error}"))
        };
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
        let header = reader.headers().map_err(fault)?.clone();
        let columns = header.iter().enumerate();
        let mut table = Self {
            path: path.into(),
            columns: columns.map(|(at, name)| (name.to_owned(), at)).collect(),
            header,
            rows: Vec::new(),
            torn: false,
        };
        for record in reader.records() {
            if matches!(rows, Rows::First(n) if table.rows.len() >= n) {
                break;
            }
            let cells = record.map_err(fault)?;
            // Spreadsheets end a table with lines of nothing but commas.
            if !cells.iter().all(str::is_empty) {
                table.rows.push(cells);
            }
        }
        let last = table.rows.last().map_or(usize::MAX, csv::StringRecord::len);
        if rows == Rows::Whole && !text.ends_with(['\n', '\r']) && last <= table.header.len() {
            table.rows.pop();
            table.torn = true;
        }
        Ok(table)
    }

    /// Whether there is such a column.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.columns.contains_key(name)
    }

    pub(crate) fn fault(&self, line: Option<usize>, problem: String) -> RecordError {
        RecordError::content(&self.path, line, problem)
    }

    /// Its rows; an error for one that has not as many cells as the header.
    pub(crate) fn rows(&self) -> impl Iterator<Item = Result<Row<'_>, RecordError>> {
        self.rows.iter().map(|cells| {
            let row = Row { table: self, cells };
            if cells.len() == self.header.len() {
                return Ok(row);
            }
            let (found, columns) = (cells.len(), self.header.len());
            Err(row.fault(format!("{found} cells under {columns} columns")))
        })
    }

    /// A whole column of numbers.
    pub(crate) fn numbers(&self, name: &str) -> Result<Vec<f64>, RecordError> {
        self.rows().map(|row| row?.number(name)).collect()
    }

    /// A whole column of counts.
    pub(crate) fn counts(&self, name: &str) -> Result<Vec<usize>, RecordError> {
        self.rows().map(|row| row?.count(name)).collect()
    }
}

/// One row, its cells by the names of their columns.
pub(crate) struct Row<'a> {
    table: &'a Table,
    cells: &'a csv::StringRecord,
}

impl Row<'_> {
    fn fault(&self, problem: String) -> RecordError {
        let line = self.cells.position().map(|at| at.line() as usize);
        self.table.fault(line, problem)
    }

    pub(crate) fn cell(&self, name: &str) -> Result<&str, RecordError> {
        let at = self.table.columns.get(name);
        let cell = at.and_then(|at| self.cells.get(*at));
        cell.ok_or_else(|| self.fault(format!("no column {name}")))
    }

    pub(crate) fn number(&self, name: &str) -> Result<f64, RecordError> {
        let text = self.cell(name)?;
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.fault(format!("{name} = {text:?} is not a finite number"))),
        }
    }

    /// A number that a map is fitted to: of a size one can reckon with, as in a task.
    pub(crate) fn bounded(&self, name: &str) -> Result<f64, RecordError> {
        let value = self.number(name)?;
        if value.abs() > LARGEST {
            let bound = format!("{name} = {value:e} is larger than {LARGEST:e} in size");
            return Err(self.fault(bound));
        }
        Ok(value)
    }

    /// Zero where there is no such column.
    pub(crate) fn optional(&self, name: &str) -> Result<f64, RecordError> {
        if self.table.has(name) { self.number(name) } else { Ok(0.0) }
    }

    pub(crate) fn count(&self, name: &str) -> Result<usize, RecordError> {
        let text = self.cell(name)?;
        let count = text.parse::<usize>().ok().filter(|count| *count <= MOST);
        count.ok_or_else(|| {
            let bound = "is not a whole number of at most 1000000000";
            self.fault(format!("{name} = {text:?} {bound}"))
        })
    }

    /// The one of several values whose word the cell holds.
    pub(crate) fn word<T: Copy>(
        &self,
        name: &str,
        values: &[T],
        word: impl Fn(T) -> &'static str,
    ) -> Result<T, RecordError> {
        let text = self.cell(name)?;
        let known = values.iter().find(|value| word(**value) == text);
        known.copied().ok_or_else(|| {
            let words: Vec<&str> = values.iter().map(|value| word(*value)).collect();
            self.fault(format!("{name} = {text:?}; it is one of {}", words.join(", ")))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_last_line_is_left_out_and_said() {
        let table = |text| Table::parse(Path::new("t.csv"), text, Rows::Whole).unwrap();
        let torn = table("a,b\n1,2\n3,");
        assert!(torn.torn && torn.rows().count() == 1);
        let whole = table("a,b\n1,2\n3,4\n");
        assert!(!whole.torn && whole.rows().count() == 2);
    }
}
