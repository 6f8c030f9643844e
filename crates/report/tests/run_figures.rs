//! The figures of a synthetic run: what they count and what they say.

#![allow(clippy::unwrap_used)] // helpers of tests stand outside of #[test]

mod common;

use common::run::{Faults, write_run};
use std::path::Path;
use stridemap_report::figures::*;
use stridemap_report::run::{Run, StrideEnd};
use stridemap_report::*;

fn run(faults: Faults) -> (tempfile::TempDir, Run) {
    let dir = tempfile::tempdir().unwrap();
    write_run(dir.path(), 1, faults);
    let run = Run::read(dir.path()).unwrap();
    (dir, run)
}

fn figure<'a>(sections: &'a [Section], stem: &str) -> &'a Figure {
    sections
        .iter()
        .flat_map(|s| &s.figures)
        .find(|f| f.stem == stem)
        .unwrap()
}

#[test]
fn a_whole_run_is_read_and_drawn() {
    let (_dir, run) = run(Faults::default());
    assert_eq!(run.problems, Vec::<String>::new());
    assert_eq!(run.missing, Vec::<String>::new());
    assert_eq!(run.target_deg(), Some(2.0));
    assert_eq!(
        (run.transitions.len(), run.maps.len(), run.recordings.len()),
        (80, 4, 2)
    );
    let sections = sections(&run);
    assert!(
        sections.iter().all(|s| s.notes.is_empty()),
        "{:?}",
        sections.iter().map(|s| &s.notes).collect::<Vec<_>>()
    );
    let gallery = Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery");
    for figure in sections.iter().flat_map(|s| &s.figures) {
        figure.write(&gallery).unwrap();
    }

    let learning = figure(&sections, "learning");
    assert!(
        learning.caption.contains("(n = 240 trials)")
            && learning.caption.contains("(n = 80 strides, 0 ended")
    );
    assert!(
        learning.caption.contains("nominal gait (−0.102)")
            && learning.caption.contains("final policy (−0.00062)")
    );
    assert_eq!(learning.csv.lines().count(), 1 + 240 + 80);
    let state = figure(&sections, "state");
    assert!(
        state.caption.contains("nominal gait (n = 60, 0 falls)")
            && state.caption.contains("desired value, 2.0")
    );
    let policy = figure(&sections, "policy");
    assert!(
        policy.caption.contains("n = 80 strides")
            && policy.caption.contains("the 4 basis functions")
    );
    assert!(
        policy.csv.starts_with(
            "along,psi_roll_deg,mean_step_amplitude_deg,std_step_amplitude_deg,value\n"
        )
    );
    let map = figure(&sections, "map");
    assert_eq!(map.svg.matches("<rect fill=\"#").count(), 41 * 41 + 64);
    let predicted = figure(&sections, "predicted");
    let inside = predicted
        .csv
        .lines()
        .filter(|l| l.ends_with(",true"))
        .count();
    assert!(
        predicted
            .caption
            .contains(&format!("{inside} of 80 within ±2 sd"))
    );
    assert!(
        figure(&sections, "fig10")
            .caption
            .contains("learned policy: slope 0.12")
    );
}

#[test]
fn a_fall_is_counted_and_marked() {
    let (_dir, run) = run(Faults {
        fall: true,
        ..Faults::default()
    });
    assert_eq!(run.falls(), (1, 0));
    assert_eq!(run.transitions[31].end, StrideEnd::Fell);
    let sections = sections(&run);
    let learning = figure(&sections, "learning");
    assert!(learning.caption.contains("1 ended without a section"));
    assert!(learning.csv.contains("robot,2,32,-1,1,1,fell\n"));
    assert!(
        learning.svg.contains(">fall<"),
        "the legend names the cross"
    );
}

#[test]
fn a_killed_run_says_what_is_missing() {
    let (_dir, run) = run(Faults {
        killed: true,
        ..Faults::default()
    });
    assert!(!run.finished());
    assert_eq!(run.transitions.len(), 27);
    assert!(run.missing.contains(&"summary.json".to_owned()));
    assert_eq!(
        run.problems,
        ["transitions.csv: the last line was cut off and is left out"]
    );
    let sections = sections(&run);
    assert!(
        figure(&sections, "learning")
            .caption
            .contains("final policy (not measured)")
    );
    assert!(sections[3].notes[0].contains("was not pushed"));
}

#[test]
fn one_stride_is_enough_for_a_picture() {
    let (_dir, run) = run(Faults {
        one_stride: true,
        ..Faults::default()
    });
    let sections = sections(&run);
    assert!(
        figure(&sections, "learning")
            .caption
            .contains("(n = 1 stride,")
    );
    assert_eq!(
        sections[1].notes,
        ["The run has no policy yet.", "The run has no map yet."]
    );
}

