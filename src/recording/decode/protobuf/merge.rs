//! Messages whose fields are not in order, or that come in pieces: what the format allows and few writers do.
//!
//! The last value of a field counts, pieces of a message add up, and the last member of a oneof displaces the others.
//! Pieces are kept as slices, not joined: each takes two bytes of the message at least, so what this allocates is a
//! fixed multiple of the message's size.

use super::plan::{Message, Place, Slot, Take};
use super::scalar::wrong_wire_type;
use super::walk::{Stop, Walk};
use super::wire::{Payload, Wire};
use super::{DecodeError, malformed};
use crate::recording::limits::MAX_VECTOR_WIDTH;

/// A field of the wire that is wanted, or displaces one that is.
struct Occurrence<'a> {
    number: u32,
    slot: Slot,
    payload: Payload<'a>,
}

impl Walk<'_> {
    /// Takes what is wanted of a message that comes in `pieces`.
    pub(super) fn merge(&mut self, plan: &Message, pieces: &[&[u8]]) -> Result<(), Stop> {
        let mut occurrences = gather(plan, pieces)?;
        displace(&mut occurrences);
        // Stable: what is repeated stays in its order.
        occurrences.sort_by_key(|o| o.slot.index);
        let mut rest = &occurrences[..];
        for (index, field) in plan.fields.iter().enumerate() {
            let n = rest
                .iter()
                .take_while(|o| o.slot.index == Some(index))
                .count();
            let (own, others) = rest.split_at(n);
            rest = others;
            match &field.place {
                Place::One { take, .. } => match own.last() {
                    Some(last) => self.last(take, own, last)?,
                    None => self.finish(field, 0)?,
                },
                Place::Many { kind, parts, .. } => {
                    let mut count = 0;
                    for o in own {
                        count = self.elements(*kind, parts, count, o.payload)?;
                    }
                    self.finish(field, count)?;
                }
            }
        }
        Ok(())
    }

    /// A field that stands once, however often it came.
    fn last(
        &mut self,
        take: &Take,
        all: &[Occurrence<'_>],
        last: &Occurrence<'_>,
    ) -> Result<(), Stop> {
        match take {
            Take::Message(plan) => {
                let pieces: Vec<&[u8]> = all
                    .iter()
                    .map(|o| match o.payload {
                        Payload::Bytes(data) => Ok(data),
                        _ => Err(wrong_wire_type()),
                    })
                    .collect::<Result<_, _>>()?;
                self.merge(plan, &pieces)
            }
            Take::Scalar { kind, .. } => {
                for o in all {
                    kind.datum(o.payload)?;
                }
                self.take(take, last.payload)
            }
            Take::Bytes(_) => self.take(take, last.payload),
        }
    }
}

/// The occurrences of what the plan knows.
fn gather<'a>(plan: &Message, pieces: &[&'a [u8]]) -> Result<Vec<Occurrence<'a>>, DecodeError> {
    let mut occurrences = Vec::new();
    for piece in pieces {
        let mut wire = Wire::new(piece);
        while let Some((number, payload)) = wire.field()? {
            let Some(slot) = plan.slot(number) else {
                continue;
            };
            if occurrences.len() >= MAX_VECTOR_WIDTH {
                return Err(malformed(
                    "more fields out of order than a vector may have values",
                ));
            }
            occurrences.push(Occurrence {
                number,
                slot,
                payload,
            });
        }
    }
    Ok(occurrences)
}

/// Drops what a later member of the same oneof displaces, and members that are not wanted.
fn displace(occurrences: &mut Vec<Occurrence<'_>>) {
    // Of each oneof the member that came last, and whether another came before it.
    let mut last: Vec<Option<(u32, bool)>> = Vec::new();
    let mut keep = vec![true; occurrences.len()];
    for (o, keep) in occurrences.iter().zip(&mut keep).rev() {
        if let Some(oneof) = o.slot.oneof {
            if last.len() <= oneof {
                last.resize(oneof + 1, None);
            }
            let (member, is_displaced) = last[oneof].get_or_insert((o.number, false));
            *is_displaced |= *member != o.number;
            *keep = !*is_displaced;
        }
        *keep &= o.slot.index.is_some();
    }
    let mut keep = keep.into_iter();
    occurrences.retain(|_| keep.next().unwrap_or(false));
}
