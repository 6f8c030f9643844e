//! Reads run directories and draws them; computes nothing new.
//!
//! Every figure is a function from plain data to a [`Figure`], which writes itself as SVG, PNG and CSV.
//! A [`Run`](stridemap_record::Run) is a run directory read as far as it goes; [`write_report`] makes one page of one or several.
//!
//! ```
//! use stridemap_report::figures::{SamplesPoint, samples};
//!
//! let point = SamplesPoint { samples: 20, seed: 1, error: 0.5, unseen_error: 0.9, speed_m_s: Some(0.3), falls: 0 };
//! let figure = samples(&[point])?;
//! assert!(figure.caption.contains("(20: 0.5 and 0.9, 0.300 m/s). 0 falls in 1 runs"));
//! assert_eq!(figure.csv, "samples,seed,error,unseen_error,speed_m_s,falls\n20,1,0.5,0.9,0.3,0\n");
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
pub use page::{film_html, report_html, write_report};
pub use report::{Section, sections, write_figures};
pub use view::{RERUN_STREAM, view_lines, write_mcap};
