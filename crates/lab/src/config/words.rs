//! What serde reports, in the words of someone who writes TOML.

use std::fmt;

use serde::de::{self, Unexpected};

use super::error::{ConfigError, Problem, owned};
use super::node::{describe_bool, describe_float, describe_integer, describe_string};
use super::suggest::nearest;

impl serde::ser::Error for ConfigError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::here(Problem::Invalid {
            message: message.to_string(),
        })
    }
}

impl de::Error for ConfigError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::here(Problem::Invalid {
            message: message.to_string(),
        })
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::here(Problem::WrongType {
            expected: in_words(&expected.to_string()),
            found: describe(found),
        })
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn de::Expected) -> Self {
        Self::here(Problem::OutOfRange {
            expected: in_words(&expected.to_string()),
            found: describe(found),
        })
    }

    fn invalid_length(found: usize, expected: &dyn de::Expected) -> Self {
        Self::here(Problem::WrongLength {
            expected: expected.to_string(),
            found,
        })
    }

    fn unknown_variant(variant: &str, expected: &'static [&'static str]) -> Self {
        Self::here(Problem::UnknownValue {
            found: variant.to_owned(),
            nearest: nearest(variant, expected).map(str::to_owned),
            allowed: owned(expected),
        })
    }

    fn unknown_field(field: &str, expected: &'static [&'static str]) -> Self {
        Self::unknown_key(field, expected)
    }

    fn missing_field(field: &'static str) -> Self {
        let problem = Problem::MissingKey {
            allowed: Vec::new(),
        };
        Self::here(problem).inside(field)
    }

    fn duplicate_field(field: &'static str) -> Self {
        let message = format!("the key `{field}` is given twice, perhaps under two names");
        Self::here(Problem::Invalid { message })
    }
}

/// Serde names Rust types; a user's words are those of TOML.
fn in_words(expected: &str) -> String {
    let words = match expected {
        "f32" | "f64" => "a number",
        "i8" | "i16" | "i32" | "i64" | "isize" => "an integer",
        "u8" | "u16" | "u32" | "u64" | "usize" => "an integer of at least 0",
        "a boolean" => "true or false",
        "a sequence" => "an array",
        "a map" => "a table",
        _ if expected.starts_with("struct ") => "a table",
        _ => expected,
    };
    words.to_owned()
}

fn describe(found: Unexpected<'_>) -> String {
    match found {
        Unexpected::Bool(value) => describe_bool(value),
        Unexpected::Unsigned(value) => describe_integer(value),
        Unexpected::Signed(value) => describe_integer(value),
        Unexpected::Float(value) => describe_float(value),
        Unexpected::Str(text) => describe_string(text),
        Unexpected::Seq => "an array".to_owned(),
        Unexpected::Map => "a table".to_owned(),
        other => other.to_string(),
    }
}
