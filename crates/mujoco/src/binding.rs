//! From the names of a configuration to the places of a model.

use mujoco_rs::prelude::{MjData, MjModel};
use mujoco_rs::wrappers::mj_model::{MjtJoint, MjtObjBase};
use stridemap_robot::{LEG_JOINTS, LegJoint, LegRole, Legs, Side};

use crate::axis::{Axis, Drive, Given};
use crate::config::{LegMap, MujocoConfig, no_such_name};
use crate::engine::{allocation, name_of, own_bodies};
use crate::error::MujocoError;
use crate::payload::Parts;
use crate::per_joint::{PerJoint, RestAngle};
use crate::{actuators, foreign, world};

/// Natural frequency with which a joint beyond the legs is held where the model gives it no servo.
pub(crate) const HOLD_RAD_S: f64 = 40.0;

/// Where everything is in one model.
#[derive(Clone, Debug)]
pub(crate) struct Binding {
    /// The leg joints and every other hinge and slide of the robot, in the model's order.
    pub axes: Vec<Axis>,
    /// Which of them are leg joints.
    pub legs: Legs<Option<LegRole>>,
    /// Root body.
    pub torso: usize,
    /// Index of the free joint in `qpos`.
    pub root_qpos: usize,
    /// Index of the free joint in `qvel`.
    pub root_dof: usize,
    /// Foot bodies by side; the first, where a side has two.
    pub feet: [usize; 2],
    /// Whether the feet are points, as on a robot of four legs: they say nothing of the base's pitch.
    pub point_feet: bool,
    /// Where the robot looks in the reference posture, from +x to the left.
    pub heading_rad: f64,
    /// For each geom: the side of the foot that it belongs to.
    pub foot_of_geom: Vec<Option<u8>>,
    /// For each geom: whether it is part of the floor (fixed to the world, and able to touch).
    pub is_floor: Vec<bool>,
}

impl Binding {
    /// Finds everything that the configuration names.
    pub(crate) fn find(model: &MjModel, config: &MujocoConfig) -> Result<Self, MujocoError> {
        let mut feet = [0; 2];
        let mut more_feet = Vec::new();
        for side in Side::BOTH {
            let whole = config.leg(side).foot.as_str();
            let body = |name: &str| model.name_to_id(MjtObjBase::mjOBJ_BODY, name);
            let names: Vec<&str> = match body(whole) {
                Some(_) => vec![whole],
                None => whole.split(' ').filter(|name| !name.is_empty()).collect(),
            };
            if names.iter().all(|name| body(name).is_none()) && *config.leg(side) == LegMap::biped(side) {
                return Err(not_mapped(model, config, side));
            }
            let find = |name: &str| {
                body(name).ok_or_else(|| {
                    let field = format!("{}.foot", side.name());
                    let names = 0..model.nbody() as usize;
                    let names = names.filter_map(|id| model.id_to_name(MjtObjBase::mjOBJ_BODY, id));
                    no_such_name(field, "body", name, names)
                })
            };
            feet[side.index()] = find(names.first().copied().unwrap_or(whole))?;
            for name in names.iter().skip(1) {
                more_feet.push((find(name)?, side));
            }
        }
        let not_a_biped = |reason: String| MujocoError::NotABiped { model: config.model.to_string(), reason };
        if let Some(problem) = world::problem(model) {
            return Err(not_a_biped(problem));
        }
        let torso = model.body_rootid()[feet[0]] as usize;
        let root = (0..model.njnt() as usize)
            .find(|&j| {
                model.jnt_type()[j] == MjtJoint::mjJNT_FREE
                    && model.jnt_bodyid()[j] as usize == torso
            })
            .ok_or_else(|| {
                not_a_biped(format!(
                    "the body {:?}, from which the feet hang, has no <freejoint/>: the robot could neither move nor fall",
                    name_of(model, MjtObjBase::mjOBJ_BODY, torso)
                ))
            })?;
        if model.body_rootid()[feet[1]] as usize != torso || feet[0] == feet[1] {
            return Err(not_a_biped("left.foot and right.foot must be two bodies of one robot".into()));
        }
        let named = leg_joints(model, config)?;
        let axes = axes(model, config, torso, &named)?;
        let legs = Legs::from_fn(|side, joint| {
            let (id, sign) = named[(side, joint)]?;
            let joint = axes.iter().position(|axis| axis.joint == id)?;
            Some(LegRole { joint, sign })
        });
        let foot_of_geom = (0..model.ngeom() as usize)
            .map(|geom| {
                let body = model.geom_bodyid()[geom] as usize;
                let more = || more_feet.iter().find(|(foot, _)| *foot == body).map(|(_, side)| side.index() as u8);
                foot_of(model, body, feet).or_else(more)
            })
            .collect();
        let is_floor: Vec<bool> = (0..model.ngeom() as usize)
            .map(|geom| model.body_weldid()[model.geom_bodyid()[geom] as usize] == 0 && collides(model, geom))
            .collect();
        Ok(Self {
            axes,
            legs,
            torso,
            root_qpos: model.jnt_qposadr()[root] as usize,
            root_dof: model.jnt_dofadr()[root] as usize,
            feet,
            point_feet: !more_feet.is_empty(),
            heading_rad: match config.heading_deg {
                Some(deg) => deg.to_radians(),
                None => heading_rad(model, &named)?,
            },
            foot_of_geom,
            is_floor,
        })
    }

