//! A directory in an object store. What is written is staged in the file system, and put into the store under its final
//! name as soon as it is finished: an object is there whole or not at all, so nothing in the store is ever temporary.
//!
//! The folder of the staging has the names of what the store holds, with nothing in most of these files, so that
//! whoever lists it finds what the store has. It is this process's own, and goes with it.

use std::fs::{self, DirBuilder, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use super::StorageError;
use crate::cloud::{self, RemoteFile};

/// How many folders this process has had for staging.
static N_FOLDERS: AtomicU32 = AtomicU32::new(0);

/// How much of an object a process needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Need {
    /// It is none of ours.
    Nothing,
    /// That it is there.
    Name,
    /// What is in it.
    Content,
}

/// A directory in a store, and the folder where it is staged.
#[derive(Debug)]
pub(crate) struct Mirror {
    address: String,
    staging: PathBuf,
}

impl Mirror {
    /// Lists what is below an address, and fetches what is needed of it. Names that `need` knows lead nowhere else.
    pub(crate) fn open(address: &str, need: impl Fn(&str) -> Need) -> Result<Self, StorageError> {
        let address = address.trim_end_matches('/').to_owned();
        let named = PathBuf::from(&address);
        let root = format!("{address}/");
        cloud::check_writable(&address).map_err(StorageError::io("write to", &named))?;
        let objects = cloud::list(&address).map_err(StorageError::io("list", &named))?;
        let mirror = Self {
            staging: new_folder()?,
            address,
        };
        let mut contents = Vec::new();
        for object in objects {
            let Some(relative) = object.address.strip_prefix(&root) else {
                let what = io::Error::from(io::ErrorKind::InvalidInput);
                return Err(StorageError::io("understand", &named)(what));
            };
            match need(relative) {
                Need::Nothing => {}
                Need::Name => mirror.stage(relative, b"")?,
                Need::Content => contents.push(object),
            }
        }
        for (object, content) in contents.iter().zip(cloud::read_all(&contents)) {
            match content {
                Ok(content) => mirror.stage(&object.address[root.len()..], &content)?,
                // Gone since it was listed.
                Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                Err(e) => return Err(StorageError::io("read", Path::new(&object.address))(e)),
            }
        }
        Ok(mirror)
    }

    /// Where it is staged.
    pub(crate) fn staging(&self) -> &Path {
        &self.staging
    }

    /// The address of what is staged at a path; any other path as it is.
    pub(crate) fn named(&self, path: &Path) -> PathBuf {
        match path.strip_prefix(&self.staging) {
            Ok(below) if below.as_os_str().is_empty() => PathBuf::from(&self.address),
            Ok(below) => Path::new(&self.address).join(below),
            Err(_) => path.to_owned(),
        }
    }

    /// Puts a finished file into the store under its final name; in the staging only the name stays.
    pub(super) fn put(&self, finished: &Path, path: &Path) -> Result<(), StorageError> {
        cloud::put(&self.address_of(path), finished)
            .map_err(StorageError::io("write", &self.named(path)))?;
        leave_name(finished, path)
    }

    /// The same for a name that must not be taken.
    pub(super) fn put_new(&self, finished: &Path, path: &Path) -> Result<(), StorageError> {
        let content = fs::read(finished).map_err(StorageError::io("read", finished))?;
        cloud::put_new(&self.address_of(path), &content)
            .map_err(StorageError::io("create", &self.named(path)))?;
        leave_name(finished, path)
    }

    pub(super) fn remove(&self, path: &Path) -> Result<(), StorageError> {
        cloud::delete(&self.address_of(path)).map_err(StorageError::io("remove", &self.named(path)))
    }

    /// Fetches what is in the object of a staged name.
    pub(super) fn fetch(&self, path: &Path) -> Result<(), StorageError> {
        let mut object = RemoteFile::open(&self.address_of(path))
            .map_err(StorageError::io("read", &self.named(path)))?;
        let mut file = File::create(path).map_err(StorageError::io("create", path))?;
        io::copy(&mut object.by_ref(), &mut file)
            .map_err(StorageError::io("read", &self.named(path)))?;
        Ok(())
    }

    /// Addresses have `/` on all systems.
    fn address_of(&self, path: &Path) -> String {
        let below = path.strip_prefix(&self.staging).unwrap_or(path);
        let names = below.iter().map(|name| name.to_string_lossy());
        names.fold(self.address.clone(), |address, name| {
            format!("{address}/{name}")
        })
    }

    fn stage(&self, relative: &str, content: &[u8]) -> Result<(), StorageError> {
        let path = self.staging.join(relative);
        path.parent()
            .map_or(Ok(()), fs::create_dir_all)
            .and_then(|()| fs::write(&path, content))
            .map_err(StorageError::io("create", &path))
    }
}

impl Drop for Mirror {
    fn drop(&mut self) {
        // There is no one left to tell.
        let _best_effort: io::Result<()> = fs::remove_dir_all(&self.staging);
    }
}

/// Removes what this process has staged: for one that must end at once.
pub(crate) fn remove_stagings() {
    for n in 0..N_FOLDERS.load(Ordering::Relaxed) {
        // There is no one left to tell.
        let _best_effort: io::Result<()> = fs::remove_dir_all(folder(n));
    }
}

fn folder(n: u32) -> PathBuf {
    std::env::temp_dir().join(format!("coact-{}-{n}", cloud::token()))
}

/// A folder that nobody else has, and nobody else may look into.
fn new_folder() -> Result<PathBuf, StorageError> {
    let path = folder(N_FOLDERS.fetch_add(1, Ordering::Relaxed));
    let mut builder = DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder
        .create(&path)
        .map_err(StorageError::io("create the folder", &path))?;
    Ok(path)
}

fn leave_name(finished: &Path, path: &Path) -> Result<(), StorageError> {
    File::create(path)
        .and_then(|_| fs::remove_file(finished))
        .map_err(StorageError::io("create", path))
}
