//! Processes of this program, started by it: they end with it, however it ends.

use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdout, Command, Stdio, exit};

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
}

fn working(what: impl std::fmt::Display) -> Failure {
    Failure::working(what.to_string())
}

impl Process {
    /// Starts it, its stderr where this process's goes.
    pub fn start(arguments: &[&str]) -> Result<Self, Failure> {
        let me = std::env::current_exe().map_err(working)?;
        let child = Command::new(me)
            .args(arguments)
            .env(PARENT, std::process::id().to_string())
            // Ctrl-C in the terminal is for this process, which ends the other.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| working(format!("cannot start a process: {e}")))?;
        Ok(Self { child })
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
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