    /// Where the parts of the robot are.
    pub(crate) fn parts(&self) -> Parts {
        Parts { torso: self.torso, feet: self.feet, joints: self.axes.iter().map(|axis| axis.joint).collect() }
    }

    /// Geoms of the feet and of the floor.
    pub(crate) fn contact_geoms(&self) -> Vec<usize> {
        (0..self.is_floor.len()).filter(|&geom| self.is_floor[geom] || self.foot_of_geom[geom].is_some()).collect()
    }
}

/// Where a robot looks, by the places of its hips: across from the right to the left one is left. Near +x it is +x; near −x it
/// is more likely that left and right were exchanged.
fn heading_rad(model: &MjModel, named: &Legs<Option<(usize, f64)>>) -> Result<f64, MujocoError> {
    const AXIS_RAD: f64 = 0.35;
    let mut data = MjData::try_new(model).map_err(allocation)?;
    data.kinematics();
    let hip = |side| {
        let joints = [LegJoint::HipPitch, LegJoint::HipRoll, LegJoint::HipYaw];
        let (id, _) = joints.into_iter().find_map(|joint| named[(side, joint)])?;
        Some(data.xanchor()[id])
    };
    let (Some(left), Some(right)) = (hip(Side::Left), hip(Side::Right)) else { return Ok(0.0) };
    let heading = (right[0] - left[0]).atan2(left[1] - right[1]);
    let along_x = heading.abs() < AXIS_RAD || heading.abs() > std::f64::consts::PI - AXIS_RAD;
    Ok(if along_x { 0.0 } else { heading })
}

/// The error for a model of the user's own under the names of the built-in biped.
fn not_mapped(model: &MjModel, config: &MujocoConfig, side: Side) -> MujocoError {
    let hinges: Vec<&str> = (0..model.njnt() as usize)
        .filter(|&joint| model.jnt_type()[joint] == MjtJoint::mjJNT_HINGE)
        .filter_map(|joint| model.id_to_name(MjtObjBase::mjOBJ_JOINT, joint))
        .collect();
    let has = match hinges[..] {
        [] => "it has no hinges with names".into(),
        _ => format!("its hinges are {}", hinges.join(", ")),
    };
    let side = side.name();
    MujocoError::NotABiped {
        model: config.model.to_string(),
        reason: format!(
            "robot.{side} is not given, and the names of the built-in biped are not in it; name its joints and foot \
             as {side} = {{ hip_roll = \"...\", hip_pitch = \"...\", knee = \"...\", ankle_pitch = \"...\", \
             ankle_roll = \"...\" (where it has one, and hip_yaw), foot = \"...\" }}; {has}"
        ),
    }
}

