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
    #[error("{}{} is in use by another process{}", of_shard(*shard), directory.display(), with_id(holder))]
    Locked {
        /// Which.
        directory: PathBuf,
        /// Which shard of it; 0 when there is none.
        shard: u32,
        /// Its process id, if it could be read.
        holder: String,
    },
    /// Another process has committed rows of the run, or of the shard, while this one was at the same.
    #[error(
        "{}{} is being written by another process as well, which was faster: run it again once that one has ended",
        of_shard(*shard),
        directory.display()
    )]
    Overtaken {
        /// Which.
        directory: PathBuf,
        /// Which shard of it.
        shard: u32,
    },
    /// There is no plan where one is needed.
    #[error(
        "{} holds no plan: make one with `coact plan INPUT... --output {} --shards N`",
        directory.display(),
        directory.display()
    )]
    NoPlan {
        /// Which.
        directory: PathBuf,
    },
    /// The tables hold what the plan does not say.
    #[error("{}: {what}", directory.display())]
    NotAsPlanned {
        /// Which.
        directory: PathBuf,
        /// What is wrong.
        what: String,
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

fn of_shard(shard: u32) -> String {
    if shard == 0 {
        String::new()
    } else {
        format!("shard {shard} of ")
    }
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

    /// The same, told of the directory by its name: it may be staged elsewhere.
    pub(super) fn named(mut self, name: &Path) -> Self {
        match &mut self {
            Self::AnotherRun { directory, .. }
            | Self::Locked { directory, .. }
            | Self::Overtaken { directory, .. }
            | Self::NoPlan { directory }
            | Self::NotAsPlanned { directory, .. } => name.clone_into(directory),
            Self::Storage(_) | Self::Parquet { .. } => {}
        }
        self
    }

    /// Was a name refused because it is taken?
    pub(super) fn is_taken(&self) -> bool {
        matches!(self, Self::Storage(e) if e.source.kind() == io::ErrorKind::AlreadyExists)
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
