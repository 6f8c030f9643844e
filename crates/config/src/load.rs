//! Texts by name or path, and following `extends` from one to the next.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::Error;

use crate::error::{ConfigError, Source};
use crate::format::{Format, Moved};
use crate::node::{Content, Node, Reader};

/// The key that names the task a text stands on.
pub(crate) const EXTENDS: &str = "extends";

/// The longest chain of tasks. Real ones have two or three links.
const MAX_CHAIN: usize = 32;

pub(crate) struct Text {
    source: Arc<Source>,
    text: String,
    pub(crate) file: Option<PathBuf>,
}

/// A built-in task; any other name is a path, relative to the file that names it.
pub(crate) fn find(name: &str, from: &Path, built_in: &[(&str, &str)]) -> Result<Text, ConfigError> {
    if let Some((name, text)) = built_in.iter().find(|(task, _)| *task == name) {
        let source = Source { name: format!("built-in task {name}"), base_dir: None };
        return Ok(Text { source: Arc::new(source), text: (*text).to_owned(), file: None });
    }
    let file = from.join(name);
    if !file.exists() && !name.contains(['/', '\\', '.']) {
        let known: Vec<&str> = built_in.iter().map(|(name, _)| *name).collect();
        let end = "; or the path of a file";
        return Err(ConfigError::unknown("task", name, &known, "built in", end));
    }
    read(&file)
}

/// The text of a file, whose path need not be text itself.
pub(crate) fn read(file: &Path) -> Result<Text, ConfigError> {
    let name = file.display().to_string();
    let cannot = |name: &str, why: String| ConfigError::new(None, "", format!("cannot read {name}: {why}"));
    let bytes = std::fs::read(file).map_err(|error| cannot(&name, error.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let good = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + good.iter().filter(|byte| **byte == b'\n').count();
        cannot(&format!("{name}:{line}"), "is not text (UTF-8)".into())
    })?;
    let base_dir = Some(file.parent().unwrap_or(Path::new("")).to_owned());
    Ok(Text { source: Arc::new(Source { name, base_dir }), text, file: Some(file.to_owned()) })
}

/// A text laid over those it extends. `chain`: the texts that extend this one.
pub(crate) fn resolve(
    text: &Text,
    chain: &mut Vec<Arc<Source>>,
    format: Format<'_>,
    moved: &mut Vec<Moved>,
) -> Result<Node, ConfigError> {
    chain.push(Arc::clone(&text.source));
    let mut layer = Reader::document(&text.source, &text.text)?;
    let extends = match &mut layer.content {
        Content::Table(table) => table.remove(EXTENDS),
        _ => None,
    };
    let Some(extends) = extends else {
        let mut root = layer.empty();
        format.lay(&mut root, layer, moved)?;
        return Ok(root);
    };
    let placed = |error: ConfigError| error.at(&extends.place, EXTENDS);
    let Content::String(name) = &extends.content else {
        let expected = &"the name of a task or a file";
        return Err(placed(Error::invalid_type(extends.unexpected(), expected)));
    };
    let from = text.source.base_dir.as_deref().unwrap_or(Path::new(""));
    let below = find(name, from, format.built_in).map_err(placed)?;
    if chain.contains(&below.source) {
        let chain = chain.iter().chain([&below.source]).map(|source| &*source.name);
        let chain = chain.collect::<Vec<_>>().join(" -> ");
        return Err(placed(Error::custom(format!("a task extends itself: {chain}"))));
    }
    if chain.len() == MAX_CHAIN {
        let message = format!("more than {MAX_CHAIN} tasks extend one another");
        return Err(placed(Error::custom(message)));
    }
    let mut below = resolve(&below, chain, format, moved)?;
    format.lay(&mut below, layer, moved)?;
    Ok(below)
}
