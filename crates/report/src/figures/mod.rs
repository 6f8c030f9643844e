//! The figures of the paper and of a run, each a function from plain data to a [`Figure`](crate::Figure).

mod check;
mod map;
mod names;
mod paper;
mod policy;
mod progress;
mod return_map;
mod samples;
mod stepping;
mod strips;
mod surface;
mod table;
mod trust;

pub use map::{MapFigure, MapGrid, map_slices, map_surface};
pub use paper::{Fig7, Fig8, Fig9, MeanSd, PolicyCurve, TrialComparison, fig7, fig8, fig9};
pub use policy::{PolicyFigure, PolicyGrid, policy};
pub use progress::{
    LearningCurves, RunCurve, StateOverStrides, learning_curves, runs_compared, state_over_strides,
};
pub use return_map::{
    Fig10, ReturnMap, ReturnPair, UndisturbedReturnMaps, fig10, undisturbed_return_maps,
};
pub use samples::{SamplesPoint, samples};
pub use stepping::{Fig14, fig14};
pub use strips::{Shot, Solid, Strip, TimeLapse, View, solids, time_lapses};
pub use surface::fig13;
pub use table::{ComparisonRow, ComparisonTable};
pub use trust::{SuccessRate, predicted_actual, standardized_residuals, success_against_strides};

pub(crate) use names::{label, quantity};
