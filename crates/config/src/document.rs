//! A task file with all it stands on.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde_path_to_error::{Deserializer, Segment, Track};

use crate::error::{ConfigError, Place, Source};
use crate::format::{Format, Moved};
use crate::key::{dotted, segments};
use crate::load::{self, EXTENDS, Text};
use crate::node::{Content, Node, Reader};

/// A task, resolved: its own text laid over those it extends, and each `--set` over that.
#[derive(Clone, Debug)]
pub struct Document {
    root: Node,
    file: Option<PathBuf>,
    moved: Vec<Moved>,
}

impl Document {
    /// Loads a task by its built-in name, or else by its path.
    ///
    /// # Arguments
    ///
    /// - `sets` – `KEY=VALUE` each, laid over in this order. The value is TOML; what is not TOML
    ///   is a string. In an array a segment of the key is an index from 0.
    /// - `format` – the built-in tasks, pairs of name and text, and what else the kind of file knows.
    ///
    /// # Errors
    ///
    /// A task that cannot be found or read, a text that is not TOML or holds a date, a task that extends
    /// itself, a `--set` that is not `KEY=VALUE` or has an index outside its array. Keys are checked only by
    /// [`deserialize`](Self::deserialize), which knows them.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_config::Document;
    ///
    /// let tasks = [("stepping", ""), ("walking", "")];
    /// let error = Document::load("walkign", &[], &tasks).unwrap_err();
    /// assert_eq!(
    ///     error.to_string(),
    ///     "unknown task \"walkign\"; did you mean \"walking\"? \
    ///      (built in: stepping, walking; or the path of a file)"
    /// );
    /// ```
    pub fn load<'t>(name: &str, sets: &[String], format: impl Into<Format<'t>>) -> Result<Self, ConfigError> {
        let format = format.into();
        Self::resolve(&load::find(name, Path::new(""), format.built_in)?, sets, format)
    }

    /// Loads a file, even where a built-in task has the same name.
    ///
    /// # Errors
    ///
    /// As for [`load`](Self::load).
    pub fn load_file<'t>(path: &Path, sets: &[String], format: impl Into<Format<'t>>) -> Result<Self, ConfigError> {
        Self::resolve(&load::read(path)?, sets, format.into())
    }

    fn resolve(text: &Text, sets: &[String], format: Format<'_>) -> Result<Self, ConfigError> {
        let mut moved = Vec::new();
        let mut root = load::resolve(text, &mut Vec::new(), format, &mut moved)?;
        for argument in sets {
            set(&mut root, argument, format, &mut moved)?;
        }
        Ok(Self { root, file: text.file.clone(), moved })
    }

    /// What was read from where earlier versions had it, one line each with file, line, old key and new place.
    #[must_use]
    pub fn moved(&self) -> Vec<String> {
        self.moved.iter().map(|(place, said)| format!("{place}: {said}")).collect()
    }

    /// The document as a typed configuration.
    ///
    /// # Errors
    ///
    /// An unknown key, unknown value, missing key or value of the wrong kind or size, with its place.
    pub fn deserialize<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        let mut track = Track::new();
        T::deserialize(Deserializer::new(&self.root, &mut track)).map_err(|error| {
            let path = track.path();
            let keys = path.iter().filter_map(|segment| match segment {
                Segment::Map { key } => Some(key.clone()),
                Segment::Seq { index } => Some(index.to_string()),
                Segment::Enum { .. } | Segment::Unknown => None,
            });
            let last = (!error.key.is_empty()).then(|| error.key.clone());
            let path: Vec<String> = keys.chain(last).collect();
            error.at(&self.root.descend(&path).0.place, &dotted(&path))
        })
    }

    /// Puts a value, as TOML, at each of these keys where the document says only `word`, a promise that the value is found
    /// later; the keys where it did, in the order given.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_config::Document;
    ///
    /// let text = "bounds = \"auto\"\nweight = 0.1";
    /// let mut document = Document::load("task", &[], &[("task", text)])?;
    /// assert_eq!(document.stand_in("auto", &[("bounds", "[0.0, 1.0]"), ("weight", "2.0")]), ["bounds"]);
    /// # Ok::<(), stridemap_config::ConfigError>(())
    /// ```
    pub fn stand_in(&mut self, word: &str, values: &[(&str, &str)]) -> Vec<String> {
        let mut stood_in = Vec::new();
        for (key, value) in values {
            let Some(path) = segments(key) else { continue };
            let (node, depth) = self.root.descend(&path);
            let said = depth == path.len() && matches!(&node.content, Content::String(text) if text == word);
            if !said {
                continue;
            }
            let source = Arc::clone(&node.place.source);
            let place = node.place.clone();
            if let Ok(value) = Reader::set_value(&source, &path, value)
                && self.root.set(&path, 0, Node { place, ..value }).is_ok()
            {
                stood_in.push((*key).to_owned());
            }
        }
        stood_in
    }

    /// The file it was loaded from; `None` if it is built in.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The keys of the table at a key; `None` if there is no table.
    #[must_use]
    pub fn keys(&self, key: &str) -> Option<Vec<&str>> {
        let path = segments(key)?;
        let (node, depth) = self.root.descend(&path);
        match &node.content {
            Content::Table(table) if depth == path.len() => Some(table.keys().map(String::as_str).collect()),
            _ => None,
        }
    }

    /// Where the value at a key was written; if it was not, where the table it would stand in was, or the table
    /// around that.
    fn place(&self, key: &str) -> &Place {
        let path = segments(key).unwrap_or_default();
        &self.root.descend(&path).0.place
    }

    /// The directory from which a relative path at this key starts: that of the file which wrote it; empty, the
    /// working directory, for a `--set`; `None` for a built-in task.
    #[must_use]
    pub fn base_dir(&self, key: &str) -> Option<&Path> {
        self.place(key).source.base_dir.as_deref()
    }

    /// A fault that another module found in the value at a key, with its file and line.
    ///
    /// ```
    /// use stridemap_config::Document;
    ///
    /// let document = Document::load("task", &[], &[("task", "[gait]\n\nfrequency_hz = -1")])?;
    /// let error = document.located("gait.frequency_hz", "must be positive");
    /// assert_eq!(error.to_string(), "built-in task task:3: gait.frequency_hz: must be positive");
    /// # Ok::<(), stridemap_config::ConfigError>(())
    /// ```
    #[must_use]
    pub fn located(&self, key: &str, message: impl Into<String>) -> ConfigError {
        // With the quotes that it needs, and no others.
        let plain = segments(key).map_or_else(|| key.to_owned(), |path| dotted(&path));
        ConfigError::new(Some(self.place(key)), &plain, message)
    }
}

