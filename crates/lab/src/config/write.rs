//! From a tree back to TOML text.

use std::fmt::Write;

use super::node::{Content, Node, Table};

/// A document as TOML text: values first, then a section for each table.
pub(super) fn document(root: &Node) -> String {
    let mut out = String::new();
    match &root.content {
        Content::Table(table) => section(&mut out, table, &mut Vec::new()),
        _ => value(&mut out, root),
    }
    out
}

fn section(out: &mut String, table: &Table, path: &mut Vec<String>) {
    for entry in table.entries() {
        if !is_section(&entry.value) && !is_sections(&entry.value) {
            out.push_str(&key(&entry.key));
            out.push_str(" = ");
            value(out, &entry.value);
            out.push('\n');
        }
    }
    for entry in table.entries() {
        let tables: Vec<(&Table, bool)> = match &entry.value.content {
            Content::Table(table) => vec![(table, false)],
            Content::Array(items) if is_sections(&entry.value) => items
                .iter()
                .filter_map(|item| Some((item.as_table()?, true)))
                .collect(),
            _ => continue,
        };
        path.push(key(&entry.key));
        for (table, in_array) in tables {
            if !out.is_empty() {
                out.push('\n');
            }
            let name = path.join(".");
            out.push_str(&if in_array {
                format!("[[{name}]]\n")
            } else {
                format!("[{name}]\n")
            });
            section(out, table, path);
        }
        path.pop();
    }
}

fn is_section(node: &Node) -> bool {
    node.as_table().is_some()
}

/// Whether an array can be written as `[[name]]` sections.
fn is_sections(node: &Node) -> bool {
    node.as_array()
        .is_some_and(|items| !items.is_empty() && items.iter().all(is_section))
}

/// A value on one line.
fn value(out: &mut String, node: &Node) {
    match &node.content {
        Content::String(text) => string(out, text),
        Content::Integer(number) => out.push_str(&number.to_string()),
        // The shortest decimal that reads back as the same bits, always with a point or exponent.
        Content::Float(number) => out.push_str(&format!("{number:?}")),
        Content::Bool(truth) => out.push_str(if *truth { "true" } else { "false" }),
        Content::Array(items) => {
            out.push('[');
            for (at, item) in items.iter().enumerate() {
                out.push_str(if at > 0 { ", " } else { "" });
                value(out, item);
            }
            out.push(']');
        }
        Content::Table(table) => {
            out.push('{');
            for (at, entry) in table.entries().iter().enumerate() {
                out.push_str(if at > 0 { ", " } else { " " });
                out.push_str(&key(&entry.key));
                out.push_str(" = ");
                value(out, &entry.value);
            }
            out.push_str(if table.entries().is_empty() {
                "}"
            } else {
                " }"
            });
        }
    }
}

/// A key, in quotes if it needs them.
pub(super) fn key(key: &str) -> String {
    let bare = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
    if !key.is_empty() && key.chars().all(bare) {
        return key.to_owned();
    }
    let mut out = String::new();
    string(&mut out, key);
    out
}

fn string(out: &mut String, text: &str) {
    out.push('"');
    for letter in text.chars() {
        match letter {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            '\t' => out.push_str("\\t"),
            letter if letter.is_control() => {
                // Writing to a String cannot fail.
                let _ = write!(out, "\\u{:04X}", u32::from(letter));
            }
            letter => out.push(letter),
        }
    }
    out.push('"');
}
