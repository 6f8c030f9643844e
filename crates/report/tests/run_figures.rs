//! The figures of a synthetic run: what they count and what they say.

#![allow(clippy::unwrap_used)] // helpers of tests stand outside of #[test]

mod common;

use common::run::{Faults, write_run};
use std::path::Path;
use stridemap_process::StrideEnd;
use stridemap_record::grid::{MapGrid, PolicyGrid};
use stridemap_record::{
    Columns, GuardWarning, IterationSummary, Performance, Proof, Region, ReturnMapLine, Run, StridePhase, Summary,
    Transition, Verdict, Warning,
};
use stridemap_report::figures::*;
use stridemap_report::*;

fn run(faults: Faults) -> (tempfile::TempDir, Run) {
    let dir = tempfile::tempdir().unwrap();
    write_run(dir.path(), 1, faults);
    let run = Run::read(dir.path()).unwrap();
    (dir, run)
}

fn figure<'a>(sections: &'a [Section], stem: &str) -> &'a Figure {
    sections.iter().flat_map(|s| &s.figures).find(|f| f.stem == stem).unwrap()
}

#[test]
fn a_whole_run_is_read_and_drawn() {
    let (_dir, run) = run(Faults::default());
    assert_eq!(run.problems, Vec::<String>::new());
    assert_eq!(run.missing, Vec::<String>::new());
    assert_eq!(run.target_deg(), Some(2.0));
    assert_eq!((run.transitions.len(), run.maps.len(), run.recordings.len()), (80, 4, 2));
    let sections = sections(&run);
    let notes: Vec<&String> = sections.iter().flat_map(|s| &s.notes).collect();
    assert!(notes.len() == 1 && notes[0].contains("--atlas"), "{notes:?}");
    let gallery = Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery");
    for figure in sections.iter().flat_map(|s| &s.figures) {
        figure.write(&gallery).unwrap();
    }

    let learning = figure(&sections, "learning");
    assert!(learning.caption.contains("(n = 240 trials)") && learning.caption.contains("(n = 80 strides, 0 ended"));
    assert!(learning.caption.contains("nominal gait (−0.102)") && learning.caption.contains("final policy (−0.00062)"));
    assert_eq!(learning.csv.lines().count(), 1 + 240 + 80);
    let state = figure(&sections, "state");
    assert!(state.caption.contains("nominal gait (n = 60, 0 falls)") && state.caption.contains("desired value, 2.0"));
    let policy = figure(&sections, "policy");
    assert!(policy.caption.contains("n = 80 strides") && policy.caption.contains("the 5 basis functions"));
    assert!(policy.csv.starts_with("along,psi_roll_deg,mean_step_amplitude_deg,std_step_amplitude_deg,value\n"));
    let map = figure(&sections, "map");
    assert_eq!(map.svg.matches("<rect fill=\"#").count(), 41 * 41 + 64);
    let predicted = figure(&sections, "predicted");
    let inside = predicted.csv.lines().filter(|l| l.ends_with(",true")).count();
    assert!(predicted.caption.contains(&format!("{inside} of 80 within ±2 sd")));
    assert!(figure(&sections, "fig10").caption.contains("learned policy: slope 0.12"));
}

#[test]
fn a_fall_is_counted_and_marked() {
    let (_dir, run) = run(Faults { fall: true, ..Faults::default() });
    assert_eq!(run.falls(), (1, 0));
    assert_eq!(run.transitions[31].end, StrideEnd::Fell);
    let sections = sections(&run);
    let learning = figure(&sections, "learning");
    assert!(learning.caption.contains("1 ended without a section"));
    assert!(learning.csv.contains("robot,2,32,-1,1,1,fell\n"));
    assert!(learning.svg.contains(">fall<"), "the legend names the cross");
}

#[test]
fn a_killed_run_says_what_is_missing() {
    let (_dir, run) = run(Faults { killed: true, ..Faults::default() });
    assert!(!run.finished());
    assert_eq!(run.transitions.len(), 27);
    assert!(run.missing.contains(&"summary.json".to_owned()));
    assert_eq!(run.problems, ["transitions.csv: the last line was cut off and is left out"]);
    let sections = sections(&run);
    assert!(figure(&sections, "learning").caption.contains("final policy (not measured)"));
    assert!(sections[4].notes[0].contains("was not pushed"));
}

#[test]
fn a_byte_that_is_no_text_costs_one_line() {
    let (_dir, run) = run(Faults::default());
    let path = run.dir.join("record.csv");
    let mut bytes = std::fs::read(&path).unwrap();
    let second = bytes.iter().position(|b| *b == b'\n').unwrap() + 1;
    bytes[second] = 0xff;
    std::fs::write(&path, bytes).unwrap();
    let again = Run::read(&run.dir).unwrap();
    assert_eq!(again.record, run.record[1..]);
    assert_eq!(again.problems, ["record.csv, line 2: is no text and is left out"]);
}

#[test]
fn one_stride_is_enough_for_a_picture() {
    let (_dir, run) = run(Faults { one_stride: true, ..Faults::default() });
    let sections = sections(&run);
    assert!(figure(&sections, "learning").caption.contains("(n = 1 stride,"));
    assert_eq!(
        sections[2].notes,
        ["Policy: not drawn, the run has no policy yet.", "Map: not drawn, the run has no map yet."]
    );
}

