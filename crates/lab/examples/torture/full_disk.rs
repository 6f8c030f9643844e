//! The disk is full at a size; then it is larger, and the run is made as if nothing had been.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::program::{Program, differences, ended};
use crate::{Found, Outcome, SHORT};

/// From less than a directory to nearly all of the run.
const SIZES_KIB: [u32; 12] = [4, 8, 12, 16, 24, 32, 48, 64, 128, 256, 512, 768];

/// A file system in memory of a size of its own, gone when it is dropped.
struct Small<'a>(&'a Path);

impl<'a> Small<'a> {
    /// Mounts it, where this user may.
    fn mount(dir: &'a Path, options: &str) -> Option<Self> {
        let mounted =
            Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(dir).stderr(Stdio::null()).status();
        mounted.is_ok_and(|s| s.success()).then_some(Self(dir))
    }
}

impl Drop for Small<'_> {
    fn drop(&mut self) {
        // A left-over is in a directory of this torture, in memory, and ends with the machine.
        let _ = Command::new("umount").arg(self.0).status();
    }
}

/// Learns on a disk of each of so many sizes, then on one with room.
pub fn fill(program: &Program, dir: &Path, sizes: usize) -> Outcome<Found> {
    let begin = [&["learn", "stepping", "--out", "run"][..], &SHORT].concat();
    let whole = dir.join("whole");
    std::fs::create_dir(&whole)?;
    let end = program.run(&whole, &begin)?;
    if end.code != Some(0) {
        return Err(format!("unbroken: {}", end.said).into());
    }
    let mut found = Found::default();
    for size in SIZES_KIB.iter().step_by(SIZES_KIB.len() / sizes.max(1)) {
        let own = dir.join(format!("{size}"));
        std::fs::create_dir(&own)?;
        let small = Small::mount(&own, &format!("size={size}k"));
        let kind = if small.is_some() { "tmpfs" } else { "RLIMIT_FSIZE" };
        found.remark = format!("{kind}, 4 to {size} KiB");
        let end = if small.is_some() {
            program.run(&own, &begin)?
        } else {
            let limit = format!("ulimit -f {}; exec \"$@\"", size.div_ceil(8));
            let inner = program.command(&own, &begin);
            let mut shell = Command::new("bash");
            shell.args(["-c", &limit, "bash"]).arg(inner.get_program()).args(inner.get_args());
            shell.current_dir(&own).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
            ended(shell.spawn()?)?
        };
        found.done += 1;
        let mut fault = |text: String| found.faults.push(format!("{size} KiB: {text}"));
        if let Some(bad) = end.fault() {
            fault(bad);
        }
        if small.is_some() && end.code == Some(0) {
            fault("the disk was not full".into());
        }
        if end.code != Some(0) && !(end.said.contains("run") && end.said.contains("os error")) {
            fault(format!("the message names no file: {}", end.said));
        }
        if small.is_some() {
            let grown = Command::new("mount").args(["-o", "remount,size=64m"]).arg(&own).status()?;
            if !grown.success() {
                return Err("cannot enlarge the disk".into());
            }
        }
        let has_run = own.join("run/config.toml").exists();
        let words = if has_run { &["learn", "--resume", "run"][..] } else { &begin };
        let end = program.run(&own, words)?;
        if end.code == Some(0) {
            differences(&own.join("run"), &whole.join("run"))?.into_iter().for_each(fault);
        } else {
            fault(format!("{words:?} refused: {}", end.said));
        }
    }
    Ok(found)
}
