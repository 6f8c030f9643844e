//! Compiled models, so that each is compiled once: kept in this process, and on disk where meshes or other assets
//! make compiling slow.
//!
//! An entry on disk is named by the SHA-256 of everything that went into it: MuJoCo's version, the machine, and
//! path and bytes of the model and of every file that it names. It carries the SHA-256 of its own content; what
//! does not fit is compiled anew. Entries lie in `$XDG_CACHE_HOME/stridemap/models` (or `~/.cache/...`), together
//! at most [`MOST_BYTES`]; the oldest give way, and any may be deleted at any time.

use std::collections::BTreeSet;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use mujoco_rs::prelude::MjModel;
use sha2::{Digest, Sha256};

use crate::config::{Missing, ModelSource};
use crate::engine::{bytes, compile, mujoco_version, sha256};
use crate::error::MujocoError;

/// First line of an entry: what it is, and in which format.
const MAGIC: &[u8] = b"stridemap compiled model 1\n";
/// Most bytes of all entries together.
const MOST_BYTES: u64 = 1 << 30;
/// Places of files that are looked at; a model that needs more is compiled anew each time.
const MOST_FILES: usize = 10_000;

/// The last model of this process, and what its files looked like before it was read.
struct Kept {
    source: ModelSource,
    added: Vec<Missing>,
    seen: Vec<(PathBuf, Option<Look>)>,
    model: Arc<MjModel>,
}

/// What tells a file from another or changed one without reading it: device, inode, length, times of change.
type Look = [i64; 7];

/// Everything that a model is made of.
struct Inputs {
    /// Every path where a named file may lie, whether there is one or not: the model itself first.
    candidates: Vec<PathBuf>,
    /// Whether there is more than XML.
    has_assets: bool,
}

/// A model as MuJoCo compiles it, meshes included and without overrides: as a file `*.mjb` it stands for the
/// original wherever a model file is named, in this version of MuJoCo.
///
/// # Errors
///
/// [`MujocoError::Load`].
pub fn compiled(source: &ModelSource, added: &[Missing]) -> Result<Vec<u8>, MujocoError> {
    let model = load(source, added)?;
    bytes(&model)
}

/// Loads a model as it is, compiled at most once as long as nothing that it is made of changes.
pub(crate) fn load(source: &ModelSource, added: &[Missing]) -> Result<Arc<MjModel>, MujocoError> {
    static KEPT: Mutex<Option<Kept>> = Mutex::new(None);
    // Held while compiling: others that want the same model need not compile it as well.
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    let inputs = match source {
        ModelSource::File(path) if added.contains(&Missing::Meshes) => {
            Some(Inputs { candidates: vec![path.clone()], has_assets: false })
        }
        ModelSource::File(path) => inputs(path),
        ModelSource::Biped | ModelSource::Op3 => Some(Inputs { candidates: Vec::new(), has_assets: false }),
    };
    let Some(inputs) = inputs else {
        return compile(source, added).map(Arc::new);
    };
    let seen: Vec<_> = (inputs.candidates.iter()).map(|path| (path.clone(), look(path))).collect();
    if let Some(kept) = &*kept
        && kept.source == *source
        && kept.added == added
        && kept.seen == seen
    {
        return Ok(Arc::clone(&kept.model));
    }
    let dir = directory().filter(|_| inputs.has_assets);
    let model = Arc::new(match dir {
        Some(dir) => through(&dir, &inputs.candidates, added, || compile(source, added))?,
        None => compile(source, added)?,
    });
    *kept = Some(Kept { source: source.clone(), added: added.to_vec(), seen, model: Arc::clone(&model) });
    Ok(model)
}

/// Where entries lie; `None` for a user without a home.
fn directory() -> Option<PathBuf> {
    Some(stridemap_files::cache_dir()?.join("models"))
}

fn look(path: &Path) -> Option<Look> {
    let of = std::fs::metadata(path).ok()?;
    Some([
        of.dev().cast_signed(),
        of.ino().cast_signed(),
        of.size().cast_signed(),
        of.mtime(),
        of.mtime_nsec(),
        of.ctime(),
        of.ctime_nsec(),
    ])
}

/// Every path where a file of this name may lie: MuJoCo looks in some of them, by rules of its own.
fn places(name: &str, bases: &BTreeSet<PathBuf>, sub_dirs: &BTreeSet<String>) -> Vec<PathBuf> {
    let bare = Path::new(name).file_name().unwrap_or_default();
    let dirs = bases.iter().flat_map(|base| sub_dirs.iter().map(|sub| base.join(sub)));
    let mut all: Vec<PathBuf> = dirs.flat_map(|dir| [dir.join(name), dir.join(bare)]).collect();
    all.sort();
    all.dedup();
    all
}

