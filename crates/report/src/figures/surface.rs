//! Fig. 13: the map of one stride as a surface in space, with its uncertainty and the data.

use super::map::{MapOf, Plane};
use super::names::{label, quantity};
use crate::draw::{
    Anchor, Axis, Dash, Key, Mark, N, Sheet, cell_look, extent, line_svg, mark_svg, number, path_data, plain,
    ramp_color, rect_svg, text_svg,
};
use crate::error::Result;
use crate::figure::{Figure, HoverPoint};
use stridemap_process::StrideEnd;
use stridemap_record::{Run, Transition};

/// Size of tick labels, px.
const TICK: f64 = 11.5;
/// Size of axis labels, px.
const LABEL: f64 = 13.0;
/// Height of the drawing, px.
const HEIGHT: f64 = 440.0;
/// By how much the scene is turned about the vertical, and how far the camera looks down.
const TURN_DEG: f64 = 38.0;
const DOWN_DEG: f64 = 28.0;
/// Cells of the surface along either axis, at most.
const CELLS: usize = 28;

/// An axonometric camera on a box of three axes.
struct Camera {
    axes: [Axis; 3],
    /// Pixels to an edge of the box, across and upward.
    size: [f64; 2],
    middle: [f64; 2],
    /// Whether the second axis runs towards the camera instead of away from it.
    towards: bool,
}

impl Camera {
    /// Pixel of a point, and how far away it is.
    fn see(&self, p: [f64; 3]) -> ([f64; 2], f64) {
        let [x, u, z] = [0, 1, 2].map(|i| self.axes[i].fraction(p[i]) - 0.5);
        let u = if self.towards { -u } else { u };
        let (st, ct) = TURN_DEG.to_radians().sin_cos();
        let (sd, cd) = DOWN_DEG.to_radians().sin_cos();
        let away = u * ct - x * st;
        let right = self.middle[0] + self.size[0] * (x * ct + u * st);
        let down = self.middle[1] - self.size[0] * away * sd - self.size[1] * z * cd;
        ([right, down], away)
    }

    fn path(&self, points: impl IntoIterator<Item = [f64; 3]>) -> String {
        path_data(points.into_iter().map(|p| self.see(p).0))
    }

    fn ends(&self, axis: usize) -> [f64; 2] {
        [self.axes[axis].min, self.axes[axis].max]
    }

    /// Floor and back walls with their grid, ticks and labels.
    fn frame(&self) -> String {
        let [[x0, x1], [mut u0, mut u1], [z0, z1]] = [0, 1, 2].map(|i| self.ends(i));
        if self.towards {
            std::mem::swap(&mut u0, &mut u1); // u0 is the near end of the axis.
        }
        let mut grid = String::new();
        for (x, _) in &self.axes[0].ticks {
            grid.push_str(&self.path([[*x, u0, z0], [*x, u1, z0], [*x, u1, z1]]));
        }
        for (u, _) in &self.axes[1].ticks {
            grid.push_str(&self.path([[x1, *u, z0], [x0, *u, z0], [x0, *u, z1]]));
        }
        for (z, _) in &self.axes[2].ticks {
            grid.push_str(&self.path([[x0, u0, *z], [x0, u1, *z], [x1, u1, *z]]));
        }
        let edges = [
            self.path([[x0, u0, z1], [x0, u0, z0], [x1, u0, z0], [x1, u1, z0]]),
            self.path([[x0, u0, z0], [x0, u1, z0], [x1, u1, z0]]),
            self.path([[x0, u1, z0], [x0, u1, z1]]),
        ]
        .concat();
        let mut svg = format!(
            "<path class=\"floor\" d=\"{}Z\"/><path class=\"grid\" stroke-width=\"1\" d=\"{grid}\"/>\
             <path class=\"axis\" stroke-width=\"1\" d=\"{edges}\"/>",
            self.path([[x0, u0, z0], [x1, u0, z0], [x1, u1, z0], [x0, u1, z0]])
        );
        let mut note = |at: [f64; 3], by: [f64; 2], anchor: Anchor, size: f64, text: &str| {
            let [x, y] = self.see(at).0;
            svg += &text_svg(if size < LABEL { "mut" } else { "" }, x + by[0], y + by[1], size, anchor, text);
        };
        for (x, text) in &self.axes[0].ticks {
            note([*x, u0, z0], [-5.0, 15.0], Anchor::End, TICK, text);
        }
        for (u, text) in &self.axes[1].ticks {
            note([x1, *u, z0], [6.0, 15.0], Anchor::Start, TICK, text);
        }
        for (z, text) in &self.axes[2].ticks {
            note([x0, u0, *z], [-8.0, 4.0], Anchor::End, TICK, text);
        }
        let half = |[a, b]: [f64; 2]| 0.5 * (a + b);
        let names = [0, 1, 2].map(|i| self.axes[i].label.clone());
        note([half([x0, x1]), u0, z0], [-30.0, 34.0], Anchor::End, LABEL, &names[0]);
        note([x1, half([u0, u1]), z0], [34.0, 36.0], Anchor::Start, LABEL, &names[1]);
        note([x0, u0, z1], [-8.0, -14.0], Anchor::Middle, LABEL, &names[2]);
        svg
    }
}

