//! CSV files as tables of text, with errors that name file, line and column.

use std::path::{Path, PathBuf};

use crate::error::{ReportError, Result};

/// Most that anything in a run counts to.
const MOST: u64 = 1_000_000_000;

/// A CSV file in memory.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table {
    path: PathBuf,
    pub(crate) header: Vec<String>,
    /// Line in the file and cells.
    pub(crate) rows: Vec<(u64, Vec<String>)>,
    /// Whether the last line was cut off in the middle of being written and left out.
    pub(crate) torn: bool,
}

impl Table {
    /// Parses a table. A last line without its end and with too few cells is left out: an append-only
    /// log of a killed run may end so.
    pub(crate) fn parse(path: &Path, text: &str) -> Result<Table> {
        let fail = |source| ReportError::Csv {
            path: path.to_owned(),
            source,
        };
        let whole = text.ends_with(['\n', '\r']);
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let header: Vec<String> = reader
            .headers()
            .map_err(fail)?
            .iter()
            .map(str::to_owned)
            .collect();
        let mut rows: Vec<(u64, Vec<String>)> = Vec::new();
        for record in reader.records() {
            let record = record.map_err(fail)?;
            // Spreadsheets end a table with lines of nothing but commas.
            if record.iter().all(str::is_empty) {
                continue;
            }
            let line = record.position().map_or(0, csv::Position::line);
            rows.push((line, record.iter().map(str::to_owned).collect()));
        }
        let mut torn = false;
        if !whole && rows.last().is_some_and(|r| r.1.len() <= header.len()) {
            rows.pop();
            torn = true;
        }
        let table = Table {
            path: path.to_owned(),
            header,
            rows,
            torn,
        };
        for (line, cells) in &table.rows {
            if cells.len() != table.header.len() {
                let last = table.header.last().map_or("", String::as_str);
                return Err(table.cell_error(
                    *line,
                    last,
                    &cells.join(","),
                    "as many cells as the header",
                ));
            }
        }
        Ok(table)
    }

    fn cell_error(
        &self,
        line: u64,
        column: &str,
        found: &str,
        expected: &'static str,
    ) -> ReportError {
        ReportError::Cell {
            path: self.path.clone(),
            line,
            column: column.to_owned(),
            found: found.to_owned(),
            expected,
        }
    }

    /// Index of a column, if it is there.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|h| h == name)
    }

    /// Index of a column that must be there.
    pub(crate) fn column(&self, name: &str) -> Result<usize> {
        self.find(name).ok_or_else(|| ReportError::Column {
            path: self.path.clone(),
            column: name.to_owned(),
            found: self.header.join(", "),
        })
    }

    /// A number; an empty cell is NaN, which figures leave out.
    pub(crate) fn number(&self, row: usize, column: usize) -> Result<f64> {
        let (line, cells) = &self.rows[row];
        let text = &cells[column];
        if text.is_empty() {
            return Ok(f64::NAN);
        }
        text.parse()
            .map_err(|_| self.cell_error(*line, &self.header[column], text, "a number"))
    }

    /// A count, small enough to be added to; an empty cell is 0.
    pub(crate) fn count(&self, row: usize, column: usize) -> Result<u64> {
        let (line, cells) = &self.rows[row];
        let text = &cells[column];
        if text.is_empty() {
            return Ok(0);
        }
        let count = text.parse::<u64>().ok().filter(|count| *count <= MOST);
        count.ok_or_else(|| {
            let expected = "a whole number of at most 1,000,000,000";
            self.cell_error(*line, &self.header[column], text, expected)
        })
    }

    /// A word.
    pub(crate) fn word(&self, row: usize, column: usize) -> &str {
        &self.rows[row].1[column]
    }

    /// A word out of a set.
    pub(crate) fn parsed<T>(
        &self,
        row: usize,
        column: usize,
        expected: &'static str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Result<T> {
        let (line, cells) = &self.rows[row];
        parse(&cells[column])
            .ok_or_else(|| self.cell_error(*line, &self.header[column], &cells[column], expected))
    }

    /// A whole column of numbers.
    pub(crate) fn numbers(&self, name: &str) -> Result<Vec<f64>> {
        let column = self.column(name)?;
        (0..self.rows.len())
            .map(|row| self.number(row, column))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_last_line_is_left_out_and_said() {
        let table = Table::parse(Path::new("t.csv"), "a,b\n1,2\n3,").unwrap();
        assert!(table.torn);
        assert_eq!(table.rows.len(), 1);
        let whole = Table::parse(Path::new("t.csv"), "a,b\n1,2\n3,4\n").unwrap();
        assert!(!whole.torn && whole.rows.len() == 2);
    }

    #[test]
    fn a_bad_cell_is_named_with_its_line() {
        let table = Table::parse(Path::new("t.csv"), "a,b\n1,2\n3,x\n").unwrap();
        let beyond = Table::parse(Path::new("t.csv"), "k\n18446744073709551615\n").unwrap();
        let message = beyond.count(0, 0).unwrap_err().to_string();
        assert!(message.contains("t.csv, line 2: column `k`"), "{message}");
        let message = table.number(1, 1).unwrap_err().to_string();
        assert_eq!(
            message,
            "t.csv, line 3: column `b` holds `x`, expected a number"
        );
        assert!(
            table
                .column("c")
                .unwrap_err()
                .to_string()
                .contains("found a, b")
        );
    }
}
