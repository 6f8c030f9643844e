//! A robot at one moment as flat outlines, as a camera far away sees it.
//!
//! ```text
//!   side: the robot walks to the right      front: the robot comes towards us
//!          up                                      up
//!          │                                       │
//!          └── ahead                               └── left
//! ```
//!
//! Lengths are metres in the frame of the start: its origin on the floor under the torso at the first
//! moment, its first axis along the torso's heading there, its last one upward.

use super::outline::{AROUND, balls, hull};
use stridemap_record::{Frame, Recording};
use stridemap_robot::kinematics::rotate;

/// From where a robot is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// From its right: it walks to the right of the picture.
    Side,
    /// From ahead: its left is on the right of the picture.
    Front,
}

/// How a piece is shaded: legs are told apart by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tone {
    /// On the robot's left: farther from a camera on its right.
    Far,
    /// In the middle.
    Middle,
    /// On the robot's right.
    Near,
}

impl Tone {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Far => "left",
            Self::Middle => "middle",
            Self::Near => "right",
        }
    }
}

/// A piece of a robot at a moment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) name: String,
    pub(crate) tone: Tone,
    /// Its centre: ahead, left, up.
    pub(crate) centre_m: [f64; 3],
    /// Convex outline in the picture: to the right, upward.
    pub(crate) outline_m: Vec<[f64; 2]>,
}

/// A robot at a moment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Silhouette {
    /// Robot time since the start.
    pub(crate) time_s: f64,
    /// The torso's way from the start: ahead, left.
    pub(crate) way_m: [f64; 2],
    /// Pieces, the farthest first.
    pub(crate) pieces: Vec<Piece>,
}

impl Silhouette {
    /// Least and greatest of a coordinate of the outlines: 0 to the right, 1 upward.
    pub(crate) fn extent_m(&self, axis: usize) -> [f64; 2] {
        let points = self.pieces.iter().flat_map(|p| &p.outline_m);
        points.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], p| [lo.min(p[axis]), hi.max(p[axis])])
    }

    /// Least and greatest to the right of what is near the floor: under 5 % of the robot's height.
    pub(crate) fn standing_m(&self) -> [f64; 2] {
        let [low, high] = self.extent_m(1);
        let near = low.max(0.0) + 0.05 * (high - low);
        let points = self.pieces.iter().flat_map(|p| &p.outline_m);
        points
            .filter(|p| p[1] <= near)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], p| [lo.min(p[0]), hi.max(p[0])])
    }

    /// The torso's way along the picture.
    pub(crate) fn along_m(&self, view: View) -> f64 {
        match view {
            View::Side => self.way_m[0],
            View::Front => self.way_m[1],
        }
    }
}

/// Shapes this near to the middle, as a share of the farthest to the side, belong to neither side.
const MIDDLE: f64 = 0.08;

/// A recording seen from one side.
pub(crate) struct Scene<'a> {
    recording: &'a Recording,
    view: View,
    /// The body that carries the largest shape: the torso.
    torso: usize,
    origin_m: [f64; 2],
    /// Cosine and sine of the heading at the start.
    heading: [f64; 2],
    tones: Vec<Tone>,
}

impl<'a> Scene<'a> {
    /// `None` for a recording without frames or shapes.
    pub(crate) fn new(recording: &'a Recording, view: View) -> Option<Self> {
        let first = recording.frames.first()?;
        let torso = recording.torso()?.body;
        let pose = *first.poses.get(torso)?;
        let [x, y, _] = rotate([pose[3], pose[4], pose[5], pose[6]], [1.0, 0.0, 0.0]);
        let yaw = y.atan2(x);
        // In the torso's own frame, because the robot may be swaying at the start.
        let own = [pose[3], -pose[4], -pose[5], -pose[6]];
        let lateral: Vec<f64> = recording
            .shapes
            .iter()
            .map(|s| {
                let p = first.point_m(s, [0.0; 3]).unwrap_or_default();
                rotate(own, [0, 1, 2].map(|i| p[i] - pose[i]))[1]
            })
            .collect();
        let widest = lateral.iter().fold(0.0, |most: f64, l| most.max(l.abs()));
        let tone = |l: &f64| match *l {
            l if l > MIDDLE * widest => Tone::Far,
            l if l < -MIDDLE * widest => Tone::Near,
            _ => Tone::Middle,
        };
        let scene = Self {
            recording,
            view,
            torso,
            origin_m: [pose[0], pose[1]],
            heading: [yaw.cos(), yaw.sin()],
            tones: lateral.iter().map(tone).collect(),
        };
        Some(scene)
    }