/// A map as a surface, its rows as a grid.
struct Surface<'a> {
    map: MapOf<'a>,
    plane: Plane,
    /// State, action and next state of each stride.
    strides: Vec<[f64; 3]>,
}

impl Surface<'_> {
    fn at(&self, column: &[f64], (i, j): (usize, usize)) -> f64 {
        column[self.plane.rows[j * self.plane.x.len() + i]]
    }

    fn mean(&self, at: (usize, usize)) -> f64 {
        self.at(&self.map.grid.mean[0], at)
    }

    fn std(&self, at: (usize, usize)) -> f64 {
        self.at(&self.map.grid.latent_std[0], at)
    }

    /// A point of the surface, `k` standard deviations above it.
    fn point(&self, at: (usize, usize), k: f64) -> [f64; 3] {
        [self.plane.x[at.0], self.plane.u[at.1], self.mean(at) + k * self.std(at)]
    }

    fn everywhere(&self) -> impl Iterator<Item = (usize, usize)> {
        let nx = self.plane.x.len();
        (0..self.plane.u.len()).flat_map(move |j| (0..nx).map(move |i| (i, j)))
    }

    fn camera(&self, [left, top]: [f64; 2]) -> Camera {
        let (state, action) = (&self.map.columns.state[0], &self.map.columns.action[0]);
        let (x, u) = (&self.plane.x, &self.plane.u);
        let heights = self.everywhere().flat_map(|at| [-2.0, 2.0].map(|k| self.point(at, k)[2]));
        let (z0, z1) = extent(heights.chain(self.strides.iter().map(|s| s[2])));
        Camera {
            axes: [
                Axis::linear_with(&label(state, "(k)"), x[0], x[x.len() - 1], 6.0),
                Axis::linear_with(&label(action, "(k)"), u[0], u[u.len() - 1], 6.0),
                Axis::linear_with(&label(state, "(k + 1)"), z0, z1, 6.0),
            ],
            size: [372.0, 190.0],
            middle: [left + 0.5 * Sheet::FREE_WIDTH + 6.0, top + 0.5 * HEIGHT],
            // The surface shows its face where it rises away from the camera.
            towards: self.mean((x.len() / 2, u.len() - 1)) < self.mean((x.len() / 2, 0)),
        }
    }

    /// The cells, the farthest first, and two standard deviations above and below along the edges of the surface.
    fn draw(&self, camera: &Camera, [s0, s1]: [f64; 2]) -> String {
        let (nx, nu) = (self.plane.x.len(), self.plane.u.len());
        let (xs, us) = (thin(nx), thin(nu));
        let mut cells = Vec::new();
        for j in us.windows(2) {
            for i in xs.windows(2) {
                let ring = [(i[0], j[0]), (i[1], j[0]), (i[1], j[1]), (i[0], j[1])];
                let corners = ring.map(|at| self.point(at, 0.0));
                let away: f64 = corners.iter().map(|c| camera.see(*c).1).sum();
                let std = ring.iter().map(|at| self.std(*at)).sum::<f64>() / 4.0;
                cells.push((away, std, camera.path(corners)));
            }
        }
        cells.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut svg = String::new();
        for (_, std, d) in &cells {
            let color = ramp_color((std - s0) / (s1 - s0).max(1e-12));
            svg += &format!(
                "<path fill=\"{color}\" fill-opacity=\"0.86\" stroke=\"{color}\" stroke-width=\"0.6\" d=\"{d}Z\"/>"
            );
        }
        let border = (0..nx)
            .map(|i| (i, 0))
            .chain((1..nu).map(|j| (nx - 1, j)))
            .chain((0..nx - 1).rev().map(|i| (i, nu - 1)))
            .chain((0..nu - 1).rev().map(|j| (0, j)));
        for k in [-2.0, 2.0] {
            let edge = border.clone().map(|at| self.point(at, k));
            svg += &line_svg("s6", Dash::Dashed, &camera.path(edge), 1.2);
        }
        svg
    }

    /// Data, with their distance from the surface.
    fn draw_strides(&self, camera: &Camera) -> (String, Vec<HoverPoint>) {
        let nearest = |values: &[f64], v: f64| {
            let off = |i: &usize| (values[*i] - v).abs();
            (0..values.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
        };
        let (mut svg, mut hover) = (String::new(), Vec::new());
        for s in &self.strides {
            let surface = self.mean((nearest(&self.plane.x, s[0]), nearest(&self.plane.u, s[1])));
            let [x, y] = camera.see(*s).0;
            svg += &line_svg("s1", Dash::Solid, &camera.path([*s, [s[0], s[1], surface]]), 1.3);
            svg += &mark_svg("s1", if s[2] >= surface { Mark::Disc } else { Mark::Circle }, x, y, 3.6);
            let [from, action, to, map] = [s[0], s[1], s[2], surface].map(N);
            let text = format!("from {from:.2} with {action:.2}: {to:.2} (map {map:.2})");
            hover.push(HoverPoint { x, y, text });
        }
        (svg, hover)
    }
}

