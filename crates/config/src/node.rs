//! The tree of values, each with the place where it was written.

use std::sync::Arc;

use serde::de::Unexpected;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use toml::map::Map;

use crate::error::{ConfigError, Place, Source};
use crate::key::dotted;

/// The deepest nesting of tables and arrays that is read; a task file has about five levels.
const MAX_DEPTH: usize = 64;

/// A value and its place: for a table the line of its header or, if it has none, of its first key.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub place: Place,
    pub content: Content,
}

/// What a task file may hold; dates are refused.
#[derive(Clone, Debug)]
pub(crate) enum Content {
    Table(Map<String, Node>),
    Array(Vec<Node>),
    String(String),
    Integer(i64),
    Float(f64),
    Bool(bool),
}

impl Node {
    /// An empty table at the same place.
    pub fn empty(&self) -> Self {
        Self { place: self.place.clone(), content: Content::Table(Map::new()) }
    }

    /// The deepest node on a path, and how many of its segments lead there.
    pub fn descend(&self, path: &[String]) -> (&Self, usize) {
        let mut node = self;
        for (depth, segment) in path.iter().enumerate() {
            let next = match &node.content {
                Content::Table(table) => table.get(segment),
                Content::Array(items) => segment.parse().ok().and_then(|i: usize| items.get(i)),
                _ => None,
            };
            match next {
                Some(next) => node = next,
                None => return (node, depth),
            }
        }
        (node, path.len())
    }

    /// Lays another layer over this one.
    pub fn merge(&mut self, above: Self) {
        match (&mut self.content, above.content) {
            (Content::Table(below), Content::Table(above)) => {
                for (key, value) in above {
                    match below.get_mut(&key) {
                        Some(twin) => twin.merge(value),
                        None => _ = below.insert(key, value),
                    }
                }
            }
            (below, above) => *below = above,
        }
        self.place = above.place;
    }

    /// Lays a value over what stands at `path[depth..]` below this node. What lies on the way keeps its place.
    pub fn set(&mut self, path: &[String], depth: usize, value: Self) -> Result<(), ConfigError> {
        let Some(segment) = path.get(depth) else {
            self.merge(value);
            return Ok(());
        };
        if let Content::Array(items) = &mut self.content {
            let count = items.len();
            let item = segment.parse().ok().and_then(|i: usize| items.get_mut(i));
            let Some(item) = item else {
                let expected = match count {
                    0 => "a value for the whole array, which is empty".to_owned(),
                    1 => "the index 0".to_owned(),
                    _ => format!("an index from 0 to {}", count - 1),
                };
                let fault = ConfigError::unfit(&expected, &format!("{segment:?}"));
                return Err(fault.at(&value.place, &dotted(&path[..depth])));
            };
            return item.set(path, depth + 1, value);
        }
        let empty = value.empty();
        if !matches!(self.content, Content::Table(_)) {
            *self = empty.clone();
        }
        match &mut self.content {
            Content::Table(table) => {
                let below = table.entry(segment.as_str()).or_insert(empty);
                below.set(path, depth + 1, value)
            }
            _ => Ok(()),
        }
    }

    /// What an error message says was found here.
    pub fn unexpected(&self) -> Unexpected<'_> {
        match &self.content {
            Content::Table(_) => Unexpected::Map,
            Content::Array(_) => Unexpected::Seq,
            Content::String(text) => Unexpected::Str(text),
            Content::Integer(number) => Unexpected::Signed(*number),
            Content::Float(number) => Unexpected::Float(*number),
            Content::Bool(truth) => Unexpected::Bool(*truth),
        }
    }
}

/// Reads a text with the place of every value.
pub(crate) struct Reader<'a> {
    source: &'a Arc<Source>,
    /// Byte offsets at which lines begin; none for a `--set`, which has but one line.
    line_starts: Vec<usize>,
}