    /// A point of the world in the frame of the start: ahead, left, up.
    fn to_start(&self, p: [f64; 3]) -> [f64; 3] {
        let (dx, dy) = (p[0] - self.origin_m[0], p[1] - self.origin_m[1]);
        let [c, s] = self.heading;
        [c * dx + s * dy, c * dy - s * dx, p[2]]
    }

    fn in_picture(&self, p: [f64; 3]) -> [f64; 2] {
        match self.view {
            View::Side => [p[0], p[2]],
            View::Front => [p[1], p[2]],
        }
    }

    /// The frame nearest to a time since the first one; `None` beyond the end of the recording.
    fn frame_at(&self, time_s: f64) -> Option<&Frame> {
        let frames = &self.recording.frames;
        let start_s = frames.first()?.time_s;
        let last_s = frames.last()?.time_s - start_s;
        if time_s > last_s + 0.5 * self.recording.period_s {
            return None;
        }
        frames.iter().min_by(|a, b| {
            let off = |f: &Frame| (f.time_s - start_s - time_s).abs();
            off(a).total_cmp(&off(b))
        })
    }

    /// The robot at a time since the first frame; `None` beyond the end of the recording.
    pub(crate) fn at(&self, time_s: f64) -> Option<Silhouette> {
        let frame = self.frame_at(time_s)?;
        let start_s = self.recording.frames.first()?.time_s;
        let shapes = self.recording.shapes.iter().zip(&self.tones);
        let mut pieces: Vec<Piece> = shapes
            .enumerate()
            .map(|(i, (shape, tone))| {
                let (points, radius) = balls(&shape.kind);
                let place = |local_m| frame.point_m(shape, local_m).unwrap_or_default();
                let mut seen = Vec::new();
                for p in points {
                    let [u, v] = self.in_picture(self.to_start(place(p)));
                    if radius == 0.0 {
                        seen.push([u, v]);
                        continue;
                    }
                    for k in 0..AROUND {
                        let angle = 2.0 * std::f64::consts::PI * k as f64 / AROUND as f64;
                        seen.push([u + radius * angle.cos(), v + radius * angle.sin()]);
                    }
                }
                Piece {
                    name: if shape.name.is_empty() { format!("piece {i}") } else { shape.name.clone() },
                    tone: *tone,
                    centre_m: self.to_start(place([0.0; 3])),
                    outline_m: hull(seen),
                }
            })
            .collect();
        // Towards the camera: to the right of the robot, or ahead of it.
        let nearness = |p: &Piece| match self.view {
            View::Side => -p.centre_m[1],
            View::Front => p.centre_m[0],
        };
        pieces.sort_by(|a, b| nearness(a).total_cmp(&nearness(b)));
        let torso = frame.poses.get(self.torso)?;
        let way = self.to_start([torso[0], torso[1], torso[2]]);
        Some(Silhouette { time_s: frame.time_s - start_s, way_m: [way[0], way[1]], pieces })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_robot::{Pose, Shape, ShapeKind};

    fn shape(name: &str, body: usize, kind: ShapeKind, at: [f64; 3]) -> Shape {
        Shape {
            name: name.into(),
            body,
            kind,
            pose: Pose { position_m: at, orientation: [1.0, 0.0, 0.0, 0.0] },
            rgba: [1.0; 4],
        }
    }

    fn frame(time_s: f64, pose: [f64; 7]) -> Frame {
        Frame { time_s, poses: vec![[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], pose], ..Frame::default() }
    }

    /// A torso 1 m up with a foot on either side, 0.1 m to the side and 0.02 m thick, on the floor.
    /// It stands at (2, 3), looks along +y, and goes 0.5 m along +y in a second.
    fn recording() -> Recording {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let torso = ShapeKind::Box { half_extents_m: [0.1, 0.15, 0.3] };
        let foot = ShapeKind::Box { half_extents_m: [0.12, 0.05, 0.01] };
        Recording {
            format: 1,
            shapes: vec![
                shape("torso", 1, torso, [0.0; 3]),
                shape("left foot", 1, foot.clone(), [0.0, 0.1, -0.99]),
                shape("right foot", 1, foot, [0.0, -0.1, -0.99]),
            ],
            period_s: 0.5,
            frames: [0.0, 0.5, 1.0]
                .iter()
                .map(|t| frame(7.0 + t, [2.0, 3.0 + 0.5 * t, 1.0, half, 0.0, 0.0, half]))
                .collect(),
        }
    }

    #[test]
    fn feet_stand_on_the_floor_and_the_way_is_what_was_recorded() {
        let recording = recording();
        let scene = Scene::new(&recording, View::Side).unwrap();
        let (first, last) = (scene.at(0.0).unwrap(), scene.at(1.0).unwrap());
        assert!(first.extent_m(1)[0].abs() < 1e-12, "the soles are at 0");
        assert!((first.extent_m(1)[1] - 1.3).abs() < 1e-12);
        let way = last.extent_m(0)[0] - first.extent_m(0)[0];
        assert!((way - 0.5).abs() < 1e-12 && (last.way_m[0] - 0.5).abs() < 1e-12);
        assert!(last.way_m[1].abs() < 1e-12 && (last.time_s - 1.0).abs() < 1e-12);
        // A foot of 0.24 m about its centre.
        assert!((first.extent_m(0)[1] - 0.12).abs() < 1e-12);
        assert!(scene.at(1.6).is_none(), "beyond the recording");
    }

    #[test]
    fn the_left_foot_is_behind_in_the_side_view_and_on_the_right_in_the_front_view() {
        let recording = recording();
        let side = Scene::new(&recording, View::Side).unwrap().at(0.0).unwrap();
        let names: Vec<_> = side.pieces.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["left foot", "torso", "right foot"]);
        let tones: Vec<_> = side.pieces.iter().map(|p| p.tone).collect();
        assert_eq!(tones, [Tone::Far, Tone::Middle, Tone::Near]);
        let front = Scene::new(&recording, View::Front).unwrap().at(1.0).unwrap();
        let left = front.pieces.iter().find(|p| p.name == "left foot").unwrap();
        let reach = left.outline_m.iter().map(|p| p[0]).fold(0.0, f64::max);
        assert!((reach - 0.15).abs() < 1e-12);
        assert!(front.along_m(View::Front).abs() < 1e-12, "walking on is not seen");
    }

