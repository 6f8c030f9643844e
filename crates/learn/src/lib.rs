//! Policies, and learners that improve them inside any [`stridemap_returnmap::StrideProcess`].

mod policy;

pub use policy::Policy;
