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
    /// A file of a run is not what it should be.
    #[error(transparent)]
    Record(#[from] stridemap_record::RecordError),
    /// A run could not be composed as MCAP.
    #[error("{path}: cannot be composed as MCAP: {reason}")]
    Mcap {
        /// The file.
        path: PathBuf,
        /// What was wrong.
        reason: String,
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
