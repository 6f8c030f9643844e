//! Where a robot's parts are, given its joint angles: a tree of rigid bodies.

use crate::error::RobotError;

type Vec3 = [f64; 3];
/// Unit quaternion (w, x, y, z).
type Quat = [f64; 4];

/// The hinge with which a body hangs from its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Position among the machine's joints.
    pub joint: usize,
    /// Unit vector of the axis, in the body's frame.
    pub axis: Vec3,
    /// A point of the axis, in the body's frame.
    pub anchor_m: Vec3,
}

/// One rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Its parent, an earlier entry; the first body is the base and its own parent.
    pub parent: usize,
    /// Origin in the parent's frame, with the joint at zero.
    pub position_m: Vec3,
    /// Orientation in the parent's frame, with the joint at zero.
    pub orientation: Quat,
    /// Mass.
    pub mass_kg: f64,
    /// Centre of mass in the body's frame.
    pub com_m: Vec3,
    /// How it hangs from its parent; `None` if it is fixed to it, and for the base.
    pub hinge: Option<Hinge>,
}

/// A point of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyPoint {
    /// The body.
    pub body: usize,
    /// The point in its frame.
    pub point_m: Vec3,
}

/// A robot as a tree of rigid bodies, with its two soles: what is needed to know where the centre of
/// mass and the feet are from joint angles alone. Pure arithmetic, no simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct KinematicModel {
    joints: usize,
    bodies: Vec<Body>,
    soles: [BodyPoint; 2],
    /// Upward normals of the soles in their bodies' frames: level with every joint at zero.
    up: [Vec3; 2],
}

/// Where things are for given joint angles, relative to the base's origin, in the world's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placement {
    /// Centre of mass of the whole robot.
    pub com_m: Vec3,
    /// Centres of the soles, left and right.
    pub soles_m: [Vec3; 2],
    /// Upward normals of the soles, which are level with every joint at zero and the base upright.
    pub soles_up: [Vec3; 2],
}

impl KinematicModel {
    /// A model of a machine with this number of joints.
    ///
    /// # Errors
    ///
    /// [`RobotError::Kinematics`] if there is no body or no mass, a parent does not come before its
    /// child, a joint does not exist, a sole is on no body, or a number is not finite.
    pub fn new(joints: usize, bodies: Vec<Body>, soles: [BodyPoint; 2]) -> Result<Self, RobotError> {
        let fault = |what| Err(RobotError::Kinematics { what });
        if bodies.is_empty() {
            return fault("no bodies");
        }
        let mass_kg: f64 = bodies.iter().map(|b| b.mass_kg).sum();
        if !(mass_kg.is_finite() && mass_kg > 0.0) {
            return fault("no mass");
        }
        for (i, body) in bodies.iter().enumerate() {
            if i > 0 && body.parent >= i {
                return fault("a parent that does not come before its child");
            }
            if body.hinge.is_some_and(|h| h.joint >= joints) {
                return fault("a joint that does not exist");
            }
            let numbers = body.position_m.iter().chain(&body.orientation);
            if !numbers.chain(&body.com_m).all(|v| v.is_finite()) {
                return fault("a number that is not finite");
            }
        }
        if soles.iter().any(|s| s.body >= bodies.len()) {
            return fault("a sole on no body");
        }
        let mut model = Self { joints, bodies, soles, up: [[0.0, 0.0, 1.0]; 2] };
        let frames = model.frames(&[], [1.0, 0.0, 0.0, 0.0]);
        model.up = soles.map(|sole| rotate(inverse(frames[sole.body].1), [0.0, 0.0, 1.0]));
        Ok(model)
    }

    /// Joints of the machine.
    #[must_use]
    pub const fn joints(&self) -> usize {
        self.joints
    }

    /// Total mass.
    #[must_use]
    pub fn mass_kg(&self) -> f64 {
        self.bodies.iter().map(|b| b.mass_kg).sum()
    }

