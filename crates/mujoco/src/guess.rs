//! The joint map of a model that nobody mapped, from its kinematics: chains from the floating base to two feet, axes in the
//! reference posture.

use std::path::Path;

use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_model::{MjtJoint, MjtObjBase};
use stridemap_robot::{LegJoint, Side};

use crate::binding::collides;
use crate::config::{LegMap, Missing, ModelSource, MujocoConfig};
use crate::engine::{allocation, name_of, own_bodies};
use crate::error::MujocoError;
use crate::foreign::is_urdf;
use crate::store::load;

/// Hinges of the shortest leg: hip roll and pitch, knee, ankle.
const FEWEST_HINGES: usize = 4;
/// Cosine between an axis and what its name says beyond which there is no doubt.
const CERTAIN: f64 = 0.9;
/// Feet whose middle is nearer to below their ankles do not show where is ahead.
const UNCLEAR_M: f64 = 0.01;
/// Share of roll in an axis below the knee from which it can take the ankle's part.
const SOME_ROLL: f64 = 0.3;
/// Most seconds of physics in one step with which feet still land softly.
const LONGEST_STEP_S: f64 = 0.002;

/// One joint of a guessed map.
#[derive(Clone, Debug, PartialEq)]
pub struct GuessedJoint {
    /// Its leg.
    pub side: Side,
    /// Its role.
    pub joint: LegJoint,
    /// Its name in the model, with a minus where the sign is the other way round.
    pub name: String,
    /// Cosine between its axis and that of its role: 1 is certain.
    pub certainty: f64,
}

impl GuessedJoint {
    /// How far its axis is from that of its role, in degrees, if that is far enough to look at.
    #[must_use]
    pub fn doubt_deg(&self) -> Option<f64> {
        (self.certainty < CERTAIN).then(|| self.certainty.acos().to_degrees())
    }
}

/// What was found of a biped in a model.
#[derive(Clone, Debug)]
pub struct Guess {
    /// The robot: model, legs, heading, what is missing, periods.
    pub config: MujocoConfig,
    /// Every joint of the map.
    pub joints: Vec<GuessedJoint>,
    /// What a user should look at, or should know.
    pub notes: Vec<String>,
    /// Whether names and feet agree on which leg is the left one.
    pub sides_agree: bool,
    /// Names of the model's keyframes.
    pub keyframes: Vec<String>,
}

impl Guess {
    /// Whether nothing is in doubt.
    #[must_use]
    pub fn is_certain(&self) -> bool {
        self.sides_agree && self.joints.iter().all(|joint| joint.doubt_deg().is_none())
    }
}

/// One leg: its hinges from the hip to the foot, which the other leg does not share.
struct Chain {
    hinges: Vec<usize>,
    roles: Vec<(LegJoint, usize, f64, f64)>,
    foot: usize,
}

