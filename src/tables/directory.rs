//! Which files in an output directory are ours, and whether a run is done. Nothing else in it is ever touched.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::collections::hash_map::RandomState;
use std::ffi::OsStr;
use std::fs;
use std::hash::{BuildHasher, Hasher};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use super::commit;
use super::error::TableError;
use super::schema::Table;
use crate::storage::{self, Need, Storage};

/// The shard of a run that has none.
pub(super) const WHOLE: u32 = 0;

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

/// The same for a file that other processes may be writing at once, on this machine or another: no two use one name.
pub(super) fn own_temporary_name(name: &str) -> String {
    format!("{TEMPORARY_PREFIX}{name}{}", own_suffix())
}

/// Ends the names of the temporary files of this process.
fn own_suffix() -> String {
    // A process number would not do: in containers all are 1.
    static TOKEN: LazyLock<u64> = LazyLock::new(|| RandomState::new().build_hasher().finish());
    let token = *TOKEN;
    format!(".{token:016x}{TEMPORARY_SUFFIX}")
}

/// How much a process needs of an object in a store, by its name below the directory: all that says what run it is, and
/// the commits that `reads` asks for by their shards.
pub(super) fn need(name: &str, reads: impl Fn(u32) -> bool) -> Need {
    let (folder, file) = name.rsplit_once('/').unwrap_or(("", name));
    let at = Path::new(folder).join(file);
    let no_directory = Path::new("");
    if at == commit::run_path(no_directory) || at == commit::plan_path(no_directory) {
        return Need::Content;
    }
    let is_commit = Path::new(folder) == commit::commits_folder(no_directory);
    match commit::parse_commit_name(file).filter(|_| is_commit) {
        Some((shard, _)) if reads(shard) => return Need::Content,
        Some(_) => return Need::Name,
        None => {}
    }
    let is_table = Table::ALL.iter().any(|table| table.name() == folder);
    if name == SUCCESS || (is_table && parse_part_name(file).is_some()) {
        Need::Name
    } else {
        Need::Nothing
    }
}

