//! The events files of a run: one a recording, written as its episodes come.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::error::EventsError;
use super::names;
use super::sidecar::{About, Sidecar, is_current};
use crate::model::{Episode, Outcome, RecordingIdentity};
use crate::storage::{Faults, Storage, StorageError};

/// Where events go, and what is said of them.
#[derive(Debug, Clone)]
pub struct EventsOptions {
    /// The folder.
    pub directory: PathBuf,
    /// Parameters that the events depend on, as key-value pairs for each file's metadata.
    pub metadata: Vec<(String, String)>,
    /// Calls to the file system that are to fail, in tests.
    pub faults: Option<Arc<Faults>>,
}

/// What comes of a recording, in order.
#[derive(Debug, Clone, Copy)]
pub enum Item<'a> {
    /// One of its episodes.
    Episode(&'a RecordingIdentity, &'a Episode, &'a Outcome),
    /// Its end.
    End(&'a RecordingIdentity),
}

/// Writes the events files below one folder.
pub struct EventsWriter {
    files: Files,
    /// Folders that are there, without what an earlier process left unfinished.
    prepared: BTreeSet<PathBuf>,
    /// The file of the recording whose end has not come.
    open: Option<Sidecar>,
}

/// Which file is whose, and how they are made: what threads share.
struct Files {
    about: About,
    storage: Storage,
    /// By the recording's name.
    paths: BTreeMap<Arc<str>, PathBuf>,
}

impl EventsWriter {
    /// For recordings of these names.
    pub fn new<'a>(options: &EventsOptions, names: impl Iterator<Item = &'a Arc<str>>) -> Self {
        let paths = names::paths(names).into_iter();
        Self {
            files: Files {
                about: options.metadata.iter().cloned().collect(),
                storage: Storage::new(options.faults.clone()),
                paths: paths
                    .map(|(name, path)| (name, options.directory.join(path)))
                    .collect(),
            },
            prepared: BTreeSet::new(),
            open: None,
        }
    }

    /// For these recordings alone; others of the same run are another process's.
    #[must_use]
    pub fn only<'a>(mut self, names: impl Iterator<Item = &'a Arc<str>>) -> Self {
        let names: BTreeSet<&Arc<str>> = names.collect();
        self.files.paths.retain(|name, _| names.contains(name));
        self
    }

    /// Is the file of a recording there, complete, and made with these parameters?
    pub fn is_current(&self, identity: &RecordingIdentity) -> bool {
        let files = &self.files;
        files
            .path(identity)
            .is_some_and(|path| is_current(path, identity, &files.about))
    }

    /// Appends what came; recordings side by side, each in the order of its episodes.
    ///
    /// # Errors
    /// If the file system refuses; files that were finished before stay.
    pub fn write(&mut self, items: &[Item<'_>]) -> Result<(), EventsError> {
        for item in items {
            if let Item::Episode(identity, ..) = item
                && let Some(folder) = self.files.path(identity).and_then(Path::parent)
            {
                self.files.prepare(folder, &mut self.prepared)?;
            }
        }
        let mut open = self.open.take();
        let files = &self.files;
        let recordings: Vec<(Option<Sidecar>, &[Item<'_>])> = items
            .split_inclusive(|item| matches!(item, Item::End(_)))
            .map(|of_one| (open.take(), of_one))
            .collect();
        let still_open: Vec<Option<Sidecar>> = recordings
            .into_par_iter()
            .with_max_len(1)
            .map(|(sidecar, items)| files.write_one(sidecar, items))
            .collect::<Result<_, _>>()?;
        self.open = still_open.into_iter().flatten().last().or(open);
        Ok(())
    }
}

impl Files {
    /// Writes on a recording; its file, if its end has not come.
    fn write_one(
        &self,
        mut sidecar: Option<Sidecar>,
        items: &[Item<'_>],
    ) -> Result<Option<Sidecar>, EventsError> {
        for item in items {
            match item {
                Item::Episode(identity, episode, outcome) => {
                    let sidecar = match &mut sidecar {
                        Some(sidecar) => sidecar,
                        none => {
                            let Some(path) = self.path(identity) else {
                                continue;
                            };
                            let created =
                                Sidecar::create(&self.storage, path, identity, &self.about)?;
                            none.insert(created)
                        }
                    };
                    sidecar.write(episode, outcome)?;
                }
                Item::End(identity) => match sidecar.take() {
                    Some(sidecar) => sidecar.commit()?,
                    None => self.remove_old(identity)?,
                },
            }
        }
        Ok(sidecar)
    }

    /// A recording without episodes has no file; one that is left of another run goes.
    fn remove_old(&self, identity: &RecordingIdentity) -> Result<(), EventsError> {
        match self.path(identity) {
            Some(path) if names::is_events_file(path) => Ok(self.storage.remove(path)?),
            _ => Ok(()),
        }
    }

    fn path(&self, identity: &RecordingIdentity) -> Option<&Path> {
        self.paths.get(&identity.name).map(PathBuf::as_path)
    }

    /// Makes a folder, and removes files from it that an earlier process did not finish and that this run makes again.
    fn prepare(&self, folder: &Path, prepared: &mut BTreeSet<PathBuf>) -> Result<(), EventsError> {
        if !prepared.insert(folder.to_owned()) {
            return Ok(());
        }
        self.storage.create_folder(folder)?;
        let ours: BTreeSet<&PathBuf> = self.paths.values().collect();
        let entries =
            std::fs::read_dir(folder).map_err(StorageError::io("read the folder", folder))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            if names::finished(&path).is_some_and(|(finished, _)| ours.contains(&finished)) {
                self.storage.remove(&path)?;
            }
        }
        Ok(())
    }
}

/// Removes the temporary files of this process: for one that must end at once.
pub fn remove_temporaries(directory: &Path) {
    let is_ours = |path: &Path| {
        names::finished(path).is_some_and(|(_, process)| process == std::process::id())
    };
    for entry in walkdir::WalkDir::new(directory).into_iter().flatten() {
        if is_ours(entry.path()) {
            // There is no one left to tell.
            let _best_effort = std::fs::remove_file(entry.path());
        }
    }
}