/// The model's joint for each leg joint that the configuration names, and its sign.
fn leg_joints(model: &MjModel, config: &MujocoConfig) -> Result<Legs<Option<(usize, f64)>>, MujocoError> {
    let mut named: Legs<Option<(usize, f64)>> = Legs::default();
    let place = |side: Side, joint: LegJoint| format!("{}.{}", side.name(), joint.name());
    for side in Side::BOTH {
        for joint in LEG_JOINTS {
            let Some((sign, name)) = config.leg(side).joint(joint) else {
                continue;
            };
            let field = place(side, joint);
            let id = model
                .name_to_id(MjtObjBase::mjOBJ_JOINT, name)
                .ok_or_else(|| no_such_name(field.clone(), "joint", name, joint_names(model)))?;
            if model.jnt_type()[id] != MjtJoint::mjJNT_HINGE {
                let name = name.to_owned();
                return Err(MujocoError::NotAHinge { field, name });
            }
            let same = |at: &Option<(usize, f64)>| at.is_some_and(|(taken, _)| taken == id);
            if let Some((s, j, _)) = named.iter().find(|(.., at)| same(at)) {
                return Err(MujocoError::NamedTwice { first: place(s, j), second: field, name: name.into() });
            }
            named[(side, joint)] = Some((id, sign));
        }
    }
    Ok(named)
}

/// Every joint of the robot that is driven or held: the leg joints, and all other hinges and slides.
fn axes(
    model: &MjModel,
    config: &MujocoConfig,
    torso: usize,
    named: &Legs<Option<(usize, f64)>>,
) -> Result<Vec<Axis>, MujocoError> {
    let bodies = own_bodies(model, torso);
    let keyframe = config.keyframe.as_deref().map(|name| keyframe(model, name)).transpose()?;
    let mut axes = Vec::new();
    for id in 0..model.njnt() as usize {
        let kind = model.jnt_type()[id];
        let hinge = kind == MjtJoint::mjJNT_HINGE;
        let role =
            named.iter().find_map(|(side, joint, at)| at.filter(|at| at.0 == id).map(|(_, sign)| (side, joint, sign)));
        let own = bodies.contains(&(model.jnt_bodyid()[id] as usize));
        let qpos = model.jnt_qposadr()[id] as usize;
        let in_keyframe = keyframe.map(|key| model.key_qpos()[key * model.nq() as usize + qpos]);
        let name = model.id_to_name(MjtObjBase::mjOBJ_JOINT, id);
        let reference = in_keyframe.unwrap_or(model.qpos0()[qpos]);
        let rest_rad = match role {
            Some((side, joint, sign)) => match config.given_rest_rad(side, joint) {
                _ if !config.actuators && by_name(config, name).is_some() => by_name(config, name).unwrap_or(reference),
                Some(given) => sign * given,
                None => in_keyframe.unwrap_or(sign * config.rest_rad(side, joint)),
            },
            None if own && hinge => {
                let posture = name.and_then(|name| config.posture.get(name)).map(|posture| posture.rest_deg());
                posture.map(f64::to_radians).or(by_name(config, name)).unwrap_or(reference)
            }
            None if own && kind == MjtJoint::mjJNT_SLIDE => reference,
            None => continue,
        };
        let named = name.unwrap_or_default();
        let given = match role {
            Some((_, joint, _)) => Some(Given::of(config, joint.name(), named)),
            None => (hinge && !config.actuators).then(|| Given::of(config, "", named)),
        };
        let mut axis = axis(model, id, given, rest_rad)?;
        if given.is_none() && axis.actuator.is_some_and(|servo| foreign::is_added(model, servo)) {
            axis.given = held(model, axis.dof);
        }
        if let Some(given) = given {
            let servo = matches!(axis.drive, Drive::Servo { .. });
            let own = servo && !axis.actuator.is_some_and(|servo| foreign::is_added(model, servo));
            if !own && (given.kp.is_none() || given.kv.is_none()) {
                let joint = name_of(model, MjtObjBase::mjOBJ_JOINT, id);
                return Err(MujocoError::NoGains { joint });
            }
            // A servo's own range is replaced by a limit of the user's.
            if given.torque_nm.is_none() || !servo {
                actuators::torque_range(model, &axis)?;
            }
        }
        axes.push(axis);
    }
    check_names(model, config, &axes, named)?;
    Ok(axes)
}

/// The rest angle that a file gives a joint by its name in the model.
fn by_name(config: &MujocoConfig, name: Option<&str>) -> Option<f64> {
    config.rest_deg.get(name?).map(|angle| angle.of(Side::Left).to_radians())
}

/// Gains with which a joint beyond the legs is held where its model says none: they follow from its inertia.
fn held(model: &MjModel, dof: usize) -> Given {
    let inertia = model.dof_m0()[dof];
    Given { kp: Some(inertia * HOLD_RAD_S * HOLD_RAD_S), kv: Some(2.0 * inertia * HOLD_RAD_S), ..Given::default() }
}