#[test]
fn several_runs_share_their_axes() {
    let runs: Vec<Run> = (1..4)
        .map(|seed| {
            let dir = tempfile::tempdir().unwrap();
            write_run(
                dir.path(),
                seed,
                Faults {
                    fall: seed == 2,
                    ..Faults::default()
                },
            );
            Run::read(dir.path()).unwrap()
        })
        .collect();
    let figure = comparison(&runs).unwrap();
    assert!(figure.caption.contains("(n = 3 runs), 1 fall while"));
    assert_eq!(figure.csv.lines().count(), 1 + 3 * 5);
    figure
        .write(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery"))
        .unwrap();
}

#[test]
fn success_carries_its_interval() {
    let rate = |strides, successes| SuccessRate {
        strides,
        successes,
        runs: 100,
    };
    let figure = success_against_strides(&[
        rate(80, 99),
        rate(20, 41),
        rate(40, 83),
        rate(60, 94),
        rate(100, 100),
    ])
    .unwrap();
    figure
        .write(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery"))
        .unwrap();
    assert!(figure.caption.contains("41 of 100 at 20, 83 of 100 at 40"));
    // Wilson for 99 of 100: 0.9455 to 0.9982.
    assert!(figure.csv.contains("80,99,100,0.99,0.9455") && figure.csv.contains(",0.9982"));
}

#[test]
fn a_vector_of_states_and_actions_has_a_panel_for_each_pair() {
    let columns = run::Columns {
        state: ["psi_roll_deg", "psi_pitch_deg", "psi_pitch_rate_deg_s"]
            .map(str::to_owned)
            .to_vec(),
        action: ["walk_amplitude_deg", "ankle_lean_deg"]
            .map(str::to_owned)
            .to_vec(),
    };
    let mut grid = PolicyGrid {
        state: vec![Vec::new(); 3],
        mean: vec![Vec::new(); 2],
        std: vec![Vec::new(); 2],
        ..PolicyGrid::default()
    };
    let mut map = MapGrid {
        state: vec![Vec::new(); 3],
        action: vec![Vec::new(); 2],
        mean: vec![Vec::new(); 3],
        latent_std: vec![Vec::new(); 3],
        noise_std: vec![Vec::new(); 3],
        ..MapGrid::default()
    };
    for along in 0..3 {
        for i in 0..40 {
            grid.along.push(along);
            for s in 0..3 {
                grid.state[s].push(if s == along { f64::from(i) * 0.1 } else { 2.0 });
            }
            for a in 0..2 {
                grid.mean[a].push(5.0 + (f64::from(i) * 0.1).sin());
                grid.std[a].push(0.3);
            }
        }
        for action in 0..2 {
            for (x, u) in (0..11).flat_map(|x| (0..11).map(move |u| (f64::from(x), f64::from(u)))) {
                map.state_axis.push(along);
                map.action_axis.push(action);
                (0..3).for_each(|s| map.state[s].push(if s == along { x } else { 5.0 }));
                (0..2).for_each(|a| map.action[a].push(if a == action { u } else { 5.0 }));
                for o in 0..3 {
                    map.mean[o].push(2.0 - 0.7 * x + 0.2 * u);
                    map.latent_std[o].push(0.1 + 0.02 * (x - 5.0).abs());
                    map.noise_std[o].push(0.2);
                }
            }
        }
    }
    let gallery = Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery/walking");
    let figure = policy(&PolicyFigure {
        iteration: 2,
        columns: columns.clone(),
        grid: grid.clone(),
        ..PolicyFigure::default()
    })
    .unwrap();
    assert_eq!(figure.svg.matches("class=\"panel\"").count(), 6);
    figure.write(&gallery).unwrap();
    let data = MapFigure {
        iteration: 2,
        columns: columns.clone(),
        grid: map,
        strides: Vec::new(),
    };
    let slices = map_slices(&data).unwrap();
    assert_eq!(slices.svg.matches("class=\"panel\"").count(), 9);
    slices.write(&gallery).unwrap();
    map_surface(&data).unwrap().write(&gallery).unwrap();

    // A column too few is refused, not drawn.
    grid.std.pop();
    let short = PolicyFigure {
        iteration: 2,
        columns,
        grid,
        ..PolicyFigure::default()
    };
    assert!(matches!(
        policy(&short),
        Err(ReportError::Shape {
            found: 1,
            expected: 2,
            ..
        })
    ));
}
