//! The only place that prints: results to stdout, everything else to stderr.
#![allow(clippy::print_stdout, clippy::print_stderr)] // This is the place.

use std::io::Write;

use serde::Serialize;

use crate::failure::Failure;

/// Prints a line of a result. A closed pipe (`| head`) is not an error.
pub fn line(text: impl AsRef<str>) {
    let mut stdout = std::io::stdout().lock();
    let _ = writeln!(stdout, "{}", text.as_ref());
}

/// Prints a result as one JSON document.
pub fn json(value: &impl Serialize) -> Result<(), Failure> {
    line(serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Prints a line for the person who waits.
pub fn note(text: impl AsRef<str>) {
    let mut stderr = std::io::stderr().lock();
    let _ = writeln!(stderr, "{}", text.as_ref());
}

/// Overwrites the last status line (terminals only).
pub fn status(text: impl AsRef<str>) {
    let mut stderr = std::io::stderr().lock();
    let _ = write!(stderr, "\r\x1b[2K{}", text.as_ref());
    let _ = stderr.flush();
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
        if causes
            .last()
            .is_none_or(|last: &String| !last.contains(&text))
        {
            causes.push(text);
        }
    }
    note(format!("error: {}", causes.join(": ")));
}
