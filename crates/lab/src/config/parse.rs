//! From TOML text to a tree with positions.

use std::sync::Arc;

use toml::Spanned;
use toml::de::{DeInteger, DeTable, DeValue};

use super::error::{ConfigError, Problem};
use super::node::{Content, Entry, Node, Origin, Source, Table, describe_integer};
use super::path::{KeyPath, MAX_DEPTH};

/// Reads a whole document.
pub(super) fn document(source: &Arc<Source>, text: &str) -> Result<Node, ConfigError> {
    let places = Places::new(source, text);
    let table = DeTable::parse(text).map_err(|error| places.syntax(&error))?;
    let mut path = Vec::new();
    let table = places.table(table.into_inner(), &mut path)?;
    Ok(Node {
        content: Content::Table(table),
        origin: Origin::whole(source),
    })
}

/// Reads the value that a `--set` gives to the key at `path`.
///
/// What is not a TOML value is a string without its quotes, `--set map.sample=full`, unless it
/// opens as a quoted string, an array or a table does: then a closing mark was forgotten.
pub(super) fn set_value(
    source: &Arc<Source>,
    path: &KeyPath,
    text: &str,
) -> Result<Node, ConfigError> {
    let text = text.trim();
    let places = Places {
        source,
        line_starts: None,
    };
    let bare = |text: &str| Node {
        content: Content::String(text.to_owned()),
        origin: Origin::whole(source),
    };
    match DeValue::parse(text) {
        Ok(value) if value.get_ref().is_datetime() => Ok(bare(text)),
        Ok(value) => places.value(value, &mut path.segments().to_vec()),
        Err(error) if text.starts_with(['"', '\'', '[', '{']) => {
            Err(places.syntax(&error).below(path))
        }
        Err(_) => Ok(bare(text)),
    }
}

struct Places<'a> {
    source: &'a Arc<Source>,
    /// Byte offsets at which lines begin; `None` for a text that has no lines.
    line_starts: Option<Vec<usize>>,
}

impl<'a> Places<'a> {
    fn new(source: &'a Arc<Source>, text: &str) -> Self {
        let newlines = text.match_indices('\n').map(|(at, _)| at + 1);
        Self {
            source,
            line_starts: Some(std::iter::once(0).chain(newlines).collect()),
        }
    }

    fn origin(&self, offset: usize) -> Origin {
        let line = |starts: &Vec<usize>| starts.partition_point(|start| *start <= offset);
        Origin {
            source: Arc::clone(self.source),
            line: self.line_starts.as_ref().map(line),
        }
    }

    fn syntax(&self, error: &toml::de::Error) -> ConfigError {
        let origin = match error.span() {
            Some(span) => self.origin(span.start),
            None => Origin::whole(self.source),
        };
        let message = error.message().to_owned();
        ConfigError::new(
            Some(origin),
            KeyPath::default(),
            Problem::Syntax { message },
        )
    }

    fn table(&self, table: DeTable<'_>, path: &mut Vec<String>) -> Result<Table, ConfigError> {
        // The parser sorts keys; the reader of a resolved file wants them as they were written.
        let mut pairs: Vec<_> = table.into_iter().collect();
        pairs.sort_by_key(|(key, _)| key.span().start);
        let mut entries = Vec::with_capacity(pairs.len());
        for (key, value) in pairs {
            let key_origin = self.origin(key.span().start);
            let key = key.into_inner().into_owned();
            path.push(key.clone());
            let mut value = self.value(value, path)?;
            path.pop();
            if matches!(value.content, Content::Table(_)) {
                value.origin = key_origin.clone();
            }
            entries.push(Entry {
                key,
                key_origin,
                value,
            });
        }
        Ok(Table { entries })
    }

    fn value(
        &self,
        value: Spanned<DeValue<'_>>,
        path: &mut Vec<String>,
    ) -> Result<Node, ConfigError> {
        let origin = self.origin(value.span().start);
        let fault = |problem, path: &[String]| {
            let path = KeyPath::from(path.to_vec());
            ConfigError::new(Some(origin.clone()), path, problem)
        };
        if path.len() > MAX_DEPTH {
            let message = format!("nested more than {MAX_DEPTH} deep");
            return Err(fault(Problem::Syntax { message }, &[]));
        }
        let content = match value.into_inner() {
            DeValue::String(text) => Content::String(text.into_owned()),
            DeValue::Boolean(value) => Content::Bool(value),
            DeValue::Integer(value) => {
                let problem = || Problem::OutOfRange {
                    expected: "an integer of at most 64 bits".to_owned(),
                    found: describe_integer(&value),
                };
                Content::Integer(integer(&value).ok_or_else(|| fault(problem(), path))?)
            }
            DeValue::Float(value) => {
                let text = value.as_str();
                let number: f64 = text.parse().unwrap_or(f64::NAN);
                if number.is_nan() {
                    return Err(fault(Problem::NotANumber, path));
                }
                if number.is_infinite() && !text.contains("inf") {
                    let problem = Problem::OutOfRange {
                        expected: "a number below 1.8e308 in size".to_owned(),
                        found: format!("the number {text}"),
                    };
                    return Err(fault(problem, path));
                }
                Content::Float(number)
            }
            DeValue::Datetime(date) => {
                let problem = Problem::WrongType {
                    expected: "a string, number, boolean, array or table".to_owned(),
                    found: format!("the date {date}"),
                };
                return Err(fault(problem, path));
            }
            DeValue::Array(items) => {
                let mut nodes = Vec::with_capacity(items.len());
                for (at, item) in items.into_iter().enumerate() {
                    path.push(at.to_string());
                    nodes.push(self.value(item, path)?);
                    path.pop();
                }
                Content::Array(nodes)
            }
            DeValue::Table(table) => Content::Table(self.table(table, path)?),
        };
        Ok(Node { content, origin })
    }
}

fn integer(value: &DeInteger<'_>) -> Option<i64> {
    i64::from_str_radix(value.as_str(), value.radix()).ok()
}
