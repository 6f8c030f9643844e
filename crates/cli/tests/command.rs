//! The command as its users meet it: results, exit codes, what is written and what is not.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::process::{Command, Output};

/// Overrides that make a run short.
const SHORT: [&str; 8] = [
    "--set=collect.strides=[6]",
    "--set=algorithm.iterations=1",
    "--set=algorithm.evaluation_strides=2",
    "--set=algorithm.evaluation_discard=0",
    "--set=learner.actor_critic.trials=10",
    "--set=record.strides=3",
    "--set=record.iteration_strides=2",
    "--set=record.pose_seconds=0.5",
];

fn stridemap(dir: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_stridemap")).current_dir(dir).args(arguments).output().unwrap()
}

fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn learn(dir: &Path, out: &str, more: &[&str]) -> Output {
    let arguments = [&["learn", "stepping", "--json", "--out", out][..], &SHORT, more].concat();
    stridemap(dir, &arguments)
}

fn entries(dir: &Path) -> usize {
    std::fs::read_dir(dir).unwrap().count()
}

#[test]
fn learn_writes_a_run_that_every_other_command_takes_up() {
    let dir = tempfile::tempdir().unwrap();
    let summary = json(&learn(dir.path(), "run", &["--seed", "3"]));
    assert_eq!(summary["experiment"], "stepping");
    assert_eq!(summary["seed"], 3);
    assert_eq!(summary["strides"]["training"], 8);
    assert_eq!(summary["final"]["strides"], 3);
    assert!(summary["nominal"]["mean_reward"].as_f64().unwrap() < -0.05);
    let run = dir.path().join("run");
    for file in [
        "config.toml",
        "provenance.json",
        "transitions.csv",
        "map/1.json",
        "policy/final.json",
        "learning.csv",
        "events.ndjson",
        "summary.json",
        "report.html",
        "figures/map.svg",
    ] {
        assert!(run.join(file).exists(), "{file} is missing");
    }

    let before = std::fs::read_to_string(run.join("summary.json")).unwrap();
    let files = entries(&run);
    let evaluated = json(&stridemap(
        dir.path(),
        &["evaluate", "run", "--strides", "4", "--set", "robot.mass_scale=1.05", "--json"],
    ));
    assert_eq!((evaluated["strides"].as_u64(), evaluated["falls"].as_u64()), (Some(4), Some(0)));
    let pushed = json(&stridemap(dir.path(), &["push", "run", "--strides", "16", "--json"]));
    assert_eq!(pushed["pairs"], 4);
    assert!(pushed["slope"].is_number());
    // 95 kg and 0.04 m/s: 3.8 N s, in 0.2 s 19 N.
    for (key, value) in [("force_n", 19.0), ("impulse_n_s", 3.8), ("velocity_change_m_s", 0.04)] {
        assert!((pushed[key].as_f64().unwrap() - value).abs() < 1e-9, "{key}: {pushed}");
    }
    assert_eq!(entries(&run), files + 2, "evaluate leaves the run alone, push adds two files");
    assert_eq!(std::fs::read_to_string(run.join("summary.json")).unwrap(), before);

    let fitted = json(&stridemap(dir.path(), &["fit", "run/transitions.csv", "--json"]));
    assert_eq!(fitted["samples"], 8);
    assert!(stridemap(dir.path(), &["report", "run"]).status.success());
}

#[test]
fn a_run_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    assert!(learn(dir.path(), "run", &[]).status.success());
    let again = learn(dir.path(), "run", &[]);
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("--resume"), "{}", stderr(&again));
}

#[test]
fn a_typo_is_told_with_its_place_and_the_nearest_key_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("my-robot.toml"), "extends = \"stepping\"\n\n[robot]\nfrictoin = 0.7\n").unwrap();
    let output = stridemap(dir.path(), &["learn", "my-robot.toml"]);
    assert_eq!(output.status.code(), Some(2));
    let text = stderr(&output);
    assert!(text.contains("my-robot.toml:4: robot.frictoin: unknown key"), "{text}");
    assert!(text.contains("did you mean `friction`?") && text.contains("allowed:"), "{text}");
    assert_eq!(entries(dir.path()), 1, "nothing but the task file");

    for (arguments, expected) in [
        (vec!["learn", "steping"], "did you mean \"stepping\"?"),
        (vec!["learn", "stepping", "--set", "map.draw=ful"], "did you mean \"full\"?"),
        (vec!["learn", "stepping", "--set", "robot.mass_scale=heavy"], "robot.mass_scale"),
        (vec!["learn", "stepping", "--seeds", "0"], "--seeds"),
        (vec!["push", "nowhere"], "holds no run"),
        (vec!["report", "nowhere"], "holds no run"),
        (vec!["learn", "--resume", "nowhere"], "holds no run"),
        (vec!["learn"], "required"),
    ] {
        let output = stridemap(dir.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    }
    assert_eq!(entries(dir.path()), 1);
}

