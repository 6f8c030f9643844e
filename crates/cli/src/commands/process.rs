//! Processes of this program, started by it: they end with it, however it ends.

use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio, exit};
use std::time::{Duration, Instant};

use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, getppid};

use crate::failure::Failure;

/// Names the process with which one that it started ends.
const PARENT: &str = "STRIDEMAP_PARENT";

/// In a process that was started as a [`Process`]: it is killed as soon as its parent is gone.
pub fn end_with_parent() {
    let parent = std::env::var(PARENT).ok().and_then(|p| p.parse().ok());
    let Some(parent) = parent else { return };
    // The parent may have ended before this was asked for.
    if set_pdeathsig(Signal::SIGKILL).is_err() || getppid() != Pid::from_raw(parent) {
        exit(1);
    }
}

/// A process of this program that ends with its owner. It must be started by a thread that outlives it.
pub struct Process {
    child: Child,
    /// Where its stderr goes, if not where this process's goes.
    told: Option<PathBuf>,
}

fn working(what: impl std::fmt::Display) -> Failure {
    Failure::working(what.to_string())
}

impl Process {
    /// Starts it, its stderr in a file or where this process's goes.
    pub fn start(arguments: &[String], told: Option<&Path>) -> Result<Self, Failure> {
        let me = std::env::current_exe().map_err(working)?;
        let stderr = match told {
            None => Stdio::inherit(),
            Some(path) => {
                File::create(path).map_err(|e| working(format!("{}: cannot be written: {e}", path.display())))?.into()
            }
        };
        let child = Command::new(me)
            .args(arguments)
            .env(PARENT, std::process::id().to_string())
            // Ctrl-C in the terminal is for this process, which ends the other.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(stderr)
            .spawn()
            .map_err(|e| working(format!("cannot start a process: {e}")))?;
        Ok(Self { child, told: told.map(Path::to_path_buf) })
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// What it prints.
    pub const fn stdout(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: Signal) -> Result<(), Failure> {
        let id = i32::try_from(self.id()).map_err(working)?;
        kill(Pid::from_raw(id), signal).map_err(working)
    }

    /// Kills it as `kill -9` does.
    pub fn kill(&mut self) -> Result<(), Failure> {
        self.child.kill().and_then(|()| self.child.wait().map(|_| ())).map_err(working)
    }

    /// How it ended, if it did.
    pub fn ended(&mut self) -> Result<Option<ExitStatus>, Failure> {
        self.child.try_wait().map_err(working)
    }

    /// Waits for its end; whether it ended well.
    pub fn end(&mut self, most: Duration) -> Result<bool, Failure> {
        let deadline = Instant::now() + most;
        while Instant::now() < deadline {
            if let Some(status) = self.ended()? {
                return Ok(status.success());
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Err(working("a process did not end"))
    }

    /// The last lines of its stderr.
    pub fn last_words(&self) -> String {
        /// Enough for an error and what led to it.
        const LINES: usize = 5;
        let told = self.told.as_ref();
        let text = told.and_then(|path| std::fs::read_to_string(path).ok());
        let text = text.unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(LINES)..].join("\n")
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
