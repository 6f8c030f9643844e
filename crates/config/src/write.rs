//! A typed configuration back to TOML, in the form in which users write it.

use serde::Serialize;
use toml::{Table, Value};
use toml_writer::{ToTomlKey, ToTomlValue, TomlStringBuilder};

use crate::error::ConfigError;
use crate::key::dotted;

/// A typed configuration as TOML text, every value written out, defaults too: values first, then a section for
/// each table. Read again it gives the same values, floats bit for bit; `None` is left out.
///
/// # Errors
///
/// What TOML cannot hold: an integer beyond 64 bits with its sign, `None` in an array, a value that is not a table.
///
/// # Example
///
/// ```
/// #[derive(serde::Serialize)]
/// struct Task { map: Map, seed: u64 }
/// #[derive(serde::Serialize)]
/// struct Map { ridge: f64, note: Option<String> }
///
/// let task = Task { map: Map { ridge: 1e-9, note: None }, seed: 1 };
/// assert_eq!(stridemap_config::to_toml(&task)?, "seed = 1\n\n[map]\nridge = 1e-9\n");
/// # Ok::<(), stridemap_config::ConfigError>(())
/// ```
pub fn to_toml<T: Serialize>(value: &T) -> Result<String, ConfigError> {
    let mut out = String::new();
    section(&mut out, &table(value)?, &mut Vec::new());
    Ok(out)
}

/// Calls `visit` with the dotted key of every value of a typed configuration that is no table or array.
///
/// # Errors
///
/// As for [`to_toml`].
pub fn walk<T: Serialize>(value: &T, visit: &mut impl FnMut(&str, &Value)) -> Result<(), ConfigError> {
    fn below(value: &Value, path: &mut Vec<String>, visit: &mut impl FnMut(&str, &Value)) {
        let mut step = |key: String, value: &Value| {
            path.push(key);
            below(value, path, visit);
            path.pop();
        };
        match value {
            Value::Table(table) => table.iter().for_each(|(key, value)| step(key.clone(), value)),
            Value::Array(items) => {
                let items = items.iter().enumerate();
                items.for_each(|(at, item)| step(at.to_string(), item));
            }
            leaf => visit(&dotted(path), leaf),
        }
    }
    below(&Value::Table(table(value)?), &mut Vec::new(), visit);
    Ok(())
}

fn table<T: Serialize>(value: &T) -> Result<Table, ConfigError> {
    Table::try_from(value).map_err(|error| ConfigError::new(None, "", error.to_string()))
}

fn section(out: &mut String, table: &Table, path: &mut Vec<String>) {
    for (key, value) in table.iter().filter(|(_, value)| sections(value).is_none()) {
        *out += &format!("{} = {}\n", key.to_toml_key(), inline(value));
    }
    for (key, value) in table {
        let Some((tables, [open, close])) = sections(value) else {
            continue;
        };
        path.push(key.to_toml_key());
        for table in tables {
            if !out.is_empty() {
                out.push('\n');
            }
            *out += &format!("{open}{}{close}\n", path.join("."));
            section(out, table, path);
        }
        path.pop();
    }
}

/// The tables that are written as sections of their own, and the brackets of their headers.
fn sections(value: &Value) -> Option<(Vec<&Table>, [&'static str; 2])> {
    match value {
        Value::Table(table) => Some((vec![table], ["[", "]"])),
        Value::Array(items) if !items.is_empty() => {
            let tables: Option<Vec<&Table>> = items.iter().map(Value::as_table).collect();
            Some((tables?, ["[[", "]]"]))
        }
        _ => None,
    }
}

/// A value on one line.
fn inline(value: &Value) -> String {
    match value {
        Value::String(text) => TomlStringBuilder::new(text).as_basic().to_toml_value(),
        Value::Float(number) if number.is_nan() => "nan".to_owned(),
        // The shortest decimal that reads back as the same bits, always with a point or exponent.
        Value::Float(number) => format!("{number:?}"),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(inline).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Table(table) if !table.is_empty() => {
            let pairs = table.iter().map(|(key, value)| format!("{} = {}", key.to_toml_key(), inline(value)));
            format!("{{ {} }}", pairs.collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}
