//! What an output directory holds: which files in it are ours, and whether a run is done.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::error::TableError;
use super::schema::Table;
use super::storage;

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
pub(super) fn mark_done(directory: &Path) -> Result<(), TableError> {
    storage::write_whole(
        &directory.join(SUCCESS),
        &directory.join(temporary_name(SUCCESS)),
        b"",
    )
}

/// Does `directory` hold tables of a run, finished or not?
///
/// # Errors
/// If it is there and cannot be read.
pub fn holds_run(directory: &Path) -> Result<bool, TableError> {
    Ok(!own_files(directory)?.is_empty())
}

/// Removes what a run has left in `directory`, and nothing else.
///
/// # Errors
/// If the file system refuses.
pub fn clear_own_files(directory: &Path) -> Result<(), TableError> {
    // The mark goes first: a directory half cleared is not done.
    storage::remove(&directory.join(SUCCESS))?;
    own_files(directory)?
        .iter()
        .try_for_each(|path| storage::remove(path))?;
    for table in Table::ALL {
        storage::remove_empty_folder(&directory.join(table.name()));
    }
    Ok(())
}

/// Our files in `directory`; no directory has none.
fn own_files(directory: &Path) -> Result<Vec<PathBuf>, TableError> {
    let mut files = Vec::new();
    for table in Table::ALL {
        files.extend(
            names_in(&directory.join(table.name()))?
                .into_iter()
                .filter(|path| path.file_name().is_some_and(is_part)),
        );
    }
    let success = directory.join(SUCCESS);
    if success.is_file() {
        files.push(success);
    }
    Ok(files)
}

/// `part-SSSSS-NNNNN.parquet`, finished or not.
fn is_part(name: &OsStr) -> bool {
    let Some(name) = name.to_str() else {
        return false;
    };
    let finished = name
        .strip_prefix(TEMPORARY_PREFIX)
        .and_then(|n| n.strip_suffix(TEMPORARY_SUFFIX))
        .unwrap_or(name);
    let Some(numbers) = finished
        .strip_prefix("part-")
        .and_then(|n| n.strip_suffix(".parquet"))
    else {
        return false;
    };
    numbers.split('-').count() == 2
        && numbers
            .split('-')
            .all(|n| n.len() == 5 && n.bytes().all(|b| b.is_ascii_digit()))
}

fn names_in(folder: &Path) -> Result<Vec<PathBuf>, TableError> {
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
        for name in ["part-00000-00000.parquet", ".part-00001-00012.parquet.tmp"] {
            assert!(is_part(OsStr::new(name)), "{name}");
        }
        for name in [
            "part-0-0.parquet",
            "notes.parquet",
            "part-00000-00000.parquet.bak",
            "part-00000.parquet",
        ] {
            assert!(!is_part(OsStr::new(name)), "{name}");
        }
    }
}
