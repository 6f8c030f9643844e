//! What a run learned: the policy.

use super::check::{column, named, present, some};
use super::names::{label, quantity};
use super::of_run::{final_or_last, map_strides};
use crate::draw::{Axis, Dash, Key, Mark, N, Panel, Sheet, extent, plain};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::grid::PolicyGrid;
use stridemap_record::{Columns, Run, Transition};

/// A policy and what belongs to it.
struct Drawn<'a> {
    columns: &'a Columns,
    grid: &'a PolicyGrid,
    /// Policies of other iterations, drawn thin.
    others: Vec<&'a PolicyGrid>,
    /// Strides whose states make the rug.
    strides: Vec<&'a Transition>,
}

fn check_policy(stem: &str, grid: &PolicyGrid, columns: &Columns) -> Result<()> {
    let n = grid.along.len();
    some(stem, "no row of the policy", n)?;
    let groups = [
        (&grid.state, &columns.state, "state"),
        (&grid.mean, &columns.action, "mean"),
        (&grid.std, &columns.action, "std"),
    ];
    for (values, names, what) in groups {
        named(stem, what, values.len(), names.len())?;
        for (values, name) in values.iter().zip(names) {
            column(stem, &format!("{what} {name}"), values, n)?;
        }
    }
    grid.value.as_ref().map_or(Ok(()), |value| column(stem, "value", value, n))
}

/// Draws mean and standard deviation of each action over each component of the state, and the value
/// function if there is one, with basis centres and a rug of the visited states: of the final policy, or of the last.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no policy, or its columns differ in length or hold a value that is not
/// finite.
pub fn policy(run: &Run) -> Result<Figure> {
    let stem = "policy";
    let (iteration, grid) = present(stem, "the run has no policy yet", final_or_last(run, &run.policies))?;
    check_policy(stem, grid, &run.columns)?;
    let others = run.policies.iter().filter(|p| p.0 != *iteration).map(|p| &p.1).collect();
    let data = Drawn { columns: &run.columns, grid, others, strides: map_strides(run, usize::MAX) };
    let (states, actions) = (grid.state.len(), grid.mean.len());
    let mut sheet = Sheet::new(stem, "The policy over the state");
    let drawn: Vec<usize> = (0..actions).filter(|a| varies(grid, *a)).collect();
    // A policy of constants is still worth one panel.
    let drawn = if drawn.is_empty() { vec![0] } else { drawn };
    let height = if states * drawn.len() == 1 { 260.0 } else { 150.0 };
    let specs = |y: Axis, most: f64| {
        let x = |s: usize| {
            let (lo, hi) = extent(line(grid, s).into_iter().map(|i| grid.state[s][i]));
            Axis::linear_with(&label(&run.columns.state[s], ""), lo, hi, most)
        };
        (0..states).map(|s| (1.0, x(s), y.clone(), None)).collect()
    };
    for action in drawn.iter().copied() {
        let row = sheet.row(height, specs(action_axis(&data, action), 6.0 / states as f64 + 2.0));
        for (s, mut p) in row.into_iter().enumerate() {
            policy_panel(&mut p, &data, s, action);
            sheet.add(p);
        }
    }
    if let Some(value) = &grid.value {
        let row = sheet.row(120.0, specs(Axis::covering("value", value.iter().copied()), 7.0));
        for (s, mut p) in row.into_iter().enumerate() {
            let points: Vec<(f64, f64)> = line(grid, s).into_iter().map(|i| (grid.state[s][i], value[i])).collect();
            p.line(&points, "s3", Dash::Solid, 2.0);
            for (x, y) in points.iter().step_by((points.len() / 40).max(1)) {
                p.hover(*x, *y, format!("value {:#.3} at {:.2}", N(*y), N(*x)));
            }
            p.key("value function", Key::Line("s3", Dash::Solid));
            sheet.add(p);
        }
    }
    let held: Vec<String> = (0..actions)
        .filter(|a| !drawn.contains(a))
        .filter_map(|a| {
            let (name, unit) = quantity(&run.columns.action[a]);
            Some(format!("{} {:.2} {unit}", plain(&name), N(*grid.mean[a].first()?)))
        })
        .collect();
    let names = run.columns.action.iter().map(|a| plain(&label(a, ""))).collect::<Vec<_>>().join(", ");
    let alt = format!("Mean and standard deviation of {names} over the state, with the visited states below.");
    Ok(sheet.finish(&caption(*iteration, &data, &held), &alt, csv(&data)))
}

