//! The changes of a robot, made to its model.

use std::collections::BTreeMap;

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::mj_model::{MjtObjBase, MjtSameFrame};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_robot::Side;

use crate::changes::{ChangesConfig, STREAM};
use crate::engine::{name_of, own_bodies};
use crate::error::{MujocoError, nearest};
use crate::rotation::{inverse, product, turn};

/// Where the parts of a robot are in its model.
pub(crate) struct Parts {
    /// Root body.
    pub torso: usize,
    /// Foot bodies by side.
    pub feet: [usize; 2],
    /// Its joints, in the robot's order.
    pub joints: Vec<usize>,
}

impl ChangesConfig {
    /// Puts the payload on its body.
    pub(crate) fn load(&self, model: &mut MjModel, parts: &Parts) -> Result<(), MujocoError> {
        let Some(mass_kg) = self.payload_kg.filter(|kg| *kg > 0.0) else { return Ok(()) };
        let bodies = own_bodies(model, parts.torso);
        let body = match &self.payload_body {
            Some(name) => model.name_to_id(MjtObjBase::mjOBJ_BODY, name).ok_or_else(|| {
                let names: Vec<String> = bodies.iter().map(|&b| name_of(model, MjtObjBase::mjOBJ_BODY, b)).collect();
                MujocoError::NoSuchName {
                    field: "changes.payload_body".into(),
                    what: "body",
                    name: name.clone(),
                    near: nearest(name, names.iter().map(String::as_str)),
                }
            })?,
            None => {
                let mass = |body: &usize| model.body_mass()[*body];
                bodies.into_iter().max_by(|a, b| mass(a).total_cmp(&mass(b))).unwrap_or(parts.torso)
            }
        };
        add_point(model, body, mass_kg, self.payload_offset_m.unwrap_or_default());
        Ok(())
    }

    /// Factors on the gains of every joint: by leg and by name.
    pub(crate) fn gain_factors(&self, model: &MjModel, parts: &Parts) -> Result<Vec<f64>, MujocoError> {
        let legs = [(Side::Left, self.gain_left), (Side::Right, self.gain_right)];
        known(&self.gains, "changes.gains", model, parts)?;
        Ok((parts.joints.iter())
            .map(|&joint| {
                let body = model.jnt_bodyid()[joint] as usize;
                let of_legs = legs.iter().filter(|(side, _)| carries(model, body, parts.feet[side.index()]));
                let leg: f64 = of_legs.filter(|_| body != parts.torso).filter_map(|(_, gain)| *gain).product();
                leg * self.gains.get(&name_of(model, MjtObjBase::mjOBJ_JOINT, joint)).copied().unwrap_or(1.0)
            })
            .collect())
    }

    /// What each joint's encoder tells beyond its angle.
    pub(crate) fn offsets(&self, model: &MjModel, parts: &Parts) -> Result<Vec<f64>, MujocoError> {
        known(&self.joint_offset_rad, "changes.joint_offset_rad", model, parts)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.individual.unwrap_or(0));
        rng.set_stream(STREAM + 1);
        let sd = self.joint_offset_sd_rad.unwrap_or(0.0);
        Ok((parts.joints.iter())
            .map(|&joint| {
                let drawn: f64 = StandardNormal.sample(&mut rng);
                let name = name_of(model, MjtObjBase::mjOBJ_JOINT, joint);
                self.joint_offset_rad.get(&name).copied().unwrap_or(sd * drawn)
            })
            .collect())
    }
}

/// Refuses a table with a joint that the robot lacks.
fn known(table: &BTreeMap<String, f64>, field: &str, model: &MjModel, parts: &Parts) -> Result<(), MujocoError> {
    let names: Vec<String> = parts.joints.iter().map(|&joint| name_of(model, MjtObjBase::mjOBJ_JOINT, joint)).collect();
    match table.keys().find(|name| !names.contains(name)) {
        None => Ok(()),
        Some(name) => Err(MujocoError::NoSuchName {
            field: format!("{field}.{name:?}"),
            what: "joint",
            name: name.clone(),
            near: nearest(name, names.iter().map(String::as_str)),
        }),
    }
}

/// Whether a foot hangs from a body.
fn carries(model: &MjModel, body: usize, foot: usize) -> bool {
    let mut at = foot;
    while at != 0 {
        if at == body {
            return true;
        }
        at = model.body_parentid()[at] as usize;
    }
    false
}

