//! What can go wrong between a run directory and a picture.

use std::path::PathBuf;

/// Why a figure or a report could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A file or directory could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A JSON file is not what its format says.
    #[error("{path}: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What was expected, with line and column.
        source: serde_json::Error,
    },
    /// A run could not be composed as MCAP.
    #[error("{path}: cannot be composed as MCAP: {reason}")]
    Mcap {
        /// The file.
        path: PathBuf,
        /// What was wrong.
        reason: String,
    },
    /// A CSV file is not a table.
    #[error("{path}: {source}")]
    Csv {
        /// The file.
        path: PathBuf,
        /// What was found, with its line.
        source: csv::Error,
    },
    /// A column that the format promises is absent.
    #[error("{path}: no column `{column}`; found {found}")]
    Column {
        /// The file.
        path: PathBuf,
        /// The column looked for.
        column: String,
        /// The columns that are there.
        found: String,
    },
    /// A cell is not what its column holds.
    #[error("{path}, line {line}: column `{column}` holds `{found}`, expected {expected}")]
    Cell {
        /// The file.
        path: PathBuf,
        /// Line in the file, the header being line 1.
        line: u64,
        /// The column.
        column: String,
        /// The text of the cell.
        found: String,
        /// What a cell of this column holds.
        expected: &'static str,
    },
    /// Two columns of a figure's data that must be equally long are not.
    #[error("{figure}: `{column}` has {found} values, expected {expected}")]
    Shape {
        /// Stem of the figure.
        figure: String,
        /// The column.
        column: String,
        /// Its length.
        found: usize,
        /// The length that it should have.
        expected: usize,
    },
    /// A value to be drawn is NaN or infinite.
    #[error("{figure}: `{column}` holds a value that is not finite, at index {index}")]
    NotFinite {
        /// Stem of the figure.
        figure: String,
        /// The column.
        column: String,
        /// Where in the column.
        index: usize,
    },
    /// There is nothing to draw.
    #[error("{figure}: no data: {what}")]
    Empty {
        /// Stem of the figure.
        figure: String,
        /// What is missing.
        what: String,
    },
    /// The SVG could not be turned into pixels.
    #[error("{figure}: cannot rasterise the SVG: {what}")]
    Raster {
        /// Stem of the figure.
        figure: String,
        /// What the rasteriser said.
        what: String,
    },
}

/// Result of reading or drawing.
pub type Result<T> = std::result::Result<T, ReportError>;