fn caption(iteration: usize, data: &Drawn<'_>, held: &[String]) -> String {
    let (grid, n) = (data.grid, data.strides.len());
    let explores = grid.std.iter().flatten().any(|s| *s > 0.0);
    let band = if explores { " and one standard deviation of its exploration (band)" } else { "" };
    let others = match grid.state.len() {
        1 => "",
        _ => ", the other components held in the middle of the range from which imagined episodes start",
    };
    let mut caption = format!(
        "Policy of iteration {iteration}: mean action (line){band} over the state{others}. Ticks along the bottom: states of \
         n = {n} strides on the robot while learning; where there are few, the policy is not determined."
    );
    if !held.is_empty() {
        caption += &format!(" The same in every state, and not drawn: {}.", held.join(", "));
    }
    if !grid.centres.is_empty() {
        let n = grid.centres.len();
        caption += &format!(" Diamonds: centres of the {n} basis functions; the paper's policies have 3 to 5.");
    }
    if !data.others.is_empty() {
        caption += " Thin lines: policies of the other iterations.";
    }
    caption += if grid.value.is_some() {
        " Below: the critic's value function, the discounted sum of rewards that it expects from a state, where learning ended."
    } else {
        " This learner keeps no value function."
    };
    caption
}

fn csv(data: &Drawn<'_>) -> String {
    let (grid, columns) = (data.grid, data.columns);
    let mut header: Vec<String> = vec!["along".to_owned()];
    header.extend(columns.state.iter().cloned());
    header.extend(columns.action.iter().flat_map(|a| [format!("mean_{a}"), format!("std_{a}")]));
    header.extend(grid.value.as_ref().map(|_| "value".to_owned()));
    let mut csv = header.join(",") + "\n";
    for (i, along) in grid.along.iter().enumerate() {
        let action = grid.mean.iter().zip(&grid.std).flat_map(|(m, s)| [m[i], s[i]]);
        let cells = grid.state.iter().map(|c| c[i]).chain(action).chain(grid.value.as_ref().map(|v| v[i]));
        csv += &along.to_string();
        cells.for_each(|cell| csv += &format!(",{cell}"));
        csv += "\n";
    }
    csv
}

/// Whether a component of the action depends on the state, or is drawn at random.
fn varies(grid: &PolicyGrid, action: usize) -> bool {
    let (lo, hi) = extent(grid.mean[action].iter().copied());
    hi - lo > 1e-9 || grid.std[action].iter().any(|s| *s > 0.0)
}

/// Rows of the grid that belong to the line along a component.
fn line(grid: &PolicyGrid, along: usize) -> Vec<usize> {
    (0..grid.along.len()).filter(|i| grid.along[*i] == along).collect()
}

fn action_axis(data: &Drawn<'_>, action: usize) -> Axis {
    let (mean, std) = (&data.grid.mean[action], &data.grid.std[action]);
    let (lo, hi) = extent(mean.iter().zip(std).flat_map(|(m, s)| [m - s, m + s]));
    let room = 0.08 * (hi - lo);
    Axis::covering(&label(&data.columns.action[action], ""), [lo - room, hi + room])
}

fn policy_panel(p: &mut Panel, data: &Drawn<'_>, state: usize, action: usize) {
    let curve = |grid: &PolicyGrid, k: f64| -> Vec<(f64, f64)> {
        let (Some(x), Some(m), Some(s)) = (grid.state.get(state), grid.mean.get(action), grid.std.get(action)) else {
            return Vec::new();
        };
        line(grid, state).into_iter().map(|i| (x[i], m[i] + k * s[i])).collect()
    };
    let mean = curve(data.grid, 0.0);
    let x: Vec<f64> = mean.iter().map(|q| q.0).collect();
    let edge = |k: f64| curve(data.grid, k).into_iter().map(|q| q.1).collect::<Vec<f64>>();
    let explores = data.grid.std[action].iter().any(|s| *s > 0.0);
    if explores {
        p.band(&x, &edge(-1.0), &edge(1.0), "s0", 0.18);
        p.key("± 1 sd (exploration)", Key::Band("s0", 0.2));
    }
    for other in &data.others {
        p.line(&curve(other, 0.0), "ref", Dash::Solid, 0.9);
    }
    p.line(&mean, "s0", Dash::Solid, 2.4);
    let visited: Vec<f64> = data.strides.iter().filter_map(|s| s.state.get(state).copied()).collect();
    p.rug(&visited, "s6", 0);
    let (name, unit) = quantity(&data.columns.action[action]);
    let along = quantity(&data.columns.state[state]).0;
    for (row, (x, y)) in line(data.grid, state).iter().zip(&mean).step_by((mean.len() / 50).max(1)) {
        let [at, mean, std] = [*x, *y, data.grid.std[action][*row]].map(N);
        p.hover(*x, *y, format!("{along} = {at:.2}: {name} = {mean:.2} ± {std:.2} {unit}"));
    }
    // Centres stand at the top: they have a place in the state, none in the action.
    let top = p.y.max - 0.05 * (p.y.max - p.y.min);
    let centres: Vec<(f64, f64)> = data.grid.centres.iter().filter_map(|c| c.get(state).map(|v| (*v, top))).collect();
    p.marks(&centres, "s4", Mark::Diamond, 3.6);
    p.key("mean action", Key::Line("s0", Dash::Solid));
    if !data.others.is_empty() {
        p.key("other iterations", Key::Line("ref", Dash::Solid));
    }
    if !centres.is_empty() {
        p.key("basis centres", Key::Mark("s4", Mark::Diamond));
    }
}
