//! What can be wrong with a task file, and how it is said.

use std::fmt;

use super::node::{Content, Node, Origin, describe_string};
use super::path::KeyPath;
use super::suggest::nearest;

/// One fault of a configuration: where, which key, what is wrong.
///
/// ```
/// use stridemap_lab::config::{Document, Problem};
///
/// #[derive(Debug, serde::Deserialize)]
/// struct Robot { friction: f64 }
///
/// let document = Document::parse("my-robot.toml", "\nfrictoin = 0.7").unwrap();
/// let error = document.deserialize::<Robot>().unwrap_err();
/// assert_eq!(
///     error.to_string(),
///     "my-robot.toml:2: frictoin: unknown key; did you mean `friction`? (allowed: friction)"
/// );
/// assert_eq!(error.origin().unwrap().line, Some(2));
/// assert!(matches!(error.problem(), Problem::UnknownKey { .. }));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigError(Box<Report>);

#[derive(Clone, Debug, PartialEq)]
struct Report {
    origin: Option<Origin>,
    key_path: KeyPath,
    problem: Problem,
}

/// The kinds of fault.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Problem {
    /// The table has no such key.
    UnknownKey {
        /// The keys that it may have.
        allowed: Vec<String>,
        /// The one that was probably meant.
        nearest: Option<String>,
    },
    /// The string is not one of those that may stand here.
    UnknownValue {
        /// The string found.
        found: String,
        /// The strings that may stand here.
        allowed: Vec<String>,
        /// The one that was probably meant.
        nearest: Option<String>,
    },
    /// A key without a default is missing.
    MissingKey {
        /// The values it may have, where they are few and known.
        allowed: Vec<String>,
    },
    /// A value of the wrong kind.
    WrongType {
        /// The kind that may stand here, in words.
        expected: String,
        /// The value found, in words.
        found: String,
    },
    /// A value of the right kind that may not stand here.
    OutOfRange {
        /// The values that may stand here, in words.
        expected: String,
        /// The value found, in words.
        found: String,
    },
    /// An array with too few or too many values.
    WrongLength {
        /// The length that is needed, in words.
        expected: String,
        /// The length found.
        found: usize,
    },
    /// A value is written `nan`, which no parameter can be.
    NotANumber,
    /// The text is not TOML, or a `--set` is not `KEY=VALUE`.
    Syntax {
        /// The parser's words.
        message: String,
    },
    /// A value that the rules of another module refuse.
    Invalid {
        /// That module's words.
        message: String,
    },
    /// A task that is neither built in nor a file.
    UnknownTask {
        /// The name asked for.
        found: String,
        /// The names of the built-in tasks.
        allowed: Vec<String>,
        /// The one that was probably meant.
        nearest: Option<String>,
    },
    /// A file that cannot be read.
    Unreadable {
        /// The file.
        name: String,
        /// The operating system's words.
        reason: String,
    },
    /// A file that, over its `extends`, extends itself.
    Cycle {
        /// From the first file to the one that closes the circle.
        chain: Vec<String>,
    },
    /// So many files extend one another that it must be a mistake.
    ChainTooLong {
        /// The number of files that may.
        limit: usize,
    },
}

impl ConfigError {
    pub(super) fn new(origin: Option<Origin>, key_path: KeyPath, problem: Problem) -> Self {
        Self(Box::new(Report {
            origin,
            key_path,
            problem,
        }))
    }

    /// A fault whose place is filled in on the way up.
    pub(super) fn here(problem: Problem) -> Self {
        Self::new(None, KeyPath::default(), problem)
    }

    pub(super) fn wrong_type(node: &Node, expected: &str) -> Self {
        Self::here(Problem::WrongType {
            expected: expected.to_owned(),
            found: node.describe(),
        })
    }

    pub(super) fn unknown_key<S: AsRef<str>>(key: &str, allowed: &[S]) -> Self {
        let path = KeyPath::from(vec![key.to_owned()]);
        Self::new(
            None,
            path,
            Problem::UnknownKey {
                nearest: nearest(key, allowed).map(str::to_owned),
                allowed: owned(allowed),
            },
        )
    }

    /// Where the fault is; `None` only if there is no text yet (a task that is not found).
    #[must_use]
    pub fn origin(&self) -> Option<&Origin> {
        self.0.origin.as_ref()
    }

    /// The key at fault; the root if it is none in particular.
    #[must_use]
    pub fn key_path(&self) -> &KeyPath {
        &self.0.key_path
    }

    /// What is wrong.
    #[must_use]
    pub fn problem(&self) -> &Problem {
        &self.0.problem
    }

    pub(super) fn with_origin(mut self, origin: &Origin) -> Self {
        self.0.origin.get_or_insert_with(|| origin.clone());
        self
    }

    /// One level up: the fault lies below this key.
    pub(super) fn inside(mut self, segment: impl Into<String>) -> Self {
        self.0.key_path.prepend(segment.into());
        self
    }

    /// Several levels up.
    pub(super) fn below(self, path: &KeyPath) -> Self {
        let keys = path.segments().iter().rev();
        keys.fold(self, |error, key| error.inside(key))
    }

