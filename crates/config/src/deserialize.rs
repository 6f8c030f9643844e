//! Serde's view of the tree. Its derived readers do the checking.

use serde::de::value::{MapDeserializer, SeqDeserializer};
use serde::de::{Deserializer, Error, IntoDeserializer, Visitor};
use serde::forward_to_deserialize_any;

use crate::error::ConfigError;
use crate::format::NONE;
use crate::node::{Content, Node};

impl<'de> IntoDeserializer<'de, ConfigError> for &'de Node {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> Deserializer<'de> for &'de Node {
    type Error = ConfigError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::Table(table) => {
                let entries = table.iter().map(|(key, node)| (key.as_str(), node));
                MapDeserializer::new(entries).deserialize_any(visitor)
            }
            Content::Array(items) => SeqDeserializer::new(items.iter()).deserialize_any(visitor),
            Content::String(text) => visitor.visit_borrowed_str(text),
            Content::Integer(number) => visitor.visit_i64(*number),
            Content::Float(number) => visitor.visit_f64(*number),
            Content::Bool(truth) => visitor.visit_bool(*truth),
        }
    }

    /// TOML has no null: the word "none" unsets what may be left out, an inherited value too.
    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::String(word) if word == NONE => visitor.visit_none(),
            _ => visitor.visit_some(self),
        }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_newtype_struct(self)
    }

    /// Refuses other keys than `fields`, and an array in their order, which serde would take.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        let Content::Table(table) = &self.content else {
            return Err(Error::invalid_type(self.unexpected(), &"a table"));
        };
        match table.keys().find(|key| !fields.contains(&key.as_str())) {
            Some(key) => Err(Error::unknown_field(key, fields)),
            None => self.deserialize_any(visitor),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        match &self.content {
            Content::String(name) if variants.contains(&name.as_str()) => {
                visitor.visit_enum(name.as_str().into_deserializer())
            }
            Content::String(name) => Err(Error::unknown_variant(name, variants)),
            _ => {
                let expected = format!("one of {}", variants.join(", "));
                Err(Error::invalid_type(self.unexpected(), &expected.as_str()))
            }
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}
