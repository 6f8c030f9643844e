//! Tables of numbers as people have them: CSV with a header, or columns without one.

use std::path::{Path, PathBuf};

use stridemap_record::{LARGEST, RecordError, files};

use crate::failure::Failure;

/// A table of cells with the names of its columns.
pub struct Table {
    path: PathBuf,
    /// Names of the columns, from the header or given.
    pub names: Vec<String>,
    /// Line in the file and cells.
    rows: Vec<(usize, Vec<String>)>,
}

/// Units at the end of names, which may be left out where a column is named.
const UNITS: [&str; 12] = ["_deg_s", "_rad_s", "_m_s2", "_m_s", "_deg", "_rad", "_nm", "_kg", "_hz", "_s", "_m", "_n"];

fn bare(name: &str) -> &str {
    UNITS.iter().find_map(|unit| name.strip_suffix(unit)).unwrap_or(name)
}

impl Table {
    /// Reads a table. Without a header columns are `time_s` (if the first grows), `interval_s` (if one is the
    /// difference of times) and `column_1`, `column_2`, ...
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let fault = |line, problem: String| RecordError::content(path, line, problem);
        let text = files::read_text(path)?;
        let text = text.trim_start_matches('\u{feff}');
        let mut lines = text.lines().enumerate().filter(|(_, line)| {
            let line = line.trim();
            !line.is_empty() && !line.starts_with('#') && !line.chars().all(|c| ",;\t ".contains(c))
        });
        let first = lines.next().ok_or_else(|| fault(None, "is empty: a table of strides has a row each".into()))?;
        let mark = [',', ';', '\t'].into_iter().find(|mark| first.1.contains(*mark));
        let cells = |line: &str| -> Vec<String> {
            let clean = |cell: &str| cell.trim().trim_matches('"').to_owned();
            match mark {
                Some(mark) => line.split(mark).map(clean).collect(),
                None => line.split_whitespace().map(clean).collect(),
            }
        };
        let head = cells(first.1);
        let has_header = head.iter().any(|cell| cell.parse::<f64>().is_err() && !cell.is_empty());
        let mut rows: Vec<(usize, Vec<String>)> = Vec::new();
        if !has_header {
            rows.push((first.0 + 1, head.clone()));
        }
        rows.extend(lines.map(|(at, line)| (at + 1, cells(line))));
        for (line, row) in &rows {
            if row.len() != head.len() {
                let problem = format!("{} cells where the first line has {}", row.len(), head.len());
                return Err(fault(Some(*line), problem).into());
            }
        }
        let mut table = Self { path: path.into(), names: head, rows };
        if !has_header {
            table.names = (1..=table.names.len()).map(|i| format!("column_{i}")).collect();
            table.name_columns();
        } else if let Some(twice) = table.names.iter().enumerate().find(|(i, n)| table.names[..*i].contains(n)) {
            return Err(fault(Some(first.0 + 1), format!("two columns are called {:?}", twice.1)).into());
        }
        Ok(table)
    }

    /// A table of numbers that were read elsewhere.
    pub fn of(path: &Path, names: &[&str], numbers: &[Vec<f64>]) -> Self {
        let row = |(k, row): (usize, &Vec<f64>)| (k + 1, row.iter().map(f64::to_string).collect());
        Self {
            path: path.into(),
            names: names.iter().map(|&name| name.into()).collect(),
            rows: numbers.iter().enumerate().map(row).collect(),
        }
    }

    /// Names the columns of a table without a header by what is in them.
    fn name_columns(&mut self) {
        let columns: Vec<Option<Vec<f64>>> = (0..self.names.len()).map(|c| self.numbers(c).ok()).collect();
        let Some(Some(time)) = columns.first() else { return };
        if time.len() < 3 || time.windows(2).any(|t| t[1] <= t[0]) {
            return;
        }
        self.names[0] = "time_s".into();
        for (column, name) in columns.iter().zip(&mut self.names).skip(1) {
            let Some(values) = column else { continue };
            let same = time.windows(2).zip(&values[1..]).filter(|(t, v)| (t[1] - t[0] - **v).abs() < 2e-3 * v.abs());
            if 10 * same.count() > 9 * (time.len() - 1) {
                *name = "interval_s".into();
                return;
            }
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// An error about a cell: file, line, column.
    pub fn fault(&self, row: Option<usize>, problem: String) -> Failure {
        let line = row.and_then(|row| self.rows.get(row)).map(|(line, _)| *line);
        RecordError::content(&self.path, line, problem).into()
    }

    /// The column of a name, which may lack its unit.
    pub fn find(&self, name: &str) -> Option<usize> {
        let exact = self.names.iter().position(|n| n == name);
        exact.or_else(|| {
            let mut alike = self.names.iter().enumerate().filter(|(_, n)| bare(n) == name);
            alike.next().map(|(i, _)| i).filter(|_| alike.next().is_none())
        })
    }

    /// The column of a name; an error that says which there are.
    pub fn column(&self, name: &str) -> Result<usize, Failure> {
        self.find(name).ok_or_else(|| {
            let known = self.names.join(", ");
            self.fault(None, format!("has no column {name:?}; its columns are {known}"))
        })
    }

    /// A whole column of numbers.
    pub fn numbers(&self, column: usize) -> Result<Vec<f64>, Failure> {
        let number = |(row, (_, cells)): (usize, &(usize, Vec<String>))| match cells[column].parse::<f64>() {
            Ok(x) if x.is_finite() && x.abs() <= LARGEST => Ok(x),
            _ => {
                let (name, cell) = (&self.names[column], &cells[column]);
                Err(self.fault(Some(row), format!("column {name}: {cell:?} is not a finite number of at most 1e12")))
            }
        };
        self.rows.iter().enumerate().map(number).collect()
    }

    /// A whole column of words.
    pub fn words(&self, column: usize) -> Vec<&str> {
        self.rows.iter().map(|(_, cells)| cells[column].as_str()).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

    use super::*;

    fn table(text: &str) -> Result<Table, Failure> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        Table::read(&path)
    }

    #[test]
    fn a_table_without_a_header_is_named_by_what_is_in_it() {
        let t = table("1.0 0.9\n2.1  1.1\n3.0 0.9\n4.2 1.2\n").unwrap();
        assert_eq!(t.names, ["time_s", "interval_s"]);
        assert_eq!(t.find("interval"), Some(1));
        assert_eq!(t.numbers(1).unwrap(), [0.9, 1.1, 0.9, 1.2]);
        assert_eq!(table("3 1\n2 1\n").unwrap().names, ["column_1", "column_2"]);
    }

    #[test]
    fn a_fault_is_told_by_file_line_and_column() {
        let t = table("roll_deg;side\n1;left\n\nx;right\n").unwrap();
        let said = format!("{:?}", t.numbers(0).unwrap_err());
        assert!(said.contains("t.csv") && said.contains("4") && said.contains("column roll_deg"), "{said}");
        assert!(table("a,b\n1\n").is_err() && table("").is_err() && table("a,a\n1,2\n").is_err());
        assert!(format!("{:?}", t.column("pitch").unwrap_err()).contains("roll_deg, side"));
    }
}
