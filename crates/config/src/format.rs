//! What a kind of task file knows beyond TOML: the texts that are built in, and a list of tables with an entry per component.

use std::collections::BTreeSet;

use serde::de::Error;

use crate::error::{ConfigError, Place};
use crate::key::segments;
use crate::node::{Content, Node};

/// A kind of task file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Format<'t> {
    /// Built-in tasks: pairs of name and text.
    pub built_in: &'t [(&'t str, &'t str)],
    /// The list of tables with an entry per component, if it has one.
    pub components: Option<Components<'t>>,
}

impl<'t> From<&'t [(&'t str, &'t str)]> for Format<'t> {
    fn from(built_in: &'t [(&'t str, &'t str)]) -> Self {
        Self { built_in, ..Self::default() }
    }
}

impl<'t, const N: usize> From<&'t [(&'t str, &'t str); N]> for Format<'t> {
    fn from(built_in: &'t [(&'t str, &'t str); N]) -> Self {
        built_in.as_slice().into()
    }
}

/// A list of tables with an entry per component, `[[action]]`. A text's list replaces an inherited one, as every list does,
/// but an entry takes the keys that it leaves out, except its own, from the inherited entry of the same name; from that at its
/// place, where both lists have as many entries and none of that name.
///
/// ```
/// use serde::Deserialize;
/// use stridemap_config::{Components, Document, Format};
///
/// #[derive(Deserialize)]
/// struct Task { action: Vec<Action> }
/// #[derive(Deserialize)]
/// struct Action { modulates: String, bounds: [f64; 2], unit: f64 }
///
/// let action = Components { key: "action", name: "modulates", own: &["bounds"], moved: &[("trust.unit", "unit")] };
/// let tasks = [
///     ("walk", "[[action]]\nmodulates = \"lean\"\nbounds = [0, 4]\nunit = 0.5"),
///     ("mine", "extends = \"walk\"\n[[action]]\nmodulates = \"lean\"\nbounds = [0, 2]"),
///     ("old", "extends = \"walk\"\n[trust]\nunit = [0.3]"),
/// ];
/// let format = Format { built_in: &tasks, components: Some(action) };
/// let mine: Task = Document::load("mine", &[], format)?.deserialize()?;
/// assert_eq!((mine.action[0].bounds, mine.action[0].unit), ([0.0, 2.0], 0.5));
/// let old = Document::load("old", &[], format)?;
/// assert_eq!(old.deserialize::<Task>()?.action[0].unit, 0.3);
/// assert_eq!(old.moved(), ["built-in task old:3: trust.unit is now `unit` in each [[action]], and was read as that"]);
/// # Ok::<(), stridemap_config::ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Components<'t> {
    /// The key of the list.
    pub key: &'t str,
    /// The key that names an entry.
    pub name: &'t str,
    /// Keys that an entry does not inherit, beside its name.
    pub own: &'t [&'t str],
    /// Keys under which earlier versions had a list with a value per component, and the key of an entry that holds it now.
    pub moved: &'t [(&'t str, &'t str)],
}

/// A key that was read from where it stood before.
pub(crate) type Moved = (Place, String);

impl Format<'_> {
    /// Lays a text over those it extends.
    pub(crate) fn lay(&self, below: &mut Node, mut above: Node, moved: &mut Vec<Moved>) -> Result<(), ConfigError> {
        if let Some(components) = &self.components {
            components.inherit(below, &mut above);
        }
        below.merge(above);
        self.components.map_or(Ok(()), |components| components.move_in(below, moved))
    }

    /// The path at which a `--set` finds what earlier versions had at this one: `a.unit.2` at `action.2.unit`.
    pub(crate) fn path(&self, path: Vec<String>) -> Vec<String> {
        let Some(components) = &self.components else { return path };
        for (old, new) in components.moved {
            let old = segments(old).unwrap_or_default();
            if let Some([index, below @ ..]) = path.strip_prefix(old.as_slice())
                && index.parse::<usize>().is_ok()
            {
                let entry = [components.key.to_owned(), index.clone()].into_iter();
                return entry.chain(segments(new).unwrap_or_default()).chain(below.iter().cloned()).collect();
            }
        }
        path
    }
}