    #[test]
    fn outlines_of_round_shapes_have_their_radius() {
        for kind in [ShapeKind::Sphere { radius_m: 0.1 }, ShapeKind::Ellipsoid { semi_axes_m: [0.1; 3] }] {
            let mut r = recording();
            r.shapes.push(shape("ball", 0, kind, [2.0, 3.0, 2.0]));
            let seen = Scene::new(&r, View::Side).unwrap().at(0.0).unwrap();
            let ball = seen.pieces.iter().find(|p| p.name == "ball").unwrap();
            for p in &ball.outline_m {
                assert!((p[0].hypot(p[1] - 2.0) - 0.1).abs() < 1e-9);
            }
            assert!(ball.outline_m.len() >= AROUND / 2);
        }
    }

    #[test]
    fn a_capsule_is_as_long_as_its_cylinder_and_two_radii() {
        let mut r = recording();
        let capsule = ShapeKind::Capsule { radius_m: 0.05, half_length_m: 0.2 };
        r.shapes = vec![shape("limb", 1, capsule, [0.0; 3])];
        let seen = Scene::new(&r, View::Side).unwrap().at(0.0).unwrap();
        let [low, high] = seen.extent_m(1);
        assert!((high - low - 0.5).abs() < 1e-12);
        let [left, right] = seen.extent_m(0);
        assert!((right - left - 0.1).abs() < 1e-12);
    }
}