/// Every so manieth index, first and last among them.
fn thin(n: usize) -> Vec<usize> {
    let step = n.saturating_sub(1).div_ceil(CELLS).max(1);
    (0..n - 1).step_by(step).chain([n - 1]).collect()
}

/// Draws the first iteration's map of the first state component as a surface over the first state and action, as in
/// Fig. 13: height is the mean of the next state, colour the standard deviation of the function, dashed
/// edges two of them above and below; data with their distance from the surface.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no grid, it is not a grid, or holds a value that is not finite.
pub fn fig13(run: &Run) -> Result<Figure> {
    let stem = "fig13";
    let map = MapOf::new(stem, run, Some(1))?;
    let crossed = map.strides.iter().filter(|s| s.end == StrideEnd::Crossing);
    let point = |s: &&Transition| Some([*s.state.first()?, *s.action.first()?, *s.next_state.first()?]);
    let strides: Vec<[f64; 3]> = crossed.filter_map(point).collect();
    let surface = Surface { plane: map.first_plane()?, map, strides };
    let (state, action) = (&surface.map.columns.state[0], &surface.map.columns.action[0]);
    let mut sheet = Sheet::new(stem, "The approximated map of one stride");
    let [left, top] = sheet.free(HEIGHT + 20.0);
    let camera = surface.camera([left, top]);
    let [z0, z1] = camera.ends(2);
    let (s0, s1) = extent(surface.everywhere().map(|at| surface.std(at)));
    let unit = quantity(state).1;

    let mut svg = camera.frame();
    // Where the data are, on the floor.
    for s in &surface.strides {
        let [x, y] = camera.see([s[0], s[1], z0]).0;
        svg += &mark_svg("s6", Mark::Dot, x, y, 2.2);
    }
    svg += &surface.draw(&camera, [s0, s1]);
    let (data, hover) = surface.draw_strides(&camera);
    svg += &data;
    let at = [left + Sheet::FREE_WIDTH - 240.0, top + 10.0];
    svg += &color_bar(at, [s0, s1], &format!("standard deviation of the function ({unit})"));
    sheet.draw(&svg, hover);
    sheet.key("stride above the surface", Key::Mark("s1", Mark::Disc));
    sheet.key("below it", Key::Mark("s1", Mark::Circle));
    sheet.key("mean ± 2 sd at the edges", Key::Line("s6", Dash::Dashed));

    let (n, [x, u]) = (surface.strides.len(), [state, action].map(|name| plain(&quantity(name).0)));
    let [least, most, noise] = [s0, s1, surface.at(&surface.map.grid.noise_std[0], (0, 0))].map(N);
    let caption = format!(
        "Fig. 13 of the paper. Map of the small humanoid's stepping after n = {n} strides (points, with their distance from the \
         surface; dots on the floor show where they are): mean of {x} after a stride (height) over {x} before it and the action {u}. \
         Colour: standard deviation of the function, {least:#.2} to {most:#.2} {unit}; dashed edges: two of them above and below the \
         surface, which is a guess where no data are. The standard deviation of the noise is {noise:#.2} {unit}."
    );
    let mut csv = format!("series,{state},{action},next_{state},latent_std,noise_std\n");
    csv += &surface.map.csv(&surface.plane, "map,");
    for [x, u, next] in &surface.strides {
        csv += &format!("stride,{x},{u},{next},,\n");
    }
    let [low, high] = [z0, z1].map(N);
    let alt = format!(
        "Surface of the predicted next {x} over state and action, between {low:#.2} and {high:#.2} {unit}, with {n} strides as \
         points."
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// A bar of the ramp with its ends and its name.
fn color_bar([left, top]: [f64; 2], [lo, hi]: [f64; 2], name: &str) -> String {
    const WIDTH: f64 = 240.0;
    const STEPS: u32 = 60;
    let wide = WIDTH / f64::from(STEPS);
    let cell = |i: f64| {
        let look = cell_look(&ramp_color((i + 0.5) / f64::from(STEPS)));
        rect_svg(&look, [left + wide * i, top + 8.0], [wide + 0.4, 9.0])
    };
    let mut svg: String = (0..STEPS).map(|i| cell(f64::from(i))).collect();
    let mut note = |x: f64, y: f64, anchor: Anchor, class: &str, text: &str| {
        svg += &text_svg(class, x, y, TICK, anchor, text);
    };
    note(left, top + 30.0, Anchor::Start, "mut", &number(lo, 2));
    note(left + WIDTH, top + 30.0, Anchor::End, "mut", &number(hi, 2));
    note(left + 0.5 * WIDTH, top + 2.0, Anchor::Middle, "", name);
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of 0 to 1: its corners are where the turn and the look downward put them.
    #[test]
    fn the_camera_looks_at_the_box_from_above_and_turned() {
        let axis = || Axis::linear("", 0.0, 1.0);
        let camera =
            Camera { axes: [axis(), axis(), axis()], size: [100.0, 100.0], middle: [0.0, 0.0], towards: false };
        let at = |p| camera.see(p);
        let (left, front, right) = (at([0.0, 0.0, 0.0]), at([1.0, 0.0, 0.0]), at([1.0, 1.0, 0.0]));
        assert!(left.0[0] < front.0[0] && front.0[0] < right.0[0]);
        assert!(front.1 < left.1 && front.1 < right.1, "the front is nearest");
        let (low, high) = (at([0.5, 0.5, 0.0]).0, at([0.5, 0.5, 1.0]).0);
        let rise = 100.0 * DOWN_DEG.to_radians().cos();
        assert!((low[1] - high[1] - rise).abs() < 1e-9 && (low[0] - high[0]).abs() < 1e-9);
    }

    /// A plane x' = 1 - u over a grid of 3 by 3, with one stride above and one below it.
    #[test]
    fn the_table_has_the_grid_and_the_strides_and_the_marks_their_side() {
        let (mut state, mut action) = (Vec::new(), Vec::new());
        for u in [0.0, 0.5, 1.0] {
            for x in [-1.0, 0.0, 1.0] {
                state.push(x);
                action.push(u);
            }
        }
        let stride = |x: f64, u: f64, next: f64| stridemap_record::Transition {
            iteration: 1,
            state: [x].as_slice().into(),
            action: [u].as_slice().into(),
            next_state: [next].as_slice().into(),
            ..Default::default()
        };
        let grid = stridemap_record::grid::MapGrid {
            state_axis: vec![0; 9],
            action_axis: vec![0; 9],
            mean: vec![action.iter().map(|u| 1.0 - u).collect()],
            latent_std: vec![vec![0.1; 9]],
            noise_std: vec![vec![0.3; 9]],
            state: vec![state],
            action: vec![action],
        };
        let run = Run {
            columns: stridemap_record::Columns {
                state: vec!["psi_roll_deg".into()],
                action: vec!["ankle_roll_amplitude_deg".into()],
                goal: Vec::new(),
            },
            grids: vec![(1, grid)],
            transitions: vec![stride(0.0, 0.5, 0.9), stride(1.0, 1.0, -0.4)],
            ..Run::default()
        };
        let figure = fig13(&run).unwrap();
        assert_eq!(figure.csv.lines().count(), 1 + 9 + 2);
        assert!(figure.csv.contains("\nstride,0,0.5,0.9,,\n"));
        assert_eq!(figure.svg.matches("fill-opacity=\"0.86\"").count(), 4, "cells");
        // One of either, and the legend's.
        assert_eq!(figure.svg.matches("class=\"f1 sbg\"").count(), 2);
        assert_eq!(figure.svg.matches("class=\"bg s1\"").count(), 2);
        assert_eq!(figure.hover[0].text, "from 0.00 with 0.50: 0.90 (map 0.50)");
        assert!(fig13(&Run::default()).is_err());
    }
}
