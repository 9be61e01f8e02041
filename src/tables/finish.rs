//! The end of a run in shards: is every recording of the plan there, once? Then what nothing names is removed, and the
//! directory marked as done.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use super::commit::{self, Commit, DoneRecording};
use super::directory::{self, part_name};
use super::error::TableError;
use super::output::{lock_for_plan, lock_shards};
use super::plan::{Plan, read_plan_at};
use super::schema::Table;
use crate::model::RecordingStatus;
use crate::storage::Storage;

/// Whether a run in shards is whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Finish {
    /// It is, and is marked as done.
    Done(Finished),
    /// These shards lack recordings.
    Missing(Vec<MissingRecordings>),
}

/// What a whole run holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Finished {
    /// Shards of the plan.
    pub n_shards: u64,
    /// Recordings in the tables, also those that failed.
    pub n_recordings: u64,
    /// Their episodes.
    pub n_episodes: u64,
    /// Steps of these.
    pub n_steps: u64,
    /// Recordings that failed, were recovered, or had something refused.
    pub n_unclean: u64,
}

/// What a shard lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MissingRecordings {
    /// Which shard, from 1.
    pub shard: u32,
    /// How many recordings it is to have.
    pub n_planned: usize,
    /// Those that are not in the tables, or not as they were planned, in order.
    pub missing: Vec<Arc<str>>,
}

/// Holds what is committed in `directory` against its plan, and marks the run as done if nothing is missing.
///
/// # Errors
/// If there is no plan, if a process still writes, if the tables hold what the plan does not say, or what the file
/// system says.
pub fn finish(directory: &Path) -> Result<Finish, TableError> {
    let need = |name: &str| directory::need(name, |_| true);
    let (storage, place) = Storage::of(directory, None, need)?;
    finish_at(&storage, &place).map_err(|e| e.named(directory))
}

fn finish_at(storage: &Storage, directory: &Path) -> Result<Finish, TableError> {
    // Also before anything is locked: a directory without a plan is none of ours.
    read_plan_at(directory)?;
    let _whole = lock_for_plan(storage, directory)?;
    let mut shards = BTreeMap::new();
    lock_shards(storage, directory, &mut shards)?;
    let plan = read_plan_at(directory)?;
    let commits = commit::read_all_commits(directory)?;
    let missing = held_against(&plan, &commits).map_err(|what| TableError::NotAsPlanned {
        directory: directory.to_owned(),
        what,
    })?;
    if !missing.is_empty() {
        return Ok(Finish::Missing(missing));
    }
    check_parts(storage, directory, &commits)?;
    let committed = commits.values().flat_map(|c| &c.parts).map(String::as_str);
    if storage.is_store() {
        check_nothing_unnamed(directory, committed)?;
    } else {
        directory::clear_unfinished(storage, directory, None, committed)?;
    }
    directory::mark_done(storage, directory)?;
    let recordings = || commits.values().flat_map(|c| &c.recordings);
    Ok(Finish::Done(Finished {
        n_shards: plan.shards.len() as u64,
        n_recordings: recordings().count() as u64,
        n_episodes: recordings().map(|r| r.n_episodes).sum(),
        n_steps: commits.values().filter_map(|c| c.n_steps).sum(),
        n_unclean: recordings().filter(|r| !r.clean).count() as u64,
    }))
}

/// Shards that lack recordings; an error where there is one that should not be there, or twice.
fn held_against(
    plan: &Plan,
    commits: &BTreeMap<(u32, u32), Commit>,
) -> Result<Vec<MissingRecordings>, String> {
    let mut there: BTreeMap<&str, (u32, &DoneRecording)> = BTreeMap::new();
    for (&(shard, _), commit) in commits {
        for recording in &commit.recordings {
            let name = &*recording.identity.name;
            if there.insert(name, (shard, recording)).is_some() {
                return Err(format!("{name} is in the tables twice"));
            }
        }
    }
    let mut lacking = Vec::new();
    for (shard, planned) in (1..).zip(&plan.shards) {
        let mut missing = Vec::new();
        for recording in &planned.recordings {
            match there.remove(&*recording.name) {
                Some((of, done)) if of == shard => {
                    // The row of one that failed says so, if it is not what was planned.
                    let is_failed = done.status == RecordingStatus::Failed;
                    if !is_failed && done.identity.bytes != recording.bytes {
                        missing.push(Arc::clone(&recording.name));
                    }
                }
                Some((of, _)) => {
                    let name = &recording.name;
                    return Err(format!("{name} of shard {shard} was written by shard {of}"));
                }
                None => missing.push(Arc::clone(&recording.name)),
            }
        }
        if !missing.is_empty() {
            lacking.push(MissingRecordings {
                shard,
                n_planned: planned.recordings.len(),
                missing,
            });
        }
    }
    match there.first_key_value() {
        Some((name, _)) => Err(format!(
            "{name} is in the tables and not among the recordings of the plan"
        )),
        None => Ok(lacking),
    }
}

/// Are all parts there that commits name?
fn check_parts(
    storage: &Storage,
    directory: &Path,
    commits: &BTreeMap<(u32, u32), Commit>,
) -> Result<(), TableError> {
    for (&(shard, number), commit) in commits {
        for table in Table::ALL {
            let path = commit.part(shard, table).map(|part| {
                let folder = directory.join(table.name());
                folder.join(part_name(shard, part))
            });
            if let Some(path) = path.filter(|path| !path.is_file()) {
                return Err(TableError::NotAsPlanned {
                    directory: directory.to_owned(),
                    what: format!(
                        "{} is gone, with rows of shard {shard} (commit {number}): give that shard --overwrite",
                        storage.named(&path).display()
                    ),
                });
            }
        }
    }
    Ok(())
}

/// Are there parts that no commit names? In a store the process that wrote them may be about to do so; only one that
/// has taken its number may remove them.
fn check_nothing_unnamed<'a>(
    directory: &Path,
    committed: impl Iterator<Item = &'a str>,
) -> Result<(), TableError> {
    let unnamed = directory::unnamed_parts(directory, None, committed)?;
    let shards: BTreeSet<u32> = unnamed.into_iter().map(|(shard, _)| shard).collect();
    if shards.is_empty() {
        return Ok(());
    }
    let shards: Vec<String> = shards.iter().map(u32::to_string).collect();
    Err(TableError::NotAsPlanned {
        directory: directory.to_owned(),
        what: format!(
            "a process still writes to shards {0}, or has left parts there that no commit names: run {0} again, which \
             removes them",
            shards.join(",")
        ),
    })
}
