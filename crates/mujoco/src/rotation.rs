//! The few rotations that are needed: row-major 3 x 3 matrices and quaternions (w, x, y, z).

/// A vector of the body's frame, in the world.
pub(crate) fn to_world(rotation: &[f64; 9], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|row| rotation[3 * row] * v[0] + rotation[3 * row + 1] * v[1] + rotation[3 * row + 2] * v[2])
}

/// A vector of the world, in the body's frame.
pub(crate) fn to_body(rotation: &[f64; 9], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|col| rotation[col] * v[0] + rotation[3 + col] * v[1] + rotation[6 + col] * v[2])
}

/// The rotation `a` after the rotation `b`.
pub(crate) fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// The inverse of a unit quaternion.
pub(crate) fn inverse([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}

/// A vector turned by a unit quaternion.
pub(crate) fn turn(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let [_, x, y, z] = product(product(q, [0.0, v[0], v[1], v[2]]), inverse(q));
    [x, y, z]
}

/// The rotation by an angle about +y.
pub(crate) fn about_y(angle_rad: f64) -> [f64; 4] {
    let (sin, cos) = (0.5 * angle_rad).sin_cos();
    [cos, 0.0, sin, 0.0]
}

/// The rotation by an angle about +z.
pub(crate) fn about_z(angle_rad: f64) -> [f64; 4] {
    let (sin, cos) = (0.5 * angle_rad).sin_cos();
    [cos, 0.0, 0.0, sin]
}
