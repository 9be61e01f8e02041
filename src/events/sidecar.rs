//! One events file while it is written, under a temporary name.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Cursor, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Compression, MAGIC, McapResult, WriteOptions, Writer};

use super::error::EventsError;
use super::messages::{ActionChange, Event, Schema, StateChange};
use super::names::{self, LIBRARY};
use super::timeline::{self, Subject};
use crate::model::{Episode, JointMode, Outcome, RecordingIdentity};
use crate::storage::{NewFile, Storage, StorageError};

/// Name of the metadata record that says what a file is of.
const METADATA: &str = "coact";

/// Name of the metadata record that says what was left out.
const OMITTED: &str = "coact.omitted";

/// Bytes of a chunk before it is compressed, about; held in memory until it is complete.
const CHUNK_BYTES: u64 = 1 << 20;

/// Most topics of joints in a file: a recording whose action is an image would have one a pixel.
const MAX_JOINT_TOPICS: usize = 4_096;

/// What a file says of itself in its first record.
pub(super) type About = BTreeMap<String, String>;

/// A file that is being written.
pub(super) struct Sidecar {
    storage: Storage,
    path: PathBuf,
    temporary: PathBuf,
    writer: Option<Writer<NoSeek<BufWriter<NewFile>>>>,
    events: u16,
    state: u16,
    joint_schema: u16,
    /// By topic, number and name of the joint.
    joints: BTreeMap<(String, i32, String), u16>,
    n_omitted: u64,
}

impl Sidecar {
    pub(super) fn create(
        storage: &Storage,
        path: &Path,
        identity: &RecordingIdentity,
        about: &About,
    ) -> Result<Self, EventsError> {
        let temporary = names::temporary(path);
        let file = storage.create(&temporary)?;
        let writer = begun(NoSeek::new(BufWriter::new(file)), identity, about);
        let mut sidecar = Self {
            storage: storage.clone(),
            path: path.to_owned(),
            temporary,
            writer: None,
            events: 0,
            state: 0,
            joint_schema: 0,
            joints: BTreeMap::new(),
            n_omitted: 0,
        };
        // From here on the temporary file is removed whatever fails.
        sidecar
            .declare(writer)
            .map_err(EventsError::mcap(&sidecar.temporary))?;
        Ok(sidecar)
    }

    /// Makes the topics that every file has.
    fn declare(
        &mut self,
        writer: McapResult<Writer<NoSeek<BufWriter<NewFile>>>>,
    ) -> McapResult<()> {
        let writer = self.writer.insert(writer?);
        let events = add_schema::<Event>(writer)?;
        let state = add_schema::<StateChange>(writer)?;
        self.joint_schema = add_schema::<ActionChange>(writer)?;
        self.events = writer.add_channel(events, "/coact/events", "protobuf", &BTreeMap::new())?;
        self.state = writer.add_channel(state, "/coact/state", "protobuf", &BTreeMap::new())?;
        Ok(())
    }

    /// Appends the events and series of an episode.
    pub(super) fn write(
        &mut self,
        episode: &Episode,
        outcome: &Outcome,
    ) -> Result<(), EventsError> {
        self.append(episode, outcome)
            .map_err(EventsError::mcap(&self.temporary))
    }

    fn append(&mut self, episode: &Episode, outcome: &Outcome) -> McapResult<()> {
        let joints = self.joint_channels(episode, outcome)?;
        let (events, state) = (self.events, self.state);
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        timeline::tell(episode, outcome, |subject, log_time, message| {
            let channel = match subject {
                Subject::Event => Some(events),
                Subject::State => Some(state),
                Subject::Joint(index) => joints[index],
            };
            let Some(channel_id) = channel else {
                return Ok(());
            };
            let header = MessageHeader {
                channel_id,
                sequence: 0,
                log_time,
                publish_time: log_time,
            };
            writer.write_to_known_channel(&header, message)
        })
    }

    /// The channel of each joint; none where there are too many.
    fn joint_channels(
        &mut self,
        episode: &Episode,
        outcome: &Outcome,
    ) -> McapResult<Vec<Option<u16>>> {
        let Outcome::Extracted(extraction) = outcome else {
            return Ok(Vec::new());
        };
        let mode = extraction.mode;
        let topics = topics(episode, mode, extraction.joints.len());
        let Some(writer) = &mut self.writer else {
            return Ok(Vec::new());
        };
        let mut channels = Vec::with_capacity(topics.len());
        for (index, topic) in topics.into_iter().enumerate() {
            let number = mode.joint_number(index);
            let name = episode.joint_name(mode, index);
            let key = (
                topic,
                number,
                name.map_or_else(String::new, ToString::to_string),
            );
            if let Some(&channel) = self.joints.get(&key) {
                channels.push(Some(channel));
                continue;
            }
            if self.joints.len() >= MAX_JOINT_TOPICS {
                self.n_omitted += 1;
                channels.push(None);
                continue;
            }
            let mut metadata = BTreeMap::from([("joint".to_owned(), number.to_string())]);
            metadata.extend(name.map(|name| ("joint_name".to_owned(), name.to_string())));
            let channel = writer.add_channel(self.joint_schema, &key.0, "protobuf", &metadata)?;
            self.joints.insert(key, channel);
            channels.push(Some(channel));
        }
        Ok(channels)
    }

