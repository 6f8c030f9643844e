//! Learning on a robot that is another process: killed, stopped, asked for, gone on with.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use stridemap_link::StatusListener;
use stridemap_robot::Ros2Config;

/// Overrides that make a run short: two iterations of eight strides and two of the policy.
const SHORT: [&str; 9] = [
    "--set=collect.strides=[8]",
    "--set=algorithm.iterations=2",
    "--set=algorithm.evaluation_strides=2",
    "--set=algorithm.evaluation_discard=0",
    "--set=learner.actor_critic.trials=10",
    "--set=record.strides=3",
    "--set=record.iteration_strides=2",
    "--set=record.discard=1",
    "--set=record.pose_seconds=0.5",
];

/// Strides of such a run, in the budget.
const STRIDES: usize = 2 * (8 + 2);

/// One robot at a time: several share too little of a small machine.
fn turn() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A process that ends with the test.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(dir: &Path, arguments: &[&str]) -> Process {
    // A signal that is ignored at the start stays ignored; a job in the background of a script ignores SIGINT.
    let child = Command::new("env")
        .args(["--default-signal=INT", env!("CARGO_BIN_EXE_stridemap")])
        .current_dir(dir)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(dir.join(format!("{}.log", arguments[0]))).unwrap())
        .spawn()
        .unwrap();
    Process(child)
}

/// A robot in lock step, which a busy machine cannot make late.
fn robot(dir: &Path, domain: u16) -> Process {
    let domain = domain.to_string();
    start(dir, &["robot", "op3", "--domain", &domain, "--realtime-factor", "0"])
}

fn learn(dir: &Path, domain: u16, more: &[&str]) -> Process {
    let domain = format!("--set=link.domain={domain}");
    let head = ["learn", "small-stepping", "--robot", "ros2", "--out", "run"];
    start(dir, &[&head[..], &SHORT, &[domain.as_str()], more].concat())
}

