//! How commands are refused, broken off and outlived: numbers out of bounds, signals, parents that die.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

const STRIDEMAP: &str = env!("CARGO_BIN_EXE_stridemap");

/// A process that ends with the test.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(dir: &Path, program: &str, arguments: &[&str]) -> Process {
    let child = Command::new(program)
        .current_dir(dir)
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    Process(child)
}

fn wait<T>(what: &str, mut done: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + Duration::from_secs(120);
    loop {
        if let Some(done) = done() {
            return done;
        }
        assert!(Instant::now() < deadline, "{what} did not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn signal(id: u32, signal: Signal) {
    kill(Pid::from_raw(id.try_into().unwrap()), signal).unwrap();
}

#[cfg(feature = "ros2")]
const OF_A_LINK: [(&str, &str); 5] = [
    ("robot op3 --realtime-factor 1e-300", "realtime_factor"),
    ("robot op3 --interface 203.0.113.7", "127.0.0.1 (lo)"),
    ("stop --interface ::1", "IPv4"),
    ("learn small-stepping --robot ros2 --yes --interface 203.0.113.7 --out run", "no interface with that address"),
    ("learn small-stepping --robot ros2 --yes --set=link.connect_s=1e300 --out run", "link.connect_s"),
];
/// Whatever needs ROS 2 says which command builds it.
#[cfg(not(feature = "ros2"))]
const OF_A_LINK: [(&str, &str); 5] = [
    ("robot op3 --seed 2", "cargo run --release --features ros2 -- robot op3 --seed 2"),
    ("stop --rearm", "built without ROS 2"),
    ("bench-link", "built without ROS 2"),
    ("learn small-stepping --robot ros2 --out run", "--features ros2 -- learn small-stepping --robot ros2 --out run"),
    ("compare small-stepping --robot ros2 --out run", "built without ROS 2"),
];

#[test]
fn numbers_and_networks_that_make_no_sense_are_refused_before_anything_is_done() {
    let dir = tempfile::tempdir().unwrap();
    for (words, told) in [
        ("robot op3 --realtime-factor nan", "must be 0 to 1000"),
        ("robot op3 --seconds nan", "must be 0 to"),
        ("robot op3 --rate 1e9", "must be 10 to 1000"),
        ("robot op3 --domain 233", "233"),
        ("bench-link --seconds inf", "must be 1 to"),
        ("run --nominal stepping --seconds -1", "must be 0.001 to"),
        ("push run --force nan", "must be 0.000001 to"),
        ("learn stepping --until-error nan", "must be 0 to"),
        ("learn stepping --domain 5 --out run", "--robot ros2"),
        ("learn walking --learner linear --set=collect.strides=[1]", "a regression on the action"),
        ("fit t.csv --out no/m.json", "no/m.json: cannot be written: No such file"),
        ("report run --out no/p.html", "no/p.html: cannot be written: No such file"),
        ("view run --out .", ".: cannot be written: is a directory"),
        ("learn stepping --set name=\u{202e}x --out run", "letters, digits"),
    ]
    .into_iter()
    .chain(OF_A_LINK)
    {
        let words = words.replace(" -1", "=-1");
        let output = Command::new(STRIDEMAP).current_dir(dir.path()).args(words.split(' ')).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{words}: {stderr}");
        assert!(stderr.contains(told), "{words}: {stderr}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "{words}");
    }
}

#[test]
fn ctrl_c_is_heard_in_the_middle_of_a_computation_and_the_run_stays() {
    let dir = tempfile::tempdir().unwrap();
    // Fit and learner would take hours.
    let words = "learn stepping --out run --set map.starts=1000 --set learner.actor_critic.trials=100000 \
                 --set learner.actor_critic.strides_per_trial=100000 --set record.strides=3 --set record.discard=0";
    // What is ignored at the start stays ignored, and a job in the background of a script ignores SIGINT.
    let env = ["--default-signal=INT", STRIDEMAP];
    let words: Vec<&str> = env.into_iter().chain(words.split(' ')).collect();
    let mut learn = start(dir.path(), "env", &words);
    let log = dir.path().join("run/events.ndjson");
    wait("the fit", || {
        let text = std::fs::read_to_string(&log).unwrap_or_default();
        text.contains("\"collect\"").then_some(())
    });
    std::thread::sleep(Duration::from_millis(200));
    signal(learn.0.id(), Signal::SIGINT);
    let status = wait("the end", || learn.0.try_wait().unwrap());
    assert_eq!(status.code(), Some(1));
    let table = std::fs::read_to_string(dir.path().join("run/transitions.csv")).unwrap();
    assert_eq!(table.lines().count(), 21, "{table}");
}

#[test]
#[cfg(feature = "ros2")]
fn a_hangup_that_was_ignored_at_the_start_stays_ignored() {
    let dir = tempfile::tempdir().unwrap();
    // `env` sets what is inherited, whatever this test was started with.
    for (disposition, ignored) in [("--ignore-signal=HUP", true), ("--default-signal=HUP", false)] {
        let robot = ["robot", "op3", "--domain=138", "--seconds=100000"];
        let words = [&[disposition, STRIDEMAP], &robot[..]].concat();
        let mut robot = start(dir.path(), "env", &words);
        let caught = || {
            let path = format!("/proc/{}/status", robot.0.id());
            let status = std::fs::read_to_string(path).ok()?;
            let mask = status.lines().find_map(|l| l.strip_prefix("SigCgt:"))?;
            let mask = u64::from_str_radix(mask.trim(), 16).ok()?;
            // Termination (15) is caught as soon as the robot listens to signals.
            (mask & (1 << 14) != 0).then_some(mask)
        };
        let mask = wait("the handler", caught);
        assert_eq!(mask & 1 == 0, ignored, "{mask:x}");
        signal(robot.0.id(), Signal::SIGHUP);
        if ignored {
            signal(robot.0.id(), Signal::SIGTERM);
        }
        assert!(wait("the end", || robot.0.try_wait().unwrap()).success());
    }
}

#[test]
fn a_file_that_may_not_grow_is_an_error_with_its_name_and_the_run_goes_on_later() {
    let dir = tempfile::tempdir().unwrap();
    let limited = |kib: &str, words: &str| {
        let line = format!("ulimit -f {kib}; exec {STRIDEMAP} {words}");
        let mut shell = Command::new("bash");
        shell.args(["-c", &line]).current_dir(dir.path());
        let end = shell.output().unwrap();
        (end.status.code(), String::from_utf8_lossy(&end.stderr).into_owned())
    };
    let sets = "--set collect.strides=[20] --set algorithm.iterations=1 --set record.strides=6 \
                --set record.pose_seconds=0.5";
    let (code, said) = limited("16", &format!("learn stepping --out run {sets}"));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("run/") && said.contains("File too large"), "{said}");
    let (code, said) = limited("unlimited", "learn --resume run");
    assert_eq!(code, Some(0), "{said}");
}
