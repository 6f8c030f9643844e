//! Level lines on a regular grid, by marching squares.

/// A grid of values to be contoured: `values[row * x.len() + column]`.
struct Grid<'a> {
    x: &'a [f64],
    y: &'a [f64],
    values: &'a [f64],
}

/// The segments on which the linearly interpolated grid takes the value `level`.
///
/// Saddles are cut in the order in which their edges come; for drawing either cut will do.
pub(crate) fn contour_lines(
    x: &[f64],
    y: &[f64],
    values: &[f64],
    level: f64,
) -> Vec<((f64, f64), (f64, f64))> {
    let grid = Grid { x, y, values };
    let mut out = Vec::new();
    if values.len() != x.len() * y.len() {
        return out;
    }
    for row in 0..y.len().saturating_sub(1) {
        for column in 0..x.len().saturating_sub(1) {
            let crossings = cell(&grid, row, column, level);
            for pair in crossings.chunks_exact(2) {
                out.push((pair[0], pair[1]));
            }
        }
    }
    out
}

fn cell(grid: &Grid<'_>, row: usize, column: usize, level: f64) -> Vec<(f64, f64)> {
    let corner = |r: usize, c: usize| (grid.x[c], grid.y[r], grid.values[r * grid.x.len() + c]);
    let ring = [
        corner(row, column),
        corner(row, column + 1),
        corner(row + 1, column + 1),
        corner(row + 1, column),
    ];
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
        let lines = contour_lines(
            &[0.0, 1.0, 2.0],
            &[0.0, 1.0],
            &[0.0, 1.0, 2.0, 0.0, 1.0, 2.0],
            0.5,
        );
        assert_eq!(lines, [((0.5, 0.0), (0.5, 1.0))]);
    }
}
