//! Strips as shapes in space, for a renderer.

use super::outline::turn;
use super::silhouette::Scene;
use super::{Shot, Strip, View};
use stridemap_robot::{Pose, ShapeKind};

/// A shape in the frame of the start: metres ahead, to the left, above the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Form and size.
    pub kind: ShapeKind,
    /// Where it is.
    pub pose: Pose,
    /// Red, green, blue, opacity, each in `[0, 1]`.
    pub rgba: [f32; 4],
}

/// Product of two rotations.
fn product([aw, ax, ay, az]: [f64; 4], [bw, bx, by, bz]: [f64; 4]) -> [f64; 4] {
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

/// The robot of a strip at its moments, each moment in a lane of its own `lane_m` behind the one before,
/// with the line of the start across all lanes.
///
/// In the side view lanes lie to the robot's left of one another, in the front view behind it. Empty for a
/// recording without poses.
#[must_use]
pub fn solids(strip: &Strip, shot: Shot, lane_m: f64) -> Vec<Solid> {
    let Some(scene) = Scene::new(&strip.recording, shot.view) else {
        return Vec::new();
    };
    let shift = |lane: f64| match shot.view {
        View::Side => [0.0, lane * lane_m, 0.0],
        View::Front => [-lane * lane_m, 0.0, 0.0],
    };
    let [cos, sin] = scene.heading;
    // Half the angle of the heading, turned back.
    let yaw = 0.5 * sin.atan2(cos);
    let back = [yaw.cos(), 0.0, 0.0, -yaw.sin()];
    let mut out = Vec::new();
    for moment in 0..shot.moments {
        let Some(frame) = scene.frame_at(moment as f64 * shot.interval_s) else {
            break;
        };
        let by = shift(moment as f64);
        for shape in &strip.recording.shapes {
            let Some(&[x, y, z, w, qx, qy, qz]) = frame.poses.get(shape.body) else {
                continue;
            };
            let orientation = [w, qx, qy, qz];
            let arm = turn(orientation, shape.pose.position_m);
            let at = scene.to_start([x + arm[0], y + arm[1], z + arm[2]]);
            out.push(Solid {
                kind: shape.kind,
                pose: Pose {
                    position_m: [0, 1, 2].map(|i| at[i] + by[i]),
                    orientation: product(back, product(orientation, shape.pose.orientation)),
                },
                rgba: shape.rgba,
            });
        }
    }
    let half = 0.5 * lane_m * shot.moments as f64;
    let middle = shift(0.5 * (shot.moments as f64 - 1.0));
    let thin = 0.03 * lane_m;
    out.push(Solid {
        kind: ShapeKind::Box {
            half_extents_m: match shot.view {
                View::Side => [thin, half, 0.001],
                View::Front => [half, thin, 0.001],
            },
        },
        pose: Pose { position_m: [middle[0], middle[1], 0.001], orientation: [1.0, 0.0, 0.0, 0.0] },
        rgba: [0.835, 0.369, 0.0, 1.0],
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_record::{Frame, Recording};
    use stridemap_robot::Shape;

    /// A ball that starts at (2, 3) looking along +y and goes 1 m along +y: in the frame of the start it
    /// goes 1 m ahead, and its lane is to the left.
    #[test]
    fn solids_stand_in_the_frame_of_the_start_and_in_their_lanes() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let frame = |t: f64| Frame {
            time_s: t,
            poses: vec![[2.0, 3.0 + t, 0.5, half, 0.0, 0.0, half]],
            cop_m: None,
            loads_n: [0.0; 2],
            crossing: false,
            push_n: None,
        };
        let strip = Strip {
            name: "ball".into(),
            speed_m_s: None,
            note: String::new(),
            recording: Recording {
                format: 1,
                shapes: vec![Shape {
                    name: "ball".into(),
                    body: 0,
                    kind: ShapeKind::Sphere { radius_m: 0.1 },
                    pose: Pose { position_m: [0.2, 0.0, 0.0], orientation: [1.0, 0.0, 0.0, 0.0] },
                    rgba: [1.0; 4],
                }],
                period_s: 1.0,
                frames: vec![frame(0.0), frame(1.0)],
            },
        };
        let shot = Shot { view: View::Side, interval_s: 1.0, moments: 2 };
        let solids = solids(&strip, shot, 0.8);
        assert_eq!(solids.len(), 3, "two moments and the line");
        let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-12);
        assert!(near(solids[0].pose.position_m, [0.2, 0.0, 0.5]));
        assert!(near(solids[1].pose.position_m, [1.2, 0.8, 0.5]));
        assert!((solids[1].pose.orientation[0] - 1.0).abs() < 1e-12, "looks ahead");
    }
}
