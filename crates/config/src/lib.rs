//! Task files: TOML in, typed configuration out, and for every fault the file, the line and the key.
//!
//! ```text
//! my-robot.toml ── extends ──> built-in task walking ── extends ──> ...
//!       │                              │
//!       └── laid over ─────────────────┘
//!                   │
//!        --set a.b=1 laid over
//!                   │
//!               Document ── deserialize ──> a derived struct
//! ```
//!
//! Tables merge key by key; everything else (arrays of tables too, but for [`Components`]) replaces. What may be left out is
//! unset by the word `"none"`. `toml` parses, serde's derived
//! readers check, `serde_path_to_error` says at which key they stopped; this crate keeps the line of every
//! value through the merge and words the faults. A key that is not a field is refused whether or not the struct
//! says `deny_unknown_fields`. An integer stands for a float, never the reverse. An enum whose variants have no
//! fields is a string.
//!
//! ```
//! use serde::Deserialize;
//! use stridemap_config::Document;
//!
//! #[derive(Debug, Deserialize)]
//! struct Task { map: Map }
//!
//! #[derive(Debug, Deserialize)]
//! struct Map { samples: usize, #[serde(default)] draw: Draw }
//!
//! #[derive(Debug, Default, Deserialize)]
//! #[serde(rename_all = "snake_case")]
//! enum Draw { #[default] Full, Latent, Mean }
//!
//! let tasks = [("mine", "extends = \"base\"\n[map]\ndraw = \"ful\""), ("base", "map.samples = 60")];
//! let task = Document::load("mine", &[], &tasks)?.deserialize::<Task>();
//! assert_eq!(
//!     task.unwrap_err().to_string(),
//!     "built-in task mine:3: map.draw = \"ful\": unknown value; did you mean \"full\"? \
//!      (allowed: full, latent, mean)"
//! );
//! let task: Task = Document::load("mine", &["map.draw=mean".into()], &tasks)?.deserialize()?;
//! assert_eq!(task.map.samples, 60);
//! # Ok::<(), stridemap_config::ConfigError>(())
//! ```

mod deserialize;
mod document;
mod error;
mod format;
mod key;
mod load;
mod node;
mod write;

#[cfg(test)]
mod tests;

pub use document::Document;
pub use error::ConfigError;
pub use format::{Components, Format};
pub use key::nearest;
pub use write::{to_toml, walk};