/// Marks the run in `directory` as done.
pub(super) fn mark_done(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    storage.write_whole(
        &directory.join(SUCCESS),
        &directory.join(own_temporary_name(SUCCESS)),
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

/// Does `directory` hold parts, or commits of such?
pub(super) fn holds_rows(directory: &Path) -> Result<bool, TableError> {
    Ok(holds_parts(directory)? || !commit_files(directory)?.is_empty())
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

/// Removes what a run has left in `directory`, but for its locks, and nothing else.
pub(super) fn clear(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    unmark_done(storage, directory)?;
    // What says which run it is goes before any row: one that is half cleared is no run that can go on.
    let described = [commit::run_path(directory), commit::plan_path(directory)];
    if described.iter().any(|path| path.exists()) {
        for path in &described {
            storage.remove(path)?;
        }
        storage.sync_folder(&directory.join(commit::FOLDER))?;
    }
    clear_rows(storage, directory, |_| true)?;
    for table in Table::ALL {
        storage::remove_empty_folder(&directory.join(table.name()));
    }
    Ok(())
}

/// Removes the rows of one shard.
pub(super) fn clear_shard(
    storage: &Storage,
    directory: &Path,
    shard: u32,
) -> Result<(), TableError> {
    clear_rows(storage, directory, |of| of == shard)
}

/// The mark goes first, then what the parts are known by: a directory half cleared is not done, and no part in it
/// counts. Of the commits the last goes first: each says of a recording what all before it hold, too.
fn clear_rows(
    storage: &Storage,
    directory: &Path,
    is_meant: impl Fn(u32) -> bool,
) -> Result<(), TableError> {
    unmark_done(storage, directory)?;
    let mut commits = commit_files(directory)?;
    commits.retain(|file| is_meant(file.shard));
    commits.sort_by_key(|file| Reverse(file.number));
    for file in &commits {
        storage.remove(&file.path)?;
    }
    if !commits.is_empty() {
        storage.sync_folder(&commit::commits_folder(directory))?;
    }
    for part in parts(directory)? {
        if is_meant(part.shard) {
            storage.remove(&part.path)?;
        }
    }
    Ok(())
}

/// Removes parts that no commit names, of all shards or of one, and temporary files of these.
pub(super) fn clear_unfinished<'a>(
    storage: &Storage,
    directory: &Path,
    shard: Option<u32>,
    committed: impl Iterator<Item = &'a str>,
) -> Result<(), TableError> {
    let committed: BTreeSet<PathBuf> = committed.map(|c| directory.join(c)).collect();
    for part in parts(directory)? {
        let is_meant = shard.is_none_or(|shard| part.shard == shard);
        if is_meant && !committed.contains(&part.path) {
            storage.remove(&part.path)?;
        }
    }
    remove_unfinished_commits(storage, directory, shard)?;
    remove_small_temporaries(storage, directory)
}

/// Removes temporary files of a shard. Where locks do not reach from one machine to another, these may be another
/// process's, which then fails before anything of its own counts; finished parts may not be touched there, since their
/// commit may be about to come.
pub(super) fn clear_unfinished_shard(
    storage: &Storage,
    directory: &Path,
    shard: u32,
) -> Result<(), TableError> {
    for part in parts(directory)? {
        if part.shard == shard && !part.is_finished {
            storage.remove(&part.path)?;
        }
    }
    remove_unfinished_commits(storage, directory, Some(shard))
}

/// Finished parts that no commit names, of all shards or of one.
pub(super) fn unnamed_parts<'a>(
    directory: &Path,
    shard: Option<u32>,
    committed: impl Iterator<Item = &'a str>,
) -> Result<Vec<(u32, PathBuf)>, TableError> {
    let committed: BTreeSet<PathBuf> = committed.map(|c| directory.join(c)).collect();
    let unnamed = parts(directory)?.into_iter().filter(|part| {
        let is_meant = shard.is_none_or(|shard| part.shard == shard);
        is_meant && part.is_finished && !committed.contains(&part.path)
    });
    Ok(unnamed.map(|part| (part.shard, part.path)).collect())
}

/// Below which number no part of a shard is there.
pub(super) fn next_part(directory: &Path, shard: u32) -> Result<u32, TableError> {
    let numbers = parts(directory)?
        .into_iter()
        .filter(|part| part.shard == shard)
        .map(|part| part.number + 1);
    Ok(numbers.max().unwrap_or(0))
}

fn remove_unfinished_commits(
    storage: &Storage,
    directory: &Path,
    shard: Option<u32>,
) -> Result<(), TableError> {
    for file in commit_files(directory)? {
        if !file.is_finished && shard.is_none_or(|shard| file.shard == shard) {
            storage.remove(&file.path)?;
        }
    }
    Ok(())
}

/// Removes those that only a process alone in the directory writes.
fn remove_small_temporaries(storage: &Storage, directory: &Path) -> Result<(), TableError> {
    for path in small_temporaries(directory)? {
        storage.remove(&path)?;
    }
    Ok(())
}

fn small_temporaries(directory: &Path) -> Result<Vec<PathBuf>, TableError> {
    let small = [
        directory.join(SUCCESS),
        commit::run_path(directory),
        commit::plan_path(directory),
    ];
    let mut found = names_in(directory)?;
    found.extend(names_in(&directory.join(commit::FOLDER))?);
    found.retain(|path| {
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or("");
        let finished = finished_name(name);
        finished != name && small.contains(&path.with_file_name(finished))
    });
    Ok(found)
}

/// Removes the temporary files of this process, for one that must end at once. It may never have held the lock: those
/// of others stay.
pub fn remove_temporaries(directory: &Path) {
    let storage = Storage::default();
    storage::remove_stagings();
    let path_of = |found: Found| found.path;
    let found = [
        parts(directory).map(|found| found.into_iter().map(path_of).collect()),
        commit_files(directory).map(|found| found.into_iter().map(path_of).collect()),
        small_temporaries(directory),
    ];
    let suffix = own_suffix();
    let is_own = |path: &PathBuf| path.to_str().is_some_and(|path| path.ends_with(&suffix));
    let found: Vec<Vec<PathBuf>> = found.into_iter().flatten().collect();
    for path in found.iter().flatten().filter(|path| is_own(path)) {
        // There is no one left to tell.
        let _best_effort = storage.remove(path);
    }
}

/// A file of ours that belongs to a shard.
struct Found {
    path: PathBuf,
    shard: u32,
    number: u32,
    is_finished: bool,
}

/// Parts in `directory`; no directory has none.
fn parts(directory: &Path) -> Result<Vec<Found>, TableError> {
    let mut found = Vec::new();
    for table in Table::ALL {
        found.extend(files_in(&directory.join(table.name()), parse_part_name)?);
    }
    Ok(found)
}

fn commit_files(directory: &Path) -> Result<Vec<Found>, TableError> {
    files_in(
        &commit::commits_folder(directory),
        commit::parse_commit_name,
    )
}

/// Files in a folder whose names, finished or not, have a shard and a number.
fn files_in(
    folder: &Path,
    parse: impl Fn(&str) -> Option<(u32, u32)>,
) -> Result<Vec<Found>, TableError> {
    let found = names_in(folder)?.into_iter().filter_map(|path| {
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or("");
        let finished = finished_name(name);
        let is_finished = finished == name;
        let (shard, number) = parse(finished)?;
        Some(Found {
            path,
            shard,
            number,
            is_finished,
        })
    });
    Ok(found.collect())
}

/// The name that a temporary file is to get; any other name as it is.
fn finished_name(name: &str) -> &str {
    let Some(unfinished) = name
        .strip_prefix(TEMPORARY_PREFIX)
        .and_then(|n| n.strip_suffix(TEMPORARY_SUFFIX))
    else {
        return name;
    };
    let is_token = |t: &str| t.len() == 16 && t.bytes().all(|b| b.is_ascii_hexdigit());
    match unfinished.rsplit_once('.') {
        Some((finished, token)) if is_token(token) => finished,
        _ => unfinished,
    }
}

/// Name of the part of a group, in each table.
pub(super) fn part_name(shard: u32, number: u32) -> String {
    format!("part-{shard:05}-{number:05}.parquet")
}

/// Shard and number in a part's name; `None` for any other name.
pub(super) fn parse_part_name(name: &str) -> Option<(u32, u32)> {
    let numbers = name.strip_prefix("part-")?.strip_suffix(".parquet")?;
    let (shard, number) = numbers.split_once('-')?;
    (commit::is_number(shard) && commit::is_number(number))
        .then_some((shard.parse().ok()?, number.parse().ok()?))
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
        assert_eq!(parse_part_name("part-00000-00000.parquet"), Some((0, 0)));
        assert_eq!(
            parse_part_name("part-00000-100000.parquet"),
            Some((0, 100_000))
        );
        let temporary = own_temporary_name("part-00001-00012.parquet");
        assert_eq!(parse_part_name(finished_name(&temporary)), Some((1, 12)));
        assert_eq!(
            parse_part_name(finished_name(".part-00001-00012.parquet.tmp")),
            Some((1, 12))
        );
        for name in [
            "part-0-0.parquet",
            "part-00000-000000.parquet",
            "notes.parquet",
            "part-00000-00000.parquet.bak",
            "part-00000.parquet",
        ] {
            assert_eq!(parse_part_name(name), None, "{name}");
        }
    }
}