impl<'a> Reader<'a> {
    /// Reads a whole document.
    pub fn document(source: &'a Arc<Source>, text: &str) -> Result<Node, ConfigError> {
        let newlines = text.match_indices('\n').map(|(at, _)| at + 1);
        let reader = Self { source, line_starts: std::iter::once(0).chain(newlines).collect() };
        let table = DeTable::parse(text).map_err(|error| reader.syntax("", &error))?;
        let content = Content::Table(reader.table(table.into_inner(), &mut Vec::new())?);
        Ok(Node { place: Place { source: Arc::clone(source), line: None }, content })
    }

    /// Reads what a `--set` gives to the key at `path`. What is not a TOML value is a string without its quotes,
    /// `--set map.draw=full`, unless it opens as a quoted string, an array or a table does: then a closing
    /// mark was forgotten.
    pub fn set_value(source: &'a Arc<Source>, path: &[String], text: &str) -> Result<Node, ConfigError> {
        let reader = Self { source, line_starts: Vec::new() };
        match DeValue::parse(text) {
            Ok(value) if !value.get_ref().is_datetime() => reader.value(value, reader.place(0), &mut path.to_vec()),
            Err(error) if text.starts_with(['"', '\'', '[', '{']) => Err(reader.syntax(&dotted(path), &error)),
            _ => Ok(Node { place: reader.place(0), content: Content::String(text.to_owned()) }),
        }
    }

    fn place(&self, offset: usize) -> Place {
        let line = self.line_starts.partition_point(|start| *start <= offset);
        Place { source: Arc::clone(self.source), line: (line > 0).then_some(line) }
    }

    fn syntax(&self, key: &str, error: &toml::de::Error) -> ConfigError {
        let place = self.place(error.span().map_or(0, |span| span.start));
        let problem = format!("not valid TOML: {}", error.message());
        ConfigError::new(Some(&place), key, problem)
    }

    fn table(&self, table: DeTable<'_>, path: &mut Vec<String>) -> Result<Map<String, Node>, ConfigError> {
        let mut nodes = Map::new();
        for (key, value) in table {
            let begin = if value.get_ref().is_table() { key.span().start } else { value.span().start };
            let key = key.into_inner().into_owned();
            path.push(key.clone());
            nodes.insert(key, self.value(value, self.place(begin), path)?);
            path.pop();
        }
        Ok(nodes)
    }

    fn value(&self, value: Spanned<DeValue<'_>>, place: Place, path: &mut Vec<String>) -> Result<Node, ConfigError> {
        let unfit =
            |expected, found: String, path: &[String]| ConfigError::unfit(expected, &found).at(&place, &dotted(path));
        if path.len() > MAX_DEPTH {
            let problem = format!("not valid TOML: nested more than {MAX_DEPTH} deep");
            return Err(ConfigError::new(Some(&place), "", problem));
        }
        let content = match value.into_inner() {
            DeValue::String(text) => Content::String(text.into_owned()),
            DeValue::Boolean(truth) => Content::Bool(truth),
            DeValue::Integer(number) => match i64::from_str_radix(number.as_str(), number.radix()) {
                Ok(number) => Content::Integer(number),
                Err(_) => {
                    let found = format!("the integer {number}");
                    return Err(unfit("an integer of at most 64 bits", found, path));
                }
            },
            DeValue::Float(number) => Content::Float(number.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Datetime(date) => {
                let expected = "a string, number, boolean, array or table";
                return Err(unfit(expected, format!("the date {date}"), path));
            }
            DeValue::Array(items) => {
                let mut nodes = Vec::with_capacity(items.len());
                for (at, item) in items.into_iter().enumerate() {
                    path.push(at.to_string());
                    let place = self.place(item.span().start);
                    nodes.push(self.value(item, place, path)?);
                    path.pop();
                }
                Content::Array(nodes)
            }
            DeValue::Table(table) => Content::Table(self.table(table, path)?),
        };
        Ok(Node { place, content })
    }
}