#[test]
fn several_runs_share_their_axes() {
    let runs: Vec<Run> = (1..4)
        .map(|seed| {
            let dir = tempfile::tempdir().unwrap();
            write_run(dir.path(), seed, Faults { fall: seed == 2, ..Faults::default() });
            Run::read(dir.path()).unwrap()
        })
        .collect();
    let figure = runs_compared(&runs).unwrap();
    assert!(figure.caption.contains("(n = 3 runs), 1 fall while"));
    // Five points and 240 trials of each run, and five medians with their quartiles.
    assert_eq!(figure.csv.lines().count(), 1 + 3 * (5 + 240) + 5);
    assert!(figure.caption.contains("Thick line: median over the runs"));
    figure.write(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("gallery")).unwrap();
}

#[test]
fn a_vector_of_states_and_actions_has_a_panel_for_each_pair() {
    let columns = Columns {
        state: ["psi_roll_deg", "psi_pitch_deg", "psi_pitch_rate_deg_s"].map(str::to_owned).to_vec(),
        action: ["walk_amplitude_deg", "ankle_lean_deg"].map(str::to_owned).to_vec(),
        goal: Vec::new(),
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
    let mut run = Run { columns, policies: vec![(2, grid)], grids: vec![(2, map)], ..Run::default() };
    let figure = policy(&run).unwrap();
    assert_eq!(figure.svg.matches("class=\"panel\"").count(), 6);
    figure.write(&gallery).unwrap();
    let slices = map_slices(&run).unwrap();
    assert_eq!(slices.svg.matches("class=\"panel\"").count(), 9);
    slices.write(&gallery).unwrap();
    map_surface(&run).unwrap().write(&gallery).unwrap();

    // A column too few is refused, not drawn.
    run.policies[0].1.std.pop();
    assert!(matches!(policy(&run), Err(ReportError::Shape { found: 1, expected: 2, .. })));
}

#[test]
fn the_spread_over_seeds_is_that_of_the_textbook() {
    let run = |name: &str, last: f64| {
        let iteration = IterationSummary { strides_so_far: 20, mean_reward: Some(last), ..Default::default() };
        let summary = Summary { iterations: vec![iteration], ..Summary::default() };
        Run { name: name.into(), summary: Some(summary), ..Run::default() }
    };
    let runs = [run("a", -0.01), run("b", -0.02), run("c", -0.04)];
    let figure = runs_compared(&runs).unwrap();
    // Quartiles of three values lie half-way to the median.
    assert!(figure.csv.contains("median,robot,20,-0.02,-0.03,-0.015,3\n"), "{}", figure.csv);
    // Two runs have no spread.
    let two = runs_compared(&runs[..2]).unwrap();
    assert!(!two.csv.contains("median") && !two.caption.contains("median"));
    assert!(runs_compared(&[]).is_err());
}

#[test]
fn actions_show_the_trust_region_and_the_warnings_of_the_guard() {
    let (_dir, mut run) = run(Faults { fall: true, ..Faults::default() });
    run.transitions[50].phase = StridePhase::Evaluate;
    let third = &mut run.summary.as_mut().unwrap().iterations[2];
    third.trust_region = Some(Region { lower: vec![0.5], upper: vec![2.5] });
    third.warnings = vec![GuardWarning { stride: 11, warning: Warning::Turn }];
    let verdict = Verdict::Warned;
    third.proof = Some(Proof { verdict, warning: None, speed_m_s: 0.0, strides: 11, attempts: 1, action: vec![2.0] });
    let figure = actions(&run).unwrap();
    assert!(figure.caption.contains("(the robot turns, once)"), "{}", figure.caption);
    assert!(figure.caption.contains("3 turned back by the guard"));
    // Stride 51 of the run is the 11th of the third iteration; only strides that try a policy have a region.
    let row = figure.csv.lines().nth(51).unwrap();
    assert!(row.starts_with("51,3,evaluate,") && row.ends_with(",0.5,2.5,turn,crossing"), "{row}");
    assert!(figure.csv.lines().nth(50).unwrap().ends_with(",,,,crossing"));
    assert!(matches!(actions(&Run::default()), Err(ReportError::Empty { .. })));
}

#[test]
fn return_maps_without_pushes_tell_slope_and_fixed_point() {
    let line = ReturnMapLine { slope: 0.5, slope_std_error: 0.1, fixed_point_deg: Some(2.0), pairs: 2 };
    let performance = Performance { return_map_1: Some(line), ..Performance::default() };
    let stride = |episode, k, psi: f64| {
        let next_state = [psi].as_slice().into();
        ("final".to_owned(), Transition { episode, k, next_state, ..Transition::default() })
    };
    let figure = undisturbed_return_maps(&Run {
        columns: Columns {
            state: vec!["psi_roll_deg".into()],
            action: vec!["step_amplitude_deg".into()],
            goal: Vec::new(),
        },
        summary: Some(Summary { final_policy: Some(performance.into()), ..Summary::default() }),
        // A fall parts the stretches: no pair reaches over it.
        record: vec![stride(0, 0, 4.0), stride(0, 1, 3.0), stride(0, 2, 2.5), stride(1, 0, 9.0)],
        ..Run::default()
    })
    .unwrap();
    assert!(figure.caption.contains(
        "final policy to k + 1: slope 0.50 ± 0.10, fixed point 2.00 deg (n = 2 pairs); final policy to k + 2: no line (n = 1 pairs)"
    ));
    assert_eq!(figure.csv.lines().count(), 1 + 2 + 1);
}

#[test]
fn cuts_through_a_map_stand_at_the_policy() {
    let (_dir, run) = run(Faults::default());
    let sections = sections(&run);
    let lines = figure(&sections, "map-lines");
    assert!(lines.caption.contains("uprights: ψ_roll 2.20 deg, A_step 1.90 deg"), "{}", lines.caption);
    assert_eq!(lines.csv.lines().count(), 1 + 2 * 41);
    let one_on = figure(&sections, "push-1");
    assert!(one_on.caption.contains("one stride later, on the other leg"));
}
