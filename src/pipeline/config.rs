//! All that decides a run, checked.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use thiserror::Error;

use super::inputs::InputError;
use super::plan::Shard;
use crate::cloud;
use crate::events::{EventsError, EventsOptions};
use crate::extraction::ExtractionParams;
use crate::recording::ReadOptions;
use crate::tables::{Faults, TableError};

/// A run, as asked for. Only parameters that can run get this far.
#[derive(Debug, Clone)]
pub struct Config {
    /// Files, folders, globs.
    pub inputs: Vec<PathBuf>,
    /// The shard of a plan that is to be done; its recordings are then those of the plan.
    pub shard: Option<Shard>,
    /// Where the tables go; `None` reads and checks everything and writes nothing.
    pub output: Option<PathBuf>,
    /// Where events files go, if they are wanted.
    pub events: Option<PathBuf>,
    /// The method's parameters.
    pub params: ExtractionParams,
    /// How recordings are read.
    pub read: ReadOptions,
    /// Write the per-step table.
    pub steps: bool,
    /// Start again in a directory that holds a run.
    pub overwrite: bool,
    /// Threads; 0 stands for all cores.
    pub threads: usize,
    /// Rows after which a part is cut; see [`crate::tables::DEFAULT_MAX_PART_ROWS`].
    pub max_part_rows: usize,
    /// Calls to the file system that are to fail, in tests.
    pub faults: Option<Arc<Faults>>,
    /// What was asked for, as key-value pairs for the tables' metadata.
    pub parameters: Vec<(String, String)>,
}

impl Config {
    /// Key-value metadata of the tables.
    pub(crate) fn metadata(&self) -> Vec<(String, String)> {
        self.parameters
            .iter()
            .map(|(key, value)| (format!("coact.{key}"), value.clone()))
            .collect()
    }

    /// Can what is to be written go there? Tables may go to an object store.
    pub(super) fn check_outputs(&self) -> Result<(), RunError> {
        check_is_file(self.events.as_deref(), "events")?;
        match self.output.as_deref().and_then(cloud::address) {
            Some(address) => cloud::check_writable(address).map_err(|e| unwritable(address, &e)),
            None => Ok(()),
        }
    }

    /// How events are written; `None` if they are not wanted.
    pub(crate) fn events(&self) -> Option<EventsOptions> {
        let mut metadata = self.metadata();
        // Events are the same with and without the per-step table.
        metadata.retain(|(key, _)| key != "coact.steps");
        Some(EventsOptions {
            directory: self.events.clone()?,
            metadata,
            faults: self.faults.clone(),
        })
    }
}

/// Refuses what goes to a file system alone where it is to go elsewhere.
pub(super) fn check_is_file(path: Option<&Path>, what: &str) -> Result<(), RunError> {
    match path.and_then(cloud::address) {
        Some(address) => Err(unwritable(
            address,
            &format!("{what} go to a file system, from where they can be copied"),
        )),
        None => Ok(()),
    }
}

fn unwritable(address: &str, why: &dyn Display) -> RunError {
    RunError::Arguments(format!("{address} cannot be written to: {why}"))
}

/// Why a run gave no summary.
#[derive(Debug, Error)]
pub enum RunError {
    /// What was asked for cannot be done as asked (exit 2).
    #[error("{0}")]
    Arguments(String),
    /// It was stopped from outside (exit 130 or 143). What is committed stands.
    #[error("interrupted; the same command goes on where this one stopped")]
    Interrupted,
    /// It was tried and failed (exit 1).
    #[error("{0:#}")]
    Failed(anyhow::Error),
}

impl From<InputError> for RunError {
    fn from(e: InputError) -> Self {
        match e {
            InputError::BadGlob { .. } => Self::Arguments(e.to_string()),
            InputError::Nothing(_) | InputError::NoListing { .. } => Self::Failed(e.into()),
        }
    }
}

impl From<TableError> for RunError {
    fn from(e: TableError) -> Self {
        match e {
            TableError::AnotherRun { .. } | TableError::NoPlan { .. } => {
                Self::Arguments(e.to_string())
            }
            e => Self::Failed(e.into()),
        }
    }
}

impl From<EventsError> for RunError {
    fn from(e: EventsError) -> Self {
        Self::Failed(e.into())
    }
}
