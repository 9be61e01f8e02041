//! Every call to the file system that writing makes, in one place, so that a test can make any of them fail; and the
//! same in an object store, where the directory is one.

mod faults;
mod mirror;

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use thiserror::Error;

pub use faults::Faults;
pub(crate) use mirror::{Need, remove_stagings};

use crate::cloud;
use mirror::Mirror;

/// A call to the file system that was refused.
#[derive(Debug, Error)]
#[error("cannot {action} {}", path.display())]
pub struct StorageError {
    /// What was tried: `create`, `write`, `sync`, `rename to`, …
    pub action: &'static str,
    /// On what.
    pub path: PathBuf,
    /// Why not.
    pub source: io::Error,
}

impl StorageError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self {
            action,
            path,
            source,
        }
    }
}

/// How long a run has waited for the disk to have what was written (fsync); shared by all that write.
#[derive(Debug, Clone, Default)]
pub struct SyncTime(Arc<AtomicU64>);

impl SyncTime {
    /// So far.
    pub fn get(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }

    fn sync(&self, file: &File) -> io::Result<()> {
        let started = Instant::now();
        let result = file.sync_all();
        let nanos = u64::try_from(started.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.0.fetch_add(nanos, Ordering::Relaxed);
        result
    }
}

/// The file system, perhaps with faults, perhaps with a store behind it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Storage {
    faults: Option<Arc<Faults>>,
    mirror: Option<Arc<Mirror>>,
    pub(crate) sync_time: SyncTime,
}

impl Storage {
    pub(crate) fn new(faults: Option<Arc<Faults>>) -> Self {
        Self {
            faults,
            ..Self::default()
        }
    }

    /// The storage of a directory, and where that is in the file system: its staging, if it is the address of one in
    /// an object store. `need` says by its relative name how much of an object there a process needs.
    pub(crate) fn of(
        directory: &Path,
        faults: Option<Arc<Faults>>,
        need: impl Fn(&str) -> Need,
    ) -> Result<(Self, PathBuf), StorageError> {
        let mut storage = Self::new(faults);
        let Some(address) = cloud::address(directory) else {
            return Ok((storage, directory.to_owned()));
        };
        let mirror = Mirror::open(address, need)?;
        let staging = mirror.staging().to_owned();
        storage.mirror = Some(Arc::new(mirror));
        Ok((storage, staging))
    }

    /// Is it an object store? Nothing is locked there, and nothing renamed.
    pub(crate) fn is_store(&self) -> bool {
        self.mirror.is_some()
    }

    /// What a path is called in messages.
    pub(crate) fn named(&self, path: &Path) -> PathBuf {
        self.mirror
            .as_ref()
            .map_or_else(|| path.to_owned(), |mirror| mirror.named(path))
    }

    /// Sees to it that a file of a store has its content here.
    pub(crate) fn fetch(&self, path: &Path) -> Result<(), StorageError> {
        self.mirror
            .as_ref()
            .map_or(Ok(()), |mirror| mirror.fetch(path))
    }

    fn check(&self) -> io::Result<()> {
        self.faults.as_ref().map_or(Ok(()), |f| f.check())
    }

    /// Makes a folder and those above it, and its name durable.
    pub(crate) fn create_folder(&self, path: &Path) -> Result<(), StorageError> {
        if path.is_dir() {
            return Ok(());
        }
        self.check()
            .and_then(|()| fs::create_dir_all(path))
            .map_err(StorageError::io("create the folder", path))?;
        path.parent().map_or(Ok(()), |above| {
            if above.as_os_str().is_empty() {
                Ok(())
            } else {
                self.sync_folder(above)
            }
        })
    }

    /// Opens a file to be locked, made if it is not there; what it holds stays.
    pub(crate) fn open_lock(&self, path: &Path) -> Result<File, StorageError> {
        self.check()
            .and_then(|()| {
                File::options()
                    .read(true)
                    .write(true)
                    .create(true)
                    .truncate(false)
                    .open(path)
            })
            .map_err(StorageError::io("open", path))
    }

    /// Takes the lock on a file if nobody has it.
    pub(crate) fn try_lock(&self, file: &File) -> Result<(), TryLockError> {
        if self.faults.as_ref().is_some_and(|faults| faults.no_locks) {
            return Err(TryLockError::Error(io::ErrorKind::Unsupported.into()));
        }
        file.try_lock()
    }

    /// Makes or empties a file.
    pub(crate) fn create(&self, path: &Path) -> Result<NewFile, StorageError> {
        self.check()
            .and_then(|()| File::create(path))
            .map(|file| NewFile {
                file,
                storage: self.clone(),
            })
            .map_err(StorageError::io("create", path))
    }

