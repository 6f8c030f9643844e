//! The figures of the paper and of a run, each a function from plain data to a [`Figure`](crate::Figure).

mod check;
mod paper;
mod return_map;

pub use paper::{Fig7, Fig8, Fig9, MeanSd, PolicyCurve, TrialComparison, fig7, fig8, fig9};
pub use return_map::{Fig10, ReturnMap, ReturnPair, fig10};
