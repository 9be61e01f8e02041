//! Drives one recording from its opening to its row in the `recordings` table.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::chunk::Inflater;
use super::error::RecordingError;
use super::ingest::{Ingest, NATIVE_TOPIC};
use super::limits::Limits;
use super::open::{self, Opened, Stream};
use super::records::{Next, op};
use crate::model::{Episode, RecordingRow, RecordingStatus};

/// How recordings are read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Bounds on memory.
    pub limits: Limits,
}

/// One recording, read from front to back.
///
/// Pull [`read`](Self::read) until [`is_done`](Self::is_done), then take the [`row`](Self::into_row).
pub struct RecordingReader {
    path: PathBuf,
    bytes: u64,
    is_compressed: bool,
    stream: Stream,
    inflater: Inflater,
    body: Vec<u8>,
    ingest: Ingest,
    limits: Limits,
    in_summary: bool,
    done: bool,
}

impl RecordingReader {
    /// Opens the file at `path`, which the tables will call `name`.
    ///
    /// # Errors
    /// If it cannot be opened, is no regular file, or is no MCAP file.
    pub fn open(
        path: &Path,
        name: Arc<str>,
        options: &ReadOptions,
    ) -> Result<Self, RecordingError> {
        let opened = open::open(path, &options.limits)?;
        Ok(Self {
            path: path.to_owned(),
            bytes: opened.bytes,
            is_compressed: opened.is_compressed(),
            stream: opened.stream,
            inflater: Inflater::default(),
            body: Vec::new(),
            ingest: Ingest::new(name, options.limits),
            limits: options.limits,
            in_summary: false,
            done: false,
        })
    }

    /// Size of the file at opening, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes of the recording read so far (inflated bytes of a `.mcap.zst`).
    pub fn position(&self) -> u64 {
        self.stream.offset()
    }

    /// Is there nothing more to read?
    pub fn is_done(&self) -> bool {
        self.done
    }

    /// Reads on until episodes of at least `budget` bytes are complete, or the recording ends.
    ///
    /// # Errors
    /// If the file cannot be read on, nothing in it can be used, or one episode is beyond the limit. Episodes given
    /// out before stand.
    pub fn read(&mut self, budget: u64) -> Result<Vec<Episode>, RecordingError> {
        let mut episodes = Vec::new();
        let mut bytes = 0;
        while !self.done && bytes < budget {
            self.step()?;
            for episode in self.ingest.episodes.take_ready() {
                let values = episode.n_steps()
                    * (episode.actions.n_columns() + episode.states.n_columns() + 2);
                bytes += 8 * values as u64;
                episodes.push(episode);
            }
        }
        Ok(episodes)
    }

    /// Takes the next record of the outer loop.
    fn step(&mut self) -> Result<(), RecordingError> {
        let in_summary = self.in_summary;
        let wanted = |opcode| {
            !in_summary
                && matches!(
                    opcode,
                    op::SCHEMA
                        | op::CHANNEL
                        | op::MESSAGE
                        | op::CHUNK
                        | op::METADATA
                        | op::DATA_END
                )
        };
        match self.stream.next(wanted, &mut self.body)? {
            Next::Record { .. } if in_summary => {}
            Next::Record {
                opcode: op::DATA_END,
                offset,
            } => self.data_end(offset),
            Next::Record { opcode, offset } => self.record(opcode, offset, true)?,
            Next::TooLarge {
                opcode,
                offset,
                declared,
            } => self.too_large(opcode, offset, declared),
            Next::Cut {
                opcode,
                offset,
                declared,
                available,
            } => {
                if !in_summary && wanted(opcode) && opcode == op::CHUNK {
                    self.record(opcode, offset, false)?;
                }
                let what = format!(
                    "the file is cut: its last record declares {declared} bytes, and {available} are left"
                );
                self.ingest.damaged("file is cut", &what, offset);
                self.end()?;
            }
            Next::ClosingMagic { junk: 0 } => self.end()?,
            Next::ClosingMagic { junk } => {
                let at = self.stream.offset() - junk;
                self.end()?;
                self.ingest.damaged(
                    "bytes after the end of the file",
                    &format!("{junk} bytes follow the closing magic"),
                    at,
                );
            }
            Next::End { offset, tail } => {
                self.ingest.damaged(
                    "file is cut",
                    &format!("the file is cut: no closing magic ({tail} bytes are no record)"),
                    offset,
                );
                self.end()?;
            }
        }
        Ok(())
    }

