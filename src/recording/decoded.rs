//! The messages of one chunk, decoded before it is their turn: by a copy of what reads their channels, on any thread.
//!
//! Only what goes without saying is decoded so. A message that cannot be read, or whose names are not the expected
//! ones, is left to [`Ingest`](super::ingest::Ingest), which reads it when it comes and decides what that means.

use std::ops::Range;
use std::sync::Arc;

use super::decode::Head;
use super::records::op;
use super::source::{ChannelReader, Source};
use super::wire::{Message, records};

/// Values of one chunk that are decoded before their turn; those beyond are left. 8 MiB, several times what a chunk of
/// usual size holds.
const MAX_VALUES: usize = 1 << 20;

/// What reads the channels of a file, as it was when version `version` of it was made.
#[derive(Debug, Clone)]
pub(crate) struct Readers {
    pub(crate) version: u64,
    /// Messages may have other names than the first: all of them are known.
    pub(crate) knows_all_names: bool,
    pub(crate) channels: Vec<(u16, Source, ChannelReader)>,
}

/// One message that could be read.
#[derive(Debug)]
struct Entry {
    /// Which of the chunk's message records it is.
    nth: usize,
    head: Head,
    values: Range<usize>,
    ends: Range<usize>,
    text: Range<usize>,
}

/// What the messages of one chunk gave, in their order.
#[derive(Debug, Default)]
pub(crate) struct Decoded {
    version: u64,
    entries: Vec<Entry>,
    /// The values of all entries.
    pub(crate) values: Vec<f64>,
    ends: Vec<usize>,
    texts: String,
    /// Entries that were taken or passed by.
    n_taken: usize,
    /// Message records that came.
    n_seen: usize,
}

impl Decoded {
    /// Forgets all; the buffers stay.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.values.clear();
        self.ends.clear();
        self.texts.clear();
        (self.n_taken, self.n_seen) = (0, 0);
    }

    /// Decodes what can be of the records of a chunk.
    pub(crate) fn fill(&mut self, chunk: &[u8], readers: &mut Readers) {
        self.clear();
        self.version = readers.version;
        let messages = records(chunk).filter_map(|record| match record {
            Ok((op::MESSAGE, body)) => Some(body),
            _ => None,
        });
        for (nth, body) in messages.enumerate() {
            if self.values.len() > MAX_VALUES {
                break;
            }
            if let Ok(message) = Message::parse(body) {
                self.push(nth, &message, readers);
            }
        }
    }

    fn push(&mut self, nth: usize, message: &Message<'_>, readers: &mut Readers) {
        let channels = &mut readers.channels;
        let Some((_, source, reader)) = channels
            .iter_mut()
            .find(|(id, ..)| *id == message.channel_id)
        else {
            return;
        };
        let result = source.read(reader, message.data);
        let is_unlike = std::mem::take(&mut source.has_other_names) && !readers.knows_all_names;
        if result.is_err() || is_unlike {
            return;
        }
        let (values, ends, text) = (self.values.len(), self.ends.len(), self.texts.len());
        self.values.extend_from_slice(&source.values);
        self.ends.extend_from_slice(&source.ends);
        self.texts.push_str(&source.row.id_text);
        self.entries.push(Entry {
            nth,
            head: source.row.head(),
            values: values..self.values.len(),
            ends: ends..self.ends.len(),
            text: text..self.texts.len(),
        });
    }

    /// Puts all but the values of the message record that has [come](Self::pass) into `source`, and says where in
    /// [`values`](Self::values) those are; if it was decoded, and `version` is still that of the readers.
    pub(crate) fn take(&mut self, version: u64, source: &mut Source) -> Option<Range<usize>> {
        let entry = self.entries.get(self.n_taken)?;
        if self.version != version || entry.nth + 1 != self.n_seen {
            return None;
        }
        self.n_taken += 1;
        source
            .row
            .set_head(&entry.head, &self.texts[entry.text.clone()]);
        source.ends.clear();
        source
            .ends
            .extend_from_slice(&self.ends[entry.ends.clone()]);
        Some(entry.values.clone())
    }

    /// The chunk's next message record comes.
    pub(crate) fn pass(&mut self) {
        let is_behind = |e: &Entry| e.nth < self.n_seen;
        if self.entries.get(self.n_taken).is_some_and(is_behind) {
            self.n_taken += 1;
        }
        self.n_seen += 1;
    }
}

/// Readers of the current version, made once for each.
#[derive(Debug, Default)]
pub(crate) struct ReadersCache {
    version: u64,
    made: Option<Arc<Readers>>,
}

impl ReadersCache {
    /// What reads the channels is not what it was.
    pub(crate) fn outdate(&mut self) {
        self.version += 1;
        self.made = None;
    }

    pub(crate) fn version(&self) -> u64 {
        self.version
    }

    /// The readers, made by `make` from the current version.
    pub(crate) fn get(&mut self, make: impl FnOnce(u64) -> Readers) -> Arc<Readers> {
        let version = self.version;
        Arc::clone(self.made.get_or_insert_with(|| Arc::new(make(version))))
    }
}
