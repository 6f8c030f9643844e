//! What a run learned: the map of one stride.

use super::check::{column, named, present, some};
use super::names::{label, quantity};
use super::of_run::map_strides;
use crate::draw::{Axis, Dash, Key, Mark, N, Panel, Sheet, contour_lines, extent, pairs, plain, ramp_color};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::grid::MapGrid;
use stridemap_record::{Columns, Run, Transition};

/// A plane of the grid: distinct states and actions, and for each the row of the table.
pub(super) struct Plane {
    pub(super) x: Vec<f64>,
    pub(super) u: Vec<f64>,
    /// `rows[action * x.len() + state]`.
    pub(super) rows: Vec<usize>,
}

fn plane(grid: &MapGrid, state: usize, action: usize) -> Option<Plane> {
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

/// A map with its data.
pub(super) struct MapOf<'a> {
    stem: &'static str,
    pub(super) iteration: usize,
    pub(super) columns: &'a Columns,
    pub(super) grid: &'a MapGrid,
    /// The training strides from which it was learned.
    pub(super) strides: Vec<&'a Transition>,
}

impl<'a> MapOf<'a> {
    /// The map of an iteration, or the last, checked: columns of one length, one a name, finite.
    pub(super) fn new(stem: &'static str, run: &'a Run, iteration: Option<usize>) -> Result<Self> {
        let found = run.grids.iter().rfind(|g| iteration.is_none_or(|i| g.0 == i));
        let (iteration, g) = present(stem, "the run has no map yet", found)?;
        let n = g.state_axis.len();
        some(stem, "no row of the map", n)?;
        let (states, actions) = (run.columns.state.len(), run.columns.action.len());
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
        column(stem, "action_axis", &g.action_axis.iter().map(|v| *v as f64).collect::<Vec<_>>(), n)?;
        let (iteration, strides) = (*iteration, map_strides(run, *iteration));
        Ok(Self { stem, iteration, columns: &run.columns, grid: g, strides })
    }

    /// The plane of the first component of the state and of the action.
    pub(super) fn first_plane(&self) -> Result<Plane> {
        present(self.stem, "no plane of state and action", plane(self.grid, 0, 0))
    }

    /// What is not drawn, where there is more than one component of either.
    fn held(&self) -> &'static str {
        match self.columns.state.len() + self.columns.action.len() {
            0..=2 => "",
            _ => ", everything else held where the map settles under the policy found in it",
        }
    }

    /// State, action, mean, standard deviation of function and noise of the rows of a plane.
    pub(super) fn csv(&self, plane: &Plane, first: &str) -> String {
        let g = self.grid;
        let columns = [&g.state[0], &g.action[0], &g.mean[0], &g.latent_std[0], &g.noise_std[0]];
        let line = |i: &usize| {
            let cells: Vec<String> = columns.iter().map(|c| c[*i].to_string()).collect();
            format!("{first}{}\n", cells.join(","))
        };
        plane.rows.iter().map(line).collect()
    }
}

