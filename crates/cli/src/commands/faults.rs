//! The fault table: faults of network, messages and robot on a running link, and of processes on processes.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use stridemap_link::{FAULT_DOMAINS, FaultRow, Status, StatusListener, fault_table};
use stridemap_robot::Ros2Config;

use super::process::Process;
use crate::args::FaultKind;
use crate::failure::Failure;
use crate::output;
use crate::stop::stop_flag;

/// Strides that each controller makes in the end.
const STRIDES: usize = 8;
/// The fault comes when so many are made.
const BEFORE: usize = 3;
/// How long anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

fn working(what: impl std::fmt::Display) -> Failure {
    Failure::working(what.to_string())
}

/// A robot and a controller, each a process, and an listener on the robot.
struct Pair {
    domain: u16,
    robot: Process,
    controller: Process,
    listener: StatusListener,
    run: PathBuf,
    dir: PathBuf,
}

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(ToOwned::to_owned).collect()
}

fn robot(domain: u16, dir: &Path) -> Result<Process, Failure> {
    let robot = words(&format!("robot op3 --seed 1 --domain {domain} --seconds 600"));
    Process::start(&robot, Some(&dir.join("robot.log")))
}

impl Pair {
    /// Starts both; returns when some strides are made.
    fn start(domain: u16, dir: &Path) -> Result<Self, Failure> {
        let run = dir.join(format!("run-{domain}"));
        let listener = StatusListener::open(&Ros2Config { domain, ..Ros2Config::default() })?;
        let robot = robot(domain, dir)?;
        let mut collect = words(&format!(
            "collect small-stepping --robot ros2 --yes --set link.domain={domain} --set \
             collect.strides=[{STRIDES}] --set link.silence_s=0.5 --set link.connect_s=5"
        ));
        collect.extend(["--out".to_owned(), run.display().to_string()]);
        let controller = Process::start(&collect, Some(&dir.join("controller.log")))?;
        let mut pair = Self { domain, robot, controller, listener, run, dir: dir.into() };
        pair.wait_for("strides", |rows| rows.len() >= BEFORE)?;
        Ok(pair)
    }

    /// Rows of the run's strides that are whole.
    fn rows(&self) -> Vec<String> {
        let text = std::fs::read_to_string(self.run.join("transitions.csv")).unwrap_or_default();
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        whole.lines().skip(1).map(ToOwned::to_owned).collect()
    }

