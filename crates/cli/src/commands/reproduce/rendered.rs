//! Strips as pictures by MuJoCo's renderer (feature `render`).

use std::path::Path;

use stridemap_mujoco::render::{Camera, Solid, render};
use stridemap_report::figures::{Shot, Solid as Drawn, TimeLapse, View, solids};
use stridemap_robot::ShapeKind as Kind;

use crate::failure::Failure;
use crate::output;

/// Size of a picture.
const SIZE_PX: [u32; 2] = [1800, 720];
/// Vertical angle of view: from afar, so that near and far robots are about as tall.
const VIEW_DEG: f64 = 12.0;
/// Distance between lanes, as a share of the robot's height.
const LANE: f64 = 0.55;

/// Renders each strip of a figure to `<stem>-<letter>-rendered.png`, with the camera that sees all strips
/// of all figures. Without EGL it says so and goes on.
pub fn write(dir: &Path, lapse: &TimeLapse, all: &[TimeLapse], shot: Shot) -> Result<(), Failure> {
    let height_m = all
        .iter()
        .flat_map(|l| &l.strips)
        .flat_map(|strip| solids(strip, shot, 0.0))
        .map(|s| s.pose.position_m[2] + reach(s.kind))
        .fold(0.0, f64::max);
    let lane_m = LANE * height_m;
    let everything: Vec<Drawn> =
        all.iter().flat_map(|l| &l.strips).flat_map(|strip| solids(strip, shot, lane_m)).collect();
    let camera = seeing(&everything, shot.view);
    for (index, strip) in lapse.strips.iter().enumerate() {
        let letter = char::from(b'a' + u8::try_from(index % 26).unwrap_or(0));
        let path = dir.join(format!("{}-{letter}-rendered.png", lapse.stem));
        let shapes: Vec<Solid> = solids(strip, shot, lane_m).into_iter().map(solid).collect();
        if let Err(error) = render(&shapes, camera, SIZE_PX, &path) {
            output::note(format!("{error} (rendering needs libEGL; figures are drawn without it)"));
            return Ok(());
        }
    }
    Ok(())
}

/// From a shape's centre to its farthest point, at most.
fn reach(kind: Kind) -> f64 {
    match kind {
        Kind::Sphere { radius_m } => radius_m,
        Kind::Capsule { radius_m, half_length_m } => radius_m + half_length_m,
        Kind::Cylinder { radius_m, half_length_m } => radius_m.hypot(half_length_m),
        Kind::Ellipsoid { semi_axes_m: [a, b, c] } => a.max(b).max(c),
        Kind::Box { half_extents_m: [a, b, c] } => (a * a + b * b + c * c).sqrt(),
    }
}

fn solid(s: Drawn) -> Solid {
    Solid { kind: s.kind, pose: s.pose, rgba: s.rgba }
}

/// The nearest camera in its direction that sees everything.
fn seeing(solids: &[Drawn], view: View) -> Camera {
    // From the robot's right, a little from ahead and above, so that later lanes lie to the right; or from
    // ahead, a little from its left.
    let away: [f64; 3] = match view {
        View::Side => [0.50, -0.84, 0.24],
        View::Front => [0.80, 0.55, 0.24],
    };
    let length = away.iter().map(|c| c * c).sum::<f64>().sqrt();
    let z = away.map(|c| c / length);
    let level = z[0].hypot(z[1]);
    let x = [-z[1] / level, z[0] / level, 0.0];
    let y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // The middle of what is seen, across and upward.
    let span = |axis: [f64; 3]| {
        solids.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], s| {
            let (at, r) = (dot(axis, s.pose.position_m), small_reach(s.kind));
            [lo.min(at - r), hi.max(at + r)]
        })
    };
    let middle = |[lo, hi]: [f64; 2]| 0.5 * (lo + hi);
    let (mx, my, mz) = (middle(span(x)), middle(span(y)), middle(span(z)));
    let target_m = [0, 1, 2].map(|i| mx * x[i] + my * y[i] + mz * z[i]);
    let tall = (0.5 * VIEW_DEG.to_radians()).tan();
    let wide = tall * f64::from(SIZE_PX[0]) / f64::from(SIZE_PX[1]);
    let distance = solids
        .iter()
        .map(|s| {
            let at = [0, 1, 2].map(|i| s.pose.position_m[i] - target_m[i]);
            let r = small_reach(s.kind);
            let across = (dot(x, at).abs() + r) / wide;
            let upward = (dot(y, at).abs() + r) / tall;
            across.max(upward) + dot(z, at)
        })
        .fold(0.1, f64::max);
    Camera { target_m, from_m: [0, 1, 2].map(|i| target_m[i] + 1.04 * distance * z[i]), view_deg: VIEW_DEG }
}

/// As [`reach`], but the line on the floor may leave the picture.
fn small_reach(kind: Kind) -> f64 {
    match kind {
        Kind::Box { half_extents_m: [_, _, c] } if c < 2e-3 => 0.0,
        other => reach(other),
    }
}
