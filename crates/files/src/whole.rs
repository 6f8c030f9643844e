//! Whole files: aside and renamed where they are regular, straight through where they are not.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, fchown};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::fs::{Access, access};
use rustix::io::Errno;

/// Most links that are followed, as in the kernel.
const MOST_LINKS: usize = 40;

/// Sockets that somebody listened on when they were looked at: who listens may take one call only.
static HELD: Mutex<BTreeMap<PathBuf, UnixStream>> = Mutex::new(BTreeMap::new());

/// What a path stands for when it is written to.
enum Target {
    /// The standard output or error of this process, under whatever name: what it wrote there before stays.
    Own(File),
    /// A device, fifo or socket: written through, never replaced.
    Through(PathBuf, Metadata),
    /// A regular file, or none yet, with links followed.
    Regular(PathBuf, Option<Metadata>),
}

impl Target {
    fn of(path: &Path) -> io::Result<Self> {
        let found = match fs::metadata(path) {
            Ok(found) => Some(found),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        if let Some(meta) = &found {
            if meta.is_dir() {
                return Err(ErrorKind::IsADirectory.into());
            }
            for own in [io::stdout().as_fd().try_clone_to_owned(), io::stderr().as_fd().try_clone_to_owned()] {
                let own = File::from(own?);
                let m = own.metadata()?;
                if (m.dev(), m.ino()) == (meta.dev(), meta.ino()) {
                    return Ok(Self::Own(own));
                }
            }
        }
        Ok(match found {
            Some(meta) if !meta.is_file() => Self::Through(path.into(), meta),
            found => Self::Regular(resolved(path)?, found),
        })
    }
}

/// The place that a path names once links at its end are followed, whether or not anything is there.
///
/// # Errors
///
/// A chain of links that has no end.
pub fn resolved(path: &Path) -> io::Result<PathBuf> {
    let mut place = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        match fs::read_link(&place) {
            Ok(link) => place = directory_of(&place).join(link),
            Err(_) => return Ok(place),
        }
    }
    Err(Errno::LOOP.into())
}

/// The directory in which a path stands.
fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Writes a whole file: aside, flushed to the disk, renamed. A reader sees the old file or the new one, never
/// half of it; mode and owner of an old file stay.
///
/// Links are followed. A device, a fifo or a socket is written through, and so is what this process has as its
/// standard output or error.
///
/// # Errors
///
/// The system's; an old file is then untouched.
///
/// ```
/// let dir = tempfile::tempdir()?;
/// let (file, link) = (dir.path().join("map.json"), dir.path().join("latest.json"));
/// std::os::unix::fs::symlink("map.json", &link)?;
/// stridemap_files::write_whole(&link, b"{}\n")?;
/// assert_eq!(std::fs::read(&file)?, b"{}\n");
/// assert!(link.is_symlink());
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    match Target::of(path)? {
        Target::Own(mut file) => file.write_all(bytes),
        Target::Through(path, meta) if meta.file_type().is_socket() => {
            let held = HELD.lock().ok().and_then(|mut held| held.remove(&path));
            held.map_or_else(|| UnixStream::connect(path), Ok)?.write_all(bytes)
        }
        Target::Through(path, _) => OpenOptions::new().write(true).open(path)?.write_all(bytes),
        Target::Regular(path, old) => replace(&path, old.as_ref(), bytes),
    }
}

/// Puts a new file in the place of an old one; where the directory or the owner does not allow that, writes
/// into the old one.
fn replace(path: &Path, old: Option<&Metadata>, bytes: &[u8]) -> io::Result<()> {
    if old.is_some() {
        access(path, Access::WRITE_OK)?;
    }
    let (aside, mut file) = match (Aside::create(path), old) {
        (Ok(made), _) => made,
        (Err(error), Some(_)) if error.kind() == ErrorKind::PermissionDenied => {
            return overwrite(path, bytes);
        }
        (Err(error), _) => return Err(error),
    };
    if let Some(old) = old {
        let new = file.metadata()?;
        let (uid, gid) = (old.uid(), old.gid());
        if (uid, gid) != (new.uid(), new.gid()) && fchown(&file, Some(uid), Some(gid)).is_err() {
            return overwrite(path, bytes);
        }
        // After the owner, whose change takes away bits of the mode.
        file.set_permissions(old.permissions())?;
    }
    file.write_all(bytes)?;
    file.sync_all()?;
    match aside.into_place(path) {
        // Something is mounted on the file itself.
        Err(error) if old.is_some() && error.kind() == ErrorKind::ResourceBusy => overwrite(path, bytes),
        renamed => renamed,
    }
}

