//! Why events cannot be written.

use std::path::{Path, PathBuf};

use mcap::McapError;
use thiserror::Error;

use crate::storage::StorageError;

/// An events file that cannot be written.
#[derive(Debug, Error)]
pub enum EventsError {
    /// The file system refused.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The MCAP writer refused; on a full disk too.
    #[error("cannot write {}", path.display())]
    Mcap {
        /// The file, under its temporary name.
        path: PathBuf,
        /// Why not.
        source: McapError,
    },
}

impl EventsError {
    pub(super) fn mcap(path: &Path) -> impl FnOnce(McapError) -> Self {
        let path = path.to_owned();
        move |source| Self::Mcap { path, source }
    }
}