/// Adds a point mass to a body: mass, centre and principal moments of both together.
fn add_point(model: &mut MjModel, body: usize, mass_kg: f64, at_m: [f64; 3]) {
    let (own, centre, axes) = (model.body_mass()[body], model.body_ipos()[body], model.body_iquat()[body]);
    let total = own + mass_kg;
    let middle = [0, 1, 2].map(|i| (own * centre[i] + mass_kg * at_m[i]) / total);
    // The tensor about the common centre, in the body's frame.
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| turn(axes, e));
    let moments = model.body_inertia()[body];
    let mut tensor = [[0.0; 3]; 3];
    for (i, row) in tensor.iter_mut().enumerate() {
        for (j, entry) in row.iter_mut().enumerate() {
            *entry = (0..3).map(|k| columns[k][i] * moments[k] * columns[k][j]).sum();
        }
    }
    for (mass, point) in [(own, centre), (mass_kg, at_m)] {
        let d = [0, 1, 2].map(|i| point[i] - middle[i]);
        let square: f64 = d.iter().map(|x| x * x).sum();
        for i in 0..3 {
            for j in 0..3 {
                tensor[i][j] += mass * (if i == j { square } else { 0.0 } - d[i] * d[j]);
            }
        }
    }
    let (moments, turned) = principal(tensor);
    model.body_mass_mut()[body] = total;
    model.body_ipos_mut()[body] = middle;
    model.body_iquat_mut()[body] = turned;
    model.body_inertia_mut()[body] = moments;
    free_frames(model, body);
}

/// Shortcuts for frames that coincide no longer hold once a body's centre of mass has moved: a geom must not move with it.
pub(crate) fn free_frames(model: &mut MjModel, body: usize) {
    model.body_sameframe_mut()[body] = MjtSameFrame::mjSAMEFRAME_NONE;
    let on_body = |bodies: &[i32]| -> Vec<bool> { bodies.iter().map(|&b| b as usize == body).collect() };
    let geoms = on_body(model.geom_bodyid());
    for (frame, _) in (model.geom_sameframe_mut().iter_mut().zip(geoms)).filter(|(_, own)| *own) {
        *frame = MjtSameFrame::mjSAMEFRAME_NONE;
    }
    let sites = on_body(model.site_bodyid());
    for (frame, _) in (model.site_sameframe_mut().iter_mut().zip(sites)).filter(|(_, own)| *own) {
        *frame = MjtSameFrame::mjSAMEFRAME_NONE;
    }
}

/// Principal moments of a symmetric tensor, and the rotation to their axes, by Jacobi's rotations.
fn principal(mut tensor: [[f64; 3]; 3]) -> ([f64; 3], [f64; 4]) {
    let mut turned = [1.0, 0.0, 0.0, 0.0];
    for _ in 0..20 {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            if tensor[i][j].abs() < 1e-15 {
                continue;
            }
            let angle = 0.5 * (2.0 * tensor[i][j]).atan2(tensor[i][i] - tensor[j][j]);
            let (sin, cos) = angle.sin_cos();
            // New axes: e_i' = cos e_i + sin e_j, e_j' = −sin e_i + cos e_j.
            for row in &mut tensor {
                (row[i], row[j]) = (cos * row[i] + sin * row[j], cos * row[j] - sin * row[i]);
            }
            let (a, b) = (tensor[i], tensor[j]);
            for k in 0..3 {
                tensor[i][k] = cos * a[k] + sin * b[k];
                tensor[j][k] = cos * b[k] - sin * a[k];
            }
            // From i to j is a turn about the third axis, against it for (x, z).
            let sign = if (i, j) == (0, 2) { -1.0 } else { 1.0 };
            let (half_sin, half_cos) = (0.5 * sign * angle).sin_cos();
            let mut step = [half_cos, 0.0, 0.0, 0.0];
            step[1 + (3 - i - j)] = half_sin;
            turned = product(turned, step);
        }
    }
    ([tensor[0][0], tensor[1][1], tensor[2][2]], turned)
}

/// The rotation of an inertial unit that is pitched forward and rolled to the right on the base.
pub(crate) fn mount(pitch_rad: f64, roll_rad: f64) -> [f64; 4] {
    let about = |axis: usize, angle: f64| {
        let (sin, cos) = (0.5 * angle).sin_cos();
        let mut q = [cos, 0.0, 0.0, 0.0];
        q[axis] = sin;
        q
    };
    product(about(2, pitch_rad), about(1, roll_rad))
}

/// A vector of the base as a unit in this mount sees it.
pub(crate) fn seen_from(mount: [f64; 4], vector: [f64; 3]) -> [f64; 3] {
    turn(inverse(mount), vector)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Trace, determinant and the tensor itself come back from moments and axes.
    #[test]
    fn principal_axes_give_the_tensor_back() {
        let tensor = [[2.0, 0.3, -0.4], [0.3, 1.5, 0.2], [-0.4, 0.2, 1.0]];
        let (moments, q) = principal(tensor);
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| turn(q, e));
        for i in 0..3 {
            for j in 0..3 {
                let back: f64 = (0..3).map(|k| columns[k][i] * moments[k] * columns[k][j]).sum();
                assert!((back - tensor[i][j]).abs() < 1e-12, "{i} {j} {back}");
            }
        }
    }

    #[test]
    fn a_unit_that_is_pitched_forward_sees_gravity_ahead() {
        let seen = seen_from(mount(0.05, 0.0), [0.0, 0.0, -1.0]);
        assert!((seen[0] - 0.05_f64.sin()).abs() < 1e-12 && seen[1].abs() < 1e-12);
    }
}