/// Guesses the joint map of a biped.
///
/// # Errors
///
/// [`MujocoError::Load`] for a model that cannot be read; [`MujocoError::NotABiped`] with what was found where no two legs
/// are.
pub fn guess(model: &Path) -> Result<Guess, MujocoError> {
    let source = ModelSource::File(model.to_path_buf());
    let (add, mut notes) = missing(&source, model)?;
    let model = load(&source, &add)?;
    let mut data = MjData::try_new(std::sync::Arc::clone(&model)).map_err(allocation)?;
    data.forward();
    let refused = |reason: String| MujocoError::NotABiped { model: source.to_string(), reason };
    let root = root(&model).ok_or_else(|| refused("it has no body with a free joint and hinges below it".into()))?;
    let [one, other] = legs(&model, &data, root).map_err(&refused)?;
    let (left_first, certain_side) = left_first(&model, &data, &one, &other);
    if !certain_side {
        notes.push("names and shape of the feet do not agree on which leg is the left one: look at a picture".into());
    }
    let chains = if left_first { [one, other] } else { [other, one] };
    let [left, right] = [&chains[0], &chains[1]].map(|chain| data.xanchor()[chain.hinges[0]]);
    let across = [left[0] - right[0], left[1] - right[1]];
    let heading = (-across[0]).atan2(across[1]);
    let mut joints = Vec::new();
    let mut maps = Vec::new();
    for (side, mut chain) in Side::BOTH.into_iter().zip(chains) {
        assign(&model, &data, &mut chain, heading);
        let name = |joint: usize| name_of(&model, MjtObjBase::mjOBJ_JOINT, joint);
        let mut map = LegMap { foot: name_of(&model, MjtObjBase::mjOBJ_BODY, chain.foot), ..no_joints() };
        for &(role, joint, sign, certainty) in &chain.roles {
            let text = format!("{}{}", if sign < 0.0 { "-" } else { "" }, name(joint));
            *map.joint_mut(role) = Some(text.clone());
            joints.push(GuessedJoint { side, joint: role, name: text, certainty });
        }
        let unused: Vec<String> = (chain.hinges.iter())
            .filter(|hinge| chain.roles.iter().all(|role| role.1 != **hinge))
            .map(|&hinge| name(hinge))
            .collect();
        if !unused.is_empty() {
            notes.push(format!("{} leg: held at rest, in no role: {}", side.name(), unused.join(", ")));
        }
        maps.push(map);
    }
    for joint in [LegJoint::HipRoll, LegJoint::HipPitch, LegJoint::Knee, LegJoint::AnklePitch] {
        if let Some(side) = Side::BOTH.into_iter().find(|side| maps[side.index()].joint(joint).is_none()) {
            let found: Vec<String> =
                joints.iter().map(|j| format!("{} {} = {}", j.side.name(), j.joint.name(), j.name)).collect();
            return Err(refused(format!(
                "no {} found in the {} leg; found were {}; write the map yourself if it has one",
                joint.name(),
                side.name(),
                found.join(", ")
            )));
        }
    }
    let time_step_s = model.opt().timestep;
    let motors = joints.iter().any(|joint| {
        let id = model.name_to_id(MjtObjBase::mjOBJ_JOINT, joint.name.trim_start_matches('-'));
        id.is_some_and(|id| !matches!(crate::actuators::drive(&model, id), Ok((crate::axis::Drive::Servo { .. }, _))))
    });
    // Our own PD laws are explicit: they need the shorter step.
    let longest_s = if motors { 0.5 * LONGEST_STEP_S } else { LONGEST_STEP_S };
    let divides = |step: f64| ((LONGEST_STEP_S / step).round() * step - LONGEST_STEP_S).abs() < 1e-9;
    let own_step_s = (time_step_s > longest_s * (1.0 + 1e-9) || !divides(time_step_s)).then_some(longest_s);
    if let Some(step_s) = own_step_s {
        notes.push(format!("the model's time step of {time_step_s} s is replaced by {step_s} s"));
    }
    let heading_deg = (heading.abs() > 0.35).then(|| {
        let deg = heading.to_degrees();
        let right_angle = (deg / 90.0).round() * 90.0;
        if (deg - right_angle).abs() < 3.0 { right_angle } else { (deg * 10.0).round() / 10.0 }
    });
    let mut maps = maps.into_iter();
    let (Some(left), Some(right)) = (maps.next(), maps.next()) else {
        return Err(refused("it has no two legs".into()));
    };
    Ok(Guess {
        config: MujocoConfig {
            body_contacts: !is_urdf(Path::new(&source.to_string())),
            model: source,
            left,
            right,
            heading_deg,
            add,
            time_step_s: own_step_s,
            ..MujocoConfig::default()
        },
        joints,
        notes,
        sides_agree: certain_side,
        keyframes: (0..model.nkey() as usize)
            .filter_map(|key| model.id_to_name(MjtObjBase::mjOBJ_KEY, key))
            .filter(|name| !name.is_empty())
            .map(str::to_owned)
            .collect(),
    })
}

/// What a model lacks, and a word on each.
fn missing(source: &ModelSource, model: &Path) -> Result<(Vec<Missing>, Vec<String>), MujocoError> {
    if is_urdf(model) {
        let note = "a URDF: free joint, floor and servos added, contact meshes replaced by their boxes";
        return Ok((Vec::new(), vec![note.into()]));
    }
    let (mut add, mut notes) = (Vec::new(), Vec::new());
    let bare = load(source, &[])?;
    if (0..bare.njnt() as usize).all(|j| bare.jnt_type()[j] != MjtJoint::mjJNT_FREE) {
        add.push(Missing::FreeJoint);
        notes.push("no free joint in the model: one is added to its largest tree".into());
    }
    let fixed = |geom: &usize| bare.body_weldid()[bare.geom_bodyid()[*geom] as usize] == 0;
    if !(0..bare.ngeom() as usize).any(|geom| fixed(&geom) && collides(&bare, geom)) {
        add.push(Missing::Floor);
        notes.push("no floor in the model: a plane at z = 0 is added".into());
    }
    Ok((add, notes))
}

