//! What can be wrong with a record.

/// A record that cannot be analysed at all. What it can say in part is refused in the answer instead
/// ([`Refusal`](crate::Refusal)).
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StabilityError {
    /// Too many components of the state, or none.
    #[error("{found} components of the state; 1 to {most} can be analysed: name fewer columns")]
    States {
        /// Named.
        found: usize,
        /// Most.
        most: usize,
    },
    /// Too many actions.
    #[error("{found} actions; at most {most} can be analysed: name fewer columns")]
    Actions {
        /// Named.
        found: usize,
        /// Most.
        most: usize,
    },
    /// Hardly any strides.
    #[error("{found} strides; at least {needed} are needed")]
    TooFew {
        /// There.
        found: usize,
        /// Least.
        needed: usize,
    },
    /// A stretch whose tables are not of one length or width.
    #[error("the stretch that begins at stride {row} has tables of different sizes")]
    Shape {
        /// Its first row, from 0.
        row: usize,
    },
    /// A number that is none.
    #[error("stride {row} has a number that is not finite")]
    NotFinite {
        /// The row, from 0.
        row: usize,
    },
    /// A component that never changes.
    #[error("{name} is the same in every stride: it says nothing, leave it out")]
    Constant {
        /// The component.
        name: String,
    },
    /// A rule for falls, or a sensor, that names no component of the state.
    #[error("{name} is no component of the state ({known})")]
    Unknown {
        /// What was named.
        name: String,
        /// The components.
        known: String,
    },
    /// Two looks that are not there.
    #[error("two looks at each section need a second column for each component ({name}_2)")]
    NoSecondLook {
        /// The first component.
        name: String,
    },
    /// A number asked for that cannot be.
    #[error("{key} = {value}: {requirement}")]
    Number {
        /// Which.
        key: String,
        /// What was asked for.
        value: f64,
        /// What it must be.
        requirement: &'static str,
    },
}
