//! Reads run directories and draws them; computes nothing new.
//!
//! Every figure is a function from plain data to a [`Figure`], which writes itself as SVG, PNG and CSV.

mod draw;
mod error;
mod figure;
pub mod figures;
mod page;
mod report;
pub mod run;

pub use error::{ReportError, Result};
pub use figure::{Figure, HoverPoint, write_aside};
pub use page::{report_html, write_report};
pub use report::{Section, comparison, sections, write_figures};