    /// Gives a finished file its final name, so that it is there whole or not at all, also after a power cut.
    pub(crate) fn commit(
        &self,
        file: NewFile,
        temporary: &Path,
        path: &Path,
    ) -> Result<(), StorageError> {
        if let Some(mirror) = &self.mirror {
            drop(file);
            return mirror.put(temporary, path);
        }
        self.sync(file, temporary)?;
        self.check()
            .and_then(|()| fs::rename(temporary, path))
            .map_err(StorageError::io("rename to", path))?;
        self.sync_name(path)
    }

    /// The same where several machines may write: a name that is taken is an error of kind `AlreadyExists`, and what
    /// stands there stays.
    pub(crate) fn commit_new(
        &self,
        file: NewFile,
        temporary: &Path,
        path: &Path,
    ) -> Result<(), StorageError> {
        if let Some(mirror) = &self.mirror {
            drop(file);
            return mirror.put_new(temporary, path);
        }
        self.sync(file, temporary)?;
        self.check()
            .and_then(|()| rename_new(temporary, path))
            .map_err(StorageError::io("create", path))?;
        self.sync_name(path)
    }

    fn sync(&self, file: NewFile, path: &Path) -> Result<(), StorageError> {
        self.check()
            .and_then(|()| self.sync_time.sync(&file.file))
            .map_err(StorageError::io("sync", path))?;
        drop(file);
        Ok(())
    }

    /// Writes a small file whole; what stands there already stays until the new one is complete.
    pub(crate) fn write_whole(
        &self,
        path: &Path,
        temporary: &Path,
        content: &[u8],
    ) -> Result<(), StorageError> {
        self.write_small(temporary, content, |file| {
            self.commit(file, temporary, path)
        })
    }

    /// The same for a name that must not be taken.
    pub(crate) fn write_whole_new(
        &self,
        path: &Path,
        temporary: &Path,
        content: &[u8],
    ) -> Result<(), StorageError> {
        self.write_small(temporary, content, |file| {
            self.commit_new(file, temporary, path)
        })
    }

    fn write_small(
        &self,
        temporary: &Path,
        content: &[u8],
        commit: impl FnOnce(NewFile) -> Result<(), StorageError>,
    ) -> Result<(), StorageError> {
        let written = self.create(temporary).and_then(|mut file| {
            file.write_all(content)
                .map_err(StorageError::io("write", temporary))?;
            commit(file)
        });
        if written.is_err() {
            // What is left of it is of no use; the next run would remove it too.
            let _best_effort: io::Result<()> = fs::remove_file(temporary);
        }
        written
    }

    /// Removes a file; that it is gone already is no error.
    pub(crate) fn remove(&self, path: &Path) -> Result<(), StorageError> {
        if let Some(mirror) = &self.mirror {
            mirror.remove(path)?;
        }
        match self.check().and_then(|()| fs::remove_file(path)) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => {
                Err(StorageError::io("remove", path)(e))
            }
            _ => Ok(()),
        }
    }

    /// Makes the name of a file durable.
    fn sync_name(&self, path: &Path) -> Result<(), StorageError> {
        path.parent()
            .map_or(Ok(()), |above| self.sync_folder(above))
    }

    /// Makes the names in a folder durable.
    pub(crate) fn sync_folder(&self, path: &Path) -> Result<(), StorageError> {
        // Other systems have no such call, and need none.
        if cfg!(unix) {
            self.check()
                .and_then(|()| File::open(path))
                .and_then(|folder| self.sync_time.sync(&folder))
                .map_err(StorageError::io("sync the folder", path))
        } else {
            Ok(())
        }
    }
}

/// Renames a file unless the new name is taken.
fn rename_new(temporary: &Path, path: &Path) -> io::Result<()> {
    match fs::hard_link(temporary, path) {
        Ok(()) => {}
        // A server that was asked twice, because its answer was lost, says so too.
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
            if !is_same_file(temporary, path) {
                return Err(e);
            }
        }
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Err(e),
        // No links here, as on FAT and on some network drives: not atomic, but there the lock remains.
        Err(_) if path.exists() => return Err(io::ErrorKind::AlreadyExists.into()),
        Err(_) => return fs::rename(temporary, path),
    }
    // The file has its name; that it has another too harms nobody.
    let _best_effort: io::Result<()> = fs::remove_file(temporary);
    Ok(())
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let id = |path: &Path| fs::metadata(path).map(|m| (m.dev(), m.ino()));
        id(a).is_ok_and(|a| id(b).is_ok_and(|b| a == b))
    }
    #[cfg(not(unix))]
    {
        let _ = (a, b);
        false
    }
}

/// Removes a folder that holds nothing; any other stays.
pub(crate) fn remove_empty_folder(path: &Path) {
    // A folder that is not empty, or not there, is none of our business.
    let _stays: io::Result<()> = fs::remove_dir(path);
}

/// A file that is being written.
pub(crate) struct NewFile {
    file: File,
    storage: Storage,
}

impl Write for NewFile {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.storage.check()?;
        self.file.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
