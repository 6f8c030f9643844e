//! Files that survive a killed process, a full disk and a second writer: every file that Stridemap writes goes
//! through here.
//!
//! - [`write_whole`]: a reader sees the old file or the new one; what is no regular file is written through.
//! - [`check_file`], [`check_dir`]: whether a result could be written, before the work for it begins.
//! - [`Lock`]: one writer for a directory.
//! - [`fetched_path`]: files of others in the user's cache.

mod cache;
mod lock;
mod whole;

pub use cache::{cache_dir, fetch_hint, fetched_dir, fetched_path};
pub use lock::{LOCK_FILE, Lock, LockError};
pub use whole::{check_dir, check_file, resolved, sweep, write_whole};