fn overwrite(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).truncate(true).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// A file beside another, gone when it is dropped unless it was renamed.
struct Aside(Option<PathBuf>);

impl Aside {
    /// Creates a file that nobody else has: `.NAME.PROCESS-NUMBER.tmp`.
    fn create(path: &Path) -> io::Result<(Self, File)> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = path.file_name().ok_or(ErrorKind::InvalidInput)?;
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let mut aside = OsString::from(".");
            aside.push(name);
            aside.push(format!(".{}-{number}.tmp", std::process::id()));
            let aside = directory_of(path).join(aside);
            match OpenOptions::new().write(true).create_new(true).open(&aside) {
                Ok(file) => return Ok((Self(Some(aside)), file)),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn into_place(mut self, path: &Path) -> io::Result<()> {
        if let Some(aside) = &self.0 {
            fs::rename(aside, path)?;
        }
        self.0 = None;
        Ok(())
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if let Some(aside) = &self.0 {
            // The reason why it is here is reported; a left-over would only confuse.
            let _ = fs::remove_file(aside);
        }
    }
}

/// The process that wrote a file aside, by the file's name.
fn writer_of(name: &str) -> Option<u32> {
    let stem = name.strip_prefix('.')?.strip_suffix(".tmp")?;
    let (pid, number) = stem.rsplit_once('.')?.1.split_once('-')?;
    number.parse::<u32>().ok()?;
    pid.parse().ok()
}

/// Removes what killed processes left beside the files that they were writing, in a directory and those
/// below it. Nothing of a process that lives.
///
/// # Errors
///
/// The system's, if a directory cannot be read.
pub fn sweep(dir: &Path) -> io::Result<()> {
    for entry in fs::read_dir(dir)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sweep(&entry.path())?;
        } else if let Some(pid) = entry.file_name().to_str().and_then(writer_of)
            && (pid == std::process::id() || !Path::new("/proc").join(pid.to_string()).exists())
        {
            let _ = fs::remove_file(entry.path());
        }
    }
    Ok(())
}

/// Whether [`write_whole`] could write a file, without touching it.
///
/// # Errors
///
/// What writing would say.
pub fn check_file(path: &Path) -> io::Result<()> {
    match Target::of(path)? {
        Target::Own(_) => Ok(()),
        Target::Through(path, meta) if meta.file_type().is_socket() => {
            let stream = UnixStream::connect(&path)?;
            if let Ok(mut held) = HELD.lock() {
                held.insert(path, stream);
            }
            Ok(())
        }
        Target::Through(path, _) => Ok(access(path, Access::WRITE_OK)?),
        Target::Regular(path, old) => {
            if old.is_some() {
                access(&path, Access::WRITE_OK)?;
            }
            match (Aside::create(&path), old) {
                (Err(error), Some(_)) if error.kind() == ErrorKind::PermissionDenied => Ok(()),
                (made, _) => made.map(drop),
            }
        }
    }
}

