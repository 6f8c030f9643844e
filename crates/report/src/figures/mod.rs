//! The figures of the paper and of a run, each a function from plain data to a [`Figure`](crate::Figure).

mod actions;
mod check;
mod lines;
mod map;
mod names;
mod paper;
mod policy;
mod progress;
mod return_map;
mod samples;
mod seeds;
mod stepping;
mod strips;
mod surface;
mod table;
mod trust;

pub use actions::{ActionFigure, ActionIteration, actions};
pub use lines::{LineFigure, map_lines};
pub use map::{MapFigure, map_slices, map_surface};
pub use paper::{Fig7, Fig8, Fig9, MeanSd, PolicyCurve, TrialComparison, fig7, fig8, fig9};
pub use policy::{PolicyFigure, policy};
pub use progress::{LearningCurves, StateOverStrides, learning_curves, state_over_strides};
pub use return_map::{
    Fig10, ReturnMap, ReturnPair, Undisturbed, UndisturbedReturnMaps, fig10, pushed_one_stride, undisturbed_return_maps,
};
pub use samples::{SamplesPoint, samples};
pub use seeds::{RunCurve, quartiles, runs_compared};
pub use stepping::{Fig14, fig14};
pub use strips::{Shot, Strip, TimeLapse, View, time_lapses};
pub use surface::fig13;
pub use table::{ComparisonRow, ComparisonTable};
pub use trust::{SuccessRate, predicted_actual, standardized_residuals, success_against_strides};

pub(crate) use actions::{verdict_words, warning_words};
pub(crate) use names::{label, quantity};
