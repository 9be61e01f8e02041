//! What becomes of each record of a recording: definitions are kept, messages of the chosen topics decoded and fed to
//! the episodes, all else counted or passed over.

use std::sync::Arc;

use super::channels::Channels;
use super::chunk::Inflater;
use super::decode::{Decoder, Row, SUPPORTED};
use super::episodes::{Common, Episodes};
use super::error::RecordingError;
use super::limits::Limits;
use super::metadata::Names;
use super::open_episode::Place;
use super::records::op;
use super::tally::Tally;
use super::wire::{Channel, Chunk, Cursor, Message, Metadata, Schema, WireError};

/// Topic of the native convention.
pub(crate) const NATIVE_TOPIC: &str = "/step";

/// A topic that was chosen, and how its messages are read.
struct Chosen {
    channel_id: u16,
    decoder: Decoder,
}

/// The state of one recording while its records come in.
pub(crate) struct Ingest {
    pub(crate) channels: Channels,
    pub(crate) episodes: Episodes,
    pub(crate) tally: Tally,
    pub(crate) common: Common,
    pub(crate) n_messages: u64,
    /// Encoding of the chosen topic, once one is seen.
    pub(crate) encoding: Option<String>,
    /// The first damage, as a sentence, and how many there were.
    pub(crate) damage: Option<(String, u64)>,
    names_known: bool,
    chosen: Vec<Chosen>,
    row: Row,
    limits: Limits,
}

impl Ingest {
    pub(crate) fn new(recording: Arc<str>, limits: Limits) -> Self {
        Self {
            channels: Channels::default(),
            episodes: Episodes::new(limits),
            tally: Tally::default(),
            common: Common {
                recording,
                env_id: None,
                joint_names: None,
            },
            n_messages: 0,
            encoding: None,
            damage: None,
            names_known: false,
            chosen: Vec::new(),
            row: Row::default(),
            limits,
        }
    }

    /// Was the metadata record `recording` found, or looked for in vain?
    pub(crate) fn names_known(&self) -> bool {
        self.names_known
    }

    pub(crate) fn set_names(&mut self, names: Option<Names>) {
        self.names_known = true;
        if let Some(Names {
            env_id,
            joint_names,
        }) = names
        {
            self.common.env_id = env_id;
            self.common.joint_names = joint_names;
        }
    }

    /// Notes damage: it is counted under `cause`, described once by `what`, and steps may have been lost.
    pub(crate) fn damaged(&mut self, cause: &str, what: &str, offset: u64) {
        self.tally.note(cause, offset, 1);
        let description = format!("{what} at offset {offset}");
        self.episodes.lose(&description);
        match &mut self.damage {
            Some((_, n)) => *n += 1,
            none => *none = Some((description, 1)),
        }
    }

    /// Takes one record of the outer loop that is not a chunk.
    pub(crate) fn record(
        &mut self,
        opcode: u8,
        body: &[u8],
        offset: u64,
    ) -> Result<(), RecordingError> {
        let result = match opcode {
            op::SCHEMA => Schema::parse(body).map(|schema| self.schema(schema, offset)),
            op::CHANNEL => match Channel::parse(body) {
                Ok(channel) => return self.channel(channel, offset),
                Err(e) => Err(e),
            },
            op::MESSAGE => match Message::parse(body) {
                Ok(message) => return self.message(&message, offset),
                Err(e) => Err(e),
            },
            op::METADATA => Metadata::parse(body).map(|record| {
                if !self.names_known
                    && let Some(names) = Names::of(&record)
                {
                    self.set_names(Some(names));
                }
            }),
            _ => Ok(()),
        };
        result.unwrap_or_else(|e: WireError| {
            self.damaged(
                "record that cannot be read",
                &format!("{} record {e}", name(opcode)),
                offset,
            );
        });
        Ok(())
    }

    /// Takes a chunk; `is_whole` is false where the end of the file cut it.
    pub(crate) fn chunk(
        &mut self,
        inflater: &mut Inflater,
        body: &[u8],
        offset: u64,
        is_whole: bool,
    ) -> Result<(), RecordingError> {
        let chunk = match Chunk::parse(body) {
            Ok(chunk) => chunk,
            Err(e) => {
                if is_whole {
                    self.damaged(
                        "chunk record that cannot be read",
                        &format!("chunk {e}"),
                        offset,
                    );
                }
                return Ok(());
            }
        };
        if !is_whole {
            let records = inflater.inflate_cut(&chunk, self.limits.max_chunk);
            return self.records_of_chunk(records, offset, false);
        }
        match inflater.inflate(&chunk, self.limits.max_chunk) {
            Ok(records) => self.records_of_chunk(records, offset, true),
            Err(e) => {
                self.damaged(e.cause(), &e.to_string(), offset);
                Ok(())
            }
        }
    }

