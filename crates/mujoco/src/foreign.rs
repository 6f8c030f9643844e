//! Models that lack something: URDFs, which know neither a free joint nor a floor and name meshes that MuJoCo cannot read,
//! and MJCF without a free joint, a floor, or its pictures.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mujoco_rs::prelude::{MjModel, MjSpec};
use mujoco_rs::wrappers::mj_editing::{MjsBody, MjsJoint, PositionConfig};
use mujoco_rs::wrappers::mj_editing::{SpecElement as _, SpecItem as _};
use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtIntegrator, MjtJoint, MjtObjBase, MjtTrn};
use roxmltree::{Document, Node};

use crate::config::Missing;

/// What is done to models here, by number: a compiled model that was kept is of one recipe.
pub(crate) const RECIPE: u32 = 3;
/// First word of the name of a servo that was added.
const ADDED: &str = "added: ";
/// Corners of a picture that stands for a mesh which is not there.
const SPECK_M: [f32; 12] = [0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3];

/// Whether a file is a URDF: by its root element.
pub(crate) fn is_urdf(path: &Path) -> bool {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let Ok(document) = Document::parse(&text) else { return false };
    document.root_element().has_tag_name("robot")
}

/// The URDF and every mesh that it names and that is there.
pub(crate) fn urdf_files(path: &Path) -> Option<Vec<PathBuf>> {
    let text = std::fs::read_to_string(path).ok()?;
    let document = Document::parse(&text).ok()?;
    let meshes = document.descendants().filter(|node| node.has_tag_name("mesh"));
    let found = meshes.filter_map(|mesh| resolve(path, mesh.attribute("filename")?));
    Some(std::iter::once(path.to_path_buf()).chain(found).collect())
}

/// Compiles a model with what it lacks.
pub(crate) fn compile(path: &Path, added: &[Missing]) -> Result<MjModel, String> {
    let text = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
    let urdf = is_urdf(path);
    let bare = added.contains(&Missing::Meshes);
    let mut spec = match (urdf, bare) {
        (true, _) => MjSpec::from_xml_string(&readable(path, &text)?),
        (false, true) => MjSpec::from_xml_string(&without_meshes(&text)?),
        (false, false) => MjSpec::from_xml(path),
    }
    .map_err(|error| error.to_string())?;
    if urdf {
        box_collisions(&mut spec)?;
        servos(&mut spec)?;
    }
    stand_ins(&mut spec, path)?;
    if urdf || added.contains(&Missing::FreeJoint) {
        free(spec.world_body_mut())?;
    }
    let has_floor = bare && spec.geom_iter().any(|geom| geom.name() == "floor");
    if (urdf || added.contains(&Missing::Floor)) && !has_floor {
        let floor = spec.world_body_mut().add_geom();
        floor.set_type(MjtGeomBase::mjGEOM_PLANE);
        *floor.size_mut() = [0.0, 0.0, 1.0];
        floor.set_contype(1);
        floor.set_conaffinity(1);
        floor.set_name("floor").map_err(|_| "the floor that is to be added: the model has a \"floor\" already")?;
    }
    spec.compile().map_err(|error| error.to_string())
}

/// A free joint on the tree with the most bodies, if it has no joint.
fn free(world: &mut MjsBody) -> Result<(), String> {
    let size = |body: &MjsBody| body.body_iter(true).count();
    let Some(most) = world.body_iter(false).map(size).max() else {
        return Err("it has no body".into());
    };
    let robot = world.body_iter_mut().find(|body| size(body) == most);
    if let Some(robot) = robot.filter(|robot| robot.joint_iter(false).next().is_none()) {
        robot.add_free_joint();
    }
    Ok(())
}

/// An MJCF's text without its meshes, and without geoms that are meshes.
fn without_meshes(text: &str) -> Result<String, String> {
    let document = Document::parse(text).map_err(|error| error.to_string())?;
    let mut out = text.to_owned();
    let gone = document.descendants().filter(|node| {
        node.has_tag_name("geom") && node.attribute("mesh").is_some()
            || node.has_tag_name("mesh") && node.parent().is_some_and(|parent| parent.has_tag_name("asset"))
    });
    let mut gone: Vec<_> = gone.map(|node| node.range()).collect();
    gone.sort_by_key(|range| std::cmp::Reverse(range.start));
    gone.into_iter().for_each(|range| out.replace_range(range, ""));
    Ok(out)
}

