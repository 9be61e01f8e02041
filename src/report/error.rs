//! Why there is no report.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::results::ResultsError;

/// A report that cannot be made.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The tables cannot be read.
    #[error(transparent)]
    Results(#[from] ResultsError),
    /// No episode is the one that was asked for.
    #[error(
        "--episode {query:?} is no episode of {}: give RECORDING:EPISODE, RECORDING or EPISODE, as in the episodes table",
        directory.display()
    )]
    NoEpisode {
        /// What was asked for.
        query: String,
        /// Where it is not.
        directory: PathBuf,
    },
    /// A comparison that is none.
    #[error("{}: {what}", path.display())]
    Comparison {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A figure cannot be made.
    #[error("cannot draw {}: {what}", path.display())]
    Figure {
        /// Which.
        path: PathBuf,
        /// Why not.
        what: String,
    },
    /// The file system refused.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// What.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
}
