//! Shapes as convex hulls.

use stridemap_robot::ShapeKind;

/// Points around a circle; a circle of radius 1 is then drawn to 0.4 %.
pub(super) const AROUND: usize = 36;

/// A shape as the hull of points, each the centre of a ball of one radius.
pub(super) fn balls(kind: &ShapeKind) -> (Vec<[f64; 3]>, f64) {
    let around = |i: usize, of: usize| 2.0 * std::f64::consts::PI * i as f64 / of as f64;
    match *kind {
        ShapeKind::Mesh { ref vertices_m, .. } => (vertices_m.iter().map(|v| v.map(f64::from)).collect(), 0.0),
        ShapeKind::Sphere { radius_m } => (vec![[0.0; 3]], radius_m),
        ShapeKind::Capsule { radius_m, half_length_m: h } => (vec![[0.0, 0.0, -h], [0.0, 0.0, h]], radius_m),
        ShapeKind::Cylinder { radius_m: r, half_length_m: h } => {
            let rim = |z: f64| {
                (0..AROUND).map(move |i| {
                    let (s, c) = around(i, AROUND).sin_cos();
                    [r * c, r * s, z]
                })
            };
            (rim(-h).chain(rim(h)).collect(), 0.0)
        }
        ShapeKind::Ellipsoid { semi_axes_m: [a, b, c] } => {
            let points = (0..=AROUND / 2).flat_map(|i| {
                let (z, ring) = (around(i, AROUND).cos(), around(i, AROUND).sin());
                (0..AROUND).map(move |j| {
                    let (s, k) = around(j, AROUND).sin_cos();
                    [a * ring * k, b * ring * s, c * z]
                })
            });
            (points.collect(), 0.0)
        }
        ShapeKind::Box { half_extents_m: [a, b, c] } => {
            let corners = (0..8_u8).map(|i| {
                let sign = |bit: u8| if i & bit == 0 { -1.0 } else { 1.0 };
                [a * sign(1), b * sign(2), c * sign(4)]
            });
            (corners.collect(), 0.0)
        }
    }
}

/// Convex hull of points in the plane, counter-clockwise (Andrew's monotone chain).
pub(super) fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while let [.., a, b] = chain.as_slice() {
                let turn = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
                if turn > 1e-12 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut out = half(&mut points.iter().copied());
    out.extend(half(&mut points.iter().rev().copied()));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_is_the_corners_counter_clockwise() {
        let points = vec![[0.0, 0.0], [1.0, 1.0], [0.5, 0.5], [1.0, 0.0], [0.5, 0.0], [0.0, 1.0], [0.0, 0.0]];
        assert_eq!(hull(points), [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        assert_eq!(hull(vec![[1.0, 2.0]; 3]), [[1.0, 2.0]]);
    }
}