/// A URDF's text as MuJoCo can read it: meshes by absolute paths, elements whose mesh is nowhere left out, what has a picture
/// and no contact geometry given one of the same form.
fn readable(path: &Path, text: &str) -> Result<String, String> {
    let document = Document::parse(text).map_err(|error| error.to_string())?;
    let mut edits: Vec<(std::ops::Range<usize>, String)> = Vec::new();
    for link in document.root_element().children().filter(|node| node.has_tag_name("link")) {
        let parts = |tag: &'static str| link.children().filter(move |node| node.has_tag_name(tag));
        let kept: Vec<Node<'_, '_>> = parts("visual").chain(parts("collision")).collect();
        for part in &kept {
            for mesh in part.descendants().filter(|node| node.has_tag_name("mesh")) {
                let Some(attribute) = mesh.attribute_node("filename") else { continue };
                match resolve(path, attribute.value()) {
                    Some(file) => edits.push((attribute.range_value(), file.display().to_string())),
                    None => edits.push((part.range(), String::new())),
                }
            }
        }
        let missing = |part: &Node<'_, '_>| {
            let mut meshes = part.descendants().filter(|node| node.has_tag_name("mesh"));
            meshes.any(|mesh| mesh.attribute("filename").is_none_or(|name| resolve(path, name).is_none()))
        };
        if parts("collision").all(|part| missing(&part)) {
            for part in parts("visual").filter(|part| !missing(part)) {
                let mut copy =
                    text[part.range()].replacen("<visual", "<collision", 1).replace("</visual", "</collision");
                for mesh in part.descendants().filter(|node| node.has_tag_name("mesh")) {
                    let name = mesh.attribute("filename").unwrap_or_default();
                    let file = resolve(path, name).unwrap_or_default();
                    copy = copy.replace(&format!("\"{name}\""), &format!("\"{}\"", file.display()));
                }
                let end = part.range().end;
                edits.push((end..end, copy));
            }
        }
    }
    let root = document.root_element();
    let options = "<mujoco><compiler strippath=\"false\" discardvisual=\"false\" fusestatic=\"true\" \
                   balanceinertia=\"true\" boundmass=\"0.001\" boundinertia=\"0.000001\"/></mujoco>";
    if let Some(first) = root.first_child() {
        edits.push((first.range().start..first.range().start, options.into()));
    }
    edits.sort_by_key(|(range, _)| (range.start, range.end));
    let (mut out, mut at) = (String::with_capacity(text.len() + 1000), 0);
    for (range, new) in edits {
        if range.start >= at {
            out.push_str(&text[at..range.start]);
            out.push_str(&new);
            at = range.end;
        }
    }
    out.push_str(&text[at..]);
    Ok(out)
}

/// The file of a mesh: beside the model, or below one of the folders above it where it names a package.
fn resolve(model: &Path, name: &str) -> Option<PathBuf> {
    let scheme = ["package://", "model://", "file://"].iter().find_map(|scheme| name.strip_prefix(scheme));
    let model = std::path::absolute(model).ok()?;
    let bases = model.ancestors().skip(1).take(8);
    let names = [Some(scheme.unwrap_or(name)), scheme.and_then(|name| Some(name.split_once('/')?.1))];
    let places = bases.flat_map(|base| names.iter().flatten().map(move |name| base.join(name)));
    places.into_iter().find(|path| path.is_file())
}

/// Gives every joint of a URDF a position servo, and the physics an integrator that is stable with their damping: links without
/// the inertia of their motors are light.
fn servos(spec: &mut MjSpec) -> Result<(), String> {
    let hinge = |joint: &&MjsJoint| joint.type_() == MjtJoint::mjJNT_HINGE || joint.type_() == MjtJoint::mjJNT_SLIDE;
    let names: Vec<String> = spec.joint_iter().filter(hinge).map(|joint| joint.name().to_owned()).collect();
    for name in names {
        let servo = spec.add_actuator();
        let added = servo.set_name(&format!("{ADDED}{name}"));
        servo.set_trntype(MjtTrn::mjTRN_JOINT);
        servo.set_target(&name);
        let set = servo.set_to_position(PositionConfig { kp: 1.0, kv: Some(1.0), ..PositionConfig::default() });
        added.and(set).map_err(|error| error.to_string())?;
    }
    spec.option_mut().integrator = MjtIntegrator::mjINT_IMPLICITFAST as i32;
    Ok(())
}

