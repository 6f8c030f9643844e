//! Over random documents: text and tree are the same thing, and no bytes make the loader panic.

use proptest::prelude::*;
use toml::{Table, Value};

use super::*;

/// Any value that a task file may hold.
fn value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        any::<String>().prop_map(Value::String),
        any::<i64>().prop_map(Value::Integer),
        any::<f64>()
            .prop_filter("nan is refused", |x| !x.is_nan())
            .prop_map(Value::Float),
        any::<bool>().prop_map(Value::Boolean),
    ];
    leaf.prop_recursive(4, 32, 4, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..4).prop_map(Value::Array),
            table_of(inner).prop_map(Value::Table),
        ]
    })
}

fn table_of(value: impl Strategy<Value = Value>) -> impl Strategy<Value = Table> {
    let key = prop_oneof!["[a-z_]{1,8}", any::<String>()];
    prop::collection::vec((key, value), 0..4).prop_map(|pairs| pairs.into_iter().collect())
}

/// Pieces of TOML in any order: nearer to real mistakes than random characters.
fn scraps() -> impl Strategy<Value = String> {
    let scrap = prop::sample::select(vec![
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        "=",
        ".",
        ",",
        "\n",
        "\r\n",
        " ",
        "\"",
        "'",
        "\"\"\"",
        "#",
        "a",
        "b",
        "kind",
        "robot",
        "extends",
        "1",
        "-",
        "1.5",
        "e9",
        "inf",
        "nan",
        "true",
        "0x",
        "\\u",
        "2026-01-01",
        "é",
        "\u{feff}",
        "\0",
    ]);
    prop::collection::vec(scrap, 0..40).prop_map(|scraps| scraps.concat())
}

/// Everything a caller may do with a text.
fn exercise(text: &str, set: &str) {
    let tasks = [("task", text)];
    if let Ok(document) = Document::load("task", &[], files(&tasks)) {
        let again = Document::parse("again", &document.to_toml());
        let again = again.unwrap_or_else(|error| panic!("{error}\n{}", document.to_toml()));
        assert!(again.root().same_value(document.root()), "{text}");
        if let Err(error) = document.deserialize::<Task>() {
            assert!(!error.to_string().is_empty());
            assert!(error.origin().is_some());
        }
        let _ = document.located(set, "x").to_string();
    }
    let _ = Document::load("task", &sets(&[set]), files(&tasks));
    let tasks = [("task", GOOD)];
    if let Ok(document) = Document::load("task", &sets(&[set]), files(&tasks)) {
        let _ = document.deserialize::<Task>();
        Document::parse("again", &document.to_toml()).unwrap();
    }
}

proptest! {
    #[test]
    fn any_document_round_trips(table in table_of(value())) {
        // The reader of `extends` would look for another task.
        prop_assume!(!table.contains_key("extends"));
        let text = toml::to_string(&table).unwrap();
        let document = Document::parse("a.toml", &text).unwrap();
        let written = document.to_toml();
        let again = Document::parse("b.toml", &written).unwrap();
        prop_assert!(again.root().same_value(document.root()), "{}\n---\n{}", text, written);
        // An independent reader sees the same values.
        let typed: Table = toml::from_str(&written).unwrap();
        prop_assert_eq!(format!("{typed:?}"), format!("{table:?}"));
        // And the serialiser writes the tree that was read.
        let ours = Document::parse("c.toml", &super::super::to_toml(&table).unwrap()).unwrap();
        prop_assert!(ours.root().same_value(document.root()));
    }

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let text = String::from_utf8_lossy(&bytes);
        exercise(&text, &text);
    }

    #[test]
    fn random_scraps_never_panic(text in scraps(), set in scraps()) {
        exercise(&text, &set);
    }

    #[test]
    fn damaged_tasks_never_panic(at in 0..GOOD.len(), length in 0..20_usize, scrap in scraps()) {
        let mut text = GOOD.to_owned();
        text.replace_range(at..(at + length).min(GOOD.len()), &scrap);
        exercise(&text, "robot.friction=1");
    }
}

/// Recursion ends before the stack does.
#[test]
fn deep_nesting_is_an_error() {
    for depth in [100, 100_000] {
        let dotted = vec!["a"; depth].join(".");
        let texts = [
            format!("x = {}{}", "[".repeat(depth), "]".repeat(depth)),
            format!("x = {}1{}", "{a=".repeat(depth), "}".repeat(depth)),
            format!("{dotted} = 1"),
            format!("[{dotted}]"),
        ];
        for text in texts {
            assert!(Document::parse("a.toml", &text).is_err());
        }
        let tasks = [("task", "")];
        for value in ["1", "bare"] {
            let set = [format!("{dotted}={value}")];
            assert!(Document::load("task", &set, files(&tasks)).is_err());
        }
    }
}

/// What is just shallow enough to be read can be written and read again.
#[test]
fn the_deepest_document_round_trips() {
    let depth = (1..100).take_while(|&depth| nested(depth).iter().all(Result::is_ok));
    assert_eq!(depth.last(), Some(62));
    assert!(nested(63).iter().any(Result::is_err));
    for document in nested(62) {
        let document = document.unwrap();
        let again = Document::parse("again", &document.to_toml()).unwrap();
        assert!(again.root().same_value(document.root()));
    }
}

fn nested(depth: usize) -> Vec<Result<Document, ConfigError>> {
    let dotted = vec!["a"; depth].join(".");
    let half = depth / 2;
    let deep = "[".repeat(half) + &"]".repeat(half);
    let set = [format!("{}={deep}", vec!["a"; depth - half].join("."))];
    let texts = [
        format!("{dotted} = 1"),
        format!("[{dotted}]"),
        format!("[[{dotted}]]\nb = 1"),
        format!("x = {}{}", "[".repeat(depth), "]".repeat(depth)),
        format!("x = {}1{}", "{a=".repeat(depth), "}".repeat(depth)),
    ];
    let parsed = texts.iter().map(|text| Document::parse("a.toml", text));
    let tasks = [("task", "")];
    parsed
        .chain([Document::load("task", &set, files(&tasks))])
        .collect()
}
