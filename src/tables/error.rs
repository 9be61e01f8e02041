//! Why the tables cannot be written.

use std::io;
use std::path::{Path, PathBuf};

use parquet::errors::ParquetError;
use thiserror::Error;

use crate::storage::StorageError;

/// A table that cannot be written.
#[derive(Debug, Error)]
pub enum TableError {
    /// The file system refused.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The directory holds a run that is not this one.
    #[error(
        "{} holds another run ({difference}): give another directory, or --overwrite to start again",
        directory.display()
    )]
    AnotherRun {
        /// Which.
        directory: PathBuf,
        /// How it differs.
        difference: String,
    },
    /// Another process writes to the directory.
    #[error("{} is in use by another process{}", directory.display(), with_id(holder))]
    Locked {
        /// Which.
        directory: PathBuf,
        /// Its process id, if it could be read.
        holder: String,
    },
    /// The Parquet writer refused; on a full disk too.
    #[error("cannot write {}", path.display())]
    Parquet {
        /// The part, under its temporary name.
        path: PathBuf,
        /// Why not.
        source: ParquetError,
    },
}

fn with_id(holder: &str) -> String {
    if holder.is_empty() {
        String::new()
    } else {
        format!(" (process {holder})")
    }
}

impl TableError {
    /// What the system said.
    pub(crate) fn cause(&self) -> String {
        std::error::Error::source(self).map_or_else(String::new, ToString::to_string)
    }

    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let storage = StorageError::io(action, path);
        move |source| Self::Storage(storage(source))
    }

    pub(crate) fn parquet(path: &Path) -> impl FnOnce(ParquetError) -> Self {
        let path = path.to_owned();
        move |source| Self::Parquet { path, source }
    }
}
