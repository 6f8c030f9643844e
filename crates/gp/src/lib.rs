//! Gaussian-process regression on its own: kernels, posteriors, evidence, fitting and scores.

/// What can go wrong when a Gaussian process is fitted or queried.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpError {}
