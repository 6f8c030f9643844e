//! Ctrl-C and termination: whatever is at work hears of them within a second.
//!
//! A flag asks for an orderly end, after the stride at hand. Work that does not look at it (a fit, a search in the
//! map, a figure) is broken off a moment later: what a run has made is on disk after every stride, and a run
//! that ended anywhere can be resumed.

use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use stridemap_link::send_stop;
use stridemap_robot::Ros2Config;

use crate::output;

/// How long an orderly end may take.
const GRACE: Duration = Duration::from_millis(700);

/// Where the robot behind a link is that is at work.
static ROBOT: OnceLock<Ros2Config> = OnceLock::new();

/// A write over a limit on the size of files (`ulimit -f`) fails with an error, as on a full disk, instead of ending
/// the process without a word.
pub fn outlive_full_files() {
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
}

/// A flag that Ctrl-C and termination set, the same for the whole process; the second one ends it at once.
pub fn stop_flag() -> Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    let flag = FLAG.get_or_init(|| {
        let flag = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&flag);
        let ignored = ignored_signals();
        // What was ignored at the start stays so: nohup, and jobs in the background of a script.
        let heard = [SIGINT, SIGTERM, SIGHUP].map(|s| (s, ignored & (1 << (s - 1)) == 0));
        let heard = heard.iter().filter_map(|(s, heard)| heard.then_some(*s));
        // Without a handler a signal just ends the process; the run can be resumed then as well.
        if let Ok(mut signals) = Signals::new(heard) {
            std::thread::spawn(move || {
                for signal in signals.forever() {
                    if seen.swap(true, Ordering::Relaxed) {
                        exit(128 + signal);
                    }
                    std::thread::spawn(end_soon);
                }
            });
        }
        flag
    });
    Arc::clone(flag)
}

/// The same flag where a robot behind a link is at work: there Ctrl-C is its emergency stop.
pub fn robot_stop_flag(link: &Ros2Config) -> Arc<AtomicBool> {
    let _ = ROBOT.set(link.clone());
    stop_flag()
}

/// Ends the process if it does not end by itself.
fn end_soon() {
    match ROBOT.get() {
        Some(link) => {
            output::note("emergency stop: the robot gives way until `stridemap stop --rearm` (again to end at once)");
            // Whoever commands the robot presses as well, but may be at work in the map.
            if !matches!(send_stop(link, "Ctrl-C at the controller", false), Ok(true)) {
                output::note("THE ROBOT HAS NOT SAID THAT IT STOPPED");
            }
        }
        None => output::note("stopping (again to end at once)"),
    }
    std::thread::sleep(GRACE);
    output::note("broken off in the middle of a computation; strides that were made are kept");
    exit(1);
}

/// Signals that this process ignores, as bits from signal 1 on; none where the system does not tell.
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok()).unwrap_or(0)
}