fn no_joints() -> LegMap {
    LegMap {
        hip_yaw: None,
        hip_roll: None,
        hip_pitch: None,
        knee: None,
        ankle_pitch: None,
        ankle_roll: None,
        foot: String::new(),
    }
}

/// The body with a free joint below which there are most hinges.
fn root(model: &MjModel) -> Option<usize> {
    let free = (0..model.njnt() as usize).filter(|&j| model.jnt_type()[j] == MjtJoint::mjJNT_FREE);
    let hinges = |body: &usize| {
        let own = own_bodies(model, *body);
        let hinge = |&j: &usize| {
            model.jnt_type()[j] == MjtJoint::mjJNT_HINGE && own.contains(&(model.jnt_bodyid()[j] as usize))
        };
        (0..model.njnt() as usize).filter(hinge).count()
    };
    let bodies = free.map(|j| model.jnt_bodyid()[j] as usize).filter(|body| model.body_parentid()[*body] == 0);
    bodies.map(|body| (hinges(&body), body)).filter(|(count, _)| *count > 0).max().map(|(_, body)| body)
}

/// The hinges from the root to a body.
fn hinges_to(model: &MjModel, root: usize, body: usize) -> Vec<usize> {
    let mut bodies = vec![body];
    while let Some(&last) = bodies.last() {
        if last == root || last == 0 {
            break;
        }
        bodies.push(model.body_parentid()[last] as usize);
    }
    let of = |body: &usize| {
        let first = usize::try_from(model.body_jntadr()[*body]).unwrap_or(0);
        first..first + model.body_jntnum()[*body] as usize
    };
    let joints = bodies.iter().rev().flat_map(of);
    joints.filter(|&j| model.jnt_type()[j] == MjtJoint::mjJNT_HINGE).collect()
}

/// The two longest disjoint chains that end lowest.
fn legs(model: &MjModel, data: &MjData<std::sync::Arc<MjModel>>, root: usize) -> Result<[Chain; 2], String> {
    let own = own_bodies(model, root);
    let is_leaf =
        |body: &&usize| !own.iter().any(|&child| child != **body && model.body_parentid()[child] as usize == **body);
    let mut ends: Vec<(f64, Vec<usize>)> = (own.iter().filter(is_leaf))
        .map(|&body| (data.xpos()[body][2], hinges_to(model, root, body)))
        .filter(|(_, hinges)| hinges.len() >= FEWEST_HINGES)
        .collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.len().cmp(&a.1.len())));
    let names = |hinges: &[usize]| {
        let names: Vec<String> = hinges.iter().map(|&j| name_of(model, MjtObjBase::mjOBJ_JOINT, j)).collect();
        names.join(" > ")
    };
    let found = || match ends.as_slice() {
        [] => "it has no chain of four hinges or more from its base".to_owned(),
        _ => format!("its chains of hinges are {}", ends.iter().map(|(_, h)| names(h)).collect::<Vec<_>>().join("; ")),
    };
    let Some((lowest_m, first)) = ends.first() else { return Err(found()) };
    let height_m = data.subtree_com()[root][2] - lowest_m;
    // Fingers of long arms hang low as well: a partner is as low, as long, and branches off before its last four hinges.
    let other = ends.iter().skip(1).find(|(low_m, hinges)| {
        let shared = first.iter().zip(hinges).take_while(|(a, b)| a == b).count();
        let own = hinges.len() - shared;
        (low_m - lowest_m).abs() < 0.1 * height_m && hinges.len() == first.len() && own >= FEWEST_HINGES
    });
    let Some((_, second)) = other else { return Err(format!("it has no two legs alike; {}", found())) };
    let shared = first.iter().zip(second).take_while(|(a, b)| a == b).count();
    Ok([first, second].map(|hinges| Chain { hinges: hinges[shared..].to_vec(), roles: Vec::new(), foot: 0 }))
}