/// Every file that a model names, by itself or through others; `None` if that cannot be told: a file that is
/// found nowhere, a plugin, XML that cannot be read.
fn inputs(model: &Path) -> Option<Inputs> {
    if model.extension().is_some_and(|kind| kind == "mjb") {
        return Some(Inputs { candidates: vec![model.to_path_buf()], has_assets: false });
    }
    if crate::foreign::is_urdf(model) {
        return Some(Inputs { candidates: crate::foreign::urdf_files(model)?, has_assets: true });
    }
    let mut unread = vec![model.to_path_buf()];
    let mut read = BTreeSet::new();
    let (mut xml, mut assets) = (BTreeSet::new(), BTreeSet::new());
    let mut bases = BTreeSet::new();
    let mut sub_dirs = BTreeSet::from([String::new()]);
    while let Some(path) = unread.pop() {
        if !read.insert(path.clone()) {
            continue;
        }
        let text = std::fs::read_to_string(&path).ok()?;
        let document = roxmltree::Document::parse(&text).ok()?;
        bases.insert(path.parent()?.to_path_buf());
        for node in document.descendants().filter(roxmltree::Node::is_element) {
            let tag = node.tag_name().name();
            if matches!(tag, "plugin" | "extension") {
                return None;
            }
            for attribute in node.attributes() {
                let value = attribute.value().to_owned();
                match attribute.name() {
                    "meshdir" | "texturedir" | "assetdir" => {
                        sub_dirs.insert(value);
                    }
                    name if !name.starts_with("file") || value.is_empty() => {}
                    _ if matches!(tag, "include" | "model") => {
                        xml.insert(value);
                    }
                    _ => {
                        assets.insert(value);
                    }
                }
            }
        }
        let parts = xml.iter().flat_map(|name| places(name, &bases, &sub_dirs));
        unread.extend(parts.filter(|path| path.is_file() && !read.contains(path)));
        if read.len() > MOST_FILES {
            return None;
        }
    }
    let mut candidates = vec![model.to_path_buf()];
    for name in xml.iter().chain(&assets) {
        let places = places(name, &bases, &sub_dirs);
        if !places.iter().any(|path| path.is_file()) {
            return None;
        }
        candidates.extend(places);
        if candidates.len() > MOST_FILES {
            return None;
        }
    }
    Some(Inputs { candidates, has_assets: !assets.is_empty() })
}

/// Takes a model from the entries of a directory, or compiles it and adds it there. Whatever goes wrong with the
/// entries only costs time.
fn through(
    dir: &Path,
    inputs: &[PathBuf],
    added: &[Missing],
    compile: impl FnOnce() -> Result<MjModel, MujocoError>,
) -> Result<MjModel, MujocoError> {
    let Some(entry) = key(inputs, added).map(|key| dir.join(key + ".mjb")) else {
        return compile();
    };
    if let Some(model) = read(&entry) {
        return Ok(model);
    }
    let model = compile()?;
    // Nothing changed while it was compiled, or the entry would lie.
    if key(inputs, added).is_some_and(|key| entry.file_stem() == Some(key.as_ref())) {
        // An entry that cannot be written costs the next start some time, nothing else.
        let _ = write(&entry, &model);
    }
    Ok(model)
}

/// The name of the entry for these files; `None` if one cannot be read.
fn key(inputs: &[PathBuf], added: &[Missing]) -> Option<String> {
    let mut parts = MAGIC.to_vec();
    parts.extend(format!("{added:?} {}", crate::foreign::RECIPE).into_bytes());
    for word in [mujoco_version(), std::env::consts::ARCH, std::env::consts::OS] {
        parts.extend(word.as_bytes());
        parts.push(0);
    }
    for path in inputs.iter().filter(|path| path.is_file()) {
        parts.extend(std::path::absolute(path).ok()?.as_os_str().as_encoded_bytes());
        parts.push(0);
        parts.extend(Sha256::digest(std::fs::read(path).ok()?));
    }
    Some(sha256(&parts))
}

/// An entry's model; `None` if there is none, or not one that this program wrote whole.
fn read(entry: &Path) -> Option<MjModel> {
    let bytes = std::fs::read(entry).ok()?;
    let rest = bytes.strip_prefix(MAGIC)?;
    let (digest, model) = rest.split_at_checked(32)?;
    (Sha256::digest(model).as_slice() == digest).then_some(())?;
    MjModel::from_buffer(model).ok()
}

/// Writes an entry beside the others and under its name at the end, then makes room.
fn write(entry: &Path, model: &MjModel) -> std::io::Result<()> {
    let mut bytes = vec![0; model.size()];
    if model.save_to_buffer(&mut bytes).is_err() || bytes.len() as u64 > MOST_BYTES {
        return Ok(());
    }
    let dir = entry.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(dir)?;
    let mut file = tempfile::NamedTempFile::new_in(dir)?;
    for part in [MAGIC, Sha256::digest(&bytes).as_slice(), &bytes] {
        std::io::Write::write_all(&mut file, part)?;
    }
    file.persist(entry)?;
    make_room(dir)
}