    /// Where centre of mass and soles are, for angles in the machine's order and signs (missing ones
    /// count as zero) and an orientation of the base.
    ///
    /// # Example
    ///
    /// A base of 1 kg, a leg of 1 kg and 1 m that hangs down and is swung by 90 degrees about −y, so
    /// that it points forward:
    ///
    /// ```
    /// use stridemap_robot::{Body, BodyPoint, Hinge, KinematicModel};
    ///
    /// let fixed = [1.0, 0.0, 0.0, 0.0];
    /// let base = Body { parent: 0, position_m: [0.0; 3], orientation: fixed, mass_kg: 1.0, com_m: [0.0; 3], hinge: None };
    /// let leg = Body {
    ///     com_m: [0.0, 0.0, -0.5],
    ///     hinge: Some(Hinge { joint: 0, axis: [0.0, -1.0, 0.0], anchor_m: [0.0; 3] }),
    ///     ..base
    /// };
    /// let sole = BodyPoint { body: 1, point_m: [0.0, 0.0, -1.0] };
    /// let model = KinematicModel::new(1, vec![base, leg], [sole, sole])?;
    /// let placed = model.place(&[std::f64::consts::FRAC_PI_2], fixed);
    /// assert!((placed.soles_m[0][0] - 1.0).abs() < 1e-15 && placed.soles_m[0][2].abs() < 1e-15);
    /// assert!((placed.com_m[0] - 0.25).abs() < 1e-15);
    /// # Ok::<(), stridemap_robot::RobotError>(())
    /// ```
    #[must_use]
    pub fn place(&self, angles_rad: &[f64], base: Quat) -> Placement {
        let frames = self.frames(angles_rad, base);
        let (mut com, mut mass) = ([0.0; 3], 0.0);
        for (body, (origin, turned)) in self.bodies.iter().zip(&frames) {
            let centre = add(*origin, rotate(*turned, body.com_m));
            com = [0, 1, 2].map(|k| com[k] + body.mass_kg * centre[k]);
            mass += body.mass_kg;
        }
        Placement {
            com_m: com.map(|c| c / mass),
            soles_m: self.soles.map(|sole| {
                let (origin, turned) = frames[sole.body];
                add(origin, rotate(turned, sole.point_m))
            }),
            soles_up: [0, 1].map(|side| rotate(frames[self.soles[side].body].1, self.up[side])),
        }
    }

    /// Origin and orientation of every body.
    fn frames(&self, angles_rad: &[f64], base: Quat) -> Vec<(Vec3, Quat)> {
        let mut frames: Vec<(Vec3, Quat)> = Vec::with_capacity(self.bodies.len());
        for (i, body) in self.bodies.iter().enumerate() {
            if i == 0 {
                frames.push(([0.0; 3], normalized(base)));
                continue;
            }
            let (parent_origin, parent_turned) = frames[body.parent];
            let at = add(parent_origin, rotate(parent_turned, body.position_m));
            let rest = product(parent_turned, body.orientation);
            frames.push(match body.hinge {
                None => (at, rest),
                Some(h) => {
                    let angle = angles_rad.get(h.joint).copied().unwrap_or(0.0);
                    let turned = product(rest, about(h.axis, angle));
                    // The anchor stays where it is while the body turns about it.
                    let before = rotate(rest, h.anchor_m);
                    let after = rotate(turned, h.anchor_m);
                    (add(at, [0, 1, 2].map(|k| before[k] - after[k])), turned)
                }
            });
        }
        frames
    }
}

fn add(a: Vec3, b: Vec3) -> Vec3 {
    [0, 1, 2].map(|k| a[k] + b[k])
}