/// Whether the first of two legs is the left one, and whether names and feet agree on it.
fn left_first(model: &MjModel, data: &MjData<std::sync::Arc<MjModel>>, one: &Chain, other: &Chain) -> (bool, bool) {
    let names = [one, other].map(|chain| name_of(model, MjtObjBase::mjOBJ_JOINT, chain.hinges[0]).to_lowercase());
    let differing = names[0].chars().zip(names[1].chars()).find(|(a, b)| a != b);
    let by_name = match differing {
        Some(('l', 'r')) => Some(true),
        Some(('r', 'l')) => Some(false),
        _ => None,
    };
    // Feet point forward: their mass and geoms are ahead of the last joint.
    let [a, b] = [one, other].map(|chain| data.xanchor()[chain.hinges[0]]);
    let across = [a[0] - b[0], a[1] - b[1]];
    let ahead = |chain: &Chain| {
        let last = chain.hinges[chain.hinges.len() - 1];
        let (anchor, foot) = (data.xanchor()[last], model.jnt_bodyid()[last] as usize);
        let geoms = (0..model.ngeom() as usize).filter(|&g| {
            let mut body = model.geom_bodyid()[g] as usize;
            while body > foot {
                body = model.body_parentid()[body] as usize;
            }
            body == foot
        });
        let centres: Vec<[f64; 3]> = geoms.map(|g| geom_centre(model, data, g)).collect();
        let mean =
            |axis: usize| centres.iter().map(|c| c[axis] - anchor[axis]).sum::<f64>() / centres.len().max(1) as f64;
        // If the first leg is left, forward is across turned right by 90 deg.
        mean(0) * across[1] - mean(1) * across[0]
    };
    let shape_m = 0.5 * (ahead(one) + ahead(other)) / across[0].hypot(across[1]).max(1e-9);
    let agrees = |left: bool| if left { shape_m > -UNCLEAR_M } else { shape_m < UNCLEAR_M };
    (by_name.unwrap_or(shape_m > 0.0), by_name.map_or(shape_m.abs() > UNCLEAR_M, agrees))
}

fn geom_centre(model: &MjModel, data: &MjData<std::sync::Arc<MjModel>>, geom: usize) -> [f64; 3] {
    let aabb = model.geom_aabb()[geom];
    let turned = crate::rotation::to_world(&data.geom_xmat()[geom], [aabb[0], aabb[1], aabb[2]]);
    [0, 1, 2].map(|i| data.geom_xpos()[geom][i] + turned[i])
}

/// Gives the hinges of a leg their roles: by the direction that each axis is nearest to, from the hip down.
fn assign(model: &MjModel, data: &MjData<std::sync::Arc<MjModel>>, chain: &mut Chain, heading: f64) {
    let (sin, cos) = heading.sin_cos();
    let kinds: Vec<(usize, [f64; 3])> = (chain.hinges.iter())
        .map(|&j| {
            let [x, y, z] = data.xaxis()[j];
            (j, [cos * x + sin * y, cos * y - sin * x, z])
        })
        .collect();
    let along = |axis: [f64; 3]| (0..3).max_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs())).unwrap_or(0);
    let mut pitches = 0;
    for &(joint, axis) in &kinds {
        // What turns an ankle and does not pitch it rolls it, whatever its axis.
        let (role, along) = match (along(axis), pitches) {
            (0, 0 | 1) => (LegJoint::HipRoll, 0),
            (1, 0) => (LegJoint::HipPitch, 1),
            (1, 1) => (LegJoint::Knee, 1),
            (1, 2) => (LegJoint::AnklePitch, 1),
            (2, 0 | 1) => (LegJoint::HipYaw, 2),
            (0 | 2, _) if axis[0].abs() > SOME_ROLL => (LegJoint::AnkleRoll, 0),
            _ => continue,
        };
        pitches += usize::from(along == 1);
        if chain.roles.iter().any(|taken| taken.0 == role) {
            continue;
        }
        // Rolls turn about +x, yaws about +z, pitches about -y.
        let turn = axis[along] * if along == 1 { -1.0 } else { 1.0 };
        chain.roles.push((role, joint, turn.signum(), turn.abs()));
    }
    let last = chain.roles.iter().rfind(|role| matches!(role.0, LegJoint::AnklePitch | LegJoint::AnkleRoll));
    let last = last.map_or(chain.hinges[chain.hinges.len() - 1], |role| role.1);
    chain.foot = model.jnt_bodyid()[last] as usize;
}
