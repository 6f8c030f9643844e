//! What a run learned: the map of one stride.

use super::check::{column, named, some};
use super::names::{label, quantity};
use crate::draw::{Axis, Dash, Key, Mark, Sheet, contour_lines, extent, number, plain, ramp_color, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::grid::MapGrid;
use stridemap_record::{Columns, Transition};

/// A map with its data.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapFigure {
    /// Iteration whose map is drawn.
    pub iteration: usize,
    /// Names of state and action.
    pub columns: Columns,
    /// The map.
    pub grid: MapGrid,
    /// The training strides from which it was learned.
    pub strides: Vec<Transition>,
}

/// A plane of the grid: distinct states and actions, and for each the row of the table.
pub(super) struct Plane {
    pub(super) x: Vec<f64>,
    pub(super) u: Vec<f64>,
    /// `rows[action * x.len() + state]`.
    pub(super) rows: Vec<usize>,
}

pub(super) fn plane(grid: &MapGrid, state: usize, action: usize) -> Option<Plane> {
    let (xs, us) = (grid.state.get(state)?, grid.action.get(action)?);
    let rows: Vec<usize> =
        (0..xs.len()).filter(|i| grid.state_axis[*i] == state && grid.action_axis[*i] == action).collect();
    let distinct = |values: &[f64]| {
        let mut d: Vec<f64> = rows.iter().map(|i| values[*i]).collect();
        d.sort_by(f64::total_cmp);
        d.dedup_by(|a, b| (*a - *b).abs() < 1e-12);
        d
    };
    let (x, u) = (distinct(xs), distinct(us));
    if x.len() < 2 || u.len() < 2 || rows.len() != x.len() * u.len() {
        return None;
    }
    let mut sorted = rows;
    sorted.sort_by(|a, b| us[*a].total_cmp(&us[*b]).then(xs[*a].total_cmp(&xs[*b])));
    Some(Plane { x, u, rows: sorted })
}

pub(super) fn check_map(stem: &str, data: &MapFigure) -> Result<()> {
    let n = data.grid.state_axis.len();
    some(stem, "no row of the map", n)?;
    let g = &data.grid;
    let (states, actions) = (data.columns.state.len(), data.columns.action.len());
    for (columns, names, what) in [
        (&g.state, states, "state"),
        (&g.action, actions, "action"),
        (&g.mean, states, "mean"),
        (&g.latent_std, states, "latent_std"),
        (&g.noise_std, states, "noise_std"),
    ] {
        named(stem, what, columns.len(), names)?;
        for values in columns {
            column(stem, what, values, n)?;
        }
    }
    column(stem, "action_axis", &g.action_axis.iter().map(|v| *v as f64).collect::<Vec<_>>(), n)
}

