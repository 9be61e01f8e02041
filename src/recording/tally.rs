//! Counts what is refused, by cause, with the place where each cause came up first.

use std::collections::BTreeMap;

use super::timeline::{BEFORE_FIRST_MARKER, BEFORE_FIRST_STATE};
use crate::model::Cause;

/// Causes and their counts. Few causes, however many messages.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    /// Count and first offset.
    causes: BTreeMap<String, (u64, u64)>,
}

/// Causes that are no loss.
const EXPECTED: [&str; 2] = [BEFORE_FIRST_STATE, BEFORE_FIRST_MARKER];

/// Most different causes that are kept apart; a hostile file could make one per message.
const MAX_CAUSES: usize = 64;

impl Tally {
    /// Counts one refused message.
    pub(crate) fn refuse(&mut self, cause: &str, offset: u64) {
        self.note(cause, offset, 1);
    }

    /// Counts `count` messages refused for one cause.
    pub(crate) fn refuse_many(&mut self, cause: &str, offset: u64, count: u64) {
        if count > 0 {
            self.note(cause, offset, count);
        }
    }

    /// Counts something that is no message of the chosen topics, such as a damaged chunk.
    pub(crate) fn note(&mut self, cause: &str, offset: u64, count: u64) {
        let cause = if self.causes.len() >= MAX_CAUSES && !self.causes.contains_key(cause) {
            "other causes"
        } else {
            cause
        };
        match self.causes.get_mut(cause) {
            Some((n, first)) => {
                *n += count;
                *first = offset.min(*first);
            }
            None => {
                self.causes.insert(cause.to_owned(), (count, offset));
            }
        }
    }

    /// The causes in the order in which they first came up.
    pub(crate) fn causes(&self) -> Vec<Cause> {
        let mut causes: Vec<Cause> = self
            .causes
            .iter()
            .map(|(cause, &(count, first_offset))| Cause {
                cause: cause.clone(),
                count,
                first_offset,
                expected: EXPECTED.contains(&cause.as_str()),
            })
            .collect();
        causes.sort_by_key(|c| c.first_offset);
        causes
    }
}
