//! A child laid over its parent, and one `--set` laid over both.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use super::error::{ConfigError, Problem};
use super::node::{Content, Entry, Node, Origin, Source, Table};
use super::parse;
use super::path::{KeyPath, MAX_DEPTH};

/// The key that names the variant of a table: `kind = "gp"`.
pub(super) const KIND: &str = "kind";

/// The key that names the task a document stands on.
pub(super) const EXTENDS: &str = "extends";

/// Lays `child` over `parent`.
///
/// Tables merge key by key, also under another `kind`: what a user did not name must not change. Everything
/// else replaces.
pub(super) fn merge(parent: &mut Node, child: Node) {
    let origin = child.origin;
    match (&mut parent.content, child.content) {
        (Content::Table(below), Content::Table(above)) => {
            let keys = below.entries.iter().enumerate();
            let places: HashMap<String, usize> = keys.map(|(at, e)| (e.key.clone(), at)).collect();
            for entry in above.entries {
                match places.get(&entry.key) {
                    Some(&at) => {
                        let twin = &mut below.entries[at];
                        twin.key_origin = entry.key_origin;
                        merge(&mut twin.value, entry.value);
                    }
                    None => below.entries.push(entry),
                }
            }
        }
        (content, above) => *content = above,
    }
    parent.origin = origin;
}

/// Lays one `KEY=VALUE` over a document.
pub(super) fn set(root: &mut Node, argument: &str) -> Result<(), ConfigError> {
    let source = Arc::new(Source {
        name: format!("--set {argument}"),
        // A path typed at the prompt starts where the prompt stands.
        base_dir: Some(PathBuf::new()),
    });
    let origin = Origin::whole(&source);
    let fault = |message: &str| {
        let message = message.to_owned();
        ConfigError::new(
            Some(origin.clone()),
            KeyPath::default(),
            Problem::Syntax { message },
        )
    };
    let (key, value) = split(argument).ok_or_else(|| fault("expected KEY=VALUE"))?;
    let path = KeyPath::parse(key).filter(|path| !path.is_root());
    let path = path.ok_or_else(|| fault("expected a key such as a.b or a.0.b"))?;
    // Set after the chain was followed, it would do nothing but break the saved file.
    if path.segments().first().is_some_and(|key| key == EXTENDS) {
        let message = "cannot be set; name the other task instead of this one".to_owned();
        let problem = Problem::Invalid { message };
        return Err(ConfigError::new(Some(origin.clone()), path, problem));
    }
    if path.segments().len() > MAX_DEPTH {
        return Err(fault("the key is too long"));
    }
    let value = parse::set_value(&source, &path, value)?;
    put(root, &path, 0, value, &origin)
}

/// Splits at the first `=` that stands outside quotes.
fn split(argument: &str) -> Option<(&str, &str)> {
    let mut quote = None;
    for (at, letter) in argument.char_indices() {
        match (quote, letter) {
            (None, '=') => return Some((&argument[..at], &argument[at + 1..])),
            (None, '"' | '\'') => quote = Some(letter),
            (Some(open), _) if open == letter => quote = None,
            _ => {}
        }
    }
    None
}

fn put(
    node: &mut Node,
    path: &KeyPath,
    depth: usize,
    value: Node,
    origin: &Origin,
) -> Result<(), ConfigError> {
    let Some(segment) = path.segments().get(depth) else {
        merge(node, value);
        return Ok(());
    };
    match &mut node.content {
        Content::Array(items) => {
            let count = items.len();
            let item = segment.parse().ok().and_then(|at: usize| items.get_mut(at));
            let Some(item) = item else {
                let here = KeyPath::from(path.segments()[..depth].to_vec());
                let problem = index_problem(count, segment);
                return Err(ConfigError::new(Some(origin.clone()), here, problem));
            };
            put(item, path, depth + 1, value, origin)
        }
        Content::Table(table) => {
            if let Some(entry) = table.get_mut(segment) {
                // The nodes on the way keep their origin: only what is set came from here.
                if depth + 1 < path.segments().len() {
                    return put(&mut entry.value, path, depth + 1, value, origin);
                }
                entry.key_origin = origin.clone();
                merge(&mut entry.value, value);
                return Ok(());
            }
            let value = nest(&path.segments()[depth + 1..], value, origin);
            table.entries.push(Entry {
                key: segment.clone(),
                key_origin: origin.clone(),
                value,
            });
            Ok(())
        }
        _ => {
            *node = nest(&path.segments()[depth..], value, origin);
            Ok(())
        }
    }
}

/// `a.b` and a value as `{ a = { b = value } }`.
fn nest(path: &[String], value: Node, origin: &Origin) -> Node {
    path.iter().rev().fold(value, |value, key| Node {
        content: Content::Table(Table {
            entries: vec![Entry {
                key: key.clone(),
                key_origin: origin.clone(),
                value,
            }],
        }),
        origin: origin.clone(),
    })
}

fn index_problem(count: usize, segment: &str) -> Problem {
    let found = format!("{segment:?}");
    let expected = match count {
        0 => {
            return Problem::OutOfRange {
                expected: "a value for the whole array, which is empty".to_owned(),
                found: format!("the index {found}"),
            };
        }
        1 => "the index 0".to_owned(),
        _ => format!("an index from 0 to {}", count - 1),
    };
    Problem::OutOfRange { expected, found }
}
