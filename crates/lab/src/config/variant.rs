//! Enums: `"name"`, and tables whose `kind` names the variant.
//!
//! Serde's own `#[serde(tag = "kind")]` copies the table into a buffer before it reads the fields,
//! and with it goes every position. So the rule lives here instead: a *plain* derived enum is read
//! from a table with the key `kind`, straight from the tree.

use serde::de::{
    self, DeserializeSeed, Deserializer, EnumAccess, IntoDeserializer, VariantAccess, Visitor,
};
use serde::forward_to_deserialize_any;

use super::deserialize::TableAccess;
use super::error::{ConfigError, Problem};
use super::merge::KIND;
use super::node::{Content, Entry, Node};

/// A variant's name and what stands beside it.
pub(super) struct Variant<'de> {
    name: &'de str,
    /// The node that the name was read from: the string itself or the `kind` of the table.
    tag: Tag<'de>,
    fields: Fields<'de>,
}

enum Tag<'de> {
    Here(&'de Node),
    Kind(&'de Entry),
    Key(&'de Entry),
}

enum Fields<'de> {
    /// The other keys of the table with `kind`; none after a bare string.
    Beside(&'de [Entry]),
    /// The value in `{ name = value }`.
    Below(&'de Entry),
}

impl<'de> Variant<'de> {
    pub(super) fn of(
        node: &'de Node,
        variants: &'static [&'static str],
    ) -> Result<Self, ConfigError> {
        let table = match &node.content {
            Content::String(name) => {
                return Ok(Self {
                    name,
                    tag: Tag::Here(node),
                    fields: Fields::Beside(&[]),
                });
            }
            Content::Table(table) => table,
            _ => {
                let expected = format!("one of {}", variants.join(", "));
                return Err(ConfigError::wrong_type(node, &expected));
            }
        };
        if let Some(kind) = table.get(KIND) {
            let Some(name) = kind.value.as_str() else {
                let error = ConfigError::wrong_type(&kind.value, "a string");
                return Err(error.at(&kind.value).inside(KIND));
            };
            return Ok(Self {
                name,
                tag: Tag::Kind(kind),
                fields: Fields::Beside(table.entries()),
            });
        }
        match table.entries() {
            [only] if variants.contains(&only.key.as_str()) => Ok(Self {
                name: &only.key,
                tag: Tag::Key(only),
                fields: Fields::Below(only),
            }),
            _ => Err(ConfigError::here(Problem::MissingKey {
                allowed: variants.iter().map(|name| (*name).to_owned()).collect(),
            })
            .inside(KIND)),
        }
    }
}

impl<'de> EnumAccess<'de> for Variant<'de> {
    type Error = ConfigError;
    type Variant = Payload<'de>;

    fn variant_seed<S: DeserializeSeed<'de>>(
        self,
        seed: S,
    ) -> Result<(S::Value, Payload<'de>), ConfigError> {
        let name: de::value::StrDeserializer<'de, ConfigError> = self.name.into_deserializer();
        let value = seed.deserialize(name).map_err(|error| match self.tag {
            Tag::Here(node) => error.at(node),
            Tag::Kind(entry) => error.at(&entry.value).inside(KIND),
            Tag::Key(entry) => error.with_origin(&entry.key_origin).inside(&entry.key),
        })?;
        Ok((value, Payload(self.fields)))
    }
}

/// What stands beside a variant's name, once the name is known.
pub(super) struct Payload<'de>(Fields<'de>);

impl<'de> VariantAccess<'de> for Payload<'de> {
    type Error = ConfigError;

    fn unit_variant(self) -> Result<(), ConfigError> {
        match self.0 {
            Fields::Beside(entries) => {
                match entries.iter().find(|entry| entry.key != KIND) {
                    Some(other) => Err(ConfigError::unknown_key(&other.key, &[KIND])
                        .with_origin(&other.key_origin)),
                    None => Ok(()),
                }
            }
            Fields::Below(entry) => match &entry.value.content {
                Content::Table(table) if table.entries().is_empty() => Ok(()),
                _ => Err(ConfigError::wrong_type(&entry.value, "an empty table")
                    .at(&entry.value)
                    .inside(&entry.key)),
            },
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<T::Value, ConfigError> {
        match self.0 {
            Fields::Beside(entries) => seed.deserialize(Beside(entries)),
            Fields::Below(entry) => seed
                .deserialize(&entry.value)
                .map_err(|error| error.at(&entry.value).inside(&entry.key)),
        }
    }

    fn tuple_variant<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        match self.0 {
            Fields::Beside(_) => Err(ConfigError::here(Problem::WrongType {
                expected: format!("{{ name = [..] }} with {length} values"),
                found: "only the name of the variant".to_owned(),
            })),
            Fields::Below(entry) => (&entry.value)
                .deserialize_tuple(length, visitor)
                .map_err(|error| error.at(&entry.value).inside(&entry.key)),
        }
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        match self.0 {
            Fields::Beside(entries) => Beside(entries).deserialize_struct("", fields, visitor),
            Fields::Below(entry) => (&entry.value)
                .deserialize_struct("", fields, visitor)
                .map_err(|error| error.at(&entry.value).inside(&entry.key)),
        }
    }
}

/// A table without its `kind`.
struct Beside<'de>(&'de [Entry]);

impl<'de> Deserializer<'de> for Beside<'de> {
    type Error = ConfigError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_map(TableAccess::new(self.0).without(KIND))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        visitor.visit_map(TableAccess::new(self.0).without(KIND).allow(fields))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        visitor.visit_newtype_struct(self)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}
