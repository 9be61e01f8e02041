//! A tree of names compiled against a message type.

use std::ops::Range;

use super::scalar::{Default, Scalar};
use crate::recording::decode::plan::Field;

/// What is wanted of a message.
#[derive(Debug, Clone)]
pub(super) struct Message {
    /// In the order of their declaration, which is the order of the values.
    pub(super) fields: Vec<FieldPlan>,
    /// By field number, for the small numbers that nearly all fields have.
    dense: Vec<Option<Slot>>,
    /// Larger numbers, sorted.
    sparse: Vec<(u32, Slot)>,
}

/// A field that is wanted.
#[derive(Debug, Clone)]
pub(super) struct FieldPlan {
    pub(super) place: Place,
}

/// How often a field stands in its message.
#[derive(Debug, Clone)]
pub(super) enum Place {
    One {
        take: Take,
        absent: Absent,
    },
    /// What is taken of which elements, by position; nothing of those between.
    Many {
        kind: Option<Scalar>,
        parts: Vec<(Range<usize>, Take)>,
        /// These are found even if there is no element.
        targets: Vec<usize>,
    },
}

/// What is done with a value.
#[derive(Debug, Clone)]
pub(super) enum Take {
    Scalar {
        kind: Scalar,
        field: Field,
        required: bool,
    },
    /// Ranges of a byte array, each with its target.
    Bytes(Vec<(Range<usize>, usize)>),
    Message(Message),
}

/// What a field means that is not in the message.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Absent {
    Default(Default),
    /// A message whose fields all have their defaults.
    Empty,
    /// A hole in an array: each value below is absent.
    Hole,
    /// Not found, which is fine, or may be told once the whole message is read.
    Nothing,
    /// The message cannot be used without.
    Refuse(Field),
}

/// What a field number stands for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slot {
    /// In `fields`; else it is here for its oneof.
    pub(super) index: Option<usize>,
    /// The oneof it belongs to, if any of its members is wanted.
    pub(super) oneof: Option<usize>,
}

/// Field numbers below are looked up in a table.
const DENSE: usize = 64;

impl Message {
    pub(super) fn new(fields: Vec<FieldPlan>, slots: &[(u32, Slot)]) -> Self {
        let mut dense = Vec::new();
        let mut sparse = Vec::new();
        for &(number, slot) in slots {
            match usize::try_from(number) {
                Ok(number) if number < DENSE => {
                    if dense.len() <= number {
                        dense.resize(number + 1, None);
                    }
                    dense[number] = Some(slot);
                }
                _ => sparse.push((number, slot)),
            }
        }
        sparse.sort_unstable_by_key(|&(number, _)| number);
        Self {
            fields,
            dense,
            sparse,
        }
    }

    #[inline]
    pub(super) fn slot(&self, number: u32) -> Option<Slot> {
        if let Some(slot) = self.dense.get(number as usize) {
            return *slot;
        }
        let found = self.sparse.binary_search_by_key(&number, |&(n, _)| n);
        found.ok().map(|i| self.sparse[i].1)
    }

    /// The targets of all values below.
    pub(super) fn targets(&self, found: &mut Vec<usize>) {
        for field in &self.fields {
            match &field.place {
                Place::One { take, .. } => take.targets(found),
                Place::Many { targets, .. } => found.extend(targets),
            }
        }
    }
}

impl Take {
    pub(super) fn targets(&self, found: &mut Vec<usize>) {
        match self {
            Self::Scalar {
                field: Field::Values(target),
                ..
            } => found.push(*target),
            Self::Scalar { .. } => {}
            Self::Bytes(parts) => found.extend(parts.iter().map(|&(_, target)| target)),
            Self::Message(message) => message.targets(found),
        }
    }
}
