//! Reads run directories and draws them; computes nothing new.
//!
//! Every figure is a function from plain data to a [`Figure`], which writes itself as SVG, PNG and CSV.
//! A [`Run`](stridemap_record::Run) is a run directory read as far as it goes; [`write_report`] makes one page of one or several.
//!
//! ```
//! use stridemap_report::figures::{SuccessRate, success_against_strides};
//!
//! let figure = success_against_strides(&[
//!     SuccessRate { strides: 40, successes: 8, runs: 10 },
//!     SuccessRate { strides: 80, successes: 10, runs: 10 },
//! ])?;
//! assert!(figure.caption.contains("8 of 10 at 40, 10 of 10 at 80"));
//! assert!(figure.csv.starts_with("strides,successes,runs,share,wilson_low,wilson_high\n40,8,10,0.8,"));
//! # Ok::<(), stridemap_report::ReportError>(())
//! ```

mod draw;
mod error;
mod figure;
pub mod figures;
mod page;
mod report;
mod view;

pub use error::{ReportError, Result};
pub use figure::{Figure, HoverPoint, write_aside};
pub use page::{report_html, write_report};
pub use report::{Section, comparison, sections, write_figures};
pub use view::{RERUN_STREAM, view_lines, write_mcap};