    fn record(&mut self, opcode: u8, offset: u64, is_whole: bool) -> Result<(), RecordingError> {
        if matches!(opcode, op::CHUNK | op::MESSAGE) && !self.ingest.names_known() {
            // Names may stand behind the messages; rows need them now.
            let names =
                Opened::find_names(&self.path, self.bytes, self.is_compressed, &self.limits)
                    .unwrap_or_default();
            self.ingest.set_names(names);
        }
        if opcode == op::CHUNK {
            self.ingest
                .chunk(&mut self.inflater, &self.body, offset, is_whole)
        } else {
            self.ingest.record(opcode, &self.body, offset)
        }
    }

    fn too_large(&mut self, opcode: u8, offset: u64, declared: u64) {
        let what = format!(
            "record with opcode {opcode:#04x} of {declared} bytes is beyond the limit of {} (--max-record)",
            self.limits.max_record
        );
        self.ingest
            .damaged("record beyond --max-record", &what, offset);
    }

    /// The data section ends here; what follows is the summary.
    fn data_end(&mut self, offset: u64) {
        self.in_summary = true;
        let declared = self
            .body
            .first_chunk::<4>()
            .map_or(0, |bytes| u32::from_le_bytes(*bytes));
        if declared != 0 {
            let found = self.stream.crc_before_last();
            if found != declared {
                let what =
                    format!("data section CRC is {found:08x} where {declared:08x} is declared");
                self.ingest
                    .damaged("data section CRC does not match", &what, offset);
            }
        }
    }

    fn end(&mut self) -> Result<(), RecordingError> {
        self.done = true;
        self.ingest.finish();
        if self.ingest.has_chosen() {
            return Ok(());
        }
        let wanted = format!("no topic {NATIVE_TOPIC:?} with steps of an agent");
        let found = self.ingest.channels.describe();
        let damage = self
            .ingest
            .damage
            .as_ref()
            .map_or(String::new(), |(what, _)| format!("; {what}"));
        Err(RecordingError::NothingToRead {
            wanted,
            found: found + &damage,
        })
    }

    /// The row of the `recordings` table; `error` if reading ended with one.
    pub fn into_row(self, error: Option<&str>) -> RecordingRow {
        let Ingest {
            episodes,
            tally,
            common,
            n_messages,
            encoding,
            damage,
            ..
        } = self.ingest;
        let n_episodes = episodes.n_given();
        let damage = damage.map(|(what, n)| {
            if n > 1 {
                format!("{what}, and {} more", n - 1)
            } else {
                what
            }
        });
        let (status, reason) = match (error, damage) {
            (Some(e), _) if n_episodes == 0 => (RecordingStatus::Failed, Some(e.to_owned())),
            (Some(e), _) => (RecordingStatus::Recovered, Some(e.to_owned())),
            (None, damage) if n_episodes == 0 => {
                let why = damage
                    .or_else(|| tally.causes().first().map(|c| c.cause.clone()))
                    .unwrap_or_else(|| "it holds no message".to_owned());
                (
                    RecordingStatus::Failed,
                    Some(format!("no episode came out: {why}")),
                )
            }
            (None, Some(damage)) => (RecordingStatus::Recovered, Some(damage)),
            (None, None) => (RecordingStatus::Ok, None),
        };
        // What an error left unused belongs to the refused: used + refused is the number of messages, always.
        let n_messages_used = episodes.n_used();
        RecordingRow {
            recording: common.recording,
            bytes: self.bytes,
            status,
            reason,
            env_id: common.env_id,
            action_selector: encoding.as_ref().map(|_| format!("{NATIVE_TOPIC}:action")),
            state_selector: encoding.as_ref().map(|_| format!("{NATIVE_TOPIC}:state")),
            encoding,
            episode_rule: episodes.rule().map(|rule| rule.describe().to_owned()),
            clock: Some("log".to_owned()),
            align: Some("before".to_owned()),
            n_messages,
            n_messages_used,
            n_messages_refused: n_messages - n_messages_used,
            causes: tally.causes(),
            n_episodes,
        }
    }

    /// The row of a recording that could not even be opened.
    pub fn failed_row(name: Arc<str>, bytes: u64, error: &str) -> RecordingRow {
        RecordingRow {
            recording: name,
            bytes,
            status: RecordingStatus::Failed,
            reason: Some(error.to_owned()),
            env_id: None,
            encoding: None,
            action_selector: None,
            state_selector: None,
            episode_rule: None,
            clock: None,
            align: None,
            n_messages: 0,
            n_messages_used: 0,
            n_messages_refused: 0,
            causes: Vec::new(),
            n_episodes: 0,
        }
    }
}