/// Removes the oldest entries until the rest is within its bound.
fn make_room(dir: &Path) -> std::io::Result<()> {
    let mut entries: Vec<_> = std::fs::read_dir(dir)?
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let of = path.metadata().ok()?;
            Some((of.modified().ok()?, of.len(), path))
        })
        .collect();
    entries.sort();
    let mut bytes: u64 = entries.iter().map(|(_, len, _)| len).sum();
    for (_, len, path) in entries {
        if bytes <= MOST_BYTES {
            break;
        }
        std::fs::remove_file(path)?;
        bytes -= len;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

    /// A model of two files and a mesh; entries go to `kept`.
    fn project(dir: &Path) -> PathBuf {
        std::fs::create_dir_all(dir.join("meshes")).unwrap();
        std::fs::write(dir.join("meshes/cube.obj"), CUBE).unwrap();
        let part = "<mujoco><asset><mesh name=\"cube\" file=\"cube.obj\"/></asset></mujoco>";
        std::fs::write(dir.join("part.xml"), part).unwrap();
        let model = "<mujoco><compiler meshdir=\"meshes\"/><include file=\"part.xml\"/>\
                     <worldbody><geom type=\"mesh\" mesh=\"cube\"/></worldbody></mujoco>";
        std::fs::write(dir.join("model.xml"), model).unwrap();
        dir.join("model.xml")
    }

    fn bytes(model: &MjModel) -> Vec<u8> {
        let mut bytes = vec![0; model.size()];
        model.save_to_buffer(&mut bytes).unwrap();
        bytes
    }

    /// Loads through the entries in `kept`; says whether it had to compile.
    fn taken(model: &Path, kept: &Path) -> (bool, Vec<u8>) {
        let mut compiled = false;
        let model = through(kept, &inputs(model).unwrap().candidates, &[], || {
            compiled = true;
            compile(&ModelSource::File(model.into()), &[])
        });
        (compiled, bytes(&model.unwrap()))
    }

    #[test]
    fn a_model_is_compiled_once_and_again_when_anything_in_it_changes() {
        let dir = tempfile::tempdir().unwrap();
        let (model, kept) = (project(dir.path()), dir.path().join("kept"));
        let first = taken(&model, &kept);
        assert!(first.0);
        assert_eq!(taken(&model, &kept), (false, first.1.clone()), "the same to the byte");
        let mesh = dir.path().join("meshes/cube.obj");
        std::fs::write(&mesh, CUBE.replace("v 1 0 0", "v 2 0 0")).unwrap();
        let changed = taken(&model, &kept);
        assert!(changed.0 && changed.1 != first.1);
        std::fs::write(&mesh, CUBE).unwrap();
        // Damaged in the middle, cut, foreign: compiled anew, and mended.
        let entry = kept.join(key(&inputs(&model).unwrap().candidates, &[]).unwrap() + ".mjb");
        let good = std::fs::read(&entry).unwrap();
        let mut damaged = good.clone();
        damaged[good.len() / 2] ^= 1;
        for bad in [&damaged[..], &good[..good.len() / 2], b"something else", b""] {
            std::fs::write(&entry, bad).unwrap();
            assert_eq!(taken(&model, &kept), (true, first.1.clone()));
            assert_eq!(std::fs::read(&entry).unwrap(), good);
        }
        // Where no entry can be written the model is there all the same.
        assert_eq!(taken(&model, &mesh.join("no/dir")), (true, first.1));
    }

    #[test]
    fn what_a_model_is_made_of_is_found_or_it_is_not_kept() {
        let dir = tempfile::tempdir().unwrap();
        let model = project(dir.path());
        let found = inputs(&model).unwrap();
        let files: Vec<_> = found.candidates.iter().filter(|path| path.is_file()).collect();
        assert!(found.has_assets && files.len() == 3, "{files:?}");
        std::fs::remove_file(dir.path().join("meshes/cube.obj")).unwrap();
        assert!(inputs(&model).is_none());
    }

    #[test]
    fn a_process_compiles_a_model_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.xml");
        let write = |size: &str| {
            let text = format!("<mujoco><worldbody><geom size=\"{size}\"/></worldbody></mujoco>");
            std::fs::write(&path, text).unwrap();
        };
        let source = ModelSource::File(path.clone());
        write("1");
        let (first, again) = (load(&source, &[]).unwrap(), load(&source, &[]).unwrap());
        write("2");
        let changed = load(&source, &[]).unwrap();
        assert!((changed.geom_size()[0][0] - 2.0).abs() < 1e-12);
        assert!((first.geom_size()[0][0] - again.geom_size()[0][0]).abs() < 1e-12);
    }
}
