//! One writer for a directory.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::Path;

/// The file in a locked directory that holds the lock, and while it is held the process of the writer.
pub const LOCK_FILE: &str = ".lock";

/// Why a directory cannot be locked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// Another process writes there, or another part of this one.
    #[error("is being written by {}; wait until it has ended, or stop it", pid.map_or_else(|| "another process".to_owned(), |p| format!("process {p}")))]
    Held {
        /// The writer's process, if it could be read.
        pid: Option<u32>,
    },
    /// The file of the lock cannot be opened or locked.
    #[error("cannot be locked: {0}")]
    Io(#[from] std::io::Error),
}

/// The right to write into a directory, for as long as this value lives or, if the process is killed, until
/// then: the system releases it.
///
/// Readers need none. The lock moves with the directory if that is renamed.
///
/// ```
/// use stridemap_files::{Lock, LockError};
///
/// let dir = tempfile::tempdir()?;
/// let lock = Lock::take(dir.path())?;
/// let second = Lock::take(dir.path()).unwrap_err();
/// assert!(matches!(second, LockError::Held { pid: Some(pid) } if pid == std::process::id()));
/// drop(lock);
/// assert!(Lock::take(dir.path()).is_ok());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Lock {
    file: File,
}

impl Lock {
    /// Locks a directory, or says who has it. Does not wait.
    ///
    /// # Errors
    ///
    /// [`LockError`].
    pub fn take(dir: &Path) -> Result<Self, LockError> {
        let path = dir.join(LOCK_FILE);
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                // Without a number the answer is the same, only less helpful.
                let _ = file.read_to_string(&mut holder);
                return Err(LockError::Held { pid: holder.trim().parse().ok() });
            }
            Err(TryLockError::Error(error)) => return Err(error.into()),
        }
        // The lock counts; the number is for people, and a full disk may have no room for it.
        let _ = file.set_len(0).and_then(|()| writeln!(file, "{}", std::process::id()));
        Ok(Self { file })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Nobody holds it any more; the file stays, since removing it would race with the next writer.
        let _ = self.file.set_len(0);
    }
}
