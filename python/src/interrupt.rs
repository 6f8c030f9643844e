//! Long work beside Python: without the GIL, ended by Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::error::{Fault, working};
use crate::parts::blamed;

/// How often signals are looked at.
const LOOK: Duration = Duration::from_millis(20);
/// How long an orderly end may take after Ctrl-C: what does not look at the flag by then (a fit, a search) ends by
/// itself, unheard, and writes nothing after it.
const GRACE: Duration = Duration::from_millis(700);

/// Does `work` in a thread of its own while this one listens for Ctrl-C. The work is told by the flag.
///
/// # Errors
///
/// Of the work; `KeyboardInterrupt`.
pub fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    stop: &Arc<AtomicBool>,
    work: impl FnOnce() -> Result<T, Fault> + Send + 'static,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    // One listener at a time; only to be shared with the closure that listens without the GIL.
    let receiver = Mutex::new(receiver);
    let thread = std::thread::Builder::new().name("stridemap".into());
    let thread = thread.spawn(move || {
        let _ = sender.send(blamed(work()));
    });
    let thread = thread.map_err(working)?;
    let mut interrupted: Option<(PyErr, Instant)> = None;
    loop {
        let got = py.detach(|| receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK));
        match (got, &interrupted) {
            (Ok(result), None) => {
                let _ = py.detach(|| thread.join());
                return Ok(result?);
            }
            (Err(RecvTimeoutError::Disconnected), None) => {
                return Err(working("a part of Stridemap failed; the message above says where"));
            }
            (Err(RecvTimeoutError::Timeout), None) => {
                if let Err(signal) = py.check_signals() {
                    stop.store(true, Ordering::Relaxed);
                    interrupted = Some((signal, Instant::now()));
                }
            }
            (Err(RecvTimeoutError::Timeout), Some((_, since))) if since.elapsed() < GRACE => {}
            (_, Some((signal, _))) => return Err(signal.clone_ref(py)),
        }
    }
}
