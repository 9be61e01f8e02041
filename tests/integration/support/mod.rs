//! What several tests need.

pub(crate) mod broken;
pub(crate) mod checked;
pub(crate) mod messages;
pub(crate) mod naive;
pub(crate) mod raw_mcap;
pub(crate) mod reading;
pub(crate) mod recording_builder;
pub(crate) mod rows;
pub(crate) mod subjects;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use coact::model::Episode;
use coact::recording::{ReadOptions, RecordingReader};

/// A path below the project.
pub(crate) fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// All episodes of a recording that must be whole.
pub(crate) fn episodes(path: &Path) -> Vec<Episode> {
    let name = Arc::from(path.file_name().unwrap().to_str().unwrap());
    let mut reader = RecordingReader::open(path, name, &ReadOptions::default()).unwrap();
    let mut episodes = Vec::new();
    while !reader.is_done() {
        episodes.extend(reader.read(u64::MAX).unwrap());
    }
    episodes
}