/// The index of a keyframe.
fn keyframe(model: &MjModel, name: &str) -> Result<usize, MujocoError> {
    model.name_to_id(MjtObjBase::mjOBJ_KEY, name).ok_or_else(|| {
        let names = (0..model.nkey() as usize).filter_map(|id| model.id_to_name(MjtObjBase::mjOBJ_KEY, id));
        no_such_name("keyframe".into(), "keyframe", name, names)
    })
}

/// An error for a joint that the robot does not have, among rest angles and the numbers of leg joints.
fn check_names(
    model: &MjModel,
    config: &MujocoConfig,
    axes: &[Axis],
    named: &Legs<Option<(usize, f64)>>,
) -> Result<(), MujocoError> {
    let of = |leg: bool| {
        let own = axes.iter().filter(move |axis| axis.of_leg == leg);
        let hinges = own.filter(|axis| model.jnt_type()[axis.joint] == MjtJoint::mjJNT_HINGE);
        hinges.filter_map(|axis| model.id_to_name(MjtObjBase::mjOBJ_JOINT, axis.joint))
    };
    let roles = || named.iter().filter(|(.., at)| at.is_some()).map(|(_, joint, _)| joint.name());
    let known: Vec<&str> = roles().chain(of(false)).chain(of(true).filter(|_| !config.actuators)).collect();
    if let Some(name) = config.rest_deg.keys().find(|name| !known.contains(&name.as_str())) {
        let field = format!("rest_deg.{name:?}");
        return Err(no_such_name(field, "leg joint or further hinge", name, known.into_iter()));
    }
    let further: Vec<&str> = of(false).collect();
    if let Some(name) = config.posture.keys().find(|name| !further.contains(&name.as_str())) {
        return Err(no_such_name(format!("posture.{name:?}"), "hinge beyond the legs", name, further.into_iter()));
    }
    for name in of(false) {
        if let Some(RestAngle::Each { .. }) = config.rest_deg.get(name) {
            return Err(MujocoError::OneAngle { field: format!("rest_deg.{name:?}") });
        }
    }
    let known: Vec<&str> = roles().chain(of(true)).collect();
    let tables = [
        ("kp_nm_rad", &config.kp_nm_rad),
        ("kv_nms_rad", &config.kv_nms_rad),
        ("torque_limit_nm", &config.torque_limit_nm),
        ("armature_kg_m2", &config.armature_kg_m2),
        ("joint_damping_nms_rad", &config.joint_damping_nms_rad),
    ];
    let names =
        tables.iter().flat_map(|(field, table)| table.iter().flat_map(PerJoint::names).map(move |n| (field, n)));
    match names.into_iter().find(|(_, name)| !known.contains(name)) {
        None => Ok(()),
        Some((field, name)) => Err(no_such_name(format!("{field}.{name:?}"), "leg joint", name, known.into_iter())),
    }
}

/// One joint and how it is driven.
fn axis(model: &MjModel, joint: usize, given: Option<Given>, rest_rad: f64) -> Result<Axis, MujocoError> {
    let (drive, actuator) = actuators::drive(model, joint)?;
    Ok(Axis {
        joint,
        qpos: model.jnt_qposadr()[joint] as usize,
        dof: model.jnt_dofadr()[joint] as usize,
        of_leg: given.is_some(),
        given: given.unwrap_or_default(),
        drive,
        actuator,
        rest_rad,
    })
}

/// Names of the joints of a model.
fn joint_names(model: &MjModel) -> impl Iterator<Item = &str> {
    (0..model.njnt() as usize).filter_map(|id| model.id_to_name(MjtObjBase::mjOBJ_JOINT, id))
}

/// The foot that a body is, or hangs from.
fn foot_of(model: &MjModel, body: usize, feet: [usize; 2]) -> Option<u8> {
    let mut body = body;
    while body != 0 {
        if body == feet[0] {
            return Some(0);
        }
        if body == feet[1] {
            return Some(1);
        }
        body = model.body_parentid()[body] as usize;
    }
    None
}

/// Whether a geom can touch anything.
pub(crate) fn collides(model: &MjModel, geom: usize) -> bool {
    let in_pair = || {
        let mut both = model.pair_geom1().iter().chain(model.pair_geom2());
        both.any(|&g| g as usize == geom)
    };
    model.geom_contype()[geom] != 0 || model.geom_conaffinity()[geom] != 0 || in_pair()
}