/// Lays one `KEY=VALUE` over a document.
fn set(root: &mut Node, argument: &str, format: Format<'_>, moved: &mut Vec<Moved>) -> Result<(), ConfigError> {
    let source = Arc::new(Source {
        name: format!("--set {argument}"),
        // A path typed at the prompt starts where the prompt stands.
        base_dir: Some(PathBuf::new()),
    });
    let place = Place { source: Arc::clone(&source), line: None };
    let fault = |key: &str, problem: &str| ConfigError::new(Some(&place), key, problem);
    let (key, value) = split(argument).ok_or_else(|| fault("", "not valid TOML: expected KEY=VALUE"))?;
    let path = segments(key).ok_or_else(|| fault("", "not valid TOML: expected a key such as a.b or a.0.b"))?;
    // Set after the chain was followed, it would do nothing but break the saved file.
    if path.first().is_some_and(|key| key == EXTENDS) {
        let problem = "cannot be set; name the other task instead of this one";
        return Err(fault(&dotted(&path), problem));
    }
    let value = Reader::set_value(&source, &path, value.trim())?;
    root.set(&format.path(path), 0, value)?;
    format.lay(root, root.empty(), moved)
}

/// Splits at the first `=` that stands outside quotes.
fn split(argument: &str) -> Option<(&str, &str)> {
    let mut quote = None;
    let at = argument.find(|letter| {
        match quote {
            None if matches!(letter, '"' | '\'') => quote = Some(letter),
            None => return letter == '=',
            Some(open) if open == letter => quote = None,
            Some(_) => {}
        }
        false
    })?;
    Some((&argument[..at], &argument[at + 1..]))
}