/// Draws the map of the first state component over the first state and action, as in Fig. 13: a heat
/// map of the mean, level lines of the latent standard deviation, and the data.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if the grid is empty, not a grid, or holds a value that is not finite.
pub fn map_surface(data: &MapFigure) -> Result<Figure> {
    let stem = "map";
    check_map(stem, data)?;
    let g = &data.grid;
    let Some(plane) = plane(g, 0, 0) else {
        return Err(crate::ReportError::Empty {
            figure: stem.to_owned(),
            what: "no plane of state and action".to_owned(),
        });
    };
    let mean: Vec<f64> = plane.rows.iter().map(|i| g.mean[0][*i]).collect();
    let latent: Vec<f64> = plane.rows.iter().map(|i| g.latent_std[0][*i]).collect();
    let (lo, hi) = extent(mean.iter().copied());
    let (state, action) = (&data.columns.state[0], &data.columns.action[0]);
    let edge = |v: &[f64]| (v[0], v[v.len() - 1]);
    let ((x0, x1), (u0, u1)) = (edge(&plane.x), edge(&plane.u));
    let mut sheet = Sheet::new(stem, "The map of one stride");
    let panels = sheet.row(
        300.0,
        vec![
            (24.0, Axis::linear(&label(state, "(k)"), x0, x1), Axis::linear(&label(action, "(k)"), u0, u1), None),
            (
                1.0,
                Axis::linear_with("", 0.0, 1.0, 0.1),
                Axis::linear(&format!("mean of {}", label(state, "(k + 1)")), lo, hi),
                None,
            ),
        ],
    );
    let mut panels = panels.into_iter();
    let levels = level_values(&latent);
    if let Some(mut p) = panels.next() {
        let (dx, du) = ((x1 - x0) / (plane.x.len() - 1) as f64, (u1 - u0) / (plane.u.len() - 1) as f64);
        for (j, u) in plane.u.iter().enumerate() {
            for (i, x) in plane.x.iter().enumerate() {
                let fraction = (mean[j * plane.x.len() + i] - lo) / (hi - lo).max(1e-12);
                p.cell((x - 0.5 * dx, x + 0.5 * dx), (u - 0.5 * du, u + 0.5 * du), &ramp_color(fraction));
            }
        }
        for (level, dash) in levels.iter().zip([Dash::Solid, Dash::Dashed, Dash::Dotted]) {
            for line in contour_lines(&plane.x, &plane.u, &latent, *level) {
                p.line(&line, "cw", dash, 1.5);
            }
        }
        let points: Vec<(f64, f64)> =
            data.strides.iter().filter_map(|s| Some((*s.state.first()?, *s.action.first()?))).collect();
        p.marks(&points, "s1", Mark::Disc, 3.4);
        let step = (plane.x.len() / 20).max(1);
        for j in (0..plane.u.len()).step_by(step) {
            for i in (0..plane.x.len()).step_by(step) {
                let at = j * plane.x.len() + i;
                p.hover(
                    plane.x[i],
                    plane.u[j],
                    format!(
                        "from {} with {}: {} ± {}",
                        signed(plane.x[i], 2),
                        signed(plane.u[j], 2),
                        signed(mean[at], 2),
                        number(latent[at], 2)
                    ),
                );
            }
        }
        p.key("strides on the robot", Key::Mark("s1", Mark::Disc));
        sheet.add(p);
    }
    if let Some(mut p) = panels.next() {
        p.x.ticks.clear();
        for i in 0..64 {
            let at = |f: f64| lo + (hi - lo) * f / 64.0;
            p.cell((0.0, 1.0), (at(f64::from(i)), at(f64::from(i) + 1.0)), &ramp_color((f64::from(i) + 0.5) / 64.0));
        }
        sheet.add(p);
    }
    let lines = levels
        .iter()
        .zip(["solid", "dashed", "dotted"])
        .map(|(l, d)| format!("{} ({d})", number(*l, 2)))
        .collect::<Vec<_>>()
        .join(", ");
    let unit = quantity(state).1;
    let caption = format!(
        "Map of iteration {}: mean of {} after a stride (colour) over state and action{}. White lines: standard deviation of the \
         function, without noise, of {lines} {unit}. Points: the n = {} strides from which the map was learned; far from them it is \
         a guess. The paper's Fig. 13 shows such a map from 20 strides of the small humanoid.",
        data.iteration,
        plain(&label(state, "")),
        if data.columns.state.len() + data.columns.action.len() > 2 {
            ", everything else held where the map settles under the policy found in it"
        } else {
            ""
        },
        data.strides.len()
    );
    let mut csv = format!("{state},{action},mean_next_{state},latent_std,noise_std\n");
    for i in &plane.rows {
        csv.push_str(&format!(
            "{},{},{},{},{}\n",
            g.state[0][*i], g.action[0][*i], g.mean[0][*i], g.latent_std[0][*i], g.noise_std[0][*i]
        ));
    }
    let alt = format!(
        "Heat map of the predicted next {} over state and action, from {} to {} {unit}, with the training data.",
        plain(&quantity(state).0),
        number(lo, 2),
        number(hi, 2)
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// Three levels at the lower quartile, the median and the upper quartile, rounded to one digit.
fn level_values(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut levels: Vec<f64> = [0.25, 0.5, 0.75]
        .iter()
        .map(|q| {
            let v = sorted[((sorted.len() - 1) as f64 * q) as usize].max(1e-12);
            let unit = 10f64.powf(v.log10().floor());
            (v / unit).round() * unit
        })
        .collect();
    levels.dedup_by(|a, b| (*a - *b).abs() < 1e-12);
    levels
}

/// Draws slices of the map: each component of the next state over itself, for three actions, with two
/// standard deviations of the prediction (function and noise) and the data.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if the grid is empty, not a grid, or holds a value that is not finite.
pub fn map_slices(data: &MapFigure) -> Result<Figure> {
    let stem = "map-slices";
    check_map(stem, data)?;
    let g = &data.grid;
    let (state_names, action_name) = (&data.columns.state, &data.columns.action[0]);
    let mut sheet = Sheet::new(stem, "Slices of the map with their uncertainty");
    let mut csv = String::from("output,state,action,mean,latent_std,noise_std\n");
    for (o, name) in state_names.iter().enumerate().take(g.mean.len()) {
        let Some(plane) = plane(g, o, 0) else {
            continue;
        };
        // Slices at a quarter, half and three quarters of the axis: within the data, which the axis overshoots.
        let picks: Vec<usize> = [1, 2, 3].iter().map(|q| q * (plane.u.len() - 1) / 4).collect();
        let n = plane.x.len();
        let at = |j: usize, k: f64| -> Vec<f64> {
            (0..n)
                .map(|i| {
                    let row = plane.rows[j * n + i];
                    g.mean[o][row] + k * g.latent_std[o][row].hypot(g.noise_std[o][row])
                })
                .collect()
        };
        let outcomes: Vec<(f64, f64, f64)> = data
            .strides
            .iter()
            .filter_map(|s| Some((*s.state.get(o)?, *s.next_state.get(o)?, *s.action.first()?)))
            .collect();
        let mut all: Vec<f64> = outcomes.iter().map(|q| q.1).collect();
        for j in &picks {
            all.extend(at(*j, 2.0));
            all.extend(at(*j, -2.0));
        }
        let y = Axis::covering(&label(name, "(k + 1)"), all);
        let specs = picks
            .iter()
            .map(|_| (1.0, Axis::linear_with(&label(name, "(k)"), plane.x[0], plane.x[n - 1], 5.0), y.clone()))
            .collect::<Vec<_>>();
        let (printed, unit) = quantity(action_name);
        let titles: Vec<String> =
            picks.iter().map(|j| format!("{printed} = {} {unit}", signed(plane.u[*j], 2))).collect();
        let specs = specs.into_iter().zip(&titles).map(|((s, x, y), t)| (s, x, y, Some(t.as_str()))).collect();
        for (slot, mut p) in sheet.row(190.0, specs).into_iter().enumerate() {
            let j = picks[slot];
            p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 0.9);
            p.band(&plane.x, &at(j, -2.0), &at(j, 2.0), "s0", 0.2);
            let mean = at(j, 0.0);
            let points: Vec<(f64, f64)> = plane.x.iter().copied().zip(mean.iter().copied()).collect();
            p.line(&points, "s0", Dash::Solid, 2.2);
            // Data belong to the slice whose action is nearest.
            let near: Vec<(f64, f64)> =
                outcomes.iter().filter(|q| nearest(&picks, &plane.u, q.2) == slot).map(|q| (q.0, q.1)).collect();
            p.marks(&near, "s1", Mark::Disc, 3.2);
            let std: Vec<f64> = at(j, 1.0).iter().zip(&mean).map(|(a, m)| a - m).collect();
            for i in (0..n).step_by((n / 25).max(1)) {
                p.hover(
                    plane.x[i],
                    mean[i],
                    format!(
                        "{}, from {}: {} ± {}",
                        plain(&titles[slot]),
                        signed(plane.x[i], 2),
                        signed(mean[i], 2),
                        signed(std[i], 2)
                    ),
                );
                let row = plane.rows[j * n + i];
                csv.push_str(&format!(
                    "{name},{},{},{},{},{}\n",
                    plane.x[i], plane.u[j], mean[i], g.latent_std[o][row], g.noise_std[o][row]
                ));
            }
            p.key("mean", Key::Line("s0", Dash::Solid));
            p.key("± 2 sd (function and noise)", Key::Band("s0", 0.2));
            p.key("strides of the nearest slice", Key::Mark("s1", Mark::Disc));
            p.key("identity", Key::Line("ref", Dash::Solid));
            sheet.add(p);
        }
    }
    let several = data.columns.state.len() + data.columns.action.len() > 2;
    let caption = format!(
        "Slices of the map of iteration {} at three values of {}{}: predicted state after a stride over the state before it, mean \
         (line) and ±2 standard deviations of the prediction, noise included (band). Points: n = {} strides on the robot, each in \
         the slice whose action is nearest to its own{}.",
        data.iteration,
        plain(&label(action_name, "")),
        if several { ", everything else held where the map settles under the policy found in it" } else { "" },
        data.strides.len(),
        if several { "; in the other components they lie anywhere, so they need not lie in the band" } else { "" }
    );
    let alt = format!(
        "Slices of the learned map of {} over the state with bands of two standard deviations and the data.",
        plain(&label(&state_names[0], ""))
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

fn nearest(picks: &[usize], u: &[f64], action: f64) -> usize {
    (0..picks.len()).min_by(|a, b| (u[picks[*a]] - action).abs().total_cmp(&(u[picks[*b]] - action).abs())).unwrap_or(0)
}
