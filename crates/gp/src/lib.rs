//! Gaussian-process regression on its own: kernels, posteriors, evidence, fitting and scores.
