//! The rows of an output directory as text, for comparing one run with another.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use coact::tables::Table;
use parquet::file::reader::{FileReader, SerializedFileReader};

/// Every part of every table that a reader of the directory would see.
pub(crate) fn parts(directory: &Path) -> Vec<PathBuf> {
    let mut parts = Vec::new();
    for table in Table::ALL {
        let Ok(entries) = fs::read_dir(directory.join(table.name())) else {
            continue;
        };
        parts.extend(
            entries
                .map(|e| e.unwrap().path())
                .filter(|p| p.extension().is_some_and(|e| e == "parquet")),
        );
    }
    parts.sort();
    parts
}

/// Opens every part and reads it whole: none may be half written.
#[track_caller]
pub(crate) fn check_all_open(directory: &Path) {
    for part in parts(directory) {
        // A process that runs beside may take a part away that no commit names.
        let Ok(file) = File::open(&part) else {
            continue;
        };
        let reader = SerializedFileReader::new(file)
            .unwrap_or_else(|e| panic!("{} does not open: {e}", part.display()));
        let read: Result<Vec<_>, _> = reader.get_row_iter(None).unwrap().collect();
        assert_eq!(
            read.unwrap().len() as i64,
            reader.metadata().file_metadata().num_rows()
        );
    }
}

/// All rows by table, sorted: rows of a run that was stopped may stand in other parts.
pub(crate) fn rows(directory: &Path) -> BTreeMap<&'static str, Vec<String>> {
    let mut rows: BTreeMap<&'static str, Vec<String>> = BTreeMap::new();
    for table in Table::ALL {
        rows.insert(table.name(), Vec::new());
    }
    for part in parts(directory) {
        let table = Table::ALL
            .into_iter()
            .find(|t| part.parent().unwrap().ends_with(t.name()))
            .unwrap();
        let reader = SerializedFileReader::new(File::open(&part).unwrap()).unwrap();
        let of_table = rows.get_mut(table.name()).unwrap();
        of_table.extend(
            reader
                .get_row_iter(None)
                .unwrap()
                .map(|row| row.unwrap().to_string()),
        );
    }
    for rows in rows.values_mut() {
        rows.sort();
    }
    rows
}

/// Names in a directory and below that are neither tables nor of the protocol.
pub(crate) fn temporaries(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![directory.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "tmp") {
                found.push(path);
            }
        }
    }
    found
}
