//! Serde's view of a tree: structs, numbers, arrays and maps, with the place of every fault.

use std::slice;

use serde::de::{self, DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};

use super::error::{ConfigError, Problem};
use super::key::Key;
use super::node::{Content, Entry, Node};
use super::variant;

/// The largest integer of either sign that a double holds without a gap, 2⁵³.
const EXACT_INTEGER: u64 = 1 << 53;

impl<'de> Deserializer<'de> for &'de Node {
    type Error = ConfigError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::Table(table) => visitor.visit_map(TableAccess::new(table.entries())),
            Content::Array(items) => visit_array(items, visitor),
            Content::String(text) => visitor.visit_borrowed_str(text),
            Content::Integer(number) => visitor.visit_i64(*number),
            Content::Float(number) => visitor.visit_f64(*number),
            Content::Bool(truth) => visitor.visit_bool(*truth),
        }
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match self.content {
            Content::Bool(truth) => visitor.visit_bool(truth),
            _ => Err(ConfigError::wrong_type(self, "true or false")),
        }
    }

    fn deserialize_i8<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, i8::MIN.into(), i8::MAX.into(), visitor)
    }

    fn deserialize_i16<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, i16::MIN.into(), i16::MAX.into(), visitor)
    }

    fn deserialize_i32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, i32::MIN.into(), i32::MAX.into(), visitor)
    }

    fn deserialize_i64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, i64::MIN, i64::MAX, visitor)
    }

    fn deserialize_i128<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, i64::MIN, i64::MAX, visitor)
    }

    fn deserialize_u8<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, 0, u8::MAX.into(), visitor)
    }

    fn deserialize_u16<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, 0, u16::MAX.into(), visitor)
    }

    fn deserialize_u32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, 0, u32::MAX.into(), visitor)
    }

    fn deserialize_u64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, 0, i64::MAX, visitor)
    }

    fn deserialize_u128<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        integer(self, 0, i64::MAX, visitor)
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        if let Content::Float(number) = self.content
            && number.is_finite()
            && number.abs() > f64::from(f32::MAX)
        {
            return Err(out_of_range(self, "a number below 3.4e38 in size"));
        }
        self.deserialize_f64(visitor)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match self.content {
            Content::Float(number) => visitor.visit_f64(number),
            Content::Integer(number) if number.unsigned_abs() <= EXACT_INTEGER => {
                visitor.visit_f64(number as f64)
            }
            Content::Integer(_) => Err(out_of_range(
                self,
                "an integer of at most 2^53 in size, or a number with a point",
            )),
            _ => Err(ConfigError::wrong_type(self, "a number")),
        }
    }

    fn deserialize_char<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::String(text) if text.chars().count() == 1 => visitor.visit_borrowed_str(text),
            _ => Err(ConfigError::wrong_type(self, "a string of one character")),
        }
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::String(text) => visitor.visit_borrowed_str(text),
            _ => Err(ConfigError::wrong_type(self, "a string")),
        }
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        self.deserialize_str(visitor)
    }

    fn deserialize_identifier<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        self.deserialize_str(visitor)
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        self.deserialize_seq(visitor)
    }

    /// TOML has no null: an option that is given is `Some`, one that is absent is `None`.
    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_some(self)
    }

    fn deserialize_unit<V: Visitor<'de>>(self, _: V) -> Result<V::Value, ConfigError> {
        Err(ConfigError::wrong_type(self, "nothing"))
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        self.deserialize_unit(visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::Array(items) => visit_array(items, visitor),
            _ => Err(ConfigError::wrong_type(self, "an array")),
        }
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        let values = if length == 1 { "value" } else { "values" };
        let expected = format!("an array of {length} {values}");
        match &self.content {
            Content::Array(items) if items.len() == length => visit_array(items, visitor),
            Content::Array(items) => Err(ConfigError::here(Problem::WrongLength {
                expected,
                found: items.len(),
            })),
            _ => Err(ConfigError::wrong_type(self, &expected)),
        }
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        self.deserialize_tuple(length, visitor)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::Table(table) => visitor.visit_map(TableAccess::new(table.entries())),
            _ => Err(ConfigError::wrong_type(self, "a table")),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::Table(table) => {
                visitor.visit_map(TableAccess::new(table.entries()).allow(fields))
            }
            _ => Err(ConfigError::wrong_type(self, "a table")),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        visitor.visit_enum(variant::Variant::of(self, variants)?)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_unit()
    }
}

