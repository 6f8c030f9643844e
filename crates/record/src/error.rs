//! What can go wrong with the files of a run.

use std::path::PathBuf;

/// What can go wrong with the files of a run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A file or directory cannot be read or written.
    #[error("{path}: cannot {doing}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What was being done, e.g. `"write"`.
        doing: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A result could not be written where it was asked for; found before the work for it.
    #[error("{path}: cannot be written: {source}")]
    Unwritable {
        /// The file or directory.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// A run is being written by another process.
    #[error("{path}: {source}")]
    Locked {
        /// The run directory.
        path: PathBuf,
        /// Who has it.
        source: stridemap_files::LockError,
    },
    /// A file holds something else than it should.
    #[error("{path}{}: {problem}", line.map(|l| format!(":{l}")).unwrap_or_default())]
    Content {
        /// The file.
        path: PathBuf,
        /// One-based line, where known.
        line: Option<usize>,
        /// What is wrong, and what to do.
        problem: String,
    },
}

impl RecordError {
    /// A file that holds something else than it should.
    pub fn content(path: impl Into<PathBuf>, line: Option<usize>, problem: impl Into<String>) -> Self {
        Self::Content { path: path.into(), line, problem: problem.into() }
    }

    /// A file or directory that cannot be read or written.
    pub fn file(path: impl Into<PathBuf>, doing: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { path, doing, source }
    }

    /// Whether the request itself was wrong, rather than something that happened while working.
    #[must_use]
    pub const fn is_request(&self) -> bool {
        !matches!(self, Self::File { .. })
    }
}