/// Whether an actuator was added here: its gains are nobody's.
pub(crate) fn is_added(model: &MjModel, actuator: usize) -> bool {
    let name = model.id_to_name(MjtObjBase::mjOBJ_ACTUATOR, actuator);
    name.is_some_and(|name| name.starts_with(ADDED))
}

/// Turns the contact meshes of a URDF into boxes along their links' axes, which are good feet.
fn box_collisions(spec: &mut MjSpec) -> Result<(), String> {
    let touching = touching(spec);
    let mut meshes = BTreeMap::new();
    for mesh in spec.mesh_iter().filter(|mesh| touching.iter().any(|name| name == mesh.name())) {
        let points = points_of(Path::new(mesh.file()))?;
        let scale = *mesh.scale();
        meshes.insert(mesh.name().to_owned(), (points, scale));
    }
    for geom in spec.geom_iter_mut() {
        if geom.type_() != MjtGeomBase::mjGEOM_MESH || (geom.contype() == 0 && geom.conaffinity() == 0) {
            continue;
        }
        let Some((points, scale)) = meshes.get(geom.meshname()) else { continue };
        let (pos, quat) = (*geom.pos(), *geom.quat());
        let (mut low, mut high) = ([f64::MAX; 3], [f64::MIN; 3]);
        for point in points {
            let turned = crate::rotation::turn(quat, [0, 1, 2].map(|i| f64::from(point[i]) * scale[i]));
            for i in 0..3 {
                low[i] = low[i].min(pos[i] + turned[i]);
                high[i] = high[i].max(pos[i] + turned[i]);
            }
        }
        geom.set_type(MjtGeomBase::mjGEOM_BOX);
        geom.set_meshname("");
        *geom.pos_mut() = [0, 1, 2].map(|i| 0.5 * (low[i] + high[i]));
        *geom.quat_mut() = [1.0, 0.0, 0.0, 0.0];
        *geom.size_mut() = [0, 1, 2].map(|i| (0.5 * (high[i] - low[i])).max(1e-3));
    }
    Ok(())
}

/// Names of the meshes whose geoms can touch.
fn touching(spec: &MjSpec) -> Vec<String> {
    let touch = spec.geom_iter().filter(|geom| geom.contype() != 0 || geom.conaffinity() != 0);
    touch.map(|geom| geom.meshname().to_owned()).collect()
}

/// Every corner of a mesh file: COLLADA by ourselves, the others by MuJoCo.
fn points_of(file: &Path) -> Result<Vec<[f32; 3]>, String> {
    if is_collada(file) {
        let corners = collada_points(file).ok_or_else(|| format!("{}: is no COLLADA mesh", file.display()))?;
        return Ok(corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect());
    }
    let mut alone = MjSpec::new();
    let mesh = alone.add_mesh();
    mesh.set_file(&file.display().to_string());
    mesh.set_name("mesh").map_err(|error| error.to_string())?;
    let geom = alone.world_body_mut().add_geom();
    geom.set_type(MjtGeomBase::mjGEOM_MESH);
    geom.set_meshname("mesh");
    let model = alone.compile().map_err(|error| format!("{}: {error}", file.display()))?;
    // MuJoCo moves a mesh to its centre and axes of inertia.
    let (pos, quat) = (model.mesh_pos()[0], model.mesh_quat()[0]);
    let place = |v: &[f32; 3]| {
        let turned = crate::rotation::turn(quat, v.map(f64::from));
        #[expect(clippy::cast_possible_truncation)] // As they were in the file.
        [0, 1, 2].map(|i| (pos[i] + turned[i]) as f32)
    };
    Ok(model.mesh_vert().iter().map(place).collect())
}

fn is_collada(file: &Path) -> bool {
    file.extension().is_some_and(|kind| kind.eq_ignore_ascii_case("dae"))
}