fn wait(what: &str, mut done: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(120);
    while !done() {
        assert!(Instant::now() < deadline, "{what} did not come");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn end(process: &mut Process) -> bool {
    let mut status = None;
    wait("the end", || {
        status = process.0.try_wait().unwrap();
        status.is_some()
    });
    status.unwrap().success()
}

fn signal(process: &Process, signal: Signal) {
    kill(Pid::from_raw(process.0.id().try_into().unwrap()), signal).unwrap();
}

fn read(path: PathBuf) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

/// Whole rows of the run's strides.
fn rows(dir: &Path) -> Vec<String> {
    let text = read(dir.join("run/transitions.csv"));
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    whole.lines().skip(1).map(ToOwned::to_owned).collect()
}

fn crossings(dir: &Path) -> usize {
    rows(dir).iter().filter(|r| r.contains(",crossing,")).count()
}

/// What was asked and answered, in the run's events.
fn answers(dir: &Path) -> Vec<(String, String)> {
    let text = read(dir.join("run/events.ndjson"));
    let events = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    events
        .filter(|e| e["event"] == "asked")
        .map(|e| {
            let word = |key: &str| e[key].as_str().unwrap().to_owned();
            (word("asked"), word("answered"))
        })
        .collect()
}

fn say(stdin: &mut ChildStdin, line: &str) {
    writeln!(stdin, "{line}").unwrap();
    stdin.flush().unwrap();
}

fn stop(dir: &Path, domain: u16, more: &[&str]) {
    let domain = domain.to_string();
    let words = [&["stop", "--domain", &domain][..], more].concat();
    assert!(end(&mut start(dir, &words)));
}

#[test]
fn a_controller_that_is_killed_goes_on_without_losing_a_stride() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let _robot = robot(dir, 20);
    let mut controller = learn(dir, 20, &["--yes"]);
    // In the middle of the second batch.
    wait("the second batch", || rows(dir).len() >= 11);
    controller.0.kill().unwrap();
    controller.0.wait().unwrap();
    let before = rows(dir);
    assert!(before.len() < STRIDES, "killed too late: {}", before.len());
    let mut again = start(dir, &["learn", "--resume", "run", "--yes"]);
    assert!(end(&mut again), "{}", read(dir.join("learn.log")));
    let after = rows(dir);
    assert_eq!(after[..before.len()], before[..], "strides from before are the first");
    assert_eq!(crossings(dir), STRIDES);
    assert!(dir.join("run/summary.json").exists() && dir.join("run/log-2.mcap").exists());
    let first = ("before the first stride".to_owned(), "yes (--yes)".to_owned());
    assert_eq!(answers(dir), [first.clone(), first], "asked at both starts");
    let events = read(dir.join("run/events.ndjson"));
    // Of the rows, 8 were explored and 2 proved the first policy.
    let kept = format!("\"of_an_unfinished_batch\":{}", before.len() - 10);
    assert!(events.contains(&kept), "{events}");
}

#[test]
fn the_robot_moves_after_a_yes_and_again_after_a_stop_only_when_it_was_set_up() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let _robot = robot(dir, 21);
    let log = || read(dir.join("learn.log"));
    // A no: nothing moves, and the answer is kept.
    let mut refused = learn(dir, 21, &[]);
    let mut stdin = refused.0.stdin.take().unwrap();
    say(&mut stdin, "n");
    assert!(!end(&mut refused));
    for word in ["strides to learn from", "joints turn at up to", "falls are expected", "[y/N]", "the operator said no"]
    {
        assert!(log().contains(word), "{word:?} in {}", log());
    }
    assert_eq!(rows(dir).len(), 0);

    // The same run with a yes, and the stop pressed in the first batch.
    let mut controller = start(dir, &["learn", "--resume", "run"]);
    let mut stdin = controller.0.stdin.take().unwrap();
    say(&mut stdin, "y");
    wait("strides", || crossings(dir) >= 3);
    stop(dir, 21, &["--reason", "a test"]);
    wait("a question", || log().matches("[y/N]").count() == 2);
    let made = crossings(dir);
    assert!(rows(dir).last().unwrap().contains(",aborted,"));
    // Still latched: a yes is not enough, and is asked again.
    say(&mut stdin, "y");
    wait("another question", || log().matches("[y/N]").count() == 3);
    assert_eq!(crossings(dir), made, "the robot stands while it is asked for");
    stop(dir, 21, &["--rearm"]);
    say(&mut stdin, "y");
    assert!(end(&mut controller), "{}", log());
    assert_eq!(crossings(dir), STRIDES, "the aborted stride is none of them");
    let asked = answers(dir);
    let answered: Vec<&str> = asked.iter().map(|(_, a)| a.as_str()).collect();
    assert_eq!(answered, ["no", "yes", "yes", "yes"], "{asked:?}");
    assert!(asked[2].0.contains("a test"), "{asked:?}");
}

#[test]
fn after_a_fall_the_robot_waits_until_it_is_set_up() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let _robot = robot(dir, 22);
    // What counts as a fall: psi_roll under 3.5 deg, where the nominal gait stands above 5.
    let mut controller = learn(dir, 22, &["--set=failure.psi_roll_below_deg=3.5"]);
    let mut stdin = controller.0.stdin.take().unwrap();
    say(&mut stdin, "y");
    wait("a fall", || answers(dir).len() == 1 && rows(dir).iter().any(|r| r.contains(",fell,")));
    let log = || read(dir.join("learn.log"));
    wait("a question", || log().contains("the robot fell"));
    say(&mut stdin, "n");
    assert!(!end(&mut controller));
    let (asked, answered) = answers(dir)[1].clone();
    assert!(asked.starts_with("the robot fell: psi_roll") && answered == "no", "{asked}");
}

