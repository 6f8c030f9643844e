//! The only place that prints: results to stdout, everything else to stderr.
#![allow(clippy::print_stdout, clippy::print_stderr)] // This is the place.

use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Serialize;

use crate::failure::Failure;

/// The first error on stdout but a closed pipe (`| head`), which is none.
static LOST: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// Keeps an error on stdout until [`written`] is asked.
fn keep(written: std::io::Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
        && let Ok(mut lost) = LOST.lock()
    {
        lost.get_or_insert(error);
    }
}

/// Whether every result reached stdout: asked once, at the end of every command.
pub fn written() -> Result<(), Failure> {
    keep(std::io::stdout().flush());
    match LOST.lock().ok().and_then(|mut lost| lost.take()) {
        Some(error) => Err(Failure::working(format!("the result could not be written to stdout: {error}"))),
        None => Ok(()),
    }
}

/// Whether this process was started with its stdout closed (`>&-`).
static CLOSED: AtomicBool = AtomicBool::new(false);

/// Looks at stdout before Rust's runtime does, which puts /dev/null where it is closed.
extern "C" fn look() {
    let open = Path::new("/proc/self/fd");
    CLOSED.store(open.exists() && !open.join("1").is_symlink(), Ordering::Relaxed);
}

#[used]
#[allow(unsafe_code)] // A place among the functions that run first; `look` needs nothing of the runtime.
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;

/// An error where stdout was closed at the start.
fn open() -> std::io::Result<()> {
    match CLOSED.load(Ordering::Relaxed) {
        true => Err(std::io::Error::other("it is closed")),
        false => Ok(()),
    }
}

/// Prints a line of a result.
pub fn line(text: impl AsRef<str>) {
    keep(open().and_then(|()| writeln!(std::io::stdout().lock(), "{}", text.as_ref())));
}

/// Prints what clap has to say: help and version are results, wrong usage is not.
pub fn usage(said: &clap::Error) {
    let printed = said.print();
    if !said.use_stderr() {
        keep(open().and(printed));
    }
}

/// Whether a JSON document was printed.
static PRINTED_JSON: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

/// Prints a failure as the JSON document that was asked for, unless a result was printed already.
pub fn json_failure(failure: &Failure) {
    if std::env::args_os().any(|word| word == "--json") && !PRINTED_JSON.load(std::sync::atomic::Ordering::Relaxed) {
        let causes: Vec<String> = failure.error().chain().map(ToString::to_string).collect();
        let refused = matches!(failure, Failure::Request(_));
        let _ = json(&serde_json::json!({ "error": causes.join(": "), "refused": refused }));
    }
}

/// Prints a result as one JSON document.
pub fn json(value: &impl Serialize) -> Result<(), Failure> {
    PRINTED_JSON.store(true, std::sync::atomic::Ordering::Relaxed);
    line(serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Prints a line for the person who waits.
pub fn note(text: impl AsRef<str>) {
    let mut stderr = std::io::stderr().lock();
    let _ = writeln!(stderr, "{}", text.as_ref());
}

/// Overwrites the last status line (terminals only), cut to the width of the terminal: a line that wrapped
/// could not be overwritten.
pub fn status(text: impl AsRef<str>) {
    let size = terminal_size::terminal_size_of(std::io::stderr());
    let width = size.map_or(80, |(w, _)| usize::from(w.0));
    let mut stderr = std::io::stderr().lock();
    let _ = write!(stderr, "\r\x1b[2K{}", fitted(text.as_ref(), width));
    let _ = stderr.flush();
}

/// The text, or its beginning with an ellipsis if it is wider than a terminal of so many columns.
pub(crate) fn fitted(text: &str, width: usize) -> String {
    let room = width.saturating_sub(1);
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let kept: String = text.chars().take(room.saturating_sub(1)).collect();
    kept + "\u{2026}"
}

/// Clears the status line (terminals only).
pub fn clear_status() {
    status("");
}

/// Prints why a command failed.
pub fn error(failure: &Failure) {
    let mut causes = Vec::new();
    for cause in failure.error().chain() {
        let text = cause.to_string();
        // Transparent errors repeat their source.
        if causes.last().is_none_or(|last: &String| !last.contains(&text)) {
            causes.push(text);
        }
    }
    note(format!("error: {}", causes.join(": ")));
}

#[cfg(test)]
mod tests {
    use super::fitted;

    #[test]
    fn a_status_line_never_wraps() {
        assert_eq!(fitted("stride 3", 80), "stride 3");
        // The last column stays free: some terminals wrap as soon as it is written.
        assert_eq!(fitted("stride 3", 8), "stride\u{2026}");
        assert_eq!(fitted("stride 3", 0), "\u{2026}");
    }
}
