//! MCAP recordings built in memory, so that a test says what is in them.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use serde_json::{Value, json};

/// Nanoseconds between two messages.
pub(crate) const STEP_NANOS: u64 = 100_000_000;

/// A recording that grows message by message.
pub(crate) struct RecordingBuilder {
    writer: Writer<Cursor<Vec<u8>>>,
    channels: BTreeMap<String, u16>,
    n_messages: u64,
}

/// How a file is laid out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    pub(crate) compression: Option<Compression>,
    pub(crate) chunked: bool,
    pub(crate) summary: bool,
    /// Bytes; small, so that a short recording has several chunks.
    pub(crate) chunk_size: u64,
}

impl Default for Layout {
    fn default() -> Self {
        Self {
            compression: Some(Compression::Zstd),
            chunked: true,
            summary: true,
            chunk_size: 1 << 20,
        }
    }
}

impl RecordingBuilder {
    pub(crate) fn new() -> Self {
        Self::with_layout(Layout::default())
    }

    pub(crate) fn with_layout(layout: Layout) -> Self {
        let options = WriteOptions::new()
            .compression(layout.compression)
            .use_chunks(layout.chunked)
            .chunk_size(Some(layout.chunk_size))
            .emit_summary_records(layout.summary)
            .emit_summary_offsets(layout.summary);
        Self {
            writer: options.create(Cursor::new(Vec::new())).unwrap(),
            channels: BTreeMap::new(),
            n_messages: 0,
        }
    }

    /// Adds one message; the topic's channel is made when it is first used.
    pub(crate) fn message(&mut self, topic: &str, encoding: &str, data: &[u8]) -> &mut Self {
        let log_time = self.n_messages * STEP_NANOS;
        self.message_at(topic, encoding, log_time, data)
    }

    pub(crate) fn message_at(
        &mut self,
        topic: &str,
        encoding: &str,
        log_time: u64,
        data: &[u8],
    ) -> &mut Self {
        let channel_id = if let Some(&id) = self.channels.get(topic) {
            id
        } else {
            let id = self
                .writer
                .add_channel(0, topic, encoding, &BTreeMap::new())
                .unwrap();
            self.channels.insert(topic.to_owned(), id);
            id
        };
        self.n_messages += 1;
        let sequence = u32::try_from(self.n_messages).unwrap();
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time,
            publish_time: log_time,
        };
        self.writer.write_to_known_channel(&header, data).unwrap();
        self
    }

    /// A channel with a schema (name, encoding, definition); none: without. The same again is the same channel.
    pub(crate) fn channel(
        &mut self,
        topic: &str,
        encoding: &str,
        schema: Option<(&str, &str, &[u8])>,
    ) -> u16 {
        let schema_id = schema.map_or(0, |(name, encoding, data)| {
            self.writer.add_schema(name, encoding, data).unwrap()
        });
        self.writer
            .add_channel(schema_id, topic, encoding, &BTreeMap::new())
            .unwrap()
    }

    /// One message of a channel, published `lead` nanoseconds before it was logged.
    pub(crate) fn send(&mut self, channel_id: u16, log_time: u64, lead: u64, data: &[u8]) {
        self.n_messages += 1;
        let header = MessageHeader {
            channel_id,
            sequence: u32::try_from(self.n_messages).unwrap(),
            log_time,
            publish_time: log_time - lead,
        };
        self.writer.write_to_known_channel(&header, data).unwrap();
    }

    /// One JSON message at a time.
    pub(crate) fn json(&mut self, topic: &str, log_time: u64, message: &Value) -> &mut Self {
        self.message_at(topic, "json", log_time, message.to_string().as_bytes())
    }

    pub(crate) fn step(&mut self, message: &Value) -> &mut Self {
        self.message("/step", "json", message.to_string().as_bytes())
    }

    pub(crate) fn raw_step(&mut self, text: &str) -> &mut Self {
        self.message("/step", "json", text.as_bytes())
    }

    /// Steps `0..n` of one episode, the last one terminated.
    pub(crate) fn episode(&mut self, episode: i64, n: usize) -> &mut Self {
        for step in 0..n {
            self.step(&step_message(episode, step, step + 1 == n));
        }
        self
    }

    pub(crate) fn metadata(&mut self, entries: &[(&str, &str)]) -> &mut Self {
        let metadata = entries
            .iter()
            .map(|(k, v)| ((*k).to_owned(), (*v).to_owned()))
            .collect();
        self.writer
            .write_metadata(&mcap::records::Metadata {
                name: "recording".to_owned(),
                metadata,
            })
            .unwrap();
        self
    }

    pub(crate) fn finish(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }
}

/// A step whose action changes now and then and whose state moves.
pub(crate) fn step_message(episode: i64, step: usize, last: bool) -> Value {
    let x = step as f64;
    let action = if (step / 7).is_multiple_of(2) {
        0.0
    } else {
        1.5
    };
    json!({
        "episode": episode,
        "step": step,
        "action": [action],
        "state": [(x * 0.37).sin() * (1.0 + episode as f64), x * 0.01, (step % 5) as f64],
        "reward": 1.0,
        "terminated": last,
        "truncated": false,
    })
}
