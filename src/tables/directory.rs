//! Which files in an output directory are ours, and whether a run is done. Nothing else in it is ever touched.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::commit;
use super::error::TableError;
use super::schema::Table;
use crate::storage::{self, Storage};

/// In the directory once a run is done.
const SUCCESS: &str = "_SUCCESS";

/// Begins the name of a file that is not finished.
const TEMPORARY_PREFIX: &str = ".";

/// Ends the name of a file that is not finished.
const TEMPORARY_SUFFIX: &str = ".tmp";

/// Under which name a file is written until it is finished.
pub(super) fn temporary_name(name: &str) -> String {
    format!("{TEMPORARY_PREFIX}{name}{TEMPORARY_SUFFIX}")
}

/// Marks the run in `directory` as done.
pub(super) fn mark_done(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    storage.write_whole(
        &directory.join(SUCCESS),
        &directory.join(temporary_name(SUCCESS)),
        b"",
    )?;
    Ok(())
}

/// Takes the mark away: the run goes on.
pub(super) fn unmark_done(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    if !is_marked_done(directory) {
        return Ok(());
    }
    storage.remove(&directory.join(SUCCESS))?;
    storage.sync_folder(directory)?;
    Ok(())
}

pub(super) fn is_marked_done(directory: &Path) -> bool {
    directory.join(SUCCESS).is_file()
}

/// Does `directory` hold parts of tables, finished or not?
pub(super) fn holds_parts(directory: &Path) -> Result<bool, TableError> {
    Ok(!parts(directory)?.is_empty())
}

/// Does `directory` hold a run, finished or not?
///
/// # Errors
/// If it is there and cannot be read.
pub fn holds_run(directory: &Path) -> Result<bool, TableError> {
    Ok(holds_parts(directory)?
        || is_marked_done(directory)
        || commit::run_path(directory).is_file())
}

/// Has no shard but `shard` ever been written here?
pub(super) fn is_of_shard_alone(directory: &Path, shard: u32) -> bool {
    let own = commit::lock_path(directory, shard);
    names_in(&directory.join(commit::FOLDER))
        .is_ok_and(|paths| paths.iter().all(|p| *p == own || !commit::is_lock(p)))
}

/// Removes what a run has left in `directory`, but for its lock, and nothing else.
pub(super) fn clear(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    // The mark goes first, then what the parts are known by: a directory half cleared is not done, and no part in it
    // counts.
    storage.remove(&directory.join(SUCCESS))?;
    for path in names_in(&commit::commits_folder(directory))? {
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
        if commit::parse_commit_name(finished_name(name)).is_some() {
            storage.remove(&path)?;
        }
    }
    for part in parts(directory)? {
        storage.remove(&part.path)?;
    }
    storage.remove(&commit::run_path(directory))?;
    for table in Table::ALL {
        storage::remove_empty_folder(&directory.join(table.name()));
    }
    Ok(())
}

/// Removes parts of `shard` that no commit names, and temporary files.
pub(super) fn clear_unfinished(
    storage: &Storage,
    directory: &Path,
    shard: u32,
    committed: &[&str],
) -> Result<(), TableError> {
    for part in parts(directory)? {
        let is_committed = committed.iter().any(|c| directory.join(c) == part.path);
        if part.shard == shard && !is_committed {
            storage.remove(&part.path)?;
        }
    }
    remove_small_temporaries(storage, directory)
}

fn remove_small_temporaries(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    let mut paths = vec![
        directory.join(temporary_name(SUCCESS)),
        commit::run_path(directory).with_file_name(temporary_name("run.json")),
    ];
    paths.extend(
        names_in(&commit::commits_folder(directory))?
            .into_iter()
            .filter(|path| {
                let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
                let finished = finished_name(name);
                finished != name && commit::parse_commit_name(finished).is_some()
            }),
    );
    for path in paths {
        if path.exists() {
            storage.remove(&path)?;
        }
    }
    Ok(())
}

/// Removes all temporary files of ours: for a process that must end at once.
pub fn remove_temporaries(directory: &Path) {
    let storage = Storage::default();
    let unfinished = parts(directory).unwrap_or_default();
    for part in unfinished.iter().filter(|p| !p.is_finished) {
        // There is no one left to tell.
        let _best_effort = storage.remove(&part.path);
    }
    let _best_effort = remove_small_temporaries(&storage, directory);
}

/// A part of ours.
struct FoundPart {
    path: PathBuf,
    shard: u32,
    is_finished: bool,
}

/// Parts in `directory`; no directory has none.
fn parts(directory: &Path) -> Result<Vec<FoundPart>, TableError> {
    let mut found = Vec::new();
    for table in Table::ALL {
        for path in names_in(&directory.join(table.name()))? {
            let name = path.file_name().and_then(OsStr::to_str).unwrap_or("");
            let finished = finished_name(name);
            if let Some(shard) = shard_of(finished) {
                found.push(FoundPart {
                    shard,
                    is_finished: finished == name,
                    path,
                });
            }
        }
    }
    Ok(found)
}

/// The name that a temporary file is to get; any other name as it is.
fn finished_name(name: &str) -> &str {
    name.strip_prefix(TEMPORARY_PREFIX)
        .and_then(|n| n.strip_suffix(TEMPORARY_SUFFIX))
        .unwrap_or(name)
}

/// The shard in `part-SSSSS-NNNNN.parquet`; `None` for any other name.
fn shard_of(name: &str) -> Option<u32> {
    let numbers = name.strip_prefix("part-")?.strip_suffix(".parquet")?;
    let (shard, number) = numbers.split_once('-')?;
    (commit::is_number(shard) && commit::is_number(number))
        .then(|| shard.parse().ok())
        .flatten()
}

/// What is in a folder; no folder has nothing.
pub(super) fn names_in(folder: &Path) -> Result<Vec<PathBuf>, TableError> {
    let error = || TableError::io("read the folder", folder);
    match fs::read_dir(folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(e) => Err(error()(e)),
        Ok(entries) => entries
            .map(|entry| entry.map(|e| e.path()).map_err(error()))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_parts_are_ours() {
        assert_eq!(shard_of("part-00000-00000.parquet"), Some(0));
        assert_eq!(shard_of("part-00000-100000.parquet"), Some(0));
        assert_eq!(
            shard_of(finished_name(".part-00001-00012.parquet.tmp")),
            Some(1)
        );
        for name in [
            "part-0-0.parquet",
            "part-00000-000000.parquet",
            "notes.parquet",
            "part-00000-00000.parquet.bak",
            "part-00000.parquet",
        ] {
            assert_eq!(shard_of(name), None, "{name}");
        }
    }
}
