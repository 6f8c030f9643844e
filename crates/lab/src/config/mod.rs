//! Task files: TOML in, typed configuration out, and for every fault the file, the line and the key.
//!
//! ```text
//! my-robot.toml ── extends ──> built-in task walking ── extends ──> ...
//!       │                              │
//!       └── laid over ─────────────────┘
//!                   │
//!        --set a.b=1 laid over
//!                   │
//!               Document ── deserialize ──> a struct of the laboratory
//! ```
//!
//! # What configuration structs look like
//!
//! Plain derived structs and enums, no attributes needed. A key that is not a field is refused
//! whether or not the struct says `deny_unknown_fields`; `#[serde(default)]` and `Option` make a
//! key optional. Integers stand for floats, never the reverse; `nan` is refused.
//!
//! **Enums need no attribute either.** A unit variant is a string. A variant with fields is a table
//! whose key `kind` names it. Do *not* write `#[serde(tag = "kind")]`: serde would copy the table
//! before reading it and lose all positions (such an enum still works, and its errors name at
//! least the table, and the key where the fault leaves no doubt). `#[serde(rename_all)]` is fine.
//!
//! ```
//! use std::collections::BTreeMap;
//! use serde::Deserialize;
//! use stridemap_lab::config::Document;
//!
//! #[derive(Deserialize)]
//! struct Task { map: Map, #[serde(default)] action: Vec<Action>, rest_deg: BTreeMap<Joint, f64> }
//!
//! #[derive(Deserialize)]
//! #[serde(rename_all = "snake_case")]
//! enum Map { Gp { samples: usize, #[serde(default)] sample: Sample }, Exact }
//!
//! #[derive(Default, Deserialize)]
//! #[serde(rename_all = "snake_case")]
//! enum Sample { #[default] Full, Latent, Mean }
//!
//! #[derive(Deserialize)]
//! struct Action { modulates: String, bounds: [f64; 2] }
//!
//! #[derive(Deserialize, PartialEq, Eq, PartialOrd, Ord)]
//! #[serde(rename_all = "snake_case")]
//! enum Joint { HipPitch, Knee }
//!
//! let text = r#"
//! rest_deg = { hip_pitch = 15, knee = -30 }
//! [map]
//! kind = "gp"
//! samples = 60
//! sample = "ful"
//! [[action]]
//! modulates = "walk_amplitude_deg"
//! bounds = [0, 12]
//! "#;
//! let error = Document::parse("my-robot.toml", text).unwrap().deserialize::<Task>().err().unwrap();
//! assert_eq!(
//!     error.to_string(),
//!     "my-robot.toml:6: map.sample = \"ful\": unknown value; did you mean \"full\"? \
//!      (allowed: full, latent, mean)"
//! );
//!
//! let document = Document::parse("my-robot.toml", &text.replace("ful", "full")).unwrap();
//! let task: Task = document.deserialize().unwrap();
//! assert_eq!(task.action[0].bounds, [0.0, 12.0]);
//! assert_eq!(task.rest_deg[&Joint::Knee], -30.0);
//! ```
//!
//! # What one layer does to the one below
//!
//! Tables merge key by key, also where their `kind` differs; scalars and arrays (of tables too) replace.

mod deserialize;
mod document;
mod error;
mod key;
mod load;
mod merge;
mod node;
mod parse;
mod path;
mod serialize;
mod suggest;
mod variant;
mod words;
mod write;

#[cfg(test)]
mod tests;

pub use document::Document;
pub(crate) use error::walk;
pub use error::{ConfigError, Problem};
pub use load::{ResolveError, TaskText, resolver, task_text};
pub use node::{Content, Entry, Node, Origin, Source, Table};
pub use path::KeyPath;
pub(crate) use serialize::to_node;
pub use serialize::to_toml;
pub use suggest::nearest;
