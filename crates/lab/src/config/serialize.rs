//! A typed configuration back to TOML text, in the form in which users write it.

use std::sync::Arc;

use serde::Serialize;
use serde::ser::{
    self, SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant, SerializeTuple,
    SerializeTupleStruct, Serializer,
};

use super::error::{ConfigError, Problem};
use super::merge::KIND;
use super::node::{Content, Entry, Node, Origin, Source, Table};
use super::write;

/// A typed configuration as TOML text, every value written out, defaults too.
///
/// The reverse of [`Document::deserialize`](super::Document::deserialize): a variant with fields
/// becomes a table with `kind`, `None` is left out, floats are written with the digits that give
/// the same bits again.
///
/// # Errors
///
/// What TOML or a task file cannot hold: NaN, an integer beyond 64 bits with sign, `None` inside
/// an array, a map whose keys are not strings or integers, a value that is not a table.
///
/// # Example
///
/// ```
/// use serde::{Deserialize, Serialize};
/// use stridemap_lab::config::{Document, to_toml};
///
/// #[derive(Debug, PartialEq, Serialize, Deserialize)]
/// struct Task { seed: u64, map: Map, note: Option<String> }
/// #[derive(Debug, PartialEq, Serialize, Deserialize)]
/// #[serde(rename_all = "snake_case")]
/// enum Map { Gp { samples: usize }, Exact }
///
/// let task = Task { seed: 1, map: Map::Gp { samples: 60 }, note: None };
/// let text = to_toml(&task).unwrap();
/// assert_eq!(text, "seed = 1\n\n[map]\nkind = \"gp\"\nsamples = 60\n");
/// assert_eq!(Document::parse("config.toml", &text).unwrap().deserialize::<Task>(), Ok(task));
/// ```
pub fn to_toml<T: Serialize + ?Sized>(value: &T) -> Result<String, ConfigError> {
    Ok(write::document(&to_node(value)?))
}

/// A typed configuration as a tree; errors as for [`to_toml`].
pub(crate) fn to_node<T: Serialize + ?Sized>(value: &T) -> Result<Node, ConfigError> {
    let writer = Writer(Origin::whole(&Arc::new(Source {
        name: "configuration".to_owned(),
        base_dir: None,
    })));
    match value.serialize(&writer)? {
        Some(root) if root.as_table().is_some() => Ok(root),
        Some(other) => Err(ConfigError::wrong_type(&other, "a table")),
        None => Err(unfit("a table", "nothing")),
    }
}

fn unfit(expected: &str, found: &str) -> ConfigError {
    ConfigError::here(Problem::WrongType {
        expected: expected.to_owned(),
        found: found.to_owned(),
    })
}

/// Makes nodes; `None` stands for an absent value.
struct Writer(Origin);

type Made = Result<Option<Node>, ConfigError>;

impl Writer {
    fn node(&self, content: Content) -> Made {
        Ok(Some(Node {
            content,
            origin: self.0.clone(),
        }))
    }

    fn integer<N: TryInto<i64> + ToString + Copy>(&self, number: N) -> Made {
        match number.try_into() {
            Ok(number) => self.node(Content::Integer(number)),
            Err(_) => Err(ConfigError::here(Problem::OutOfRange {
                expected: "an integer of at most 64 bits with its sign".to_owned(),
                found: format!("the integer {}", number.to_string()),
            })),
        }
    }

    fn items(&self) -> Items<'_> {
        Items {
            writer: self,
            nodes: Vec::new(),
            variant: None,
        }
    }

    fn fields(&self, kind: Option<&str>) -> Result<Fields<'_>, ConfigError> {
        let mut fields = Fields {
            writer: self,
            table: Table::default(),
            key: None,
        };
        if let Some(kind) = kind {
            fields.put(KIND.to_owned(), kind)?;
        }
        Ok(fields)
    }
}

macro_rules! integers {
    ($($method:ident: $number:ty,)*) => {$(
        fn $method(self, number: $number) -> Made {
            self.integer(number)
        }
    )*};
}

impl<'w> Serializer for &'w Writer {
    type Ok = Option<Node>;
    type Error = ConfigError;
    type SerializeSeq = Items<'w>;
    type SerializeTuple = Items<'w>;
    type SerializeTupleStruct = Items<'w>;
    type SerializeTupleVariant = Items<'w>;
    type SerializeMap = Fields<'w>;
    type SerializeStruct = Fields<'w>;
    type SerializeStructVariant = Fields<'w>;

    integers! {
        serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_i128: i128, serialize_u8: u8, serialize_u16: u16, serialize_u32: u32,
        serialize_u64: u64, serialize_u128: u128,
    }

    fn serialize_bool(self, truth: bool) -> Made {
        self.node(Content::Bool(truth))
    }

    fn serialize_f32(self, number: f32) -> Made {
        self.serialize_f64(number.into())
    }

    fn serialize_f64(self, number: f64) -> Made {
        if number.is_nan() {
            return Err(ConfigError::here(Problem::NotANumber));
        }
        self.node(Content::Float(number))
    }

    fn serialize_char(self, letter: char) -> Made {
        self.node(Content::String(letter.to_string()))
    }

