//! Files that survive a killed process and a full disk.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use stridemap_files::Lock;

use crate::FORMAT;
use crate::error::RecordError;

/// Writes a whole file, as [`stridemap_files::write_whole`] does.
///
/// # Errors
///
/// [`RecordError::File`]; the old file is then untouched.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    stridemap_files::write_whole(path, bytes).map_err(RecordError::file(path, "write"))
}

/// Whether a file could be written, before the work for it begins; touches nothing.
///
/// # Errors
///
/// [`RecordError::Unwritable`].
pub fn check_file(path: &Path) -> Result<(), RecordError> {
    stridemap_files::check_file(path).map_err(|source| RecordError::Unwritable { path: path.into(), source })
}

/// Whether files could be written into a directory, which need not be there yet; makes nothing.
///
/// # Errors
///
/// [`RecordError::Unwritable`].
pub fn check_dir(path: &Path) -> Result<(), RecordError> {
    stridemap_files::check_dir(path).map_err(|source| RecordError::Unwritable { path: path.into(), source })
}

fn unfit(path: &Path) -> impl FnOnce(serde_json::Error) -> RecordError {
    move |error| RecordError::content(path, None, format!("cannot be written as JSON: {error}"))
}

/// Writes a value as JSON in one line, whole.
///
/// # Errors
///
/// As [`write_whole`].
pub fn write_json_line(path: &Path, value: &impl serde::Serialize) -> Result<(), RecordError> {
    let text = serde_json::to_string(value).map_err(unfit(path))?;
    write_whole(path, text.as_bytes())
}

/// Writes a value as indented JSON with a final newline, whole.
///
/// # Errors
///
/// As [`write_whole`].
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), RecordError> {
    let mut text = serde_json::to_string_pretty(value).map_err(unfit(path))?;
    text.push('\n');
    write_whole(path, text.as_bytes())
}

/// Reads a file of text.
///
/// # Errors
///
/// [`RecordError::File`].
pub fn read_text(path: &Path) -> Result<String, RecordError> {
    fs::read_to_string(path).map_err(RecordError::file(path, "read"))
}

/// Reads a file.
///
/// # Errors
///
/// [`RecordError::File`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, RecordError> {
    fs::read(path).map_err(RecordError::file(path, "read"))
}

/// Reads a JSON file.
///
/// # Errors
///
/// [`RecordError::File`], or [`RecordError::Content`] with the line at fault.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, RecordError> {
    parse_json(path, &read_text(path)?)
}

/// Reads JSON that came from a file; one of another version than [`crate::FORMAT`] is refused by that.
pub(crate) fn parse_json<T: serde::de::DeserializeOwned>(path: &Path, text: &str) -> Result<T, RecordError> {
    #[derive(serde::Deserialize)]
    struct Version {
        format: u32,
    }
    if let Ok(Version { format }) = serde_json::from_str(text)
        && format != FORMAT
    {
        let problem = format!("has format {format}; this version reads format {FORMAT}");
        return Err(RecordError::content(path, None, problem));
    }
    serde_json::from_str(text).map_err(|error| {
        let problem = format!("is damaged or of another kind: {error}");
        RecordError::content(path, Some(error.line()), problem)
    })
}

/// Creates a directory and those above it.
///
/// # Errors
///
/// [`RecordError::File`].
pub fn create_dir(path: &Path) -> Result<(), RecordError> {
    fs::create_dir_all(path).map_err(RecordError::file(path, "create directory"))
}

/// Takes the right to write into a run, for as long as the lock lives.
///
/// # Errors
///
/// [`RecordError::Locked`].
pub fn lock(run: &Path) -> Result<Lock, RecordError> {
    Lock::take(run).map_err(|source| RecordError::Locked { path: run.into(), source })
}

/// Removes what killed processes left aside in a directory.
///
/// # Errors
///
/// [`RecordError::File`].
pub fn sweep(path: &Path) -> Result<(), RecordError> {
    stridemap_files::sweep(path).map_err(RecordError::file(path, "read"))
}

/// How much of a log is kept when it is opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// So many rows; what a killed process wrote after its last checkpoint is dropped.
    Rows(usize),
    /// Every whole line: the log is only ever appended to.
    Lines,
}

/// A log that only grows, one line after another, each handed to the system as it is written.
///
/// Nothing is changed before the first line is appended: then what is not kept is cut off. Lines are bytes: one
/// that cannot be read stays, and costs no other.
pub struct Log {
    path: PathBuf,
    header: String,
    file: Option<File>,
    rows: usize,
    keep: Keep,
    /// Bytes that are kept; 0: the log begins anew.
    kept_bytes: u64,
    cut_line: bool,
}

