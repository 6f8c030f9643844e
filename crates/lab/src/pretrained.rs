//! A task whose gait is a pretrained network: its tables, wherever they were written, and what they say of the robot.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use stridemap_config::Document;
use stridemap_files::fetched_path;
use stridemap_gait::{
    ClockConfig, Each, GaitConfig, GaitError, ModelConfig, PolicyConfig, Source, joints_of, numbers_of, read_network,
};
use stridemap_mujoco::{LegMap, Missing, ModelSource, MujocoConfig, PerJoint, RestAngle};
use stridemap_robot::Side;

use crate::error::{Invalid, LabError};

/// A file with the tables of a policy.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PolicyFile {
    policy: PolicyConfig,
    clock: Option<ClockConfig>,
    model: Option<ModelConfig>,
}

/// Puts the tables of a policy where they belong: those of a file into the task, paths as seen from where they were written,
/// `gait.model` into `robot`.
///
/// # Errors
///
/// [`LabError::Config`] with file and line for a file that cannot be read; [`LabError::Gait`] for numbers that do not fit.
pub(crate) fn adopt(
    gait: &mut GaitConfig,
    robot: &mut MujocoConfig,
    base_below_m: &mut Option<f64>,
    document: &Document,
) -> Result<(), LabError> {
    if let Some(file) = gait.policy_file.take() {
        let file = fetched_path(&file, document.base_dir("gait.policy_file"));
        let name = file.display().to_string();
        let tables: PolicyFile = Document::load_file(&file, &[], &[])
            .and_then(|tables| tables.deserialize())
            .map_err(|error| LabError::Config(Box::new(error)))?;
        let given = [gait.policy.is_some(), gait.clock.is_some(), gait.model.is_some()];
        if given.contains(&true) {
            let requirement = format!("{name} has the tables of the policy: leave [gait.policy], clock and model out");
            return Err(Invalid { key: "gait.policy_file".into(), requirement }.into());
        }
        let base = file.parent().map(Path::to_path_buf);
        let own = |path: &PathBuf| fetched_path(path, base.as_deref());
        let mut policy = tables.policy;
        policy.onnx = own(&policy.onnx);
        gait.model = tables.model.map(|model| ModelConfig { mjcf: own(&model.mjcf), ..model });
        (gait.policy, gait.clock) = (Some(policy), tables.clock);
    } else {
        if let Some(policy) = &mut gait.policy {
            policy.onnx = fetched_path(&policy.onnx, document.base_dir("gait.policy.onnx"));
        }
        if let Some(model) = &mut gait.model {
            model.mjcf = fetched_path(&model.mjcf, document.base_dir("gait.model.mjcf"));
        }
    }
    // A task that is extended may have a clock where this one has none.
    gait.clock = gait.clock.take().filter(|clock| !clock.start_rad.is_empty());
    match (gait.model.take(), gait.policy.clone()) {
        (Some(model), Some(policy)) => {
            *base_below_m = Some(model.fallen_below_m);
            robot_of(gait, robot, &model, policy)
        }
        (Some(_), None) => Err(Invalid { key: "gait.model".into(), requirement: "needs [gait.policy]".into() }.into()),
        (None, _) => Ok(()),
    }
}

