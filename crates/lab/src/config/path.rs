//! Key paths such as `robot.left.knee` and `action.0.bounds`.

use std::fmt;

use toml::de::{DeTable, DeValue};

/// The deepest nesting of tables and arrays that is read. A task file has about five levels.
pub(super) const MAX_DEPTH: usize = 64;

/// A path of keys from the root of a document; in an array a segment is an index from 0.
///
/// ```
/// use stridemap_lab::config::KeyPath;
///
/// let path = KeyPath::parse("action.0.bounds").unwrap();
/// assert_eq!(path.segments(), ["action", "0", "bounds"]);
/// let quoted = KeyPath::parse("legs.\"left knee\"").unwrap();
/// assert_eq!(quoted.segments(), ["legs", "left knee"]);
/// assert_eq!(quoted.to_string(), "legs.\"left knee\"");
/// assert!(KeyPath::parse("a..b").is_none());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct KeyPath(Vec<String>);

impl KeyPath {
    /// Reads a dotted key as TOML writes it; `None` if it is not one. Nothing is the root.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        if text.trim().is_empty() {
            return Some(Self::default());
        }
        if text.contains(['\n', '\r']) {
            return None;
        }
        let line = format!("{text} = true");
        let table = DeTable::parse(&line).ok()?.into_inner();
        let mut segments = Vec::new();
        let mut table = &table;
        loop {
            let (key, value) = table.iter().next()?;
            segments.push(key.get_ref().clone().into_owned());
            match value.get_ref() {
                DeValue::Table(inner) => table = inner,
                DeValue::Boolean(true) => return Some(Self(segments)),
                _ => return None,
            }
        }
    }

    /// The segments from the root downwards, without quotes.
    #[must_use]
    pub fn segments(&self) -> &[String] {
        &self.0
    }

    /// Whether it is the root itself.
    #[must_use]
    pub fn is_root(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn prepend(&mut self, segment: String) {
        self.0.insert(0, segment);
    }
}

impl From<Vec<String>> for KeyPath {
    fn from(segments: Vec<String>) -> Self {
        Self(segments)
    }
}

impl fmt::Display for KeyPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, segment) in self.0.iter().enumerate() {
            if at > 0 {
                f.write_str(".")?;
            }
            f.write_str(&super::write::key(segment))?;
        }
        Ok(())
    }
}