fn normalized(q: Quat) -> Quat {
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if norm > 0.0 { q.map(|v| v / norm) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// Hamilton product.
#[must_use]
pub fn product(a: Quat, b: Quat) -> Quat {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Quaternion of a turn about a unit axis.
#[must_use]
pub fn about(axis: Vec3, angle_rad: f64) -> Quat {
    let (sin, cos) = (0.5 * angle_rad).sin_cos();
    [cos, sin * axis[0], sin * axis[1], sin * axis[2]]
}

/// Quaternion of a rotation vector (axis times angle).
#[must_use]
pub fn of_rotation_vector(vector_rad: Vec3) -> Quat {
    let angle = vector_rad.iter().map(|v| v * v).sum::<f64>().sqrt();
    if angle > 0.0 { about(vector_rad.map(|v| v / angle), angle) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// The rotation vector (axis times angle, at most π) of a unit quaternion.
#[must_use]
pub fn rotation_vector(q: Quat) -> Vec3 {
    let [w, x, y, z] = if q[0] < 0.0 { q.map(|v| -v) } else { q };
    let sin = (x * x + y * y + z * z).sqrt();
    let scale = if sin > 1e-12 { 2.0 * sin.atan2(w) / sin } else { 2.0 };
    [x, y, z].map(|v| scale * v)
}

/// The inverse of a unit quaternion.
#[must_use]
pub fn inverse([w, x, y, z]: Quat) -> Quat {
    [w, -x, -y, -z]
}

/// A vector turned by a unit quaternion.
#[must_use]
pub fn rotate(q: Quat, v: Vec3) -> Vec3 {
    let [w, x, y, z] = q;
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + y * t[2] - z * t[1],
        v[1] + w * t[1] + z * t[0] - x * t[2],
        v[2] + w * t[2] + x * t[1] - y * t[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_on_the_axis_does_not_move() {
        let base = Body {
            parent: 0,
            position_m: [0.0; 3],
            orientation: [1.0, 0.0, 0.0, 0.0],
            mass_kg: 1.0,
            com_m: [0.0; 3],
            hinge: None,
        };
        let hinge = Hinge { joint: 0, axis: [0.0, 0.0, 1.0], anchor_m: [0.3, -0.2, 0.5] };
        let arm = Body { position_m: [1.0, 2.0, 3.0], hinge: Some(hinge), ..base };
        let sole = BodyPoint { body: 1, point_m: hinge.anchor_m };
        let model = KinematicModel::new(1, vec![base, arm], [sole, sole]).unwrap();
        for angle in [0.0, 0.4, -2.0] {
            let placed = model.place(&[angle], [1.0, 0.0, 0.0, 0.0]);
            for (found, expected) in placed.soles_m[0].iter().zip([1.3, 1.8, 3.5]) {
                assert!((found - expected).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn a_rotation_vector_turns_by_its_length_about_its_direction() {
        let q = of_rotation_vector([0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let [x, y, z] = rotate(q, [1.0, 0.0, 0.0]);
        assert!(x.abs() < 1e-15 && (y - 1.0).abs() < 1e-15 && z.abs() < 1e-15);
        for vector in [[0.3, -0.2, 1.1], [0.0; 3], [-3.0, 0.1, 0.2]] {
            let back = rotation_vector(of_rotation_vector(vector));
            assert!(back.iter().zip(vector).all(|(a, b)| (a - b).abs() < 1e-12));
        }
        let twice = rotate(product(q, q), [1.0, 0.0, 0.0]);
        assert!((twice[0] + 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_model_that_makes_no_sense_is_refused() {
        let sole = BodyPoint::default();
        assert!(KinematicModel::new(0, Vec::new(), [sole; 2]).is_err());
        let massless = Body {
            parent: 0,
            position_m: [0.0; 3],
            orientation: [1.0, 0.0, 0.0, 0.0],
            mass_kg: 0.0,
            com_m: [0.0; 3],
            hinge: None,
        };
        assert!(KinematicModel::new(0, vec![massless], [sole; 2]).is_err());
        let body = Body { mass_kg: 1.0, ..massless };
        let late = Body { parent: 1, ..body };
        assert!(KinematicModel::new(0, vec![body, late], [sole; 2]).is_err());
    }
}