impl Log {
    /// Opens a log with a header line: a new one if there is none, or what is kept of an old one.
    ///
    /// # Errors
    ///
    /// [`RecordError::File`], or [`RecordError::Content`] if rows are to be kept and an old log holds fewer or begins
    /// with another header.
    pub fn open(path: &Path, header: &str, keep: Keep) -> Result<Self, RecordError> {
        let old = match fs::read(path) {
            Ok(bytes) => bytes,
            Err(error)
                if error.kind() == std::io::ErrorKind::NotFound && matches!(keep, Keep::Lines | Keep::Rows(0)) =>
            {
                Vec::new()
            }
            Err(error) => return Err(RecordError::file(path, "read")(error)),
        };
        let mut log = Self {
            path: path.into(),
            header: header.into(),
            file: None,
            rows: 0,
            keep,
            kept_bytes: 0,
            cut_line: old.last().is_some_and(|byte| *byte != b'\n'),
        };
        let mut ends = old.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(i, _)| i + 1);
        let content = |line, problem| Err(RecordError::content(path, line, problem));
        match keep {
            Keep::Lines => log.kept_bytes = whole_lines(&old),
            Keep::Rows(keep) => {
                // Not even a header: killed at its birth.
                let Some(first) = ends.next().or((keep > 0).then_some(0)) else {
                    return Ok(log);
                };
                if old[..first].strip_suffix(b"\n") != Some(header.as_bytes()) {
                    return content(Some(1), format!("its columns are not those that this version writes: {header}"));
                }
                let rows: Vec<usize> = ends.take(keep).collect();
                if rows.len() < keep {
                    return content(
                        None,
                        format!("holds {} rows where the checkpoint counts {keep}; it was changed since", rows.len()),
                    );
                }
                log.kept_bytes = rows.last().copied().unwrap_or(first) as u64;
                log.rows = keep;
            }
        }
        Ok(log)
    }

    /// Makes the log if it is not there.
    ///
    /// # Errors
    ///
    /// [`RecordError::File`].
    pub fn begin(&mut self) -> Result<&mut File, RecordError> {
        let file = match self.file.take() {
            Some(file) => file,
            None => self.opened()?,
        };
        Ok(self.file.insert(file))
    }

    fn opened(&self) -> Result<File, RecordError> {
        let kept_bytes = match self.keep {
            Keep::Rows(_) => self.kept_bytes,
            // Lines may have come since it was looked at: what a person was asked before the first stride.
            Keep::Lines => fs::read(&self.path).map_or(0, |bytes| whole_lines(&bytes)),
        };
        if kept_bytes == 0 {
            write_whole(&self.path, format!("{}\n", self.header).as_bytes())?;
        }
        let opened = OpenOptions::new().append(true).open(&self.path);
        let opened = opened.and_then(|file| {
            if kept_bytes > 0 && file.metadata()?.len() > kept_bytes {
                file.set_len(kept_bytes)?;
            }
            Ok(file)
        });
        opened.map_err(RecordError::file(&self.path, "open"))
    }

    /// Appends one row and hands it to the system.
    ///
    /// # Errors
    ///
    /// [`RecordError::File`].
    pub fn append(&mut self, row: &str) -> Result<(), RecordError> {
        let written = self.begin()?.write_all(format!("{row}\n").as_bytes());
        written.map_err(RecordError::file(&self.path, "append to"))?;
        self.rows += 1;
        Ok(())
    }

    /// Waits until every row is on the disk.
    ///
    /// # Errors
    ///
    /// [`RecordError::File`].
    pub fn sync(&self) -> Result<(), RecordError> {
        self.file.as_ref().map_or(Ok(()), File::sync_data).map_err(RecordError::file(&self.path, "write"))
    }

    /// Rows so far, the header not counted; of a log of which every line was kept, those appended.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// Whether nothing was kept when the log was opened.
    #[must_use]
    pub const fn is_new(&self) -> bool {
        self.kept_bytes == 0
    }

    /// Whether the last line was cut when the log was opened: a process was killed, or a disk full, in the
    /// middle of it.
    #[must_use]
    pub const fn has_cut_line(&self) -> bool {
        self.cut_line
    }
}

/// Bytes up to the end of the last whole line.
fn whole_lines(bytes: &[u8]) -> u64 {
    let end = bytes.iter().rposition(|byte| *byte == b'\n');
    end.map_or(0, |end| end as u64 + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_keeps_what_the_checkpoint_counts_and_drops_the_rest() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.csv");
        let mut log = Log::open(&path, "a,b", Keep::Rows(0)).unwrap();
        for row in ["1,2", "3,4", "5,6"] {
            log.append(row).unwrap();
        }
        let cut = "a,b\n1,2\n3,4\n5,"; // killed in the middle of a row
        fs::write(&path, cut).unwrap();
        let mut log = Log::open(&path, "a,b", Keep::Rows(2)).unwrap();
        assert!(log.has_cut_line());
        assert_eq!(read_text(&path).unwrap(), cut, "nothing is changed before a row is written");
        log.append("7,8").unwrap();
        assert_eq!(log.rows(), 3);
        assert_eq!(read_text(&path).unwrap(), "a,b\n1,2\n3,4\n7,8\n");
        let short = Log::open(&path, "a,b", Keep::Rows(9)).err().unwrap().to_string();
        assert!(short.contains("holds 3 rows where the checkpoint counts 9"), "{short}");
        assert!(Log::open(&path, "a,c", Keep::Rows(1)).is_err());
    }

    #[test]
    fn a_byte_that_cannot_be_read_costs_no_line_and_only_a_cut_one_is_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log");
        fs::write(&path, b"h\none\n\xff\xfe\nthree\nfo").unwrap();
        let mut log = Log::open(&path, "h", Keep::Lines).unwrap();
        log.append("four").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"h\none\n\xff\xfe\nthree\nfour\n");
        let mut log = Log::open(&path, "h", Keep::Rows(2)).unwrap();
        log.append("three again").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"h\none\n\xff\xfe\nthree again\n");
    }

    #[test]
    fn a_file_that_cannot_be_written_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing").join("x.json");
        let error = write_json(&path, &1).unwrap_err().to_string();
        assert!(error.contains("x.json: cannot write"), "{error}");
    }
}
