//! Reads an output directory back: Parquet parts to typed rows.
//!
//! ```text
//! DIR ──> Results ──> recordings, episodes, segments   (row after row; a batch in memory)
//!                └──> StepsReader ──> EpisodeSteps      (one episode, by where its rows stand)
//! ```
//!
//! Only parts that a commit names are read, so a run that goes on meanwhile does no harm. Nothing is written.
//!
//! ```no_run
//! # fn main() -> Result<(), coact::results::ResultsError> {
//! let results = coact::results::Results::open("out".as_ref())?;
//! let mut steps = results.steps();
//! for episode in results.episodes() {
//!     let episode = episode?;
//!     if let Some(steps) = steps.read(&episode)? {
//!         println!("{}: {} joints", episode.key.recording, steps.joints.len());
//!     }
//! }
//! # Ok(())
//! # }
//! ```

mod columns;
mod error;
mod iter;
mod open;
mod parameters;
mod part;
mod query;
mod rows;
mod steps;

pub use error::ResultsError;
pub use iter::RowIter;
pub use open::Results;
pub use parameters::Parameters;
pub use query::EpisodeQuery;
pub use rows::{CauseRow, EpisodeRow, RecordingRow, SegmentRow};
pub use steps::{EpisodeSteps, JointSteps, StepsReader};
