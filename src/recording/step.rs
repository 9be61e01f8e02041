//! One step of an episode on its way from a message to its episode.

use std::sync::Arc;

use super::decode::{Row, RowId};

/// The id that a message gives its episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum IdRef<'a> {
    None,
    Integer(i64),
    Text(&'a str),
}

/// The same, owned.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum LoggedId {
    Integer(i64),
    Text(Arc<str>),
}

impl LoggedId {
    pub(crate) fn of(id: IdRef<'_>) -> Option<Self> {
        match id {
            IdRef::None => None,
            IdRef::Integer(id) => Some(Self::Integer(id)),
            IdRef::Text(id) => Some(Self::Text(Arc::from(id))),
        }
    }

    pub(crate) fn as_ref(id: Option<&Self>) -> IdRef<'_> {
        match id {
            None => IdRef::None,
            Some(Self::Integer(id)) => IdRef::Integer(*id),
            Some(Self::Text(id)) => IdRef::Text(id),
        }
    }
}

/// What a message says of its step besides action and state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Meta<'a> {
    pub(crate) id: IdRef<'a>,
    pub(crate) number: Option<i64>,
    pub(crate) reward: Option<f64>,
    /// It is the last step of its episode.
    pub(crate) ended: bool,
    /// It says whether it is.
    pub(crate) has_end_flag: bool,
}

impl<'a> Meta<'a> {
    pub(crate) fn of(row: &'a Row) -> Self {
        Self {
            id: match row.id {
                RowId::None => IdRef::None,
                RowId::Integer(id) => IdRef::Integer(id),
                RowId::Text => IdRef::Text(&row.id_text),
            },
            number: row.step,
            reward: row.reward,
            ended: row.ended,
            has_end_flag: row.has_end_flag,
        }
    }
}

/// Where and when a message stood.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// Bytes from the beginning of the file; inside a chunk, of the chunk.
    pub(crate) offset: u64,
    /// Nanoseconds since the Unix epoch, if the clock has them.
    pub(crate) time: Option<i64>,
}

/// A whole step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step<'a> {
    pub(crate) action: &'a [f64],
    pub(crate) state: &'a [f64],
    pub(crate) meta: Meta<'a>,
    pub(crate) place: Place,
}
