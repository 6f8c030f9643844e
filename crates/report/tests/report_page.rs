//! What a page says and what it must not hold.

#![allow(clippy::unwrap_used)] // helpers of tests stand outside of #[test]

mod common;

use common::run::{Faults, write_run};
use std::path::Path;
use stridemap_record::Run;
use stridemap_report::{report_html, write_report};

fn run(seed: u64, faults: Faults) -> Run {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(format!("stepping-{seed}"));
    write_run(&path, seed, faults);
    Run::read(&path).unwrap()
}

/// Pages that the browser test opens.
fn keep(name: &str, runs: &[Run]) {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pages");
    std::fs::create_dir_all(&dir).unwrap();
    write_report(runs, &dir.join(name)).unwrap();
}

#[test]
fn a_page_is_whole_small_and_its_own() {
    let runs = [run(1, Faults::default())];
    let html = report_html(&runs).unwrap();
    keep("run.html", &runs);
    assert_eq!(html, report_html(&runs).unwrap(), "the same bytes");
    assert!(html.len() < 6_000_000, "{} bytes", html.len());
    assert!(html.matches("<svg").count() >= 9);
    for attribute in ["src=\"", "href=\""] {
        for rest in html.split(attribute).skip(1) {
            let to = rest.split('"').next().unwrap();
            assert!(to.starts_with('#') || to == "https://doi.org/10.1007/s10514-009-9133-z", "{attribute}{to}");
        }
    }
    assert!(!html.contains("@import") && !html.contains("url(http"));
    for says in [
        "The robot did not fall while learning.",
        "−0.102 → −0.00062",
        "0.12 at 2.03°",
        "stridemap learn stepping --seed 1",
        "the length scale of `step_amplitude_deg` is at its upper limit",
        "target_deg = 2.0",
    ] {
        assert!(html.contains(says), "{says}");
    }
    // Every picture says in words what it shows, and every id stands once.
    assert_eq!(html.matches("<svg").count(), html.matches("role=\"img\" aria-label=\"").count() - 2);
    let mut ids: Vec<&str> = html.split(" id=\"").skip(1).map(|r| r.split('"').next().unwrap()).collect();
    let all = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), all);
}

#[test]
fn what_went_wrong_stands_at_the_top() {
    let fall = [run(1, Faults { fall: true, ..Faults::default() })];
    keep("fall.html", &fall);
    let html = report_html(&fall).unwrap();
    assert!(html.contains("The robot fell once while learning: stride 32 (iteration 2)."));
    // By what, with value and threshold; a page of a run without a fall has no such table.
    let cause = "<td>stride 32 (iteration 2)</td><td>ψ<sub>roll</sub> at the section</td>\
                 <td class=\"num\">−0.4\u{b0}</td><td class=\"num\">below 0\u{b0}</td>";
    assert!(html.contains(cause), "{html:.3000}");
    let none = report_html(&[run(1, Faults::default())]).unwrap();
    assert!(!none.contains("the robot fell in"));
    let killed = [run(1, Faults { killed: true, ..Faults::default() })];
    keep("killed.html", &killed);
    let html = report_html(&killed).unwrap();
    assert!(
        html.contains("This run did not reach its end")
            && html.contains("It left 27 strides on the robot, the last of them in iteration 2.")
    );
    assert!(html.contains("the last line was cut off") && html.contains("Not in the run directory: summary.json"));
    let dir = tempfile::tempdir().unwrap();
    let faults = Faults { killed: true, ..Faults::default() };
    write_run(dir.path(), 1, faults);
    let event = r#"{"time":"2026-11-23T12:00:03Z","event":"stopped","reason":"4 falls, at most 3 < 4"}"#;
    std::fs::write(dir.path().join("events.ndjson"), format!("{event}\n")).unwrap();
    let stopped = [Run::read(dir.path()).unwrap()];
    keep("stopped.html", &stopped);
    assert!(report_html(&stopped).unwrap().contains(
        "did not reach its end: it stopped at 2026-11-23T12:00:03Z: 4 falls, at most 3 &lt; 4. It left 27 strides"
    ));
    let one = [run(1, Faults { one_stride: true, ..Faults::default() })];
    keep("one.html", &one);
    assert!(report_html(&one).unwrap().contains("This run has one stride."));
}

#[test]
fn runs_stand_side_by_side() {
    let runs = [
        run(1, Faults::default()),
        run(2, Faults { fall: true, ..Faults::default() }),
        run(3, Faults { killed: true, ..Faults::default() }),
    ];
    keep("runs.html", &runs);
    let html = report_html(&runs).unwrap();
    assert!(html.contains("3 runs side by side") && html.contains("<td>stepping-2</td>"));
    for id in ["all-runs", "r0-learning", "r1-learning", "r2-learning", "r0-fig10", "r1-fig10"] {
        assert!(html.contains(&format!("<figure id=\"{id}\"")), "{id}");
    }
    assert!(html.contains("This run has no data for this figure."));
    assert!(html.len() < 6_000_000);
}

#[test]
fn many_runs_share_a_page_that_stays_small() {
    let runs: Vec<Run> = (1..=6).map(|seed| run(seed, Faults::default())).collect();
    let html = report_html(&runs).unwrap();
    assert!(html.contains("<figure id=\"all-runs\"") && !html.contains("<figure id=\"r0-"));
    assert!(html.contains("report.html") && html.contains("Of the first of the 6 runs."));
    assert!(html.len() < 1_000_000, "{} bytes", html.len());
}

#[test]
fn an_empty_directory_gives_a_page_that_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let html = report_html(&[Run::read(dir.path()).unwrap()]).unwrap();
    assert!(html.contains("This run has no stride yet.") && html.contains("config.toml"));
    assert!(report_html(&[]).is_err());
    assert!(Run::read(&dir.path().join("nowhere")).is_err());
}

#[test]
fn text_from_files_is_not_markup() {
    let dir = tempfile::tempdir().unwrap();
    write_run(dir.path(), 1, Faults::default());
    std::fs::write(dir.path().join("config.toml"), "name = \"</pre><script>alert(1)</script>\"\n").unwrap();
    let html = report_html(&[Run::read(dir.path()).unwrap()]).unwrap();
    assert!(!html.contains("<script>alert"));
}