    /// Completes the file, flushes it to disk and gives it its name.
    pub(super) fn commit(mut self) -> Result<(), EventsError> {
        let Some(mut writer) = self.writer.take() else {
            return Ok(());
        };
        let mut end = || {
            if self.n_omitted > 0 {
                let metadata =
                    BTreeMap::from([("n_series".to_owned(), self.n_omitted.to_string())]);
                writer.write_metadata(&Metadata {
                    name: OMITTED.to_owned(),
                    metadata,
                })?;
            }
            writer.finish().map(drop)
        };
        end().map_err(EventsError::mcap(&self.temporary))?;
        let file = writer
            .into_inner()
            .into_inner()
            .into_inner()
            .map_err(|e| StorageError::io("write", &self.temporary)(e.into_error()))?;
        self.storage.commit(file, &self.temporary, &self.path)?;
        Ok(())
    }
}

impl Drop for Sidecar {
    /// A file that was not committed leaves nothing behind.
    fn drop(&mut self) {
        self.writer = None;
        // An error here has no one to be told to; the next run removes what is left.
        let _best_effort = fs::remove_file(&self.temporary);
    }
}

/// A writer behind the records that every file begins with.
fn begun<W: Write + Seek>(
    to: W,
    identity: &RecordingIdentity,
    about: &About,
) -> McapResult<Writer<W>> {
    let mut writer = WriteOptions::new()
        .library(LIBRARY)
        .compression(Some(Compression::Zstd))
        // Threads of its own would make other bytes, and more of them than there are cores.
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
        .create(to)?;
    let mut metadata = about.clone();
    metadata.insert("recording".to_owned(), identity.name.to_string());
    metadata.insert("recording_bytes".to_owned(), identity.bytes.to_string());
    metadata.insert("recording_hash".to_owned(), identity.hash.to_string());
    writer.write_metadata(&Metadata {
        name: METADATA.to_owned(),
        metadata,
    })?;
    Ok(writer)
}

fn add_schema<S: Schema>(writer: &mut Writer<impl Write + Seek>) -> McapResult<u16> {
    writer.add_schema(S::NAME, "protobuf", &S::descriptor_set())
}

/// Is the file at `path` complete, and of this recording with these parameters?
pub(super) fn is_current(path: &Path, identity: &RecordingIdentity, about: &About) -> bool {
    let beginning = begun(Cursor::new(Vec::new()), identity, about)
        .map(|writer| writer.into_inner().into_inner())
        .unwrap_or_default();
    let read = || -> io::Result<bool> {
        let mut file = File::open(path)?;
        let mut found = vec![0; beginning.len()];
        file.read_exact(&mut found)?;
        let mut end = [0; MAGIC.len()];
        let end_at = file.metadata()?.len().saturating_sub(end.len() as u64);
        file.seek(SeekFrom::Start(end_at))?;
        file.read_exact(&mut end)?;
        Ok(found == beginning && end == MAGIC)
    };
    !beginning.is_empty()
        && fs::metadata(path).is_ok_and(|m| m.is_file())
        && read().unwrap_or(false)
}

/// The topic of each joint: by its name, if that is one that viewers take in a path and no other joint of the episode
/// has it, else by its number.
fn topics(episode: &Episode, mode: JointMode, n_joints: usize) -> Vec<String> {
    let mut n_named: BTreeMap<&str, usize> = BTreeMap::new();
    for name in (0..n_joints).filter_map(|i| episode.joint_name(mode, i)) {
        *n_named.entry(name).or_default() += 1;
    }
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    let is_topic = |name: &&str| {
        name.chars().all(is_plain)
            && name.chars().any(|c| !c.is_ascii_digit())
            && n_named.get(*name) == Some(&1)
    };
    (0..n_joints)
        .map(|index| {
            let name = episode.joint_name(mode, index).map(|name| &**name);
            let name = match mode {
                JointMode::Each => name.filter(is_topic).map(ToOwned::to_owned),
                JointMode::Together => Some("together".to_owned()),
            };
            format!(
                "/coact/joints/{}",
                name.unwrap_or_else(|| index.to_string())
            )
        })
        .collect()
}
