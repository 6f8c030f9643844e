//! Files that survive a killed process and a full disk.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::LabError;

fn failed(path: &Path, doing: &'static str) -> impl FnOnce(std::io::Error) -> LabError {
    let path = path.to_path_buf();
    move |source| LabError::File {
        path,
        doing,
        source,
    }
}

/// Writes a whole file: aside, flushed to the disk, renamed. A reader sees the old file or the new
/// one, never half of it.
///
/// # Errors
///
/// [`LabError::File`]; the old file is then untouched.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), LabError> {
    let mut aside = path.as_os_str().to_owned();
    aside.push(".tmp");
    let aside = PathBuf::from(aside);
    let written = File::create(&aside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    let renamed = written.and_then(|()| fs::rename(&aside, path));
    if renamed.is_err() {
        // The reason is reported below; a left-over aside file would only confuse.
        let _ = fs::remove_file(&aside);
    }
    renamed.map_err(failed(path, "write"))
}

/// Writes a value as indented JSON with a final newline, whole.
///
/// # Errors
///
/// As [`write_whole`].
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<(), LabError> {
    let mut text = serde_json::to_string_pretty(value).map_err(|error| LabError::Content {
        path: path.into(),
        line: None,
        problem: format!("cannot be written as JSON: {error}"),
    })?;
    text.push('\n');
    write_whole(path, text.as_bytes())
}

/// Reads a file of text.
///
/// # Errors
///
/// [`LabError::File`].
pub fn read_text(path: &Path) -> Result<String, LabError> {
    fs::read_to_string(path).map_err(failed(path, "read"))
}

/// Reads a file.
///
/// # Errors
///
/// [`LabError::File`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, LabError> {
    fs::read(path).map_err(failed(path, "read"))
}

/// Reads a JSON file.
///
/// # Errors
///
/// [`LabError::File`], or [`LabError::Content`] with the line at fault.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, LabError> {
    let text = read_text(path)?;
    serde_json::from_str(&text).map_err(|error| LabError::Content {
        path: path.into(),
        line: Some(error.line()),
        problem: format!("is damaged or of another kind: {error}"),
    })
}

/// Creates a directory and those above it.
///
/// # Errors
///
/// [`LabError::File`].
pub fn create_dir(path: &Path) -> Result<(), LabError> {
    fs::create_dir_all(path).map_err(failed(path, "create directory"))
}

/// Appends one line to a file, which is made if it is not there.
///
/// # Errors
///
/// [`LabError::File`].
pub fn append_line(path: &Path, line: &str) -> Result<(), LabError> {
    let opened = OpenOptions::new().append(true).create(true).open(path);
    opened
        .and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()))
        .map_err(failed(path, "append to"))
}

/// A log that only grows, one line after another, each flushed as it is written.
pub struct Log {
    path: PathBuf,
    file: BufWriter<File>,
    rows: usize,
}

impl Log {
    /// Opens a log with a header line and `keep` rows: a new log if there is none and `keep` is 0, or
    /// the first `keep` rows of an existing one (what a killed process wrote after its last
    /// checkpoint is dropped).
    ///
    /// # Errors
    ///
    /// [`LabError::File`], or [`LabError::Content`] if an existing log holds fewer rows or begins with
    /// another header.
    pub fn open(path: &Path, header: &str, keep: usize) -> Result<Self, LabError> {
        let mut text = format!("{header}\n");
        if keep > 0 {
            let old = read_text(path)?;
            let mut lines = old.lines();
            if lines.next() != Some(header) {
                return Err(LabError::Content {
                    path: path.into(),
                    line: Some(1),
                    problem: format!("does not begin with the header this task writes: {header}"),
                });
            }
            let kept: Vec<&str> = lines.take(keep).collect();
            if kept.len() < keep {
                return Err(LabError::Content {
                    path: path.into(),
                    line: None,
                    problem: format!(
                        "holds {} rows where the checkpoint counts {keep}; it was changed since",
                        kept.len()
                    ),
                });
            }
            for line in kept {
                text.push_str(line);
                text.push('\n');
            }
        }
        write_whole(path, text.as_bytes())?;
        let file = OpenOptions::new()
            .append(true)
            .open(path)
            .map_err(failed(path, "open"))?;
        Ok(Self {
            path: path.into(),
            file: BufWriter::new(file),
            rows: keep,
        })
    }

    /// Appends one row and hands it to the system.
    ///
    /// # Errors
    ///
    /// [`LabError::File`].
    pub fn append(&mut self, row: &str) -> Result<(), LabError> {
        let written = writeln!(self.file, "{row}").and_then(|()| self.file.flush());
        written.map_err(failed(&self.path, "append to"))?;
        self.rows += 1;
        Ok(())
    }

    /// Waits until every row is on the disk.
    ///
    /// # Errors
    ///
    /// [`LabError::File`].
    pub fn sync(&self) -> Result<(), LabError> {
        self.file
            .get_ref()
            .sync_data()
            .map_err(failed(&self.path, "write"))
    }

    /// Rows so far, the header not counted.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_keeps_what_the_checkpoint_counts_and_drops_the_rest() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.csv");
        let mut log = Log::open(&path, "a,b", 0).unwrap();
        for row in ["1,2", "3,4", "5,6"] {
            log.append(row).unwrap();
        }
        fs::write(&path, "a,b\n1,2\n3,4\n5,").unwrap(); // killed in the middle of a row
        let mut log = Log::open(&path, "a,b", 2).unwrap();
        log.append("7,8").unwrap();
        assert_eq!(log.rows(), 3);
        assert_eq!(read_text(&path).unwrap(), "a,b\n1,2\n3,4\n7,8\n");
        let short = Log::open(&path, "a,b", 9).err().unwrap().to_string();
        assert!(
            short.contains("holds 3 rows where the checkpoint counts 9"),
            "{short}"
        );
        assert!(Log::open(&path, "a,c", 1).is_err());
    }

    #[test]
    fn a_file_that_cannot_be_written_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing").join("x.json");
        let error = write_json(&path, &1).unwrap_err().to_string();
        assert!(error.contains("x.json: cannot write"), "{error}");
    }
}