impl Components<'_> {
    fn inherit(&self, below: &Node, above: &mut Node) {
        let Some(inherited) = below.get(self.key).and_then(Node::items) else { return };
        let Some(entries) = above.get_mut(self.key).and_then(Node::items_mut) else { return };
        let names: BTreeSet<&str> = inherited.iter().filter_map(|entry| self.name_of(entry)).collect();
        let as_many = entries.len() == inherited.len();
        for (at, entry) in entries.iter_mut().enumerate() {
            let name = self.name_of(entry);
            let twin = match name {
                Some(name) if names.contains(name) => inherited.iter().find(|other| self.name_of(other) == Some(name)),
                _ => inherited.get(at).filter(|_| as_many),
            };
            let (Some(twin), Content::Table(_)) = (twin, &entry.content) else { continue };
            let mut whole = twin.clone();
            if let Content::Table(keys) = &mut whole.content {
                keys.retain(|key, _| key != self.name && !self.own.contains(&key));
            }
            whole.merge(entry.clone());
            *entry = whole;
        }
    }

    fn name_of<'n>(&self, entry: &'n Node) -> Option<&'n str> {
        match &entry.get(self.name)?.content {
            Content::String(name) => Some(name),
            _ => None,
        }
    }

    /// Gives each entry its share of the lists that stand where earlier versions had them.
    fn move_in(&self, root: &mut Node, moved: &mut Vec<Moved>) -> Result<(), ConfigError> {
        for (old, new) in self.moved {
            let Some(values) = segments(old).and_then(|path| root.take(&path)) else { continue };
            let count = root.get(self.key).and_then(Node::items).map_or(0, Vec::len);
            let of_each = match &values.content {
                // A word for all of them; no list at all.
                Content::String(_) => vec![values.clone(); count],
                Content::Array(items) if items.is_empty() => {
                    vec![Node { content: Content::String(NONE.to_owned()), ..values.clone() }; count]
                }
                Content::Array(items) if items.len() == count => items.clone(),
                Content::Array(items) => {
                    let problem = format!(
                        "has {} entries, needs one per component of the {}: {count} (it is `{new}` in each [[{1}]] now)",
                        items.len(),
                        self.key
                    );
                    return Err(ConfigError::new(Some(&values.place), old, problem));
                }
                _ => return Err(ConfigError::invalid_type(values.unexpected(), &"an array").at(&values.place, old)),
            };
            for (at, value) in of_each.into_iter().enumerate() {
                let path = format!("{}.{at}.{new}", self.key);
                root.set(&segments(&path).unwrap_or_default(), 0, value)?;
            }
            let said = format!("{old} is now `{new}` in each [[{}]], and was read as that", self.key);
            moved.push((values.place, said));
        }
        Ok(())
    }
}

/// The word that unsets a value which may be left out.
pub(crate) const NONE: &str = "none";

impl Node {
    fn get(&self, key: &str) -> Option<&Self> {
        match &self.content {
            Content::Table(table) => table.get(key),
            _ => None,
        }
    }

    fn get_mut(&mut self, key: &str) -> Option<&mut Self> {
        match &mut self.content {
            Content::Table(table) => table.get_mut(key),
            _ => None,
        }
    }

    const fn items(&self) -> Option<&Vec<Self>> {
        match &self.content {
            Content::Array(items) => Some(items),
            _ => None,
        }
    }

    const fn items_mut(&mut self) -> Option<&mut Vec<Self>> {
        match &mut self.content {
            Content::Array(items) => Some(items),
            _ => None,
        }
    }

    /// Takes the value at a path out of the tree, and the tables that are empty without it.
    fn take(&mut self, path: &[String]) -> Option<Self> {
        let (first, below) = path.split_first()?;
        let Content::Table(table) = &mut self.content else { return None };
        if below.is_empty() {
            return table.remove(first);
        }
        let inner = table.get_mut(first)?;
        let taken = inner.take(below)?;
        if matches!(&inner.content, Content::Table(keys) if keys.is_empty()) {
            table.remove(first);
        }
        Some(taken)
    }
}
