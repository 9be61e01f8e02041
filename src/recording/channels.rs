//! The schemas and channels of one file, as its own records define them, and how many messages each channel had.
//!
//! Ids are per file: nothing here outlives its file.

use std::collections::BTreeMap;
use std::path::Path;

use super::limits::Limits;
use super::rescue;
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
    rescued: bool,
}

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

    /// Takes over from the summary what the data does not define; true if that is anything. Looked for once.
    pub(crate) fn rescue(&mut self, path: &Path, limits: &Limits) -> bool {
        if std::mem::replace(&mut self.rescued, true) {
            return false;
        }
        let (schemas, channels) = rescue::definitions(path, limits).unwrap_or_default();
        for schema in schemas {
            self.schemas.entry(schema.id).or_insert(schema);
        }
        let n_before = self.by_id.len();
        for channel in channels {
            self.by_id.entry(channel.id).or_insert(channel);
        }
        self.by_id.len() > n_before
    }

    pub(crate) fn channel(&self, id: u16) -> Option<&Channel> {
        self.by_id.get(&id)
    }

    /// The schema of a channel; id 0 is none.
    pub(crate) fn schema(&self, id: u16) -> Option<&Schema> {
        self.schemas.get(&id)
    }

    /// Every channel, by id.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Channel> {
        self.by_id.values()
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

    /// Each channel with its messages so far.
    pub(crate) fn counted(&mut self) -> impl Iterator<Item = (&Channel, u64)> {
        self.settle();
        let counts = &self.counts;
        self.by_id
            .iter()
            .map(|(id, channel)| (channel, counts.get(id).copied().unwrap_or(0)))
    }
}
