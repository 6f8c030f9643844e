//! What a run learned: the policy.

use super::check::{column, named, some};
use super::names::{label, quantity};
use crate::draw::{Axis, Dash, Key, Mark, Panel, Sheet, extent, number, plain, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::grid::PolicyGrid;
use stridemap_record::{Columns, Transition};

/// A policy with the states that the robot visited.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PolicyFigure {
    /// Iteration whose policy is drawn.
    pub iteration: usize,
    /// Names of state and action.
    pub columns: Columns,
    /// The policy.
    pub grid: PolicyGrid,
    /// Policies of other iterations, drawn thin, with their iteration.
    pub earlier: Vec<(usize, PolicyGrid)>,
    /// Strides whose states make the rug.
    pub strides: Vec<Transition>,
}

fn check_policy(stem: &str, data: &PolicyFigure) -> Result<()> {
    let n = data.grid.along.len();
    some(stem, "no row of the policy", n)?;
    let groups = [
        (&data.grid.state, &data.columns.state, "state"),
        (&data.grid.mean, &data.columns.action, "mean"),
        (&data.grid.std, &data.columns.action, "std"),
    ];
    for (columns, names, what) in groups {
        named(stem, what, columns.len(), names.len())?;
        for (values, name) in columns.iter().zip(names) {
            column(stem, &format!("{what} {name}"), values, n)?;
        }
    }
    Ok(())
}