#[test]
fn threads_do_not_change_a_byte() {
    let dir = tempfile::tempdir().unwrap();
    for threads in ["1", "2"] {
        let out = format!("threads-{threads}");
        let output = learn(dir.path(), &out, &["--seeds", "2", "--threads", threads]);
        assert_eq!(json(&output)["seeds"], 2);
    }
    for file in ["transitions.csv", "record.csv", "learning.csv", "map/1.json", "policy/final.json"] {
        for seed in ["stepping-1", "stepping-2"] {
            let read =
                |threads: &str| std::fs::read(dir.path().join(format!("threads-{threads}/{seed}/{file}"))).unwrap();
            assert!(read("1") == read("2"), "{seed}/{file}");
        }
    }
}

#[test]
fn the_verbs_one_by_one_give_what_learn_gives() {
    let dir = tempfile::tempdir().unwrap();
    let collect = [&["collect", "stepping", "--json", "--out", "verbs"][..], &SHORT].concat();
    assert_eq!(json(&stridemap(dir.path(), &collect))["strides"], 6);
    assert!(stridemap(dir.path(), &["improve", "verbs"]).status.success());
    assert!(stridemap(dir.path(), &["evaluate", "verbs", "--strides", "2"]).status.success());
    assert!(learn(dir.path(), "learn", &[]).status.success());
    // What is missing is made by resuming.
    let resumed = json(&stridemap(dir.path(), &["learn", "--resume", "verbs", "--json"]));
    assert_eq!(resumed["final"]["strides"], 3);
    for file in ["transitions.csv", "map/1.json", "policy/1.json", "policy/final.json"] {
        let read = |run: &str| std::fs::read(dir.path().join(run).join(file)).unwrap();
        assert!(read("verbs") == read("learn"), "{file}");
    }
}