    fn serialize_str(self, text: &str) -> Made {
        self.node(Content::String(text.to_owned()))
    }

    fn serialize_bytes(self, bytes: &[u8]) -> Made {
        bytes.serialize(self)
    }

    fn serialize_none(self) -> Made {
        Ok(None)
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Made {
        value.serialize(self)
    }

    fn serialize_unit(self) -> Made {
        Err(unfit("a value", "nothing"))
    }

    fn serialize_unit_struct(self, _: &'static str) -> Made {
        self.serialize_unit()
    }

    fn serialize_unit_variant(self, _: &'static str, _: u32, variant: &'static str) -> Made {
        self.serialize_str(variant)
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Made {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &T,
    ) -> Made {
        let mut fields = self.fields(Some(variant))?;
        match value.serialize(self)? {
            Some(Node {
                content: Content::Table(table),
                ..
            }) if table.get(KIND).is_none() => {
                fields.table.entries.extend(table.entries);
                fields.finish()
            }
            Some(value) => {
                let mut fields = self.fields(None)?;
                fields.push(variant.to_owned(), value);
                fields.finish()
            }
            None => fields.finish(),
        }
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Items<'w>, ConfigError> {
        Ok(self.items())
    }

    fn serialize_tuple(self, _: usize) -> Result<Items<'w>, ConfigError> {
        Ok(self.items())
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Items<'w>, ConfigError> {
        Ok(self.items())
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Items<'w>, ConfigError> {
        let mut items = self.items();
        items.variant = Some(variant);
        Ok(items)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Fields<'w>, ConfigError> {
        self.fields(None)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Fields<'w>, ConfigError> {
        self.fields(None)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        _: usize,
    ) -> Result<Fields<'w>, ConfigError> {
        self.fields(Some(variant))
    }
}

struct Items<'w> {
    writer: &'w Writer,
    nodes: Vec<Node>,
    /// The name of a tuple variant, which is written `{ name = [..] }`.
    variant: Option<&'static str>,
}

impl Items<'_> {
    fn put<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), ConfigError> {
        let at = self.nodes.len();
        let made = value
            .serialize(self.writer)
            .and_then(|made| made.ok_or_else(|| unfit("a value", "nothing")));
        self.nodes
            .push(made.map_err(|error| error.inside(at.to_string()))?);
        Ok(())
    }

    fn finish(self) -> Made {
        let array = self.writer.node(Content::Array(self.nodes))?;
        match (self.variant, array) {
            (Some(variant), Some(array)) => {
                let mut fields = self.writer.fields(None)?;
                fields.push(variant.to_owned(), array);
                fields.finish()
            }
            (_, array) => Ok(array),
        }
    }
}

macro_rules! items {
    ($($role:ident $method:ident,)*) => {$(
        impl $role for Items<'_> {
            type Ok = Option<Node>;
            type Error = ConfigError;

            fn $method<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), ConfigError> {
                self.put(value)
            }

            fn end(self) -> Made {
                self.finish()
            }
        }
    )*};
}

use ser::SerializeTupleVariant;
items! {
    SerializeSeq serialize_element,
    SerializeTuple serialize_element,
    SerializeTupleStruct serialize_field,
    SerializeTupleVariant serialize_field,
}

struct Fields<'w> {
    writer: &'w Writer,
    table: Table,
    key: Option<String>,
}

impl Fields<'_> {
    fn push(&mut self, key: String, value: Node) {
        self.table.entries.push(Entry {
            key,
            key_origin: self.writer.0.clone(),
            value,
        });
    }

    fn put<T: Serialize + ?Sized>(&mut self, key: String, value: &T) -> Result<(), ConfigError> {
        match value.serialize(self.writer) {
            Ok(Some(node)) => self.push(key, node),
            Ok(None) => {}
            Err(error) => return Err(error.inside(key)),
        }
        Ok(())
    }

    fn finish(self) -> Made {
        self.writer.node(Content::Table(self.table))
    }
}

macro_rules! fields {
    ($($role:ident)*) => {$(
        impl $role for Fields<'_> {
            type Ok = Option<Node>;
            type Error = ConfigError;

            fn serialize_field<T: Serialize + ?Sized>(
                &mut self,
                key: &'static str,
                value: &T,
            ) -> Result<(), ConfigError> {
                self.put(key.to_owned(), value)
            }

            fn end(self) -> Made {
                self.finish()
            }
        }
    )*};
}

fields! { SerializeStruct SerializeStructVariant }

impl SerializeMap for Fields<'_> {
    type Ok = Option<Node>;
    type Error = ConfigError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), ConfigError> {
        self.key = match key.serialize(self.writer)?.map(|node| node.content) {
            Some(Content::String(key)) => Some(key),
            Some(Content::Integer(key)) => Some(key.to_string()),
            _ => return Err(unfit("a string or an integer as the key", "another value")),
        };
        Ok(())
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), ConfigError> {
        match self.key.take() {
            Some(key) => self.put(key, value),
            None => Err(ser::Error::custom("a value was given before its key")),
        }
    }

    fn end(self) -> Made {
        self.finish()
    }
}
