//! Recorded poses, packed small for a page.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use stridemap_record::Recording;
use stridemap_robot::Shape;

/// What the page's script reads; see `assets/page/replay.js`.
#[derive(Debug, Serialize)]
pub(super) struct Packed<'a> {
    shapes: &'a [Shape],
    bodies: usize,
    /// Seconds between the frames kept.
    period: f64,
    /// Height of the robot at first, metres.
    size: f64,
    /// Metres per unit of `place`.
    scale: f64,
    /// Position of the first body: three little-endian `f32` per frame, base64.
    root: String,
    /// Position of each body less that of the first: three `i16` per body and frame.
    place: String,
    /// Orientation of each body, times 32767: four `i16` per body and frame.
    turn: String,
    /// Centre of pressure: two `f32` per frame, NaN in the air.
    cop: String,
    /// Loads of the left and right foot, newtons: two `i16` per frame.
    loads: String,
    /// Frames at which a section was crossed.
    crossings: Vec<usize>,
    /// Frame and force, newtons.
    pushes: Vec<(usize, f64, f64, f64)>,
    /// Of how many recorded frames one is kept.
    #[serde(skip)]
    pub(super) every: usize,
}

fn short(v: f64) -> i16 {
    // The cast saturates.
    v.round() as i16
}

fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// Packs a recording into at most about `budget` bytes of text, by keeping every n-th frame.
pub(super) fn pack(recording: &Recording, budget: usize) -> Packed<'_> {
    let bodies = recording.frames.first().map_or(0, |f| f.poses.len());
    let per_frame = (12 + 14 * bodies + 8 + 4) * 4 / 3;
    let every = (recording.frames.len() * per_frame).div_ceil(budget.max(1)).max(1);
    let kept: Vec<_> = recording.frames.iter().step_by(every).collect();
    let first = |f: &stridemap_record::Frame| f.poses.first().copied().unwrap_or([0.0; 7]);
    let reach = kept
        .iter()
        .flat_map(|f| {
            let root = first(f);
            f.poses.iter().flat_map(move |p| (0..3).map(move |c| (p[c] - root[c]).abs()))
        })
        .fold(1e-3, f64::max);
    let scale = reach / 32_767.0;
    let (mut root, mut place, mut turn) = (Vec::new(), Vec::new(), Vec::new());
    let (mut cop, mut loads) = (Vec::new(), Vec::new());
    for f in &kept {
        let origin = first(f);
        for c in &origin[..3] {
            root.extend((*c as f32).to_le_bytes());
        }
        for p in &f.poses {
            for c in 0..3 {
                place.extend(short((p[c] - origin[c]) / scale).to_le_bytes());
            }
            for q in &p[3..] {
                turn.extend(short(q * 32_767.0).to_le_bytes());
            }
        }
        for c in f.cop_m.unwrap_or([f64::NAN; 2]) {
            cop.extend((c as f32).to_le_bytes());
        }
        for l in f.loads_n {
            loads.extend(short(l).to_le_bytes());
        }
    }
    // A crossing or a push between two kept frames is shown at the earlier of them.
    let mut crossings = Vec::new();
    let mut pushes: Vec<(usize, f64, f64, f64)> = Vec::new();
    for (i, f) in recording.frames.iter().enumerate() {
        if f.crossing {
            crossings.push(i / every);
        }
        if let Some([x, y, z]) = f.push_n
            && pushes.last().is_none_or(|p| p.0 != i / every)
        {
            pushes.push((i / every, x, y, z));
        }
    }
    Packed {
        shapes: &recording.shapes,
        bodies,
        period: recording.period_s * every as f64,
        size: height(recording),
        scale,
        root: base64(&root),
        place: base64(&place),
        turn: base64(&turn),
        cop: base64(&cop),
        loads: base64(&loads),
        crossings,
        pushes,
        every,
    }
}

/// Height of the highest shape's far end in the first frame, whatever its orientation.
fn height(recording: &Recording) -> f64 {
    use stridemap_robot::ShapeKind;
    let Some(frame) = recording.frames.first() else {
        return 1.0;
    };
    recording
        .shapes
        .iter()
        .map(|s| {
            let reach = match s.kind {
                ShapeKind::Sphere { radius_m } => radius_m,
                ShapeKind::Capsule { radius_m, half_length_m } => radius_m + half_length_m,
                ShapeKind::Cylinder { half_length_m, .. } => half_length_m,
                ShapeKind::Ellipsoid { semi_axes_m: [_, _, z] } => z,
                ShapeKind::Box { half_extents_m: [_, _, z] } => z,
                ShapeKind::Mesh { ref vertices_m, .. } => {
                    vertices_m.iter().map(|v| f64::from(v[2])).fold(0.0, f64::max)
                }
            };
            frame.poses.get(s.body).map_or(0.0, |p| p[2]) + s.pose.position_m[2] + reach
        })
        .fold(0.1, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_record::Frame;

    fn recording(frames: usize) -> Recording {
        let frame = |i: usize| Frame {
            time_s: i as f64 * 0.02,
            poses: vec![[i as f64, 0.0, 0.8, 1.0, 0.0, 0.0, 0.0], [i as f64 + 0.25, 0.0, 0.3, 0.0, 1.0, 0.0, 0.0]],
            cop_m: None,
            loads_n: [0.0, 931.4],
            crossing: i == 5,
            push_n: (i == 4 || i == 5).then_some([0.0, 40.0, 0.0]),
        };
        Recording { format: 1, shapes: Vec::new(), period_s: 0.02, frames: (0..frames).map(frame).collect() }
    }

    #[test]
    fn packed_poses_come_back() {
        let recording = recording(8);
        let packed = pack(&recording, usize::MAX);
        let place = STANDARD.decode(&packed.place).unwrap();
        let at = |i: usize| f64::from(i16::from_le_bytes([place[2 * i], place[2 * i + 1]])) * packed.scale;
        // Second body of the first frame: (0.25, 0, -0.5) from the first.
        assert!((at(3) - 0.25).abs() < 1e-4 && (at(5) + 0.5).abs() < 1e-4);
        assert_eq!((packed.crossings.as_slice(), packed.pushes.len()), ([5].as_slice(), 2));
        let loads = STANDARD.decode(&packed.loads).unwrap();
        assert_eq!(i16::from_le_bytes([loads[2], loads[3]]), 931);
    }

    #[test]
    fn a_long_recording_is_thinned_and_keeps_its_crossings() {
        let recording = recording(1000);
        let packed = pack(&recording, 20_000);
        assert_eq!(packed.every, 4);
        assert!((packed.period - 0.08).abs() < 1e-12);
        assert_eq!(packed.crossings, [1]);
        assert!(
            packed.root.len() + packed.place.len() + packed.turn.len() + packed.cop.len() + packed.loads.len() < 21_000
        );
    }
}
