//! Will it fall? Stability of a gait from a short record of strides alone, with intervals, and what cannot be known.
//!
//! [`analyse`] takes a [`Record`] — states at successive sections — and answers with an [`Analysis`]: the Floquet
//! multipliers of the stride map, five checks of what they take for granted, bounds on the time to a fall, and what it
//! refuses to say.
//!
//! # Example
//!
//! A gait whose deviations shrink by 0.6 in a stride, in 60 strides without noise of the sensor:
//!
//! ```
//! use stridemap_stability::{Bout, Options, Record, SensorKnowledge, analyse};
//!
//! let (mut x, mut noise) = (0.0, 12345_u64);
//! let mut states = Vec::new();
//! for _ in 0..60 {
//!     noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
//!     x = 0.6 * x + (noise >> 40) as f64 / f64::from(1 << 24) - 0.5;
//!     states.push(vec![x]);
//! }
//! let bouts = vec![Bout { states, ..Bout::default() }];
//! let record = Record { state: vec!["roll_deg".into()], bouts, stride_s: Some(0.8) };
//! let options = Options { sensor: SensorKnowledge::Exact, ..Options::default() };
//! let found = analyse(&record, &options)?;
//! let largest = found.multipliers.ok_or("refused")?.largest;
//! assert!(largest.low < 0.6 && 0.6 < largest.high && largest.high - largest.low < 0.5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![allow(clippy::needless_range_loop, reason = "matrices of a size known to the compiler, by their indices")]

mod analysis;
mod answer;
mod checks;
pub mod coverage;
mod error;
mod fall;
pub mod fall_study;
mod filter;
mod linear;
mod multipliers;
mod page;
mod record;
mod rule;
mod sampler;
mod small;
mod student;

pub use analysis::{Examined, Options, analyse, examine};
pub use answer::{
    Analysis, Bounds, Check, Checks, CountsOnly, Estimate, FallBounds, LongEnough, Method, Multipliers, NoiseSource,
    RecordSummary, Refusal, SensorNoise, StridesToFall, Unstable,
};
pub use error::StabilityError;
pub use multipliers::SensorKnowledge;
pub use record::{Bout, MOST_STATES, Record};
pub use rule::FallRule;
