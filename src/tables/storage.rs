//! Every call to the file system that writing makes, in one place.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use super::error::TableError;

/// Makes a folder and those above it.
pub(super) fn create_folder(path: &Path) -> Result<(), TableError> {
    fs::create_dir_all(path).map_err(TableError::io("create the folder", path))
}

/// Makes or empties a file.
pub(super) fn create(path: &Path) -> Result<PartFile, TableError> {
    File::create(path)
        .map(PartFile)
        .map_err(TableError::io("create", path))
}

/// Gives a finished file its final name, so that it is there whole or not at all, also after a power cut.
pub(super) fn commit(file: PartFile, temporary: &Path, path: &Path) -> Result<(), TableError> {
    file.0
        .sync_all()
        .map_err(TableError::io("sync", temporary))?;
    drop(file);
    fs::rename(temporary, path).map_err(TableError::io("rename to", path))?;
    path.parent().map_or(Ok(()), sync_folder)
}

/// Writes a small file whole.
pub(super) fn write_whole(path: &Path, temporary: &Path, content: &[u8]) -> Result<(), TableError> {
    let mut file = create(temporary)?;
    file.write_all(content)
        .map_err(TableError::io("write", temporary))?;
    commit(file, temporary, path)
}

/// Removes a file; that it is gone already is no error.
pub(super) fn remove(path: &Path) -> Result<(), TableError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(TableError::io("remove", path)(e)),
        _ => Ok(()),
    }
}

/// Removes a folder that holds nothing; any other stays.
pub(super) fn remove_empty_folder(path: &Path) {
    // A folder that is not empty, or not there, is none of our business.
    let _stays: io::Result<()> = fs::remove_dir(path);
}

/// Makes the names in a folder durable.
fn sync_folder(path: &Path) -> Result<(), TableError> {
    // Other systems have no such call, and need none.
    if cfg!(unix) {
        File::open(path)
            .and_then(|folder| folder.sync_all())
            .map_err(TableError::io("sync the folder", path))
    } else {
        Ok(())
    }
}

/// A file that is being written.
pub(super) struct PartFile(File);

impl Write for PartFile {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.0.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
