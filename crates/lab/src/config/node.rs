//! The tree of values, each with the place it came from.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::path::KeyPath;

/// A text that values came from: a file, a built-in task, or one `--set` argument.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Source {
    /// What an error message calls it: `my-robot.toml`, `built-in task walking`, `--set a.b=1`.
    pub name: String,
    /// Where relative paths in it start; `None` for a text that lies in no directory.
    pub base_dir: Option<PathBuf>,
}

/// Where a value or a key was written.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Origin {
    /// The text.
    pub source: Arc<Source>,
    /// The line in it, from 1; `None` for a whole text and for a `--set`, which has but one line.
    pub line: Option<usize>,
}

impl Origin {
    /// A place without a line: the text as a whole.
    #[must_use]
    pub fn whole(source: &Arc<Source>) -> Self {
        Self {
            source: Arc::clone(source),
            line: None,
        }
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) => write!(f, "{}:{line}", self.source.name),
            None => f.write_str(&self.source.name),
        }
    }
}

/// A value and the place where it was written.
#[derive(Clone, Debug)]
pub struct Node {
    /// The value.
    pub content: Content,
    /// The place: for a table the line of its header or, if it has none, of its first key.
    pub origin: Origin,
}

/// The kinds of value that a task file may hold. TOML's dates are refused, and so is `nan`.
#[derive(Clone, Debug)]
pub enum Content {
    /// `[table]` or `{ inline = "table" }`.
    Table(Table),
    /// `[1, 2]`, or the tables under one `[[name]]`.
    Array(Vec<Node>),
    /// `"text"`.
    String(String),
    /// `3`.
    Integer(i64),
    /// `3.0`, never NaN.
    Float(f64),
    /// `true` or `false`.
    Bool(bool),
}

/// Keys and values in the order in which they were written. No key occurs twice.
#[derive(Clone, Debug, Default)]
pub struct Table {
    pub(super) entries: Vec<Entry>,
}

/// One key of a table.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The key, without quotes.
    pub key: String,
    /// Where the key was written.
    pub key_origin: Origin,
    /// Its value.
    pub value: Node,
}

impl Table {
    /// The entries in the order in which they were written.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The entry with this key.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    pub(super) fn get_mut(&mut self, key: &str) -> Option<&mut Entry> {
        self.entries.iter_mut().find(|entry| entry.key == key)
    }

    /// Takes an entry out.
    pub(super) fn remove(&mut self, key: &str) -> Option<Entry> {
        let at = self.entries.iter().position(|entry| entry.key == key)?;
        Some(self.entries.remove(at))
    }
}

impl Node {
    /// The node at a path below this one; a segment counts from 0 in an array.
    #[must_use]
    pub fn get(&self, path: &KeyPath) -> Option<&Node> {
        let (found, rest) = self.descend(path.segments());
        rest.is_empty().then_some(found)
    }

    /// Follows a path as far as it goes: the last node that exists, and what is left of the path.
    pub(super) fn descend<'p>(&self, path: &'p [String]) -> (&Node, &'p [String]) {
        let Some((first, rest)) = path.split_first() else {
            return (self, path);
        };
        match self.child(first) {
            Some(child) => child.descend(rest),
            None => (self, path),
        }
    }

    fn child(&self, segment: &str) -> Option<&Node> {
        match &self.content {
            Content::Table(table) => table.get(segment).map(|entry| &entry.value),
            Content::Array(items) => items.get(segment.parse::<usize>().ok()?),
            _ => None,
        }
    }

    /// The string, if it is one.
    #[must_use]
    pub fn as_str(&self) -> Option<&str> {
        match &self.content {
            Content::String(text) => Some(text),
            _ => None,
        }
    }

    /// The table, if it is one.
    #[must_use]
    pub fn as_table(&self) -> Option<&Table> {
        match &self.content {
            Content::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The array, if it is one.
    #[must_use]
    pub fn as_array(&self) -> Option<&[Node]> {
        match &self.content {
            Content::Array(items) => Some(items),
            _ => None,
        }
    }

    /// Whether two trees hold the same values: floats bit for bit, tables whatever the order of
    /// their keys, and wherever they came from. The integer `1` is not the float `1.0`.
    #[must_use]
    pub fn same_value(&self, other: &Node) -> bool {
        match (&self.content, &other.content) {
            (Content::Table(a), Content::Table(b)) => {
                let sorted = |table: &'_ Table| {
                    let mut entries: Vec<usize> = (0..table.entries.len()).collect();
                    entries.sort_by_key(|&at| &table.entries[at].key);
                    entries
                };
                a.entries.len() == b.entries.len()
                    && sorted(a).into_iter().zip(sorted(b)).all(|(i, j)| {
                        let (a, b) = (&a.entries[i], &b.entries[j]);
                        a.key == b.key && a.value.same_value(&b.value)
                    })
            }
            (Content::Array(a), Content::Array(b)) => {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.same_value(b))
            }
            (Content::String(a), Content::String(b)) => a == b,
            (Content::Integer(a), Content::Integer(b)) => a == b,
            (Content::Float(a), Content::Float(b)) => a.to_bits() == b.to_bits(),
            (Content::Bool(a), Content::Bool(b)) => a == b,
            _ => false,
        }
    }

    /// What an error message says was found here.
    pub(super) fn describe(&self) -> String {
        match &self.content {
            Content::Table(_) => "a table".to_owned(),
            Content::Array(_) => "an array".to_owned(),
            Content::String(text) => describe_string(text),
            Content::Integer(value) => describe_integer(value),
            Content::Float(value) => describe_float(*value),
            Content::Bool(value) => describe_bool(*value),
        }
    }
}

/// The directory of a source, as a place where relative paths start.
pub(super) fn base_dir(origin: &Origin) -> Option<&Path> {
    origin.source.base_dir.as_deref()
}

/// A message quotes this many characters of a string.
const QUOTED: usize = 80;

pub(super) fn describe_string(text: &str) -> String {
    match text.char_indices().nth(QUOTED) {
        Some((end, _)) => format!("a string that begins {:?}", &text[..end]),
        None => format!("the string {text:?}"),
    }
}

pub(super) fn describe_integer(value: impl fmt::Display) -> String {
    format!("the integer {value}")
}

pub(super) fn describe_float(value: f64) -> String {
    format!("the number {value:?}")
}

pub(super) fn describe_bool(value: bool) -> String {
    format!("the boolean {value}")
}
