//! Registries: the parts of one kind that a task file may name, the built-in ones and a user's own.
//!
//! A new built-in part is one file and one line in its registry; a part of a program's own is added once,
//! before it loads a task:
//!
//! ```
//! use stridemap_lab::{StatePart, states};
//!
//! // ψ_roll in rad, for whoever prefers it.
//! static PSI_ROLL_RAD: StatePart = StatePart {
//!     name: "psi_roll_rad",
//!     about: "angle of the pendulum from the stance foot to the centre of mass, rad",
//!     invariant: false,
//!     of: |at| at.measures.psi_roll_deg.to_radians(),
//! };
//! states().add(&PSI_ROLL_RAD)?;
//! assert!(states().find("psi_roll_rad").is_some());
//! // A name is taken once.
//! assert!(states().add(&PSI_ROLL_RAD).is_err());
//! # Ok::<(), stridemap_lab::LabError>(())
//! ```

use std::sync::{PoisonError, RwLock};

use crate::error::{Invalid, LabError};

/// What a registry tells of a part.
pub trait Part: Sync + 'static {
    /// The name in task files; with its unit, where it has one.
    fn name(&self) -> &'static str;
    /// What it is, in a line.
    fn about(&self) -> &'static str;
}

/// The parts of one kind.
pub struct Registry<P: Part + ?Sized> {
    kind: &'static str,
    built_in: &'static [&'static P],
    added: RwLock<Vec<&'static P>>,
}

impl<P: Part + ?Sized> Registry<P> {
    /// A registry of the built-in parts; `kind` is the singular, for messages.
    #[must_use]
    pub const fn new(kind: &'static str, built_in: &'static [&'static P]) -> Self {
        Self { kind, built_in, added: RwLock::new(Vec::new()) }
    }

    /// Adds a part of one's own.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] if its name is taken.
    pub fn add(&self, part: &'static P) -> Result<(), LabError> {
        if self.find(part.name()).is_some() {
            return Err(LabError::Invalid(Invalid {
                key: format!("{} {:?}", self.kind, part.name()),
                requirement: "is there already; give yours another name".into(),
            }));
        }
        let mut added = self.added.write().unwrap_or_else(PoisonError::into_inner);
        added.push(part);
        Ok(())
    }

    /// Every part, the built-in ones first.
    #[must_use]
    pub fn all(&self) -> Vec<&'static P> {
        let added = self.added.read().unwrap_or_else(PoisonError::into_inner);
        self.built_in.iter().chain(added.iter()).copied().collect()
    }

    /// The part of this name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&'static P> {
        self.all().into_iter().find(|part| part.name() == name)
    }

    /// The part that a file names, or an error that lists those there are.
    ///
    /// # Errors
    ///
    /// The deserialiser's error for an unknown variant.
    pub fn read<E: serde::de::Error>(&self, name: &str) -> Result<&'static P, E> {
        self.find(name).ok_or_else(|| {
            // serde wants the list for ever; a wrong name is read once in a program's life.
            let names: Vec<&'static str> = self.all().iter().map(|part| part.name()).collect();
            E::unknown_variant(name, names.leak())
        })
    }
}

/// What a registry tells of a part that is a type of its own.
macro_rules! part {
    ($part:ty, $name:literal, $about:literal) => {
        impl $crate::registry::Part for $part {
            fn name(&self) -> &'static str {
                $name
            }
            fn about(&self) -> &'static str {
                $about
            }
        }
    };
}
pub(crate) use part;

/// A reference to a part that is equal by name, and read and written as its name.
macro_rules! named {
    ($(#[$doc:meta])* $named:ident, $part:ty, $registry:path) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        pub struct $named(pub &'static $part);

        impl std::ops::Deref for $named {
            type Target = $part;
            fn deref(&self) -> &$part {
                self.0
            }
        }

        impl PartialEq for $named {
            fn eq(&self, other: &Self) -> bool {
                $crate::registry::Part::name(self.0) == $crate::registry::Part::name(other.0)
            }
        }

        impl Eq for $named {}

        impl std::fmt::Debug for $named {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str($crate::registry::Part::name(self.0))
            }
        }

        impl serde::Serialize for $named {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str($crate::registry::Part::name(self.0))
            }
        }

        impl<'de> serde::Deserialize<'de> for $named {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let name = String::deserialize(deserializer)?;
                $registry().read(&name).map(Self)
            }
        }
    };
}
pub(crate) use named;
