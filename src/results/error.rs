//! Why results cannot be read.

use std::io;
use std::path::{Path, PathBuf};

use parquet::errors::ParquetError;
use thiserror::Error;

use crate::tables::{TABLE_VERSION, TableError};

/// Results that cannot be read.
#[derive(Debug, Error)]
pub enum ResultsError {
    /// There is no such directory.
    #[error("{} is not a directory", directory.display())]
    NoDirectory {
        /// Which.
        directory: PathBuf,
    },
    /// The directory is not one that a run has written.
    #[error(
        "{} holds no results: there is no {} that names a run (give the --output of coact extract)",
        directory.display(),
        directory.join("_coact").join("run.json").display()
    )]
    NoResults {
        /// Which.
        directory: PathBuf,
    },
    /// Its tables have columns that are not ours.
    #[error(
        "{}: its tables have version {version}, and this coact reads version {TABLE_VERSION}",
        directory.display()
    )]
    OtherVersion {
        /// Which.
        directory: PathBuf,
        /// Of the directory.
        version: u32,
    },
    /// What the directory says of itself cannot be read.
    #[error("{source}: {}", source.cause())]
    Protocol {
        /// Why not.
        source: TableError,
    },
    /// The file system refused.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// What.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// A part is no whole Parquet file.
    #[error("cannot read {}: {source}", path.display())]
    Parquet {
        /// Which.
        path: PathBuf,
        /// Why not.
        source: ParquetError,
    },
    /// A part does not hold what its table holds.
    #[error("{}: {what}", path.display())]
    Unexpected {
        /// Which.
        path: PathBuf,
        /// What was found, and what was expected.
        what: String,
    },
}

impl ResultsError {
    pub(super) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    pub(super) fn parquet(path: &Path) -> impl FnOnce(ParquetError) -> Self {
        move |source| Self::Parquet {
            path: path.to_owned(),
            source,
        }
    }

    pub(super) fn unexpected(path: &Path, what: String) -> Self {
        Self::Unexpected {
            path: path.to_owned(),
            what,
        }
    }
}
