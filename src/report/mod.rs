//! What a run has found, as one page (HTML) and as figures (SVG, PNG), made from its tables alone.
//!
//! ```text
//! Results ──> survey ──> choice ──> traces ──> page ──> report.html
//!             (counts,   (what is   (steps of the chosen episodes, packed)
//!              ranking)   embedded) └──────> figure ──> *.svg, *.png
//! ```
//!
//! The page needs nothing but itself. All that comes from tables is data in it: it stands in JSON whose `<` are
//! escaped, and its script never makes markup of it.

mod choice;
mod comparison;
mod error;
mod figure;
mod json;
mod pack;
mod page;
mod survey;
mod trace;
mod write;

pub use error::ReportError;
pub use write::{DEFAULT_MAX_BYTES, Report, ReportOptions, write};
