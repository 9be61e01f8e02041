//! The plan of a run in shards, as a file beside its commits: which recordings, in which shard, read with what options.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::commit::{self, Run};
use super::directory::{self, WHOLE, own_temporary_name};
use super::error::TableError;
use super::output::{check_run, lock_for_plan, lock_shards, write_run};
use super::writer::TableOptions;
use crate::storage::Storage;

/// Version of the file; another is refused.
const PLAN_VERSION: u32 = 1;

/// What every process of a run in shards must agree on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of this form.
    version: u32,
    /// Which program made it; the shards must be of the same.
    coact_version: String,
    /// The folder that the names of recordings are relative to.
    pub root: String,
    /// Options of `coact extract`, by name.
    pub options: serde_json::Map<String, serde_json::Value>,
    /// Shard K is the K-th, from 1. Names rise from shard to shard, so that rows do too.
    pub shards: Vec<PlannedShard>,
}

/// The recordings of one shard.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedShard {
    /// Bytes of them all.
    pub bytes: u64,
    /// In the order of their names.
    pub recordings: Vec<PlannedRecording>,
}

/// A recording as it was when the plan was made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedRecording {
    /// What the tables call it.
    pub name: Arc<str>,
    /// Bytes of its files.
    pub bytes: u64,
    /// Its files, where they are not the one that root and name give.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<String>,
    /// Set if it was known already that it cannot be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

impl Plan {
    /// A plan by this program.
    pub fn new(
        root: String,
        options: serde_json::Map<String, serde_json::Value>,
        shards: Vec<PlannedShard>,
    ) -> Self {
        Self {
            version: PLAN_VERSION,
            coact_version: env!("CARGO_PKG_VERSION").to_owned(),
            root,
            options,
            shards,
        }
    }

    /// All recordings, in order.
    pub fn recordings(&self) -> impl Iterator<Item = &PlannedRecording> {
        self.shards.iter().flat_map(|shard| &shard.recordings)
    }
}

/// Reads the plan in `directory`.
///
/// # Errors
/// If there is none, if it is of another version of the program, or if it cannot be read.
pub fn read_plan(directory: &Path) -> Result<Plan, TableError> {
    let (_held, place) = Storage::of(directory, None, |name| directory::need(name, |_| false))?;
    read_plan_at(&place).map_err(|e| e.named(directory))
}

pub(super) fn read_plan_at(directory: &Path) -> Result<Plan, TableError> {
    /// What can be told of any version.
    #[derive(Deserialize)]
    struct Versions {
        version: u32,
        coact_version: String,
    }
    let path = commit::plan_path(directory);
    let Some(Versions {
        version,
        coact_version,
    }) = commit::read(&path)?
    else {
        return Err(TableError::NoPlan {
            directory: directory.to_owned(),
        });
    };
    let own = env!("CARGO_PKG_VERSION");
    if version != PLAN_VERSION || coact_version != own {
        return Err(TableError::AnotherRun {
            directory: directory.to_owned(),
            difference: format!("its plan was made by coact {coact_version}, this is {own}"),
        });
    }
    commit::read(&path)?.ok_or_else(|| TableError::NoPlan {
        directory: directory.to_owned(),
    })
}

/// Writes a plan into `directory`, for the run that `options` describe; false if the same plan is there already, which
/// then stays, with its results.
///
/// # Errors
/// [`TableError::AnotherRun`] if there are results of anything else and `overwrite` is not set, [`TableError::Locked`]
/// if a process writes there, or what the file system says.
pub fn write_plan(
    directory: &Path,
    options: &TableOptions,
    plan: &Plan,
    overwrite: bool,
) -> Result<bool, TableError> {
    let need = |name: &str| directory::need(name, |_| false);
    let (storage, place) = Storage::of(directory, options.faults.clone(), need)?;
    write_plan_at(&storage, &place, options, plan, overwrite).map_err(|e| e.named(directory))
}

fn write_plan_at(
    storage: &Storage,
    directory: &Path,
    options: &TableOptions,
    plan: &Plan,
    overwrite: bool,
) -> Result<bool, TableError> {
    let path = commit::plan_path(directory);
    let run = Run::new(options.steps, &options.metadata);
    let text = serde_json::to_vec(plan)
        .map_err(|e| TableError::io("write", &path)(std::io::Error::other(e)))?;
    if directory.exists() && !directory.is_dir() {
        let what = std::io::Error::from(std::io::ErrorKind::NotADirectory);
        return Err(TableError::io("write a plan to", directory)(what));
    }
    if !overwrite {
        let is_same_run = || matches!(commit::read_run(directory), Ok(Some(r)) if r == run);
        if fs::read(&path).is_ok_and(|old| old == text) && is_same_run() {
            return Ok(false);
        }
        if directory::holds_rows(directory)? {
            // Parameters that differ say more than that the plan does.
            check_run(directory, &run, WHOLE + 1)?;
            return Err(another_plan(directory));
        }
    }
    storage.create_folder(&commit::commits_folder(directory))?;
    let temporary = path.with_file_name(own_temporary_name("plan.json"));
    if storage.is_store() && !overwrite {
        // A shard of another plan may be about to commit, which no lock would tell.
        write_run(storage, directory, &run, WHOLE + 1)?;
        return match storage.write_whole_new(&path, &temporary, &text) {
            Ok(()) => Ok(true),
            Err(e) if e.source.kind() == ErrorKind::AlreadyExists => {
                storage.fetch(&path)?;
                let there = fs::read(&path).map_err(TableError::io("read", &path))?;
                (there == text)
                    .then_some(false)
                    .ok_or_else(|| another_plan(directory))
            }
            Err(e) => Err(e.into()),
        };
    }
    let _whole = lock_for_plan(storage, directory)?;
    let mut shards = BTreeMap::new();
    lock_shards(storage, directory, &mut shards)?;
    directory::clear(storage, directory)?;
    // A shard that began meanwhile goes by the plan that was here; one that begins from now on finds none, or this one.
    lock_shards(storage, directory, &mut shards)?;
    commit::write_run(storage, directory, &run)?;
    storage.write_whole(&path, &temporary, &text)?;
    Ok(true)
}

fn another_plan(directory: &Path) -> TableError {
    TableError::AnotherRun {
        directory: directory.to_owned(),
        difference: "its recordings or its shards are others".to_owned(),
    }
}