#[test]
fn a_nan_in_a_log_is_told_with_line_and_column() {
    let dir = tempfile::tempdir().unwrap();
    assert!(learn(dir.path(), "run", &[]).status.success());
    let log = std::fs::read_to_string(dir.path().join("run/transitions.csv")).unwrap();
    let mut lines: Vec<String> = log.lines().map(String::from).collect();
    let mut cells: Vec<&str> = lines[3].split(',').collect();
    cells[7] = "NaN";
    lines[3] = cells.join(",");
    std::fs::write(dir.path().join("log.csv"), lines.join("\n")).unwrap();
    let output = stridemap(dir.path(), &["fit", "log.csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("log.csv:4: psi_roll_deg"), "{}", stderr(&output));
}

/// What `list` names, a task file may name.
#[test]
fn list_says_what_a_task_may_name() {
    let dir = tempfile::tempdir().unwrap();
    let names = |kind: &str| -> Vec<String> {
        let listed = json(&stridemap(dir.path(), &["list", kind, "--json"]));
        let parts = listed.as_array().unwrap().iter();
        assert!(parts.clone().all(|p| !p["about"].as_str().unwrap().is_empty()));
        parts.map(|p| p["name"].as_str().unwrap().into()).collect()
    };
    assert_eq!(names("gaits"), ["oscillator", "onnx", "zmp"]);
    assert_eq!(names("robots"), ["op3", "op3-ideal", "ros2"]);
    for (kind, key, expected) in [
        ("learners", "learner.kind=x", "search"),
        ("rewards", "reward.0.quantity=x", "speed_m_s"),
        ("states", "state=[\"x\"]", "heading_deg"),
    ] {
        let names = names(kind);
        assert!(names.iter().any(|name| name == expected), "{kind}: {names:?}");
        let refused = stridemap(dir.path(), &["check", "stepping", "--set", key]);
        let says = stderr(&refused);
        assert_eq!(refused.status.code(), Some(2));
        assert!(names.iter().all(|name| says.contains(name.as_str())), "{says}");
    }
}

#[test]
fn init_writes_a_task_file_that_can_be_learned_from() {
    let dir = tempfile::tempdir().unwrap();
    assert!(stridemap(dir.path(), &["init", "mine.toml"]).status.success());
    let twice = stridemap(dir.path(), &["init", "mine.toml"]);
    assert_eq!(twice.status.code(), Some(2));
    let report = json(&stridemap(dir.path(), &["check", "mine.toml", "--json"]));
    assert_eq!(report["ok"], true);
}

/// Strips of the small humanoid from a short run.
fn strips(dir: &Path, more: &[&str]) -> Output {
    let arguments = [
        &["reproduce", "fig16", "fig18", "--seeds", "1", "--out", "figs", "--json"][..],
        &[
            "--set=collect.strides=[6, 4]",
            "--set=collect.explore.hold=2",
            "--set=algorithm.iterations=2",
            "--set=learner.actor_critic.trials=5",
            "--set=record.walk_s=8",
            "--set=record.speed_s=8",
        ],
        more,
    ]
    .concat();
    stridemap(dir, &arguments)
}

#[test]
fn strips_are_drawn_from_runs_that_are_kept_and_say_the_recorded_speed() {
    let dir = tempfile::tempdir().unwrap();
    let document = json(&strips(dir.path(), &[]));
    let figs = dir.path().join("figs");
    let read = |file: &str| std::fs::read_to_string(figs.join(file)).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&read("runs/small-walking-1/summary.json")).unwrap();
    let speed = summary["iterations"][1]["speed_m_s"].as_f64().unwrap();
    let strides = &summary["iterations"][1]["strides_so_far"];
    let said = format!("{speed:.3} m/s").replace('-', "\u{2212}");
    let svg = read("fig18.svg");
    assert!(
        svg.contains(&format!("After iteration 2 (small-walking): {said}, learned from {strides} strides")),
        "{said}"
    );
    assert!(
        document["table"]
            .as_array()
            .unwrap()
            .iter()
            .any(|row| { row["paper"] == "0.045 m/s" && row["ours"] == format!("{speed:.3} m/s (one seed)") })
    );
    // One line a piece and a moment, and the way of the torso as recorded.
    let lapse: serde_json::Value = serde_json::from_str(&read("runs/small-walking-1/lapse/iteration-2.json")).unwrap();
    let pieces = lapse["shapes"].as_array().unwrap().len();
    let csv = read("fig18.csv");
    assert_eq!((csv.lines().count() - 1) % pieces, 0);
    assert!(csv.lines().nth(1).unwrap().contains(",0,0,0,"), "starts at the start");
    assert!(figs.join("fig16.png").exists());
    assert!(!figs.join("fig17.svg").exists(), "only what was asked for");

    // Again: the run is taken, the bytes are the same. With other settings it is refused.
    let again = strips(dir.path(), &[]);
    assert!(stderr(&again).contains("taken as it is"), "{}", stderr(&again));
    assert_eq!(read("fig18.svg"), svg);
    let other = strips(dir.path(), &["--set=record.walk_s=9"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(stderr(&other).contains("record.walk_s"), "{}", stderr(&other));
}

#[test]
fn the_small_humanoids_figures_say_what_the_run_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let document = json(&stridemap(
        dir.path(),
        &[
            "reproduce",
            "fig13",
            "fig14",
            "fig15",
            "--seeds=1",
            "--out=figs",
            "--json",
            "--set=collect.strides=[8]",
            "--set=algorithm.iterations=1",
            "--set=learner.actor_critic.trials=40",
        ],
    ));
    let figs = dir.path().join("figs");
    let read = |file: &str| std::fs::read_to_string(figs.join(file)).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&read("runs/small-stepping-1/summary.json")).unwrap();
    let mean = summary["iterations"][0]["mean_psi_roll_deg"].as_f64().unwrap();
    let said = format!("{mean:.2} deg (paper").replace('-', "\u{2212}");
    let caption = read("fig14.svg");
    assert!(caption.contains("Mean over steps 11 to 40: "), "{caption}");
    assert!(caption.contains(&said), "{said}");
    assert_eq!(document["table"][0]["paper"], "0.12 deg");
    assert_eq!(read("fig14.csv").lines().count(), 41);
    // The strides behind the map, as they are in the log.
    let log = read("runs/small-stepping-1/transitions.csv");
    let explored = log.lines().filter(|l| l.contains(",collect,"));
    let reached = explored.filter(|l| l.contains(",crossing,")).count();
    let drawn = read("fig13.csv");
    assert_eq!(drawn.lines().filter(|l| l.starts_with("stride,")).count(), reached);
    assert!(read("fig15.svg").contains("Seen from ahead"));
}

fn learns_until_killed(dir: &Path, arguments: &[&str], until: impl Fn() -> bool) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_stridemap"))
        .current_dir(dir)
        .args(arguments)
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    while !until() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Files of a run that hold no time.
fn timeless(run: &Path) -> Vec<(String, Vec<u8>)> {
    ["config.toml", "transitions.csv", "record.csv", "learning.csv", "policy/final.json"]
        .map(|name| (name.to_owned(), std::fs::read(run.join(name)).unwrap()))
        .to_vec()
}

#[test]
fn a_killed_batch_goes_on_with_the_same_command() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = [&["learn", "stepping", "--json", "--seeds", "3", "--threads", "1"][..], &SHORT].concat();
    let out = |out| [&arguments[..], &["--out", out]].concat();
    let whole = json(&stridemap(dir.path(), &out("whole")));
    let second = dir.path().join("cut/stepping-2/transitions.csv");
    learns_until_killed(dir.path(), &out("cut"), || second.exists());
    let done = std::fs::metadata(dir.path().join("cut/stepping-1/summary.json")).unwrap();
    let cut = json(&stridemap(dir.path(), &out("cut")));
    assert_eq!(whole["runs"].as_array().unwrap().len(), 3);
    assert_eq!(whole["median_mean_reward"], cut["median_mean_reward"]);
    for seed in 1..=3 {
        let run = |of: &str| dir.path().join(format!("{of}/stepping-{seed}"));
        assert!(timeless(&run("whole")) == timeless(&run("cut")), "seed {seed}");
    }
    let taken = std::fs::metadata(dir.path().join("cut/stepping-1/summary.json")).unwrap();
    assert_eq!(done.modified().unwrap(), taken.modified().unwrap(), "a finished seed is kept");
    // The same seeds of another task are not the same batch.
    let other = stridemap(dir.path(), &[&out("cut")[..], &["--set", "robot.mass_scale=1.1"]].concat());
    assert_eq!(other.status.code(), Some(2));
    assert!(stderr(&other).contains("robot.mass_scale was 1.0, is 1.1 now"), "{}", stderr(&other));
    let beyond = stridemap(dir.path(), &["learn", "stepping", "--seed", "18446744073709551615", "--seeds", "2"]);
    assert_eq!(beyond.status.code(), Some(2), "{}", stderr(&beyond));
    assert!(!dir.path().join("runs").exists());
}