/// Draws the map of the first state component over the first state and action, as in Fig. 13: a heat
/// map of the mean, level lines of the latent standard deviation, and the data.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no grid, it is not a grid, or holds a value that is not finite.
pub fn map_surface(run: &Run) -> Result<Figure> {
    let stem = "map";
    let map = MapOf::new(stem, run, None)?;
    let (g, plane) = (map.grid, map.first_plane()?);
    let mean: Vec<f64> = plane.rows.iter().map(|i| g.mean[0][*i]).collect();
    let latent: Vec<f64> = plane.rows.iter().map(|i| g.latent_std[0][*i]).collect();
    let (lo, hi) = extent(mean.iter().copied());
    let (state, action) = (&map.columns.state[0], &map.columns.action[0]);
    let axis = |name: &str, v: &[f64]| Axis::linear(&label(name, "(k)"), v[0], v[v.len() - 1]);
    let scale = Axis::linear(&format!("mean of {}", label(state, "(k + 1)")), lo, hi);
    let mut sheet = Sheet::new(stem, "The map of one stride");
    let specs = vec![
        (24.0, axis(state, &plane.x), axis(action, &plane.u), None),
        (1.0, Axis::linear_with("", 0.0, 1.0, 0.1), scale, None),
    ];
    let levels = level_values(&latent);
    for (mut p, is_map) in sheet.row(300.0, specs).into_iter().zip([true, false]) {
        if is_map {
            heat_map(&mut p, &plane, &mean, &latent, &levels);
            let points: Vec<(f64, f64)> =
                map.strides.iter().filter_map(|s| Some((*s.state.first()?, *s.action.first()?))).collect();
            p.marks(&points, "s1", Mark::Disc, 3.4);
            p.key("strides on the robot", Key::Mark("s1", Mark::Disc));
        } else {
            p.x.ticks.clear();
            for i in (0..64).map(f64::from) {
                let at = |f: f64| lo + (hi - lo) * f / 64.0;
                p.cell((0.0, 1.0), (at(i), at(i + 1.0)), &ramp_color((i + 0.5) / 64.0));
            }
        }
        sheet.add(p);
    }
    let lines: Vec<String> =
        levels.iter().zip(["solid", "dashed", "dotted"]).map(|(l, d)| format!("{:#.2} ({d})", N(*l))).collect();
    let (unit, iteration, n) = (quantity(state).1, map.iteration, map.strides.len());
    let caption = format!(
        "Map of iteration {iteration}: mean of {} after a stride (colour) over state and action{}. White lines: standard \
         deviation of the function, without noise, of {} {unit}. Points: the n = {n} strides from which the map was learned; far \
         from them it is a guess. The paper's Fig. 13 shows such a map from 20 strides of the small humanoid.",
        plain(&label(state, "")),
        map.held(),
        lines.join(", ")
    );
    let csv = format!("{state},{action},mean_next_{state},latent_std,noise_std\n") + &map.csv(&plane, "");
    let alt = format!(
        "Heat map of the predicted next {} over state and action, from {:#.2} to {:#.2} {unit}, with the training data.",
        plain(&quantity(state).0),
        N(lo),
        N(hi)
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// The mean as colours, the standard deviation as level lines.
fn heat_map(p: &mut Panel, plane: &Plane, mean: &[f64], latent: &[f64], levels: &[f64]) {
    let (lo, hi) = extent(mean.iter().copied());
    let half = |v: &[f64]| 0.5 * (v[v.len() - 1] - v[0]) / (v.len() - 1) as f64;
    let (nx, dx, du) = (plane.x.len(), half(&plane.x), half(&plane.u));
    for (j, u) in plane.u.iter().enumerate() {
        for (i, x) in plane.x.iter().enumerate() {
            let fraction = (mean[j * nx + i] - lo) / (hi - lo).max(1e-12);
            p.cell((x - dx, x + dx), (u - du, u + du), &ramp_color(fraction));
        }
    }
    for (level, dash) in levels.iter().zip([Dash::Solid, Dash::Dashed, Dash::Dotted]) {
        for line in contour_lines(&plane.x, &plane.u, latent, *level) {
            p.line(&line, "cw", dash, 1.5);
        }
    }
    let step = (nx / 20).max(1);
    for j in (0..plane.u.len()).step_by(step) {
        for i in (0..nx).step_by(step) {
            let at = j * nx + i;
            let [x, u, mean, sd] = [plane.x[i], plane.u[j], mean[at], latent[at]].map(N);
            p.hover(x.0, u.0, format!("from {x:.2} with {u:.2}: {mean:.2} ± {sd:#.2}"));
        }
    }
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
/// [`ReportError`](crate::ReportError) if there is no grid, it is not a grid, or holds a value that is not finite.
pub fn map_slices(run: &Run) -> Result<Figure> {
    let stem = "map-slices";
    let map = MapOf::new(stem, run, None)?;
    let mut sheet = Sheet::new(stem, "Slices of the map with their uncertainty");
    let mut csv = String::from("output,state,action,mean,latent_std,noise_std\n");
    for output in 0..map.columns.state.len() {
        if let Some(plane) = plane(map.grid, output, 0) {
            slices(&mut sheet, &mut csv, &map, output, &plane);
        }
    }
    let (held, n) = (map.held(), map.strides.len());
    let elsewhere = match held {
        "" => "",
        _ => "; in the other components they lie anywhere, so they need not lie in the band",
    };
    let caption = format!(
        "Slices of the map of iteration {} at three values of {}{held}: predicted state after a stride over the state before it, mean \
         (line) and ±2 standard deviations of the prediction, noise included (band). Points: n = {n} strides on the robot, each in \
         the slice whose action is nearest to its own{elsewhere}.",
        map.iteration,
        plain(&label(&map.columns.action[0], ""))
    );
    let alt = format!(
        "Slices of the learned map of {} over the state with bands of two standard deviations and the data.",
        plain(&label(&map.columns.state[0], ""))
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// A row of three slices: one component of the next state over itself.
fn slices(sheet: &mut Sheet, csv: &mut String, map: &MapOf<'_>, output: usize, plane: &Plane) {
    let (g, name) = (map.grid, &map.columns.state[output]);
    // Slices at a quarter, half and three quarters of the axis: within the data, which the axis overshoots.
    let picks = [1, 2, 3].map(|q| q * (plane.u.len() - 1) / 4);
    let n = plane.x.len();
    let at = |j: usize, k: f64| -> Vec<f64> {
        let rows = plane.rows[j * n..(j + 1) * n].iter();
        rows.map(|row| g.mean[output][*row] + k * g.latent_std[output][*row].hypot(g.noise_std[output][*row])).collect()
    };
    let outcome = |s: &&Transition| Some((*s.state.get(output)?, *s.next_state.get(output)?, *s.action.first()?));
    let outcomes: Vec<(f64, f64, f64)> = map.strides.iter().filter_map(outcome).collect();
    let bands = picks.iter().flat_map(|j| [at(*j, 2.0), at(*j, -2.0)]).flatten();
    let y = Axis::covering(&label(name, "(k + 1)"), outcomes.iter().map(|q| q.1).chain(bands));
    let x = Axis::linear_with(&label(name, "(k)"), plane.x[0], plane.x[n - 1], 5.0);
    let (printed, unit) = quantity(&map.columns.action[0]);
    let titles = picks.map(|j| format!("{printed} = {:.2} {unit}", N(plane.u[j])));
    let specs = titles.iter().map(|t| (1.0, x.clone(), y.clone(), Some(t.as_str()))).collect();
    for (slot, mut p) in sheet.row(190.0, specs).into_iter().enumerate() {
        let (j, title) = (picks[slot], plain(&titles[slot]));
        p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 0.9);
        p.band(&plane.x, &at(j, -2.0), &at(j, 2.0), "s0", 0.2);
        let (mean, edge) = (at(j, 0.0), at(j, 1.0));
        p.line(&pairs(&plane.x, &mean), "s0", Dash::Solid, 2.2);
        // Data belong to the slice whose action is nearest.
        let near = outcomes.iter().filter(|q| nearest(&picks, &plane.u, q.2) == slot);
        p.marks(&near.map(|q| (q.0, q.1)).collect::<Vec<_>>(), "s1", Mark::Disc, 3.2);
        for i in (0..n).step_by((n / 25).max(1)) {
            let ([x, y, sd], u) = ([plane.x[i], mean[i], edge[i] - mean[i]].map(N), plane.u[j]);
            p.hover(x.0, y.0, format!("{title}, from {x:.2}: {y:.2} ± {sd:.2}"));
            let row = plane.rows[j * n + i];
            let (function, noise) = (g.latent_std[output][row], g.noise_std[output][row]);
            *csv += &format!("{name},{},{u},{},{function},{noise}\n", x.0, y.0);
        }
        p.key("mean", Key::Line("s0", Dash::Solid));
        p.key("± 2 sd (function and noise)", Key::Band("s0", 0.2));
        p.key("strides of the nearest slice", Key::Mark("s1", Mark::Disc));
        p.key("identity", Key::Line("ref", Dash::Solid));
        sheet.add(p);
    }
}

fn nearest(picks: &[usize], u: &[f64], action: f64) -> usize {
    let off = |slot: &usize| (u[picks[*slot]] - action).abs();
    (0..picks.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
}
