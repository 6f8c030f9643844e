//! Coarser meshes, by vertex clustering: robots come with a million triangles, and a picture needs some thousand.
//!
//! Vertices in one cell of a grid become one, at the place with the least squared distance to the planes of the triangles
//! about it (quadric error; P. Lindstrom, "Out-of-core simplification of large polygonal models", SIGGRAPH 2000, section 3);
//! triangles whose corners fall together vanish.

use std::collections::{BTreeMap, BTreeSet};

/// Cells along the longest edge of the finest grid that is tried.
const FINEST: u32 = 96;
/// Weight of a cell's middle beside its planes: flat pieces leave a vertex free to slide.
const MIDDLE: f64 = 1e-3;

/// Corners, and triangles as three of their indices each.
pub(crate) type Mesh = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// What belongs to one cell: planes of triangles weighted by area, `xᵀ A x − 2 bᵀ x`, and the sum of its vertices.
#[derive(Clone, Copy, Default)]
struct Cell {
    a: [[f64; 3]; 3],
    b: [f64; 3],
    sum: [f64; 3],
    count: f64,
}

/// A mesh with at most so many triangles, of the same form; as it is, if it has no more.
pub(crate) fn coarse(vertices: &[[f32; 3]], faces: &[[i32; 3]], most: usize) -> Mesh {
    let inside = |face: &&[i32; 3]| face.iter().all(|&v| usize::try_from(v).is_ok_and(|v| v < vertices.len()));
    #[expect(clippy::cast_sign_loss)] // Just looked at.
    let faces: Vec<[u32; 3]> = faces.iter().filter(inside).map(|face| face.map(|v| v as u32)).collect();
    if faces.len() <= most {
        return rounded(vertices, &faces);
    }
    let (mut good, mut bad) = (2, FINEST + 1);
    let mut found = clustered(vertices, &faces, good);
    while bad - good > 1 {
        let middle = good.midpoint(bad);
        let tried = clustered(vertices, &faces, middle);
        if tried.1.len() <= most {
            (good, found) = (middle, tried);
        } else {
            bad = middle;
        }
    }
    rounded(&found.0, &found.1)
}

/// The vertices of every cell of a grid made one.
fn clustered(vertices: &[[f32; 3]], faces: &[[u32; 3]], cells: u32) -> Mesh {
    let edge = |axis: usize, pick: fn(f32, f32) -> f32| vertices.iter().map(|v| v[axis]).reduce(pick).unwrap_or(0.0);
    let low = [0, 1, 2].map(|axis| edge(axis, f32::min));
    let longest = (0..3).map(|axis| edge(axis, f32::max) - low[axis]).fold(0.0, f32::max).max(1e-9);
    #[expect(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    // Few cells, from 0 on.
    let key = |v: &[f32; 3]| [0, 1, 2].map(|i| ((v[i] - low[i]) / longest * cells as f32) as u32);
    let keys: Vec<[u32; 3]> = vertices.iter().map(key).collect();
    let mut of_key: BTreeMap<[u32; 3], Cell> = BTreeMap::new();
    let mut kept = BTreeSet::new();
    for face in faces {
        let corners = face.map(|v| vertices[v as usize].map(f64::from));
        let at = face.map(|v| keys[v as usize]);
        let along = [1, 2].map(|c| [0, 1, 2].map(|i| corners[c][i] - corners[0][i]));
        // Twice the area, along the normal.
        let n = [0, 1, 2].map(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            along[0][j] * along[1][k] - along[0][k] * along[1][j]
        });
        let d: f64 = (0..3).map(|i| n[i] * corners[0][i]).sum();
        for (corner, key) in corners.iter().zip(at) {
            let cell = of_key.entry(key).or_default();
            for i in 0..3 {
                (0..3).for_each(|j| cell.a[i][j] += n[i] * n[j]);
                cell.b[i] += n[i] * d;
                cell.sum[i] += corner[i];
            }
            cell.count += 1.0;
        }
        if at[0] != at[1] && at[1] != at[2] && at[2] != at[0] {
            // One of the three ways to begin it, so that it is counted once; its other side is another triangle.
            let first = (0..3).min_by_key(|&c| at[c]).unwrap_or(0);
            kept.insert([0, 1, 2].map(|c| at[(first + c) % 3]));
        }
    }
    let index: BTreeMap<[u32; 3], u32> = of_key.keys().copied().zip(0..).collect();
    let size = f64::from(longest) / f64::from(cells);
    let places = of_key.values().map(|cell| cell.place(size)).collect();
    (places, kept.into_iter().map(|face| face.map(|key| index[&key])).collect())
}

