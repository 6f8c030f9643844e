//! Serde's view of the keys of a table.

use serde::de::{self, Deserializer, Visitor};
use serde::forward_to_deserialize_any;

use super::error::{ConfigError, Problem};
use super::node::{Entry, describe_string};

/// The key of a map: a string, an integer, or an enum such as the name of a joint.
pub(super) struct Key<'de>(pub(super) &'de Entry);

impl<'de> Key<'de> {
    fn fault(&self, error: ConfigError) -> ConfigError {
        error.with_origin(&self.0.key_origin).inside(&self.0.key)
    }

    fn number<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        let key = &self.0.key;
        let visited = if let Ok(number) = key.parse::<u64>() {
            visitor.visit_u64(number)
        } else if let Ok(number) = key.parse::<i64>() {
            visitor.visit_i64(number)
        } else {
            Err(ConfigError::here(Problem::WrongType {
                expected: "an integer as the key".to_owned(),
                found: describe_string(key),
            }))
        };
        visited.map_err(|error| self.fault(error))
    }
}

macro_rules! integer_keys {
    ($($method:ident)*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
            self.number(visitor)
        }
    )*};
}

impl<'de> Deserializer<'de> for Key<'de> {
    type Error = ConfigError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor
            .visit_borrowed_str(&self.0.key)
            .map_err(|error: ConfigError| match error.problem() {
                // A field's name: the error says which key it is already.
                Problem::UnknownKey { .. } => error.with_origin(&self.0.key_origin),
                _ => self.fault(error),
            })
    }

    integer_keys! {
        deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_i128
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 deserialize_u128
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        if !variants.contains(&self.0.key.as_str()) {
            return Err(
                ConfigError::unknown_key(&self.0.key, variants).with_origin(&self.0.key_origin)
            );
        }
        let name: de::value::BorrowedStrDeserializer<'de, ConfigError> =
            de::value::BorrowedStrDeserializer::new(&self.0.key);
        visitor.visit_enum(name).map_err(|error| self.fault(error))
    }

    forward_to_deserialize_any! {
        bool f32 f64 char str string bytes byte_buf option unit unit_struct seq tuple
        tuple_struct map struct identifier ignored_any
    }
}