#[test]
fn ctrl_c_is_an_emergency_stop_that_stays() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let _robot = robot(dir, 23);
    let mut controller = learn(dir, 23, &["--yes"]);
    wait("strides", || crossings(dir) >= 2);
    signal(&controller, Signal::SIGINT);
    assert!(!end(&mut controller));
    let log = read(dir.join("learn.log"));
    assert!(log.contains("emergency stop"), "{log}");
    let before = rows(dir);
    let mut again = start(dir, &["learn", "--resume", "run", "--yes"]);
    assert!(!end(&mut again), "latched");
    assert!(read(dir.join("learn.log")).contains("re-arm"));
    stop(dir, 23, &["--rearm"]);
    let mut again = start(dir, &["learn", "--resume", "run", "--yes"]);
    assert!(end(&mut again), "{}", read(dir.join("learn.log")));
    let after = rows(dir);
    assert_eq!(after[..before.len()], before[..]);
    assert_eq!(crossings(dir), STRIDES);
}

/// A listener on a robot, and when it held and gave way since a moment, by its own silence.
fn listen(domain: u16) -> impl Fn(Instant) -> (f64, f64) {
    let listener = StatusListener::open(&Ros2Config { domain, ..Ros2Config::default() }).unwrap();
    move |since| {
        assert!(listener.wait(since, Duration::from_secs(20), |s| s.act == "damp"), "the robot did not give way");
        let heard = listener.since(since);
        let at = |act: &str| heard.iter().filter(|s| s.act == act).find_map(|s| s.silence_s).unwrap();
        (at("hold"), at("damp"))
    }
}

/// The robot holds within 50 ms of silence and two periods, and gives way after half a second; a loaded machine adds
/// to that.
fn held_in_time((hold_s, damp_s): (f64, f64)) {
    assert!(hold_s < 0.05 + 2.0 * 0.008 + 0.05 && hold_s < damp_s, "{hold_s} s, {damp_s} s");
}

/// No stride is longer than one can be (about 0.8 s): with a fault in it, it would be as much longer.
fn only_good(dir: &Path) {
    let good: Vec<Vec<String>> = rows(dir)
        .iter()
        .filter(|row| row.contains(",crossing,"))
        .map(|row| row.split(',').map(String::from).collect())
        .collect();
    for pair in good.windows(2).filter(|w| w[0][3] == w[1][3]) {
        let took_s = pair[1][5].parse::<f64>().unwrap() - pair[0][5].parse::<f64>().unwrap();
        assert!(took_s < 1.2, "{pair:?}");
    }
}

#[test]
fn a_robot_that_is_killed_costs_the_stride_at_hand_and_the_run_goes_on_with_another() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let mut killed = start(dir, &["robot", "op3", "--domain", "25"]);
    let mut controller = learn(dir, 25, &["--yes", "--set=link.silence_s=0.5", "--set=link.connect_s=5"]);
    wait("strides", || crossings(dir) >= 3);
    let began = Instant::now();
    killed.0.kill().unwrap();
    killed.0.wait().unwrap();
    wait("an aborted stride", || rows(dir).iter().any(|row| row.contains(",aborted,")));
    assert!(began.elapsed() < Duration::from_secs(3));
    assert!(!end(&mut controller), "there is no robot");
    let before = rows(dir);
    let _robot = robot(dir, 25);
    assert!(end(&mut start(dir, &["learn", "--resume", "run", "--yes"])), "{}", read(dir.join("learn.log")));
    assert_eq!(rows(dir)[..before.len()], before[..]);
    assert_eq!(crossings(dir), STRIDES);
    only_good(dir);
}

#[test]
fn a_robot_whose_controller_is_stopped_or_killed_holds_and_gives_way() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let reaction = listen(26);
    let _robot = start(dir, &["robot", "op3", "--domain", "26"]);
    let mut controller = learn(dir, 26, &["--yes"]);
    wait("strides", || crossings(dir) >= 3);
    let began = Instant::now();
    signal(&controller, Signal::SIGSTOP);
    std::thread::sleep(Duration::from_secs(1));
    held_in_time(reaction(began));
    signal(&controller, Signal::SIGCONT);
    wait("the aborted stride and more", || rows(dir).iter().any(|r| r.contains(",aborted,")) && crossings(dir) >= 6);
    let began = Instant::now();
    controller.0.kill().unwrap();
    held_in_time(reaction(began));
    only_good(dir);
}

