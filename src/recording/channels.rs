//! The schemas and channels of one file, as its own records define them, and how many messages each topic had.
//!
//! Ids are per file: nothing here outlives its recording.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::wire::{Channel, Schema};

/// A definition that contradicts an earlier one of the same id.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Redefined {
    pub(crate) what: String,
}

/// All definitions seen so far.
#[derive(Debug, Default)]
pub(crate) struct Channels {
    schemas: BTreeMap<u16, Schema>,
    by_id: BTreeMap<u16, Channel>,
    /// Messages seen, by channel id.
    counts: BTreeMap<u16, u64>,
    last_counted: Option<(u16, u64)>,
}

/// Most topics that an error lists.
const LISTED_TOPICS: usize = 20;

impl Channels {
    /// Adds a schema; the same again is no news. Id 0 means "no schema" and defines nothing.
    pub(crate) fn add_schema(&mut self, schema: Schema) -> Result<(), Redefined> {
        if schema.id == 0 {
            return Err(Redefined {
                what: "schema with the reserved id 0".to_owned(),
            });
        }
        match self.schemas.get(&schema.id) {
            Some(known) if *known == schema => Ok(()),
            Some(known) => Err(Redefined {
                what: format!("schema {:?} redefined differently", known.name),
            }),
            None => {
                self.schemas.insert(schema.id, schema);
                Ok(())
            }
        }
    }

    /// Adds a channel; true if it is new.
    pub(crate) fn add_channel(&mut self, channel: Channel) -> Result<bool, Redefined> {
        match self.by_id.get(&channel.id) {
            Some(known) if *known == channel => Ok(false),
            Some(known) => Err(Redefined {
                what: format!("channel {:?} redefined differently", known.topic),
            }),
            None => {
                self.by_id.insert(channel.id, channel);
                Ok(true)
            }
        }
    }

    pub(crate) fn channel(&self, id: u16) -> Option<&Channel> {
        self.by_id.get(&id)
    }

    /// Counts one message; false if its channel is not defined.
    pub(crate) fn count(&mut self, id: u16) -> bool {
        // Messages of one channel come in runs: the map is asked once a run.
        if let Some((last, n)) = &mut self.last_counted
            && *last == id
        {
            *n += 1;
            return true;
        }
        self.settle();
        if !self.by_id.contains_key(&id) {
            return false;
        }
        self.last_counted = Some((id, 1));
        true
    }

    fn settle(&mut self) {
        if let Some((id, n)) = self.last_counted.take() {
            *self.counts.entry(id).or_default() += n;
        }
    }

    /// One line of topics with encodings and message counts, for errors.
    pub(crate) fn describe(&mut self) -> String {
        self.settle();
        if self.by_id.is_empty() {
            return "the file has no topics".to_owned();
        }
        let mut text = String::from("topics found: ");
        for (i, (id, channel)) in self.by_id.iter().enumerate() {
            if i == LISTED_TOPICS {
                let _infallible = write!(text, " and {} more", self.by_id.len() - LISTED_TOPICS);
                break;
            }
            let n = self.counts.get(id).copied().unwrap_or(0);
            let separator = if i == 0 { "" } else { ", " };
            let _infallible = write!(
                text,
                "{separator}{} ({}, {n} messages)",
                channel.topic, channel.encoding
            );
        }
        text
    }
}
