//! What is wrong with a task file, and how it is said.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use serde::de::{self, Expected, Unexpected};

use crate::key::nearest;

/// A text that values come from.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Source {
    /// What messages call it: `my-robot.toml`, `built-in task walking`, `--set a.b=1`.
    pub name: String,
    /// Where relative paths in it start; `None` for a text that lies in no directory.
    pub base_dir: Option<PathBuf>,
}

/// Where a value was written: a text and, unless it has but one, the line from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub source: Arc<Source>,
    pub line: Option<usize>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) => write!(f, "{}:{line}", self.source.name),
            None => f.write_str(&self.source.name),
        }
    }
}

/// One fault of a configuration: where, which key, what is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// `None` only where there is no text yet (a task that is not found).
    place: Option<Place>,
    /// The dotted key; on the way up, the last segment of it. Empty if it is none in particular.
    pub(crate) key: String,
    /// The value, where the message quotes it beside the key.
    value: Option<String>,
    problem: String,
    /// What was probably meant, and what is allowed.
    hint: String,
}

impl ConfigError {
    /// The text at fault, as messages call it: a file, `built-in task NAME`, `--set KEY=VALUE`; `None` where there is
    /// none (a task that is not found).
    #[must_use]
    pub fn file(&self) -> Option<&str> {
        self.place.as_ref().map(|place| place.source.name.as_str())
    }

    /// The line at fault, from 1, in a text of more than one.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        self.place.as_ref()?.line
    }

    /// The dotted key at fault; empty if it is none in particular.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }

    pub(crate) fn new(place: Option<&Place>, key: &str, problem: impl Into<String>) -> Self {
        Self { place: place.cloned(), key: key.to_owned(), value: None, problem: problem.into(), hint: String::new() }
    }

    /// The fault at its place.
    pub(crate) fn at(self, place: &Place, key: &str) -> Self {
        Self { place: Some(place.clone()), key: key.to_owned(), ..self }
    }

    pub(crate) fn unfit(expected: &str, found: &str) -> Self {
        Self::new(None, "", format!("expected {expected}, found {found}"))
    }

    /// A name that is none of those known: `what` says of which kind, `of` introduces those.
    pub(crate) fn unknown(what: &str, name: &str, known: &[&str], of: &str, end: &str) -> Self {
        let near = nearest(name, known).map(|near| format!("; did you mean {near:?}?"));
        let mut hint = near.unwrap_or_default();
        if !known.is_empty() {
            hint += &format!(" ({of}: {}{end})", known.join(", "));
        }
        Self { value: Some(name.to_owned()), hint, ..Self::new(None, "", format!("unknown {what}")) }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        match (self.key.as_str(), &self.value) {
            ("", None) => write!(f, "{}", self.problem)?,
            ("", Some(value)) => write!(f, "{} {value:?}", self.problem)?,
            (key, None) => write!(f, "{key}: {}", self.problem)?,
            (key, Some(value)) => write!(f, "{key} = {value:?}: {}", self.problem)?,
        }
        f.write_str(&self.hint)
    }
}

impl std::error::Error for ConfigError {}

/// What serde's derived readers report, in the words of someone who writes TOML.
impl de::Error for ConfigError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new(None, "", message.to_string())
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::unfit(&in_words(&expected.to_string()), &describe(found))
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(found: usize, expected: &dyn Expected) -> Self {
        Self::unfit(&in_words(&expected.to_string()), &values(found))
    }

    fn unknown_variant(found: &str, allowed: &'static [&'static str]) -> Self {
        Self::unknown("value", found, allowed, "allowed", "")
    }

    fn unknown_field(field: &str, allowed: &'static [&'static str]) -> Self {
        let near = nearest(field, allowed).map(|near| format!("; did you mean `{near}`?"));
        let allowed = match allowed {
            [] => "no key is allowed here".to_owned(),
            _ => format!("allowed: {}", allowed.join(", ")),
        };
        Self { hint: format!("{} ({allowed})", near.unwrap_or_default()), ..Self::new(None, field, "unknown key") }
    }

    fn missing_field(field: &'static str) -> Self {
        Self::new(None, field, "missing key")
    }
}

/// Serde names Rust types; a user's words are those of TOML.
fn in_words(expected: &str) -> String {
    let whole = |least: i64, most: i64| format!("an integer from {least} to {most}");
    let words = match expected {
        "f32" | "f64" => "a number",
        "i8" => return whole(i8::MIN.into(), i8::MAX.into()),
        "i16" => return whole(i16::MIN.into(), i16::MAX.into()),
        "i32" => return whole(i32::MIN.into(), i32::MAX.into()),
        "u8" => return whole(0, u8::MAX.into()),
        "u16" => return whole(0, u16::MAX.into()),
        "u32" => return whole(0, u32::MAX.into()),
        "i64" | "isize" => "an integer",
        "u64" | "usize" => "an integer of at least 0",
        "a boolean" => "true or false",
        "a sequence" => "an array",
        "path string" => "a string",
        "a map" => "a table",
        _ if expected.starts_with("struct ") => "a table",
        // Of an array that is too short, then of one that is too long.
        _ => {
            let short = ["an array of length ", "a tuple of size "];
            let long = [" elements in sequence", " element in sequence"];
            let length = (short.iter().find_map(|s| expected.strip_prefix(s)))
                .or_else(|| long.iter().find_map(|s| expected.strip_suffix(s)));
            return match length.and_then(|length| length.parse().ok()) {
                Some(length) => format!("an array of {}", values(length)),
                None => expected.to_owned(),
            };
        }
    };
    words.to_owned()
}

fn values(count: usize) -> String {
    format!("{count} {}", if count == 1 { "value" } else { "values" })
}

/// A message quotes this many characters of a string.
const QUOTED: usize = 80;

fn describe(found: Unexpected<'_>) -> String {
    match found {
        Unexpected::Bool(value) => format!("the boolean {value}"),
        Unexpected::Unsigned(value) => format!("the integer {value}"),
        Unexpected::Signed(value) => format!("the integer {value}"),
        Unexpected::Float(value) => format!("the number {value:?}").to_lowercase(),
        Unexpected::Str(text) => match text.char_indices().nth(QUOTED) {
            Some((end, _)) => format!("a string that begins {:?}", &text[..end]),
            None => format!("the string {text:?}"),
        },
        Unexpected::Seq => "an array".to_owned(),
        Unexpected::Map => "a table".to_owned(),
        other => other.to_string(),
    }
}
