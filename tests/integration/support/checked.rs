//! Reads recordings through the library as a run does, and holds what comes out against what must always hold.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use coact::model::{Episode, RecordingRow};
use coact::recording::{ReadOptions, RecordingReader};

/// Episodes, and the row of the recording.
pub(crate) type Read = (Vec<Episode>, RecordingRow);

/// Reads a file to its end; an error ends in the row.
pub(crate) fn read_path(path: &Path, options: &ReadOptions) -> Read {
    let name: Arc<str> = Arc::from("r.mcap");
    let mut reader = match RecordingReader::open(path, Arc::clone(&name), options) {
        Ok(reader) => reader,
        Err(e) => {
            let row = RecordingReader::failed_row(name, 0, &e.to_string());
            return (Vec::new(), row);
        }
    };
    let mut episodes = Vec::new();
    while !reader.is_done() {
        match reader.read(1) {
            Ok(more) => episodes.extend(more),
            Err(e) => return checked(episodes, reader.into_row(Some(&e.to_string()))),
        }
    }
    checked(episodes, reader.into_row(None))
}

/// Messages on the chosen topics = used + refused, and no episode comes twice.
fn checked(episodes: Vec<Episode>, row: RecordingRow) -> Read {
    assert_eq!(
        row.n_messages,
        row.n_messages_used + row.n_messages_refused,
        "{row:?}"
    );
    assert_eq!(row.n_episodes, episodes.len() as u64, "{row:?}");
    let keys: BTreeSet<_> = episodes
        .iter()
        .map(|e| (e.key.episode, e.key.episode_id.clone()))
        .collect();
    assert_eq!(keys.len(), episodes.len(), "an episode came twice");
    (episodes, row)
}

/// Reads `bytes` from a file in `folder`, which one thread may use again and again.
pub(crate) fn read_in(folder: &Path, bytes: &[u8], options: &ReadOptions) -> Read {
    let path = folder.join("r.mcap");
    std::fs::write(&path, bytes).unwrap();
    read_path(&path, options)
}

pub(crate) fn read_with(bytes: &[u8], options: &ReadOptions) -> Read {
    let dir = tempfile::tempdir().unwrap();
    read_in(dir.path(), bytes, options)
}

pub(crate) fn read(bytes: &[u8]) -> Read {
    read_with(bytes, &ReadOptions::default())
}

/// Is anything told that a user would see: a status, a cause, an episode that is incomplete?
pub(crate) fn is_reported((episodes, row): &Read) -> bool {
    !row.is_clean() || episodes.iter().any(|e| e.incomplete.is_some())
}

/// Steps in all episodes.
pub(crate) fn n_steps(episodes: &[Episode]) -> usize {
    episodes.iter().map(Episode::n_steps).sum()
}

/// All numbers of a step, to the bit.
pub(crate) fn step_bits(episode: &Episode, step: usize) -> Vec<u64> {
    let columns = episode.actions.iter().chain(episode.states.iter());
    columns.map(|c| c[step].to_bits()).collect()
}
