//! The figures of the paper and of a run, each a function from plain data to a [`Figure`](crate::Figure).

mod actions;
mod atlas;
mod check;
mod lines;
mod map;
mod names;
mod of_run;
mod paper;
mod path;
mod policy;
mod progress;
mod return_map;
mod samples;
mod seeds;
mod stability;
mod stepping;
mod strips;
mod surface;
mod sweep;
mod trust;
mod tune;

pub use actions::actions;
pub use atlas::push_atlas;
pub use lines::map_lines;
pub use map::{map_slices, map_surface};
pub use paper::{Fig7, Fig8, Fig9, PolicyCurve, fig7, fig8, fig9};
pub use path::path;
pub use policy::policy;
pub use progress::{learning_curves, state_over_strides};
pub use return_map::{fig10, pushed_one_stride, undisturbed_return_maps};
pub use samples::{SamplesPoint, samples};
pub use seeds::{quartiles, runs_compared};
pub use stability::stability;
pub use stepping::fig14;
pub use strips::{Shot, Strip, TimeLapse, View, time_lapses};
pub use surface::fig13;
pub use sweep::{SweepMean, sweep};
pub use trust::{predicted_actual, standardized_residuals};
pub use tune::{TriedGait, tried_gaits};

pub(crate) use actions::{verdict_words, warning_words};
pub(crate) use atlas::weakest_words;
pub(crate) use names::{label, quantity};
pub(crate) use of_run::{mean_reward, measured};