    fn records_of_chunk(
        &mut self,
        records: &[u8],
        offset: u64,
        is_whole: bool,
    ) -> Result<(), RecordingError> {
        let mut cursor = Cursor::new(records);
        while !cursor.rest().is_empty() {
            let record = (|| {
                let opcode = cursor.u8("opcode")?;
                let length = cursor.u64("length")?;
                Ok::<_, WireError>((opcode, cursor.bytes(length, "body")?))
            })();
            match record {
                Ok((op::CHUNK, _)) => {
                    self.damaged("chunk inside a chunk", "chunk inside the chunk", offset);
                }
                Ok((opcode, body)) => self.record(opcode, body, offset)?,
                Err(_) if !is_whole => break,
                Err(e) => {
                    self.damaged(
                        "chunk whose records do not fit it",
                        &format!("a record {e} in the chunk"),
                        offset,
                    );
                    break;
                }
            }
        }
        Ok(())
    }

    fn schema(&mut self, schema: Schema, offset: u64) {
        if let Err(e) = self.channels.add_schema(schema) {
            self.tally.note(&e.what, offset, 1);
        }
    }

    fn channel(&mut self, channel: Channel, offset: u64) -> Result<(), RecordingError> {
        let id = channel.id;
        match self.channels.add_channel(channel) {
            Ok(true) => self.choose(id),
            Ok(false) => Ok(()),
            Err(e) => {
                self.tally.note(&e.what, offset, 1);
                Ok(())
            }
        }
    }

    /// Decides whether a new channel is one whose messages are wanted.
    fn choose(&mut self, id: u16) -> Result<(), RecordingError> {
        let Some(channel) = self
            .channels
            .channel(id)
            .filter(|c| c.topic == NATIVE_TOPIC)
        else {
            return Ok(());
        };
        let Some(decoder) = Decoder::native(&channel.encoding) else {
            return Err(RecordingError::Encoding {
                topic: channel.topic.clone(),
                encoding: channel.encoding.clone(),
                supported: SUPPORTED,
            });
        };
        self.encoding
            .get_or_insert_with(|| channel.encoding.clone());
        if self.common.env_id.is_none() {
            self.common.env_id = channel
                .metadata
                .get("env_id")
                .map(|s| Arc::from(s.as_str()));
        }
        self.chosen.push(Chosen {
            channel_id: id,
            decoder,
        });
        Ok(())
    }

    fn message(&mut self, message: &Message<'_>, offset: u64) -> Result<(), RecordingError> {
        if !self.channels.count(message.channel_id) {
            self.tally
                .note("message of a channel that is not defined", offset, 1);
            return Ok(());
        }
        let Some(chosen) = self
            .chosen
            .iter()
            .find(|c| c.channel_id == message.channel_id)
        else {
            return Ok(());
        };
        self.n_messages += 1;
        let place = Place {
            offset,
            time: i64::try_from(message.log_time).ok(),
        };
        match chosen.decoder.decode(message.data, &mut self.row) {
            Ok(()) => self
                .episodes
                .push(&self.row, place, &self.common, &mut self.tally),
            Err(e) => {
                self.episodes.bad(
                    &self.row,
                    &e.to_string(),
                    place,
                    &self.common,
                    &mut self.tally,
                );
                Ok(())
            }
        }
    }

    /// The recording is at its end: closes what is open.
    pub(crate) fn finish(&mut self) {
        self.episodes.finish(&self.common, &mut self.tally);
    }

    /// Was a topic found to read?
    pub(crate) fn has_chosen(&self) -> bool {
        !self.chosen.is_empty()
    }
}

fn name(opcode: u8) -> &'static str {
    match opcode {
        op::SCHEMA => "schema",
        op::CHANNEL => "channel",
        op::MESSAGE => "message",
        op::METADATA => "metadata",
        _ => "unknown",
    }
}