#[test]
fn a_result_that_stdout_does_not_take_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let full = |arguments: &[&str]| {
        let stdout = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        Command::new(env!("CARGO_BIN_EXE_stridemap"))
            .current_dir(dir.path())
            .args(arguments)
            .stdout(stdout)
            .output()
            .unwrap()
    };
    for arguments in [&["init", "a.toml"][..], &["--version"], &["learn", "--help"]] {
        let output = full(arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        assert!(stderr(&output).contains("stdout"), "{}", stderr(&output));
    }
    // Closed, as by `>&-` in a shell; on /dev/null, which Rust opens in its place, nothing is wrong.
    for (redirected, code) in [(">&-", 1), (">/dev/null", 0)] {
        let line = format!("exec \"$0\" --version {redirected}");
        let words = ["-c", &line, env!("CARGO_BIN_EXE_stridemap")];
        let output = Command::new("sh").args(words).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{redirected}");
    }
}

#[test]
fn a_run_in_a_directory_whose_name_is_no_text_works() {
    use std::os::unix::ffi::OsStrExt;
    let dir = tempfile::tempdir().unwrap();
    let odd = dir.path().join(std::ffi::OsStr::from_bytes(b"b\xff"));
    std::fs::create_dir(&odd).unwrap();
    assert!(learn(&odd, "run", &[]).status.success());
    let run = odd.join("run");
    for arguments in [&["evaluate", "--strides=2"][..], &["learn", "--resume"], &["fit"], &["report"]] {
        let output = Command::new(env!("CARGO_BIN_EXE_stridemap"))
            .current_dir(dir.path())
            .args(arguments)
            .arg(&run)
            .output()
            .unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    }
    std::fs::write(dir.path().join("evil.toml"), "extends = \"stepping\"\nname = \"../../evil\"\n").unwrap();
    let evil = stridemap(dir.path(), &["learn", "evil.toml"]);
    assert_eq!(evil.status.code(), Some(2));
    assert!(stderr(&evil).contains("evil.toml:2: name"), "{}", stderr(&evil));
}