fn integer<'de, V: Visitor<'de>>(
    node: &Node,
    least: i64,
    most: i64,
    visitor: V,
) -> Result<V::Value, ConfigError> {
    let expected = || match (least, most) {
        (i64::MIN, i64::MAX) => "an integer".to_owned(),
        (0, i64::MAX) => "an integer of at least 0".to_owned(),
        _ => format!("an integer from {least} to {most}"),
    };
    match node.content {
        Content::Integer(number) if (least..=most).contains(&number) => {
            match u64::try_from(number) {
                Ok(number) => visitor.visit_u64(number),
                Err(_) => visitor.visit_i64(number),
            }
        }
        Content::Integer(_) => Err(out_of_range(node, &expected())),
        _ => Err(ConfigError::wrong_type(node, &expected())),
    }
}

fn out_of_range(node: &Node, expected: &str) -> ConfigError {
    ConfigError::here(Problem::OutOfRange {
        expected: expected.to_owned(),
        found: node.describe(),
    })
}

fn visit_array<'de, V: Visitor<'de>>(
    items: &'de [Node],
    visitor: V,
) -> Result<V::Value, ConfigError> {
    let mut access = ArrayAccess {
        items: items.iter(),
        at: 0,
    };
    let value = visitor.visit_seq(&mut access)?;
    if access.items.len() == 0 {
        return Ok(value);
    }
    let values = if access.at == 1 { "value" } else { "values" };
    Err(ConfigError::here(Problem::WrongLength {
        expected: format!("an array of {} {values}", access.at),
        found: items.len(),
    }))
}

struct ArrayAccess<'de> {
    items: slice::Iter<'de, Node>,
    at: usize,
}

impl<'de> SeqAccess<'de> for ArrayAccess<'de> {
    type Error = ConfigError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, ConfigError> {
        let Some(item) = self.items.next() else {
            return Ok(None);
        };
        let at = self.at;
        self.at += 1;
        seed.deserialize(item)
            .map(Some)
            .map_err(|error| error.at(item).inside(at.to_string()))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len())
    }
}

/// The entries of a table, for a struct or a map.
pub(super) struct TableAccess<'de> {
    entries: slice::Iter<'de, Entry>,
    current: Option<&'de Entry>,
    /// The keys of the struct; `None` for a map, which has any.
    allowed: Option<&'static [&'static str]>,
    /// The key that has chosen the variant and is not the struct's own.
    tag: Option<&'static str>,
}

impl<'de> TableAccess<'de> {
    pub(super) fn new(entries: &'de [Entry]) -> Self {
        Self {
            entries: entries.iter(),
            current: None,
            allowed: None,
            tag: None,
        }
    }

    /// Refuses other keys than these, whether or not the struct says `deny_unknown_fields`.
    pub(super) fn allow(mut self, fields: &'static [&'static str]) -> Self {
        self.allowed = Some(fields);
        self
    }

    pub(super) fn without(mut self, tag: &'static str) -> Self {
        self.tag = Some(tag);
        self
    }
}

impl<'de> MapAccess<'de> for TableAccess<'de> {
    type Error = ConfigError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ConfigError> {
        let tag = self.tag;
        let next = self
            .entries
            .find(|entry| tag.is_none_or(|tag| entry.key != tag));
        let Some(entry) = next else {
            return Ok(None);
        };
        self.current = Some(entry);
        if let Some(fields) = self.allowed
            && !fields.contains(&entry.key.as_str())
        {
            let allowed: Vec<&str> = tag.into_iter().chain(fields.iter().copied()).collect();
            return Err(
                ConfigError::unknown_key(&entry.key, &allowed).with_origin(&entry.key_origin)
            );
        }
        seed.deserialize(Key(entry)).map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<T::Value, ConfigError> {
        let Some(entry) = self.current.take() else {
            return Err(de::Error::custom("a value was asked for before its key"));
        };
        seed.deserialize(&entry.value)
            .map_err(|error| error.at(&entry.value).inside(&entry.key))
    }

    fn size_hint(&self) -> Option<usize> {
        match self.tag {
            None => Some(self.entries.len()),
            Some(_) => None,
        }
    }
}