/// Gives every mesh that MuJoCo cannot read its corners (COLLADA), and every picture that is not there a speck.
fn stand_ins(spec: &mut MjSpec, model: &Path) -> Result<(), String> {
    let dir = model.parent().unwrap_or(Path::new("."));
    let mesh_dir = dir.join(spec.compiler().meshdir());
    let touching = touching(spec);
    for mesh in spec.mesh_iter_mut() {
        let file = mesh.file().to_owned();
        let bare = Path::new(&file).file_name().unwrap_or_default();
        let at = [mesh_dir.join(&file), dir.join(&file), mesh_dir.join(bare)].into_iter().find(|path| path.is_file());
        let corners = match at {
            _ if file.is_empty() => continue,
            Some(path) if is_collada(&path) => {
                collada_points(&path).ok_or_else(|| format!("{}: is no COLLADA mesh", path.display()))?
            }
            Some(_) => continue,
            None if touching.iter().any(|name| name == mesh.name()) => {
                return Err(format!(
                    "the mesh file {file:?} is not there, and what it forms can touch: the robot needs it"
                ));
            }
            None => SPECK_M.to_vec(),
        };
        mesh.set_file("");
        mesh.set_uservert(&corners);
    }
    Ok(())
}

/// Every corner of a COLLADA file in metres, its nodes' places applied; z is up.
fn collada_points(path: &Path) -> Option<Vec<f32>> {
    let text = std::fs::read_to_string(path).ok()?;
    let document = Document::parse(&text).ok()?;
    let root = document.root_element();
    let find = |tag: &str| root.descendants().find(|node| node.has_tag_name(tag));
    let unit: f64 = find("unit").and_then(|unit| unit.attribute("meter")?.parse().ok()).unwrap_or(1.0);
    let y_up = find("up_axis").is_none_or(|axis| axis.text().is_some_and(|text| text.trim() == "Y_UP"));
    let mut points = Vec::new();
    for instance in root.descendants().filter(|node| node.has_tag_name("instance_geometry")) {
        let id = instance.attribute("url")?.trim_start_matches('#');
        let geometry = root.descendants().find(|n| n.has_tag_name("geometry") && n.attribute("id") == Some(id))?;
        let vertices = geometry.descendants().find(|node| node.has_tag_name("vertices"))?;
        let source = vertices.children().find(|n| n.attribute("semantic") == Some("POSITION"))?.attribute("source")?;
        let source = geometry.descendants().find(|n| n.attribute("id") == Some(source.trim_start_matches('#')))?;
        let numbers = numbers(source.descendants().find(|node| node.has_tag_name("float_array"))?)?;
        for corner in numbers.chunks_exact(3) {
            let mut point = [corner[0], corner[1], corner[2]];
            for node in instance.ancestors().filter(|node| node.has_tag_name("node")) {
                let steps: Vec<_> = node.children().filter(Node::is_element).collect();
                for step in steps.iter().rev() {
                    point = placed(step, point)?;
                }
            }
            let [x, y, z] = point.map(|value| value * unit);
            #[expect(clippy::cast_possible_truncation)] // MuJoCo's meshes are in single precision.
            points.extend((if y_up { [x, -z, y] } else { [x, y, z] }).map(|value| value as f32));
        }
    }
    (points.len() >= 12).then_some(points)
}

/// A point after one step of a COLLADA node's place.
fn placed(step: &Node<'_, '_>, [x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
    let with = |count: usize| numbers(*step).filter(|numbers| numbers.len() == count);
    Some(match step.tag_name().name() {
        "matrix" => {
            let m = with(16)?;
            [0, 4, 8].map(|row| m[row] * x + m[row + 1] * y + m[row + 2] * z + m[row + 3])
        }
        "translate" => with(3).map(|m| [x + m[0], y + m[1], z + m[2]])?,
        "scale" => with(3).map(|m| [x * m[0], y * m[1], z * m[2]])?,
        "rotate" => {
            let m = with(4)?;
            let (sin, cos) = (0.5 * m[3].to_radians()).sin_cos();
            crate::rotation::turn([cos, sin * m[0], sin * m[1], sin * m[2]], [x, y, z])
        }
        _ => [x, y, z],
    })
}

fn numbers(node: Node<'_, '_>) -> Option<Vec<f64>> {
    node.text()?.split_ascii_whitespace().map(|word| word.parse().ok()).collect()
}
