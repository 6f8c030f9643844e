//! Files of others that a user has fetched: where they are, and how to get one that is not.

use std::path::{Path, PathBuf};

/// Word before the path of a fetched file in a task: `fetched:g1/g1.xml`.
const FETCHED: &str = "fetched:";

/// The user's cache of Stridemap, `$XDG_CACHE_HOME/stridemap` or `~/.cache/stridemap`; `None` for a user without a home.
#[must_use]
pub fn cache_dir() -> Option<PathBuf> {
    let absolute = |name: &str| {
        let path = PathBuf::from(std::env::var_os(name)?);
        path.is_absolute().then_some(path)
    };
    let cache = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(cache.join("stridemap"))
}

/// Where the files of a fetched robot are kept.
#[must_use]
pub fn fetched_dir() -> Option<PathBuf> {
    Some(cache_dir()?.join("fetched"))
}

/// The path of a file that a task names: `fetched:ROBOT/FILE` is one that `stridemap fetch ROBOT` keeps in the user's
/// cache; another path is told from `base`, the directory of the task's file.
///
/// # Example
///
/// ```
/// use std::path::Path;
/// use stridemap_files::fetched_path;
///
/// let own = fetched_path(Path::new("models/mine.onnx"), Some(Path::new("/home/me/robot")));
/// assert_eq!(own, Path::new("/home/me/robot/models/mine.onnx"));
/// if let Some(dir) = stridemap_files::fetched_dir() {
///     assert_eq!(fetched_path(Path::new("fetched:g1/g1.xml"), None), dir.join("g1/g1.xml"));
/// }
/// ```
#[must_use]
pub fn fetched_path(path: &Path, base: Option<&Path>) -> PathBuf {
    match (path.to_str().and_then(|text| text.strip_prefix(FETCHED)), fetched_dir(), base) {
        (Some(file), Some(dir), _) => dir.join(file),
        (None, _, Some(base)) => {
            let path = base.join(path);
            std::path::absolute(&path).unwrap_or(path)
        }
        _ => path.to_path_buf(),
    }
}

/// How to get a file that is not there, where it is one that `stridemap fetch` keeps.
#[must_use]
pub fn fetch_hint(path: &Path) -> Option<String> {
    let robot = path.strip_prefix(fetched_dir()?).ok()?.components().next()?;
    let robot = robot.as_os_str().to_str()?;
    (!path.exists()).then(|| format!("is not there; get it with `stridemap fetch {robot}`"))
}
