//! Level lines on a regular grid, by marching squares.

use std::collections::{BTreeMap, VecDeque};

/// A grid of values to be contoured: `values[row * x.len() + column]`.
/// A piece of a level line.
type Segment = ((f64, f64), (f64, f64));

struct Grid<'a> {
    x: &'a [f64],
    y: &'a [f64],
    values: &'a [f64],
}

/// The lines on which the linearly interpolated grid takes the value `level`.
///
/// Saddles are cut in the order in which their edges come; for drawing either cut will do.
pub(crate) fn contour_lines(x: &[f64], y: &[f64], values: &[f64], level: f64) -> Vec<Vec<(f64, f64)>> {
    let grid = Grid { x, y, values };
    let mut segments = Vec::new();
    if values.len() != x.len() * y.len() {
        return Vec::new();
    }
    for row in 0..y.len().saturating_sub(1) {
        for column in 0..x.len().saturating_sub(1) {
            let crossings = cell(&grid, row, column, level);
            for pair in crossings.chunks_exact(2) {
                segments.push((pair[0], pair[1]));
            }
        }
    }
    join(&segments)
}

/// Key of a point, so that equal ends of neighbouring segments meet.
fn key(p: (f64, f64)) -> (i64, i64) {
    ((p.0 * 1e9).round() as i64, (p.1 * 1e9).round() as i64)
}

/// Joins segments that share an end into lines, so that dashes run on along them.
fn join(segments: &[Segment]) -> Vec<Vec<(f64, f64)>> {
    let mut at: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
    for (i, (a, b)) in segments.iter().enumerate() {
        at.entry(key(*a)).or_default().push(i);
        at.entry(key(*b)).or_default().push(i);
    }
    let mut used = vec![false; segments.len()];
    let mut lines = Vec::new();
    for first in 0..segments.len() {
        if used[first] {
            continue;
        }
        used[first] = true;
        let mut line = VecDeque::from([segments[first].0, segments[first].1]);
        for forward in [true, false] {
            while let Some(end) = if forward { line.back() } else { line.front() }.copied() {
                let next = at.get(&key(end)).and_then(|all| all.iter().copied().find(|i| !used[*i]));
                let Some(next) = next else { break };
                used[next] = true;
                let (a, b) = segments[next];
                let other = if key(a) == key(end) { b } else { a };
                if forward {
                    line.push_back(other);
                } else {
                    line.push_front(other);
                }
            }
        }
        lines.push(line.into_iter().collect());
    }
    lines
}

fn cell(grid: &Grid<'_>, row: usize, column: usize, level: f64) -> Vec<(f64, f64)> {
    let corner = |r: usize, c: usize| (grid.x[c], grid.y[r], grid.values[r * grid.x.len() + c]);
    let ring = [corner(row, column), corner(row, column + 1), corner(row + 1, column + 1), corner(row + 1, column)];
    let mut out = Vec::new();
    for i in 0..4 {
        let (a, b) = (ring[i], ring[(i + 1) % 4]);
        if (a.2 < level) != (b.2 < level) {
            let t = (level - a.2) / (b.2 - a.2);
            out.push((a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_has_a_straight_level_line() {
        // v = x on a 3 x 2 grid: the level 0.5 is the line x = 0.5.
        let lines = contour_lines(&[0.0, 1.0, 2.0], &[0.0, 1.0], &[0.0, 1.0, 2.0, 0.0, 1.0, 2.0], 0.5);
        assert_eq!(lines, [[(0.5, 0.0), (0.5, 1.0)]]);
    }

    #[test]
    fn a_hill_has_one_closed_line() {
        let axis: Vec<f64> = (-10..=10).map(f64::from).collect();
        let hill: Vec<f64> = axis.iter().flat_map(|y| axis.iter().map(move |x| -(x * x + y * y).sqrt())).collect();
        let lines = contour_lines(&axis, &axis, &hill, -5.3);
        assert_eq!(lines.len(), 1);
        assert_eq!(key(lines[0][0]), key(lines[0][lines[0].len() - 1]), "closed");
        assert!(lines[0].iter().all(|(x, y)| (x.hypot(*y) - 5.3).abs() < 0.1));
    }
}