#[test]
fn a_log_gives_the_strides_again_without_a_robot() {
    let _turn = turn();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let _robot = robot(dir, 24);
    let domain = "--set=link.domain=24";
    let head = ["collect", "small-stepping", "--robot", "ros2", "--yes", "--out", "run"];
    let words = [&head[..], &["--set=collect.strides=[8]", domain]].concat();
    assert!(end(&mut start(dir, &words)), "{}", read(dir.join("collect.log")));
    let from = ["collect", "small-stepping", "--from", "run/log.mcap", "--out", "again.csv"];
    assert!(end(&mut start(dir, &from)), "{}", read(dir.join("collect.log")));
    let again = read(dir.join("again.csv"));
    let again: Vec<&str> = again.lines().skip(1).collect();
    let before = rows(dir);
    assert_eq!(again.len(), before.len());
    for (old, new) in before.iter().zip(again) {
        for (a, b) in old.split(',').zip(new.split(',')) {
            match (a.parse::<f64>(), b.parse::<f64>()) {
                // Stamps are whole nanoseconds: velocities differ in the last digits.
                (Ok(a), Ok(b)) => assert!((a - b).abs() <= 1e-5 * (1.0 + a.abs()), "{a} {b}"),
                _ => assert_eq!(a, b),
            }
        }
    }
}

/// A log without some of its messages.
fn without(log: &Path, to: &Path, drop: impl Fn(&str, usize) -> bool) {
    let bytes = std::fs::read(log).unwrap();
    let file = std::fs::File::create(to).unwrap();
    let mut writer = mcap::WriteOptions::new().compression(None).create(std::io::BufWriter::new(file)).unwrap();
    let mut seen = std::collections::BTreeMap::<String, usize>::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let topic = &message.channel.topic;
        let nth = seen.entry(topic.clone()).or_default();
        *nth += 1;
        if !drop(topic, *nth - 1) {
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn a_lost_message_of_a_log_costs_its_strides_and_changes_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let stridemap =
        |words: &[&str]| Command::new(env!("CARGO_BIN_EXE_stridemap")).current_dir(dir).args(words).output().unwrap();
    let collected = stridemap(&["collect", "small-stepping", "--log", "--out", "run"]);
    assert!(collected.status.success(), "{collected:?}");
    let log = dir.join("run/log.mcap");
    let from = |name: &str| {
        let (log, out) = (format!("{name}.mcap"), format!("{name}.csv"));
        let read = stridemap(&["collect", "small-stepping", "--from", &log, "--out", &out]);
        let table = read_rows(&dir.join(out));
        (read.status.code(), table, String::from_utf8_lossy(&read.stderr).into_owned())
    };
    without(&log, &dir.join("whole.mcap"), |_, _| false);
    let (code, whole, _) = from("whole");
    assert_eq!((code, whole.len()), (Some(0), 20));

    without(&log, &dir.join("action.mcap"), |topic, nth| topic == "/stridemap/action" && nth == 5);
    let (code, rows, told) = from("action");
    assert_eq!(code, Some(0));
    assert_eq!(rows, [&whole[..5], &whole[7..]].concat(), "{told}");
    assert!(told.contains("1 left out for want of an action"), "{told}");

    without(&log, &dir.join("gap.mcap"), |topic, nth| topic == "/joint_states" && (1500..1625).contains(&nth));
    let (code, rows, told) = from("gap");
    let (aborted, before) = rows.split_last().unwrap();
    assert_eq!((code, before), (Some(0), &whole[..before.len()]));
    assert!(before.len() > 5 && aborted.contains(",aborted,"), "{aborted}");
    assert!(told.contains("no state for 1.008 s of robot time"), "{told}");

    without(&log, &dir.join("none.mcap"), |topic, _| topic == "/stridemap/action");
    let (code, rows, told) = from("none");
    assert_eq!((code, rows.len()), (Some(1), 0));
    assert!(told.contains("no /stridemap/action"), "{told}");
}

/// The rows of a table of strides, without its head.
fn read_rows(path: &Path) -> Vec<String> {
    let text = read(path.to_path_buf());
    text.lines().skip(1).map(ToOwned::to_owned).collect()
}