/// Draws mean and standard deviation of each action over each component of the state, and the value
/// function if there is one, with basis centres and a rug of the visited states.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if columns differ in length, hold a value that is not finite, or are empty.
pub fn policy(data: &PolicyFigure) -> Result<Figure> {
    let stem = "policy";
    check_policy(stem, data)?;
    let (states, actions) = (data.grid.state.len(), data.grid.mean.len());
    let mut sheet = Sheet::new(stem, "The policy over the state");
    let drawn: Vec<usize> = (0..actions).filter(|a| varies(&data.grid, *a)).collect();
    // A policy of constants is still worth one panel.
    let drawn = if drawn.is_empty() { vec![0] } else { drawn };
    let height = if states * drawn.len() == 1 { 260.0 } else { 150.0 };
    for action in drawn.iter().copied() {
        let y = action_axis(data, action);
        let specs = (0..states)
            .map(|s| {
                let (lo, hi) = extent(line(&data.grid, s).into_iter().map(|i| data.grid.state[s][i]));
                let x = Axis::linear_with(&label(&data.columns.state[s], ""), lo, hi, 6.0 / states as f64 + 2.0);
                (1.0, x, y.clone(), None)
            })
            .collect();
        for (s, mut p) in sheet.row(height, specs).into_iter().enumerate() {
            policy_panel(&mut p, data, s, action);
            sheet.add(p);
        }
    }
    if let Some(value) = &data.grid.value {
        column(stem, "value", value, data.grid.along.len())?;
        let specs = (0..states)
            .map(|s| {
                let rows = line(&data.grid, s);
                let (lo, hi) = extent(rows.iter().map(|i| data.grid.state[s][*i]));
                let x = Axis::linear(&label(&data.columns.state[s], ""), lo, hi);
                (1.0, x, Axis::covering("value", value.iter().copied()), None)
            })
            .collect();
        for (s, mut p) in sheet.row(120.0, specs).into_iter().enumerate() {
            let points: Vec<(f64, f64)> =
                line(&data.grid, s).into_iter().map(|i| (data.grid.state[s][i], value[i])).collect();
            p.line(&points, "s3", Dash::Solid, 2.0);
            for (x, y) in points.iter().step_by((points.len() / 40).max(1)) {
                p.hover(*x, *y, format!("value {} at {}", number(*y, 3), signed(*x, 2)));
            }
            p.key("value function", Key::Line("s3", Dash::Solid));
            sheet.add(p);
        }
    }
    let held: Vec<String> = (0..actions)
        .filter(|a| !drawn.contains(a))
        .filter_map(|a| {
            let (name, unit) = quantity(&data.columns.action[a]);
            Some(format!("{} {} {unit}", plain(&name), signed(*data.grid.mean[a].first()?, 2)))
        })
        .collect();
    let explores = data.grid.std.iter().flatten().any(|s| *s > 0.0);
    let mut caption = format!(
        "Policy of iteration {}: mean action (line){} over the state{}. Ticks along the bottom: states of n = {} strides on the \
         robot while learning; where there are few, the policy is not determined.",
        data.iteration,
        if explores { " and one standard deviation of its exploration (band)" } else { "" },
        if states > 1 {
            ", the other components held in the middle of the range from which imagined episodes start"
        } else {
            ""
        },
        data.strides.len()
    );
    if !held.is_empty() {
        caption.push_str(&format!(" The same in every state, and not drawn: {}.", held.join(", ")));
    }
    if !data.grid.centres.is_empty() {
        caption.push_str(&format!(
            " Diamonds: centres of the {} basis functions; the paper's policies have 3 to 5.",
            data.grid.centres.len()
        ));
    }
    if !data.earlier.is_empty() {
        caption.push_str(" Thin lines: policies of the other iterations.");
    }
    caption.push_str(if data.grid.value.is_some() {
        " Below: the critic's value function, the discounted sum of rewards that it expects from a state, where learning ended."
    } else {
        " This learner keeps no value function."
    });
    let mut header: Vec<String> = vec!["along".to_owned()];
    header.extend(data.columns.state.iter().cloned());
    header.extend(data.columns.action.iter().flat_map(|a| [format!("mean_{a}"), format!("std_{a}")]));
    let mut csv = header.join(",") + if data.grid.value.is_some() { ",value\n" } else { "\n" };
    for i in 0..data.grid.along.len() {
        csv.push_str(&data.grid.along[i].to_string());
        data.grid.state.iter().for_each(|c| csv.push_str(&format!(",{}", c[i])));
        data.grid.mean.iter().zip(&data.grid.std).for_each(|(m, s)| csv.push_str(&format!(",{},{}", m[i], s[i])));
        if let Some(value) = &data.grid.value {
            csv.push_str(&format!(",{}", value[i]));
        }
        csv.push('\n');
    }
    let names = data.columns.action.iter().map(|a| plain(&label(a, ""))).collect::<Vec<_>>().join(", ");
    let alt = format!("Mean and standard deviation of {names} over the state, with the visited states below.");
    Ok(sheet.finish(&caption, &alt, csv))
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

fn action_axis(data: &PolicyFigure, action: usize) -> Axis {
    let (mean, std) = (&data.grid.mean[action], &data.grid.std[action]);
    let (lo, hi) = extent(mean.iter().zip(std).flat_map(|(m, s)| [m - s, m + s]));
    let room = 0.08 * (hi - lo);
    Axis::covering(&label(&data.columns.action[action], ""), [lo - room, hi + room])
}

fn policy_panel(p: &mut Panel, data: &PolicyFigure, state: usize, action: usize) {
    let curve = |grid: &PolicyGrid, k: f64| -> Vec<(f64, f64)> {
        let (Some(x), Some(m), Some(s)) = (grid.state.get(state), grid.mean.get(action), grid.std.get(action)) else {
            return Vec::new();
        };
        line(grid, state).into_iter().map(|i| (x[i], m[i] + k * s[i])).collect()
    };
    let mean = curve(&data.grid, 0.0);
    let x: Vec<f64> = mean.iter().map(|q| q.0).collect();
    let edge = |k: f64| curve(&data.grid, k).into_iter().map(|q| q.1).collect::<Vec<f64>>();
    let explores = data.grid.std[action].iter().any(|s| *s > 0.0);
    if explores {
        p.band(&x, &edge(-1.0), &edge(1.0), "s0", 0.18);
        p.key("± 1 sd (exploration)", Key::Band("s0", 0.2));
    }
    for (_, earlier) in &data.earlier {
        p.line(&curve(earlier, 0.0), "ref", Dash::Solid, 0.9);
    }
    p.line(&mean, "s0", Dash::Solid, 2.4);
    let visited: Vec<f64> = data.strides.iter().filter_map(|s| s.state.get(state).copied()).collect();
    p.rug(&visited, "s6", 0);
    let (name, unit) = quantity(&data.columns.action[action]);
    let std: Vec<f64> = line(&data.grid, state).into_iter().map(|i| data.grid.std[action][i]).collect();
    for i in (0..mean.len()).step_by((mean.len() / 50).max(1)) {
        p.hover(
            mean[i].0,
            mean[i].1,
            format!(
                "{} = {}: {name} = {} ± {} {unit}",
                quantity(&data.columns.state[state]).0,
                signed(mean[i].0, 2),
                signed(mean[i].1, 2),
                signed(std[i], 2)
            ),
        );
    }
    // Centres stand at the top: they have a place in the state, none in the action.
    let top = p.y.max - 0.05 * (p.y.max - p.y.min);
    let centres: Vec<(f64, f64)> = data.grid.centres.iter().filter_map(|c| c.get(state).map(|v| (*v, top))).collect();
    p.marks(&centres, "s4", Mark::Diamond, 3.6);
    p.key("mean action", Key::Line("s0", Dash::Solid));
    if !data.earlier.is_empty() {
        p.key("other iterations", Key::Line("ref", Dash::Solid));
    }
    if !centres.is_empty() {
        p.key("basis centres", Key::Mark("s4", Mark::Diamond));
    }
}
