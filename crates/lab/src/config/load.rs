//! Following `extends` from a task to the task it stands on.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::{ConfigError, Problem};
use super::merge::{EXTENDS, merge};
use super::node::{Content, Node, Origin, Source};
use super::parse;
use super::path::KeyPath;
use super::suggest::nearest;

/// The longest chain of tasks. Real ones have two or three links.
const MAX_CHAIN: usize = 32;

/// The text of a task, as a resolver finds it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TaskText {
    /// What error messages call it: the path of a file, or `built-in task walking`.
    pub source_name: String,
    /// The TOML text.
    pub text: String,
    /// Where relative paths in it start; `None` if it lies in no directory.
    pub base_dir: Option<PathBuf>,
}

/// Why a resolver has no text for a name.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ResolveError {
    /// Neither a built-in task nor a file.
    Unknown {
        /// The names of the built-in tasks.
        built_in: Vec<String>,
    },
    /// A file that is there, or should be, and cannot be read.
    Unreadable {
        /// The file.
        name: String,
        /// The operating system's words.
        reason: String,
    },
}

/// A resolver over built-in tasks, given as pairs of name and text, and files.
///
/// A name that is built in is that task. Otherwise it is a path, relative to the file that names
/// it, or to the working directory for the first one.
///
/// ```
/// use stridemap_lab::config::{Document, resolver};
///
/// let tasks = [("stepping", "strides = 60"), ("walking", "extends = \"stepping\"")];
/// let document = Document::load("walking", &[], resolver(&tasks)).unwrap();
/// assert_eq!(document.to_toml(), "strides = 60\n");
///
/// let error = Document::load("walkign", &[], resolver(&tasks)).unwrap_err();
/// assert_eq!(
///     error.to_string(),
///     "unknown task \"walkign\"; did you mean \"walking\"? \
///      (built in: stepping, walking; or the path of a file)"
/// );
/// ```
pub fn resolver<'t>(
    built_in: &'t [(&'t str, &'t str)],
) -> impl FnMut(&str, Option<&Path>) -> Result<TaskText, ResolveError> + 't {
    move |name, relative_to| {
        if let Some((name, text)) = built_in.iter().find(|(task, _)| *task == name) {
            return Ok(TaskText {
                source_name: format!("built-in task {name}"),
                text: (*text).to_owned(),
                base_dir: None,
            });
        }
        let file = relative_to.unwrap_or(Path::new("")).join(name);
        if !file.exists() && !name.contains(['/', '\\', '.']) {
            let built_in = built_in.iter().map(|(name, _)| (*name).to_owned());
            return Err(ResolveError::Unknown {
                built_in: built_in.collect(),
            });
        }
        task_text(&file)
    }
}

/// The text of a task file, whose path need not be text itself.
///
/// # Errors
///
/// [`ResolveError::Unreadable`].
pub fn task_text(file: &Path) -> Result<TaskText, ResolveError> {
    let unreadable = |name: String, reason: String| ResolveError::Unreadable { name, reason };
    let name = file.display().to_string();
    let bytes = std::fs::read(file).map_err(|e| unreadable(name.clone(), e.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let good = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + good.iter().filter(|byte| **byte == b'\n').count();
        unreadable(format!("{name}:{line}"), "is no text (UTF-8)".into())
    })?;
    Ok(TaskText {
        source_name: name,
        text,
        base_dir: Some(file.parent().unwrap_or(Path::new("")).to_owned()),
    })
}

/// The merged tree of a task and all it stands on, and their sources, the task's own first.
pub(super) fn load<R>(name: &str, mut resolve: R) -> Result<(Node, Vec<Arc<Source>>), ConfigError>
where
    R: FnMut(&str, Option<&Path>) -> Result<TaskText, ResolveError>,
{
    let mut layers: Vec<Node> = Vec::new();
    let mut sources: Vec<Arc<Source>> = Vec::new();
    let mut next = Some((name.to_owned(), None::<Origin>));
    while let Some((name, named_at)) = next {
        let fault = |problem| {
            let path = match named_at {
                Some(_) => KeyPath::from(vec![EXTENDS.to_owned()]),
                None => KeyPath::default(),
            };
            ConfigError::new(named_at.clone(), path, problem)
        };
        let relative_to = named_at.as_ref().and_then(super::node::base_dir);
        let task = resolve(&name, relative_to).map_err(|error| fault(unresolved(&name, error)))?;
        let source = Arc::new(Source {
            name: task.source_name,
            base_dir: task.base_dir,
        });
        let again = sources.contains(&source);
        sources.push(Arc::clone(&source));
        if again {
            let chain = sources.iter().map(|source| source.name.clone()).collect();
            return Err(fault(Problem::Cycle { chain }));
        }
        if sources.len() > MAX_CHAIN {
            return Err(fault(Problem::ChainTooLong { limit: MAX_CHAIN }));
        }
        let mut layer = parse::document(&source, &task.text)?;
        next = take_extends(&mut layer)?;
        layers.push(layer);
    }
    let mut layers = layers.into_iter().rev();
    let Some(mut root) = layers.next() else {
        return Err(ConfigError::here(unresolved(
            name,
            ResolveError::Unknown {
                built_in: Vec::new(),
            },
        )));
    };
    for layer in layers {
        merge(&mut root, layer);
    }
    Ok((root, sources))
}

fn take_extends(layer: &mut Node) -> Result<Option<(String, Option<Origin>)>, ConfigError> {
    let Content::Table(table) = &mut layer.content else {
        return Ok(None);
    };
    let Some(entry) = table.remove(EXTENDS) else {
        return Ok(None);
    };
    match entry.value.as_str() {
        Some(name) => Ok(Some((name.to_owned(), Some(entry.value.origin)))),
        None => {
            let error = ConfigError::wrong_type(&entry.value, "the name of a task or a file");
            Err(error.at(&entry.value).inside(EXTENDS))
        }
    }
}

fn unresolved(name: &str, error: ResolveError) -> Problem {
    match error {
        ResolveError::Unknown { built_in } => Problem::UnknownTask {
            found: name.to_owned(),
            nearest: nearest(name, &built_in).map(str::to_owned),
            allowed: built_in,
        },
        ResolveError::Unreadable { name, reason } => Problem::Unreadable { name, reason },
    }
}