    /// Gives a fault that has no place yet its place at or below `node`.
    ///
    /// Serde's own buffers (internally tagged and untagged enums) drop positions. What is left is
    /// the name of the key, or the value found: if it occurs once below `node`, that is the place;
    /// otherwise the place is `node`.
    pub(super) fn at(mut self, node: &Node) -> Self {
        if self.0.origin.is_some() {
            return self;
        }
        let mut places = Vec::new();
        match &self.0.problem {
            Problem::UnknownKey { .. } => {
                if let [key] = self.0.key_path.segments() {
                    keys_named(node, key, &mut Vec::new(), &mut places);
                }
            }
            Problem::UnknownValue { found, .. } => {
                values_like(node, &describe_string(found), &mut Vec::new(), &mut places);
            }
            Problem::WrongType { found, .. } | Problem::OutOfRange { found, .. } => {
                values_like(node, found, &mut Vec::new(), &mut places);
            }
            _ => {}
        }
        if let [(path, origin)] = places.as_slice() {
            self.0.key_path = KeyPath::from(path.clone());
            self.0.origin = Some(origin.clone());
        }
        self.with_origin(&node.origin)
    }
}

fn keys_named(
    node: &Node,
    key: &str,
    path: &mut Vec<String>,
    places: &mut Vec<(Vec<String>, Origin)>,
) {
    walk(node, path, &mut |entry_key, origin, _, path| {
        if entry_key == Some(key) {
            places.push((path.to_vec(), origin.clone()));
        }
    });
}

fn values_like(
    node: &Node,
    found: &str,
    path: &mut Vec<String>,
    places: &mut Vec<(Vec<String>, Origin)>,
) {
    walk(node, path, &mut |_, _, value, path| {
        if value.describe() == found {
            places.push((path.to_vec(), value.origin.clone()));
        }
    });
}

/// Calls `visit(key, origin of the key, value, path)` for everything below a node.
pub(crate) fn walk(
    node: &Node,
    path: &mut Vec<String>,
    visit: &mut impl FnMut(Option<&str>, &Origin, &Node, &[String]),
) {
    match &node.content {
        Content::Table(table) => {
            for entry in table.entries() {
                path.push(entry.key.clone());
                visit(Some(&entry.key), &entry.key_origin, &entry.value, path);
                walk(&entry.value, path, visit);
                path.pop();
            }
        }
        Content::Array(items) => {
            for (at, item) in items.iter().enumerate() {
                path.push(at.to_string());
                visit(None, &item.origin, item, path);
                walk(item, path, visit);
                path.pop();
            }
        }
        _ => {}
    }
}

pub(super) fn owned<S: AsRef<str>>(names: &[S]) -> Vec<String> {
    names.iter().map(|name| name.as_ref().to_owned()).collect()
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Report {
            origin,
            key_path,
            problem,
        } = self.0.as_ref();
        if let Some(origin) = origin {
            write!(f, "{origin}: ")?;
        }
        if !key_path.is_root() {
            write!(f, "{key_path}")?;
            if let Problem::UnknownValue { found, .. } | Problem::UnknownTask { found, .. } =
                problem
            {
                write!(f, " = {found:?}")?;
            }
            f.write_str(": ")?;
        }
        match problem {
            Problem::UnknownKey { allowed, nearest } => {
                f.write_str("unknown key")?;
                if let Some(nearest) = nearest {
                    write!(f, "; did you mean `{nearest}`?")?;
                }
                list(f, allowed, " (no key is allowed here)")
            }
            Problem::UnknownValue {
                found,
                allowed,
                nearest,
            } => {
                f.write_str("unknown value")?;
                if key_path.is_root() {
                    write!(f, " {found:?}")?;
                }
                meant(f, nearest.as_deref())?;
                list(f, allowed, "")
            }
            Problem::MissingKey { allowed } => {
                f.write_str("missing key")?;
                list(f, allowed, "")
            }
            Problem::WrongType { expected, found } | Problem::OutOfRange { expected, found } => {
                write!(f, "expected {expected}, found {found}")
            }
            Problem::WrongLength { expected, found } => {
                let values = if *found == 1 { "value" } else { "values" };
                write!(f, "expected {expected}, found {found} {values}")
            }
            Problem::NotANumber => f.write_str("expected a number, found nan"),
            Problem::Syntax { message } => write!(f, "not valid TOML: {message}"),
            Problem::Invalid { message } => f.write_str(message),
            Problem::UnknownTask {
                found,
                allowed,
                nearest,
            } => {
                f.write_str("unknown task")?;
                if key_path.is_root() {
                    write!(f, " {found:?}")?;
                }
                meant(f, nearest.as_deref())?;
                if allowed.is_empty() {
                    return Ok(());
                }
                write!(
                    f,
                    " (built in: {}; or the path of a file)",
                    allowed.join(", ")
                )
            }
            Problem::Unreadable { name, reason } => write!(f, "cannot read {name}: {reason}"),
            Problem::Cycle { chain } => {
                write!(f, "a task extends itself: {}", chain.join(" -> "))
            }
            Problem::ChainTooLong { limit } => {
                write!(f, "more than {limit} tasks extend one another")
            }
        }
    }
}

fn meant(f: &mut fmt::Formatter<'_>, nearest: Option<&str>) -> fmt::Result {
    match nearest {
        Some(nearest) => write!(f, "; did you mean {nearest:?}?"),
        None => Ok(()),
    }
}

fn list(f: &mut fmt::Formatter<'_>, allowed: &[String], none: &str) -> fmt::Result {
    if allowed.is_empty() {
        return f.write_str(none);
    }
    write!(f, " (allowed: {})", allowed.join(", "))
}

impl std::error::Error for ConfigError {}
