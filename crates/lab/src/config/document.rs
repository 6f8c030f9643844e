//! A task file with all it stands on.

use std::path::Path;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use super::error::{ConfigError, Problem};
use super::load::{self, ResolveError, TaskText};
use super::merge;
use super::node::{self, Node, Origin, Source};
use super::path::KeyPath;
use super::write;

/// A task, resolved: its own text laid over those it extends, and each `--set` over that.
#[derive(Clone, Debug)]
pub struct Document {
    root: Node,
    sources: Vec<Arc<Source>>,
}

impl Document {
    /// Loads a task by name or path, with everything it extends and the `--set` arguments.
    ///
    /// # Arguments
    ///
    /// - `name_or_path` – given to `resolve` as it is.
    /// - `sets` – `KEY=VALUE` each, laid over in this order. The value is TOML; what is not TOML
    ///   is a string. In an array a segment of the key is an index from 0.
    /// - `resolve` – the text for a name, which may be relative to the directory given with it.
    ///   [`resolver`](super::resolver) makes one.
    ///
    /// # Errors
    ///
    /// A task that cannot be found or read, a text that is not TOML or holds `nan` or a date, a
    /// task that extends itself, a `--set` that is not `KEY=VALUE` or has an index outside its
    /// array. Keys are checked only by [`deserialize`](Self::deserialize), which knows them.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::config::{Document, resolver};
    ///
    /// let tasks = [("walking", "[[action]]\nbounds = [0.0, 10.0]")];
    /// let sets = ["action.0.bounds=[0, 12]".to_owned()];
    /// let document = Document::load("walking", &sets, resolver(&tasks)).unwrap();
    /// assert_eq!(document.to_toml(), "[[action]]\nbounds = [0, 12]\n");
    /// ```
    pub fn load<R>(name_or_path: &str, sets: &[String], resolve: R) -> Result<Self, ConfigError>
    where
        R: FnMut(&str, Option<&Path>) -> Result<TaskText, ResolveError>,
    {
        let (mut root, sources) = load::load(name_or_path, resolve)?;
        for argument in sets {
            merge::set(&mut root, argument)?;
        }
        Ok(Self { root, sources })
    }

    /// Reads one text that extends nothing, such as the resolved file of a run.
    ///
    /// # Errors
    ///
    /// As for [`load`](Self::load); a text with `extends` names a task that is not known here.
    pub fn parse(source_name: &str, text: &str) -> Result<Self, ConfigError> {
        let mut only = Some(TaskText {
            source_name: source_name.to_owned(),
            text: text.to_owned(),
            base_dir: None,
        });
        let built_in = Vec::new;
        Self::load(source_name, &[], |_, _| {
            only.take().ok_or(ResolveError::Unknown {
                built_in: built_in(),
            })
        })
    }

    /// The document as a typed configuration.
    ///
    /// # Errors
    ///
    /// The first unknown key, unknown value, missing key or value of the wrong kind or size, with
    /// its place.
    pub fn deserialize<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        T::deserialize(&self.root).map_err(|error| error.at(&self.root))
    }

    /// The tree.
    #[must_use]
    pub fn root(&self) -> &Node {
        &self.root
    }

    /// The texts that were read: the task's own first, then what it extends.
    #[must_use]
    pub fn sources(&self) -> &[Arc<Source>] {
        &self.sources
    }

    /// The value at a key path such as `action.0.bounds`, if there is one.
    #[must_use]
    pub fn get(&self, key_path: &str) -> Option<&Node> {
        self.root.get(&KeyPath::parse(key_path)?)
    }

    /// Where the value at a key path was written; if it was not, where the table it would stand in
    /// was, or the table around that.
    ///
    /// ```
    /// use stridemap_lab::config::Document;
    ///
    /// let document = Document::parse("a.toml", "[gait]\nfrequency_hz = 1").unwrap();
    /// assert_eq!(document.origin_of("gait.frequency_hz").to_string(), "a.toml:2");
    /// assert_eq!(document.origin_of("gait.phase.filter_s").to_string(), "a.toml:1");
    /// ```
    #[must_use]
    pub fn origin_of(&self, key_path: &str) -> &Origin {
        let path = KeyPath::parse(key_path).unwrap_or_default();
        &self.root.descend(path.segments()).0.origin
    }

    /// The directory from which a relative path at this key starts: that of the file which wrote
    /// it; empty, the working directory, for a `--set`; `None` for a built-in task.
    ///
    /// ```
    /// use std::path::Path;
    /// use stridemap_lab::config::{Document, resolver};
    ///
    /// let tasks = [("walking", "robot.model = \"biped.xml\"")];
    /// let sets = ["robot.left.model=leg.xml".to_owned()];
    /// let document = Document::load("walking", &sets, resolver(&tasks)).unwrap();
    /// assert_eq!(document.base_dir_of("robot.model"), None);
    /// assert_eq!(document.base_dir_of("robot.left.model"), Some(Path::new("")));
    /// ```
    #[must_use]
    pub fn base_dir_of(&self, key_path: &str) -> Option<&Path> {
        node::base_dir(self.origin_of(key_path))
    }

    /// A fault that another module found in the value at a key path, with its file and line.
    ///
    /// ```
    /// use stridemap_lab::config::Document;
    ///
    /// let document = Document::parse("a.toml", "[gait]\n\nfrequency_hz = -1").unwrap();
    /// let error = document.located("gait.frequency_hz", "must be positive");
    /// assert_eq!(error.to_string(), "a.toml:3: gait.frequency_hz: must be positive");
    /// ```
    #[must_use]
    pub fn located(&self, key_path: &str, message: impl Into<String>) -> ConfigError {
        let path =
            KeyPath::parse(key_path).unwrap_or_else(|| KeyPath::from(vec![key_path.to_owned()]));
        ConfigError::new(
            Some(self.origin_of(key_path).clone()),
            path,
            Problem::Invalid {
                message: message.into(),
            },
        )
    }

    /// The resolved document as TOML text. Read again it gives the same values, floats bit for
    /// bit. Keys left to their defaults are not in it: [`to_toml`](super::to_toml) of the typed
    /// configuration writes those as well.
    #[must_use]
    pub fn to_toml(&self) -> String {
        write::document(&self.root)
    }
}