    fn wait_for(&mut self, what: &str, done: impl Fn(&[String]) -> bool) -> Result<(), Failure> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            // Asked first: what it wrote before it ended counts.
            let ended = self.controller.ended()?;
            if done(&self.rows()) {
                return Ok(());
            }
            if let Some(status) = ended {
                return Err(working(format!(
                    "the controller ended before it made {what} ({status}); it said:\n{}",
                    self.controller.last_words()
                )));
            }
            if Instant::now() > deadline {
                return Err(working(format!("the controller did not make {what} in time")));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Goes on with the run; whether it came to its end with every stride from before.
    fn resume(&mut self, before: &[String]) -> Result<bool, Failure> {
        let run = self.run.display().to_string();
        let go_on = ["collect".to_owned(), run, "--yes".to_owned()];
        self.controller = Process::start(&go_on, Some(&self.dir.join("controller.log")))?;
        let ended = self.controller.end(PATIENCE)?;
        Ok(ended && self.rows().starts_with(before) && crossings(&self.rows()) == STRIDES)
    }

    /// When the robot held and when it gave way, by its own silence.
    fn reaction(&self, since: Instant) -> (Option<f64>, Option<f64>) {
        let damps = |s: &Status| s.act == "damp";
        self.listener.wait(since, Duration::from_secs(5), damps);
        let heard = self.listener.since(since);
        let at = |act: &str| {
            let mut doing = heard.iter().filter(|s| s.act == act);
            doing.find_map(|s| s.silence_s)
        };
        (at("hold"), at("damp"))
    }
}

fn is(row: &str, end: &str) -> bool {
    row.split(',').any(|cell| cell == end)
}

fn crossings(rows: &[String]) -> usize {
    rows.iter().filter(|row| is(row, "crossing")).count()
}

fn ms(seconds: Option<f64>) -> String {
    seconds.map_or("?".into(), |s| format!("{:.0} ms", 1e3 * s))
}

/// What the strides of a run are when nothing bad has entered: all asked for, none longer than a stride can be.
fn only_good(rows: &[String]) -> bool {
    let good = rows.iter().filter(|row| is(row, "crossing"));
    // Robot time at the end of successive strides of an episode; a stride takes about 0.8 s, and one with
    // the fault in it would take as much longer.
    let ends: Vec<(String, f64)> = good
        .filter_map(|row| {
            let cells: Vec<&str> = row.split(',').collect();
            Some(((*cells.get(3)?).to_owned(), cells.get(5)?.parse().ok()?))
        })
        .collect();
    ends.windows(2).all(|w| w[0].0 != w[1].0 || w[1].1 - w[0].1 < 1.2)
}

fn controller_killed(domain: u16, dir: &Path) -> Result<FaultRow, Failure> {
    let mut pair = Pair::start(domain, dir)?;
    let began = Instant::now();
    pair.controller.kill()?;
    let (hold, damp) = pair.reaction(began);
    let before = pair.rows();
    let kept = pair.resume(&before)?;
    Ok(FaultRow::new(
        "controller killed (-9)",
        format!(
            "robot holds after {}, gives way after {}; of {} strides {} and the run is resumed to its end",
            ms(hold),
            ms(damp),
            before.len(),
            if kept { "none is lost" } else { "SOME ARE LOST" }
        ),
        hold,
        kept && only_good(&pair.rows()),
        FaultRow::held_in_time(hold) && damp.is_some(),
    ))
}

fn robot_killed(domain: u16, dir: &Path) -> Result<FaultRow, Failure> {
    let mut pair = Pair::start(domain, dir)?;
    let began = Instant::now();
    pair.robot.kill()?;
    pair.wait_for("an aborted stride", |rows| rows.iter().any(|row| is(row, "aborted")))?;
    let took_s = began.elapsed().as_secs_f64();
    let gave_up = !pair.controller.end(PATIENCE)?;
    let before = pair.rows();
    pair.robot = robot(pair.domain, dir)?;
    let kept = pair.resume(&before)?;
    Ok(FaultRow::new(
        "robot killed (-9)",
        format!(
            "controller aborts the stride after {} (silence of 0.5 s) and {}; with the robot back the run is \
             resumed, of {} strides {}",
            ms(Some(took_s)),
            if gave_up { "ends" } else { "DOES NOT END" },
            crossings(&before),
            if kept { "none is lost" } else { "SOME ARE LOST" }
        ),
        Some(took_s),
        kept && only_good(&pair.rows()),
        gave_up && took_s < 3.0,
    ))
}

fn controller_stopped(domain: u16, dir: &Path) -> Result<FaultRow, Failure> {
    let mut pair = Pair::start(domain, dir)?;
    let began = Instant::now();
    pair.controller.signal(Signal::SIGSTOP)?;
    std::thread::sleep(Duration::from_secs(1));
    let (hold, damp) = pair.reaction(began);
    pair.controller.signal(Signal::SIGCONT)?;
    let ended = pair.controller.end(PATIENCE)?;
    let rows = pair.rows();
    let aborted = rows.iter().filter(|row| is(row, "aborted")).count();
    Ok(FaultRow::new(
        "controller stopped for 1 s (SIGSTOP)",
        format!(
            "robot holds after {}, gives way after {}; {aborted} stride aborted, then the run goes on to its end",
            ms(hold),
            ms(damp)
        ),
        hold,
        aborted > 0 && only_good(&rows) && crossings(&rows) == STRIDES,
        ended && FaultRow::held_in_time(hold) && damp.is_some(),
    ))
}

/// A directory that is removed with its owner.
struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Faults of processes: the robot and the controller are processes of this program.
fn process_faults(domain: u16, dir: &Path, row: &mut dyn FnMut(FaultRow)) -> Result<(), Failure> {
    row(controller_killed(domain, dir)?);
    row(robot_killed(domain + 1, dir)?);
    row(controller_stopped(domain + 2, dir)?);
    Ok(())
}

/// Tries every fault and tells each row as soon as it is known.
fn try_all(only: Option<FaultKind>, domain: u16, dir: &Path, row: &mut dyn FnMut(FaultRow)) -> Result<(), Failure> {
    if only != Some(FaultKind::Link) {
        process_faults(domain + FAULT_DOMAINS, dir, row)?;
    }
    if only != Some(FaultKind::Processes) {
        let link = Ros2Config { domain, ..Ros2Config::default() };
        fault_table(&link, row);
    }
    Ok(())
}

fn show(row: &FaultRow) {
    let within = row.within_ms.map_or("-".into(), |ms| format!("{ms:.0} ms"));
    output::line(format!("{} {:<50} {within:>8}  {}", if row.ok { "ok  " } else { "FAIL" }, row.fault, row.seen));
}

/// Tries every fault and prints the table: each row when it is known, and those that are known when it ends
/// too early.
pub fn faults(json: bool, only: Option<FaultKind>, domain: u16) -> Result<(), Failure> {
    /// The last from which all that are needed are there.
    const LAST: u16 = 232 - FAULT_DOMAINS - 3;
    if domain > LAST {
        return Err(Failure::request(format!("--domain must be at most {LAST}")));
    }
    let name = format!("stridemap-faults-{}", std::process::id());
    let scratch = Scratch(std::env::temp_dir().join(name));
    std::fs::create_dir_all(&scratch.0).map_err(working)?;
    let stop = stop_flag();
    let (told, hears) = channel();
    // Beside this thread, which hears Ctrl-C wherever the other waits. Its processes end with this one.
    let dir = scratch.0.clone();
    std::thread::spawn(move || {
        let mut row = |row| {
            let _ = told.send(Ok(row));
        };
        if let Err(failure) = try_all(only, domain, &dir, &mut row) {
            let _ = told.send(Err(failure));
        }
    });
    let mut rows: Vec<FaultRow> = Vec::new();
    let failure = loop {
        match hears.recv_timeout(Duration::from_millis(50)) {
            Ok(Ok(row)) => {
                if !json {
                    show(&row);
                }
                rows.push(row);
            }
            Ok(Err(failure)) => break Some(failure),
            Err(RecvTimeoutError::Timeout) if !stop.load(Ordering::Relaxed) => {}
            Err(RecvTimeoutError::Timeout) => break Some(working("stopped before the last fault")),
            Err(RecvTimeoutError::Disconnected) => break None,
        }
    };
    if json {
        output::json(&rows)?;
    }
    match failure {
        Some(failure) => Err(failure),
        None if rows.iter().all(|row| row.ok) => Ok(()),
        None => Err(working("the link did not meet every fault as it must")),
    }
}