/// Writes what the table `[model]` says into a robot.
fn robot_of(
    gait: &mut GaitConfig,
    robot: &mut MujocoConfig,
    model: &ModelConfig,
    policy: PolicyConfig,
) -> Result<(), LabError> {
    let fault = |key: &str, what: String| LabError::Gait(GaitError::Policy { key: key.into(), what });
    // Only what is not written here needs the network.
    let here = |source: &Source<Each>| matches!(source, Source::Here(_));
    let net = match (&policy.joints, here(&policy.kp) && here(&policy.kd)) {
        (Source::Here(_), true) => None,
        _ => Some(read_network(&policy)?),
    };
    let joints = match (&policy.joints, &net) {
        (Source::Here(joints), _) => joints.clone(),
        (_, Some(net)) => joints_of(&policy, net)?,
        (_, None) => Vec::new(),
    };
    let count = joints.len();
    let each = |numbers: &Each, key: &str| {
        numbers.of(count).map_err(|found| fault(key, format!("has {found} numbers for {count} joints")))
    };
    let gains = |source: &Source<Each>, key: &str| match (source, &net) {
        (Source::Here(numbers), _) => each(numbers, key),
        (_, Some(net)) => Ok(numbers_of(source, key, count, net)?),
        (_, None) => Ok(Vec::new()),
    };
    let table = |values: Vec<f64>| -> BTreeMap<String, f64> { joints.iter().cloned().zip(values).collect() };
    let (mut kp, mut kd) = (table(gains(&policy.kp, "policy.kp")?), table(gains(&policy.kd, "policy.kd")?));
    let mut rest_deg = table(each(&policy.rest_rad, "policy.rest_rad")?);
    for held in &policy.held {
        kp.insert(held.joint.clone(), held.kp);
        kd.insert(held.joint.clone(), held.kd);
        rest_deg.insert(held.joint.clone(), held.rest_rad);
    }
    if model.implicit_damping {
        let own = model.joint_damping.unwrap_or(0.0);
        let damping = kd.iter().map(|(name, kd)| (name.clone(), kd + own)).collect();
        robot.joint_damping_nms_rad = Some(PerJoint::Each(damping));
        kd.values_mut().for_each(|kd| *kd = 0.0);
        let policy = PolicyConfig { kd: Source::Here(Each::All(0.0)), ..policy };
        gait.policy = Some(policy);
    } else {
        robot.joint_damping_nms_rad = model.joint_damping.map(PerJoint::All);
    }
    let optional = |numbers: &Option<Each>, key: &str| -> Result<Option<PerJoint>, LabError> {
        let numbers = numbers.as_ref().map(|numbers| each(numbers, key)).transpose()?;
        Ok(numbers.map(|values| PerJoint::Each(table(values))))
    };
    let feet: Vec<&String> = model.feet.iter().collect();
    let foot = |side: Side| {
        let own: Vec<&str> = feet.iter().skip(side.index()).step_by(2).map(|name| name.as_str()).collect();
        own.join(" ")
    };
    if feet.len() < 2 || feet.len() % 2 == 1 {
        return Err(fault("model.feet", format!("names {} feet, needs a left and a right one", feet.len())));
    }
    for side in Side::BOTH {
        let legs = match side {
            Side::Left => &mut robot.left,
            Side::Right => &mut robot.right,
        };
        // Which joints are a leg's may be said beside it.
        if *legs == LegMap::biped(side) {
            *legs = LegMap::of_foot("");
        }
        legs.foot = foot(side);
    }
    robot.model = ModelSource::File(model.mjcf.clone());
    robot.add = vec![Missing::Meshes, Missing::Floor];
    robot.time_step_s = Some(model.time_step_s);
    // Not 1.0000000000000002 milliseconds; a rate that is none is told when the gait is built.
    let rate_hz = gait.policy.as_ref().map(|policy| policy.rate_hz).filter(|rate| *rate >= 1.0);
    robot.control_period_s = (1e9 / rate_hz.unwrap_or(50.0)).round() / 1e9;
    robot.actuators = false;
    robot.body_contacts = false;
    robot.armature_kg_m2 = optional(&model.armature, "model.armature")?;
    robot.torque_limit_nm = optional(&model.torque_limit, "model.torque_limit")?;
    robot.joint_friction_nm = model.joint_friction;
    robot.friction = model.foot_friction;
    robot.kp_nm_rad = Some(PerJoint::Each(kp));
    robot.kv_nms_rad = Some(PerJoint::Each(kd));
    robot.rest_deg = rest_deg.into_iter().map(|(name, rad)| (name, RestAngle::from(rad.to_degrees()))).collect();
    Ok(())
}
