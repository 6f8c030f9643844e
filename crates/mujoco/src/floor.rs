//! What the robot stands on: a level floor under both feet.

use mujoco_rs::prelude::MjModel;
use mujoco_rs::wrappers::fun::utility::mju_ray_geom;
use mujoco_rs::wrappers::mj_model::MjtGeomBase;

use stridemap_robot::Side;

use crate::binding::{Binding, collides};
use crate::engine::Data;
use crate::error::MujocoError;
use crate::robot::MujocoRobot;

/// Where rays to the floor begin: above whatever a model may hold.
const RAY_FROM_M: f64 = 1000.0;
/// How much the floor's height may differ over the two footprints.
const LEVEL_M: f64 = 0.001;

/// Height of the floor under the feet.
///
/// `points` are the robot's soles in its rest posture, by side, in the world; `torso_m` is the height of the
/// robot's root in the model's reference posture. The floor is the highest thing under a point that is fixed to
/// the world, can touch the foot and lies below the torso: no wall beside the robot, no roof above it. (If
/// nothing lies below the torso, the lowest: some models leave the robot's start to a keyframe.)
///
/// # Errors
///
/// In words, if there is none under a foot or it is not level.
fn floor_height(
    model: &MjModel,
    data: &mut Data,
    binding: &Binding,
    points: &[Vec<[f64; 3]>; 2],
    torso_m: f64,
) -> Result<f64, String> {
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for (side, points) in points.iter().enumerate() {
        let floors: Vec<usize> = (0..model.ngeom() as usize)
            .filter(|&geom| binding.is_floor[geom])
            .filter(|&geom| {
                let of_foot = |foot: &usize| binding.foot_of_geom[*foot] == Some(side as u8);
                (0..model.ngeom() as usize).filter(of_foot).any(|foot| can_touch(model, foot, geom))
            })
            .collect();
        for &point in points {
            let below = |top: &f64| *top < torso_m;
            let tops: Vec<f64> = (floors.iter()).filter_map(|&geom| top(model, data, geom, point)).collect();
            let floor = (tops.iter().copied().filter(below).reduce(f64::max))
                .or_else(|| tops.iter().copied().reduce(f64::min))
                .ok_or_else(|| nothing_under(side, point, floors.is_empty()))?;
            lowest = lowest.min(floor);
            highest = highest.max(floor);
        }
    }
    if highest - lowest > LEVEL_M {
        return Err(format!(
            "the floor under the feet is not level: its height is {lowest:.4} to {highest:.4} m there; Stridemap \
             walks on level floors, so put one under the robot's start"
        ));
    }
    Ok(highest)
}

/// The error for a foot without a floor.
fn nothing_under(side: usize, [x, y, _]: [f64; 3], no_floor: bool) -> String {
    let foot = ["left", "right"][side];
    let found = if no_floor {
        format!("there is no floor that the {foot} foot can touch")
    } else {
        format!("there is no floor under the {foot} foot, at ({x:.2}, {y:.2}) m")
    };
    format!(
        "{found}: add <geom name=\"floor\" type=\"plane\" size=\"0 0 1\"/> to its <worldbody>, or name the scene \
         file that includes it"
    )
}

/// Height of a geom's top over a point of the ground plan; `None` where it is not.
fn top(model: &MjModel, data: &mut Data, geom: usize, [x, y, _]: [f64; 3]) -> Option<f64> {
    let (origin, frame) = (data.geom_xpos()[geom], data.geom_xmat()[geom]);
    let (from, down) = ([x, y, RAY_FROM_M], [0.0, 0.0, -1.0]);
    let distance = match model.geom_type()[geom] {
        // A plane is infinite, whatever the size of its picture.
        MjtGeomBase::mjGEOM_PLANE => {
            let normal = [frame[2], frame[5], frame[8]];
            let drop = (normal[0] * (x - origin[0]) + normal[1] * (y - origin[1])) / normal[2];
            return (normal[2] > 0.0).then_some(origin[2] - drop);
        }
        MjtGeomBase::mjGEOM_HFIELD => data.try_ray_hfield(geom, &from, &down, None).ok()?,
        MjtGeomBase::mjGEOM_MESH => data.try_ray_mesh(geom, &from, &down, None).ok()?,
        MjtGeomBase::mjGEOM_SDF => return None,
        kind => mju_ray_geom(&origin, &frame, &model.geom_size()[geom], &from, &down, kind, None),
    };
    (distance >= 0.0).then_some(RAY_FROM_M - distance)
}

/// Whether MuJoCo lets two geoms touch.
fn can_touch(model: &MjModel, one: usize, two: usize) -> bool {
    let pairs = model.pair_geom1().iter().zip(model.pair_geom2());
    let mut pairs = pairs.map(|(a, b)| (*a as usize, *b as usize));
    if pairs.any(|pair| pair == (one, two) || pair == (two, one)) {
        return true;
    }
    let (types, affinities) = (model.geom_contype(), model.geom_conaffinity());
    let bodies = [one, two].map(|geom| model.geom_bodyid()[geom]);
    let excluded = |[a, b]: [i32; 2]| model.exclude_signature().contains(&((a << 16) + b));
    collides(model, one)
        && (types[one] & affinities[two] != 0 || types[two] & affinities[one] != 0)
        && !excluded(bodies)
        && !excluded([bodies[1], bodies[0]])
}

impl MujocoRobot {
    /// Looks for the floor under the feet at rest; leaves the model's reference posture behind.
    pub(crate) fn find_floor(&mut self) -> Result<(), MujocoError> {
        let torso_m = self.data.qpos()[self.binding.root_qpos + 2];
        self.rest_on_floor();
        self.data.kinematics();
        let points = Side::BOTH.map(|side| {
            let sole = &self.soles[side.index()];
            let points = std::iter::once(&sole.centre_m).chain(&sole.corners_m);
            points.map(|&point| self.on_foot(side, point)).collect()
        });
        let (model, data) = (&self.model, &mut self.data);
        self.floor_m = floor_height(model, data, &self.binding, &points, torso_m)
            .map_err(|reason| MujocoError::NotABiped { model: self.config.model.to_string(), reason })?;
        self.hang();
        Ok(())
    }

    /// Takes the rest posture, standing; returns what [`stand`](Self::stand) does.
    pub(crate) fn rest_on_floor(&mut self) -> f64 {
        for axis in &self.binding.axes {
            self.data.qpos_mut()[axis.qpos] = axis.rest_rad;
        }
        self.stand()
    }

    /// Goes back to the model's reference posture.
    pub(crate) fn hang(&mut self) {
        self.data.reset();
        self.data.forward();
    }
}
