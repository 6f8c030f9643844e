//! Whether this machine can hold the matrices of an exact model: asked before they are, because a system that
//! promises more memory than it has ends the process later, and a limit ends it at once.

use std::fs::read_to_string;

use crate::error::{GpError, Result};

/// Matrices of `N × N` that a fit holds at once.
const OF_A_FIT: f64 = 3.0;
/// Matrices of `N × N` that a fitted model keeps: a triangle.
const OF_A_MODEL: f64 = 0.5;

/// Requires room for a fit to `points` points beside `models` fitted models of as many.
///
/// # Errors
///
/// [`GpError::Memory`] with both numbers. Where the system does not say what it has (Linux does), the
/// answer is yes.
///
/// # Example
///
/// ```
/// use stridemap_gp::{GpError, check_memory};
///
/// assert!(check_memory(1000, 3).is_ok());
/// if cfg!(target_os = "linux") {
///     let error = check_memory(10_000_000, 0).unwrap_err();
///     assert!(matches!(error, GpError::Memory { points: 10_000_000, .. }));
/// }
/// ```
pub fn check_memory(points: usize, models: usize) -> Result<()> {
    let matrix = points as f64 * points as f64;
    room_for(points, matrix * (OF_A_FIT + OF_A_MODEL * models as f64))
}

/// Requires room for so many numbers, of a model of `points` points.
pub(crate) fn room_for(points: usize, numbers: f64) -> Result<()> {
    let needed = 8.0 * numbers;
    match available_bytes() {
        Some(available) if needed > available => {
            Err(GpError::Memory { points, needed_gb: needed / 1e9, available_gb: available / 1e9 })
        }
        _ => Ok(()),
    }
}

/// Bytes that this process may still ask for: of the machine's memory, of its control group's, of its own
/// address space; the least of those that are known.
fn available_bytes() -> Option<f64> {
    let number = |text: &str| text.split_whitespace().find_map(|word| word.parse::<f64>().ok());
    let line = |file: &str, key: &str| {
        let text = read_to_string(file).ok()?;
        number(text.lines().find_map(|line| line.strip_prefix(key))?)
    };
    let whole = |file: &str| number(&read_to_string(file).ok()?);
    let machine = line("/proc/meminfo", "MemAvailable:").map(|kib| 1024.0 * kib);
    let group =
        whole("/sys/fs/cgroup/memory.max").zip(whole("/sys/fs/cgroup/memory.current")).map(|(most, used)| most - used);
    let space = line("/proc/self/limits", "Max address space")
        .zip(line("/proc/self/status", "VmSize:"))
        .map(|(most, used)| most - 1024.0 * used);
    let known = [machine, group, space].into_iter().flatten();
    known.reduce(f64::min).map(|bytes| bytes.max(0.0))
}