impl Cell {
    /// The vertex that stands for those of a cell.
    fn place(&self, size: f64) -> [f32; 3] {
        let middle = self.sum.map(|sum| sum / self.count.max(1.0));
        let weight = MIDDLE * (0..3).map(|i| self.a[i][i]).sum::<f64>();
        let mut a = self.a;
        let mut b = self.b;
        for i in 0..3 {
            a[i][i] += weight;
            b[i] += weight * middle[i];
        }
        let determinant = |m: &[[f64; 3]; 3]| {
            let minor = |i: usize| m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3];
            (0..3).map(|i| m[0][i] * minor(i)).sum::<f64>()
        };
        let whole = determinant(&a);
        // Cramer's rule; the matrix is symmetric, so that a row may stand for a column.
        let best = [0, 1, 2].map(|i| {
            let mut with = a;
            with[i] = b;
            determinant(&with) / whole
        });
        let near = (0..3).all(|i| (best[i] - middle[i]).abs() <= size);
        #[expect(clippy::cast_possible_truncation)] // As they came.
        if near { best } else { middle }.map(|v| v as f32)
    }
}

/// The vertices that are used, to a tenth of a millimetre.
fn rounded(vertices: &[[f32; 3]], faces: &[[u32; 3]]) -> Mesh {
    let used: BTreeSet<u32> = faces.iter().flatten().copied().collect();
    let index: BTreeMap<u32, u32> = used.iter().copied().zip(0..).collect();
    let places = used.iter().map(|&v| vertices[v as usize].map(|x| (x * 1e4).round() / 1e4)).collect();
    (places, faces.iter().map(|face| face.map(|v| index[&v])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit cube whose faces are n x n squares of two triangles each.
    fn cube(n: i32) -> (Vec<[f32; 3]>, Vec<[i32; 3]>) {
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for (axis, side) in [(0, 0.0), (0, 1.0), (1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0)] {
            let first = i32::try_from(vertices.len()).unwrap();
            for i in 0..=n {
                for j in 0..=n {
                    let mut v = [0.0; 3];
                    v[axis] = side;
                    v[(axis + 1) % 3] = i as f32 / n as f32;
                    v[(axis + 2) % 3] = j as f32 / n as f32;
                    vertices.push(v);
                }
            }
            for i in 0..n {
                for j in 0..n {
                    let at = |a: i32, b: i32| first + (i + a) * (n + 1) + j + b;
                    let (one, other) = ([at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]);
                    let turned = |f: [i32; 3]| if side > 0.5 { f } else { [f[0], f[2], f[1]] };
                    faces.extend([turned(one), turned(other)]);
                }
            }
        }
        (vertices, faces)
    }

    /// Volume by the divergence theorem; and the corners of a cube stay where they are.
    #[test]
    fn a_cube_stays_a_cube() {
        let (vertices, faces) = cube(20);
        let volume = |(v, f): &Mesh| {
            let triple = |[a, b, c]: [[f32; 3]; 3]| {
                a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                    + a[2] * (b[0] * c[1] - b[1] * c[0])
            };
            f.iter().map(|face| triple(face.map(|i| v[i as usize])) / 6.0).sum::<f32>()
        };
        let mesh = coarse(&vertices, &faces, 200);
        assert!(mesh.1.len() <= 200 && mesh.1.len() > 60, "{}", mesh.1.len());
        assert!((volume(&mesh) - 1.0).abs() < 0.01, "{}", volume(&mesh));
        for corner in [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]] {
            let near = |v: &[f32; 3]| (0..3).all(|i| (v[i] - corner[i] as f32).abs() < 0.01);
            assert!(mesh.0.iter().any(near), "{corner:?}");
        }
        assert_eq!(coarse(&vertices, &faces, 10_000).1.len(), faces.len());
    }
}