/// Whether files could be written into a directory, which need not be there yet; makes nothing.
///
/// # Errors
///
/// What making it or writing there would say.
pub fn check_dir(path: &Path) -> io::Result<()> {
    let mut place = path;
    loop {
        match fs::metadata(place) {
            Ok(found) if found.is_dir() => break,
            Ok(_) => return Err(ErrorKind::NotADirectory.into()),
            Err(error) if error.kind() == ErrorKind::NotFound && !place.is_symlink() => {
                place = directory_of(place);
            }
            Err(error) => return Err(error),
        }
    }
    Aside::create(&place.join("check")).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::os::unix::net::UnixListener;
    use std::process::Command;

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn what_is_no_regular_file_is_written_through_and_stays_what_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        assert!(Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        let reader = std::thread::spawn({
            let pipe = at("pipe");
            move || fs::read_to_string(pipe).unwrap()
        });
        check_file(&at("pipe")).unwrap();
        write_whole(&at("pipe"), b"one\n").unwrap();
        assert_eq!(reader.join().unwrap(), "one\n");
        assert!(fs::metadata(at("pipe")).unwrap().file_type().is_fifo());

        let listener = UnixListener::bind(at("socket")).unwrap();
        let reader = std::thread::spawn(move || {
            let mut text = String::new();
            listener.accept().unwrap().0.read_to_string(&mut text).unwrap();
            text
        });
        // Looked at, then written, in one call; a socket on which nobody listens any more is found before.
        check_file(&at("socket")).unwrap();
        write_whole(&at("socket"), b"two\n").unwrap();
        assert_eq!(reader.join().unwrap(), "two\n");
        let refused = check_file(&at("socket")).unwrap_err();
        assert_eq!(refused.kind(), ErrorKind::ConnectionRefused);

        // A device of our own, where the system lets us make one.
        let made = Command::new("mknod").arg(at("null")).args(["c", "1", "3"]).status();
        if made.is_ok_and(|status| status.success()) {
            write_whole(&at("null"), b"three\n").unwrap();
            assert!(fs::metadata(at("null")).unwrap().file_type().is_char_device());
        }
    }

    #[test]
    fn links_modes_and_the_files_of_others_stay() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("e")).unwrap();
        symlink("e/real", at("link")).unwrap(); // its target is not there yet
        fs::write(at("old"), "old").unwrap();
        fs::set_permissions(at("old"), fs::Permissions::from_mode(0o600)).unwrap();
        fs::write(at("old.tmp"), "somebody's").unwrap();
        for name in ["link", "old"] {
            check_file(&at(name)).unwrap();
            write_whole(&at(name), b"new").unwrap();
            assert_eq!(fs::read(at(name)).unwrap(), b"new", "{name}");
        }
        assert!(at("link").is_symlink() && at("e/real").is_file());
        assert_eq!(fs::metadata(at("old")).unwrap().mode() & 0o777, 0o600);
        assert_eq!(fs::read(at("old.tmp")).unwrap(), b"somebody's");
        assert_eq!(names(dir.path()), ["e", "link", "old", "old.tmp"]);
    }

    #[test]
    fn what_cannot_be_written_is_found_before() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::write(at("file"), "").unwrap();
        for (path, kind) in [
            (dir.path().to_path_buf(), ErrorKind::IsADirectory),
            (at("missing/x"), ErrorKind::NotFound),
            (at("file/x"), ErrorKind::NotADirectory),
        ] {
            assert_eq!(check_file(&path).unwrap_err().kind(), kind, "{path:?}");
        }
        symlink("loop", at("loop")).unwrap();
        for found in [check_file(&at("loop")), check_dir(&at("loop")), resolved(&at("loop")).map(drop)] {
            assert!(found.unwrap_err().to_string().contains("symbolic link"));
        }
        fs::remove_file(at("loop")).unwrap();
        assert_eq!(check_dir(&at("file/x")).unwrap_err().kind(), ErrorKind::NotADirectory);
        check_dir(&at("new/newer")).unwrap();
        assert_eq!(names(dir.path()), ["file"]);
    }

    #[test]
    fn what_a_killed_process_left_is_swept_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let mut child = Command::new("true").spawn().unwrap();
        let gone = child.id();
        child.wait().unwrap();
        let kept = [".x.tmp".into(), "y.tmp".into(), format!(".z.{}-0.tmp", std::os::unix::process::parent_id())];
        for name in [&format!(".x.csv.{gone}-3.tmp")].into_iter().chain(&kept) {
            fs::write(dir.path().join(name), "").unwrap();
        }
        sweep(dir.path()).unwrap();
        assert_eq!(names(dir.path()).len(), kept.len(), "{:?}", names(dir.path()));
    }
}
