//! Walks a message beside its plan.
//!
//! Writers put fields in the order of their numbers, each once: values then go into the row as they come. Where a
//! message does otherwise, which the format allows, the row is begun anew and `merge.rs` orders the fields first.

use std::ops::Range;

use super::plan::{Absent, FieldPlan, Message, Place, Take};
use super::scalar::{Datum, Scalar, wrong_wire_type};
use super::wire::{Payload, Wire};
use super::{DecodeError, malformed};
use crate::recording::decode::plan::Field;
use crate::recording::decode::row::{ABSENT, Row, is_absent};
use crate::recording::limits::MAX_VECTOR_WIDTH;

/// Why a walk ended early.
pub(super) enum Stop {
    /// Fields that are not in order: to be ordered first.
    Disorder,
    Error(DecodeError),
}

impl From<DecodeError> for Stop {
    fn from(e: DecodeError) -> Self {
        Self::Error(e)
    }
}

/// One walk.
pub(super) struct Walk<'r> {
    pub(super) row: &'r mut Row,
    /// Fields may come in any order.
    pub(super) is_merging: bool,
}

impl Walk<'_> {
    /// Takes what is wanted of a message.
    pub(super) fn message(&mut self, plan: &Message, data: &[u8]) -> Result<(), Stop> {
        if self.is_merging {
            return self.merge(plan, &[data]);
        }
        let mut wire = Wire::new(data);
        let mut oneofs = 0u64;
        // The first field that may still come, and how many elements of it have.
        let (mut next, mut count) = (0, 0);
        while let Some((number, payload)) = wire.field()? {
            let Some(slot) = plan.slot(number) else {
                continue;
            };
            if let Some(oneof) = slot.oneof {
                // Past 64 of them some share a bit, which costs time only.
                let bit = 1u64 << oneof.min(63);
                if oneofs & bit != 0 {
                    return Err(Stop::Disorder);
                }
                oneofs |= bit;
            }
            let Some(index) = slot.index else {
                continue;
            };
            if index < next {
                return Err(Stop::Disorder);
            }
            for field in &plan.fields[next..index] {
                self.finish(field, count)?;
                count = 0;
            }
            next = index;
            match &plan.fields[index].place {
                Place::One { take, .. } => {
                    self.take(take, payload)?;
                    next += 1;
                }
                Place::Many { kind, parts, .. } => {
                    count = self.elements(*kind, parts, count, payload)?;
                }
            }
        }
        for field in &plan.fields[next..] {
            self.finish(field, count)?;
            count = 0;
        }
        Ok(())
    }

    /// All of a field has come: `count` elements, or nothing of a field that stands once.
    pub(super) fn finish(&mut self, field: &FieldPlan, count: usize) -> Result<(), Stop> {
        match &field.place {
            Place::One { take, absent } => self.absent(take, absent),
            Place::Many { parts, targets, .. } => {
                for &target in targets {
                    self.row.values(target);
                }
                for (range, take) in parts {
                    if let Take::Scalar {
                        field,
                        required: true,
                        ..
                    } = take
                        && !matches!(field, Field::Values(_) | Field::Names(_))
                        && count <= range.start
                    {
                        return Err(self.missing(*field));
                    }
                }
                Ok(())
            }
        }
    }

    /// Out of order, a field may still come when others behind it have.
    fn missing(&self, field: Field) -> Stop {
        if self.is_merging {
            DecodeError::Missing(self.row.label(field)).into()
        } else {
            Stop::Disorder
        }
    }

    fn absent(&mut self, take: &Take, absent: &Absent) -> Result<(), Stop> {
        match (absent, take) {
            (Absent::Default(value), _) => self.put(take, value.datum())?,
            (Absent::Empty, Take::Message(plan)) => {
                for field in &plan.fields {
                    self.finish(field, 0)?;
                }
            }
            (Absent::Hole, _) => self.hole(take)?,
            (Absent::Empty | Absent::Nothing, _) => {}
            (Absent::Refuse(field), _) => return Err(self.missing(*field)),
        }
        Ok(())
    }

    /// Keeps the place of values that an element of an array does not have, so that names and values stay parallel.
    fn hole(&mut self, take: &Take) -> Result<(), DecodeError> {
        match take {
            Take::Scalar { field, .. } => match *field {
                Field::Values(target) => self.extend(target, 1, std::iter::once(ABSENT)),
                Field::Names(_) => self.row.text(*field, ""),
                _ => Ok(()),
            },
            Take::Bytes(parts) => parts
                .iter()
                .try_for_each(|&(_, target)| self.extend(target, 1, std::iter::once(ABSENT))),
            Take::Message(plan) => {
                for field in &plan.fields {
                    match &field.place {
                        Place::One { take, .. } => self.hole(take)?,
                        Place::Many { targets, .. } => {
                            for &target in targets {
                                self.row.values(target);
                            }
                        }
                    }
                }
                Ok(())
            }
        }
    }

    /// Takes one value.
    pub(super) fn take(&mut self, take: &Take, payload: Payload<'_>) -> Result<(), Stop> {
        match (take, payload) {
            (Take::Message(plan), Payload::Bytes(data)) => self.message(plan, data),
            (Take::Scalar { kind, .. }, _) => Ok(self.put(take, kind.datum(payload)?)?),
            (Take::Bytes(_), _) => Ok(self.put(take, Scalar::Bytes.datum(payload)?)?),
            (Take::Message(_), _) => Err(wrong_wire_type().into()),
        }
    }

    fn put(&mut self, take: &Take, value: Datum<'_>) -> Result<(), DecodeError> {
        match (take, value) {
            (Take::Bytes(parts), Datum::Bytes(bytes)) => {
                for (range, target) in parts {
                    let picked = &bytes[range.start.min(bytes.len())..range.end.min(bytes.len())];
                    self.bytes(*target, picked)?;
                }
                Ok(())
            }
            (
                Take::Scalar {
                    field: Field::Values(target),
                    ..
                },
                Datum::Bytes(bytes),
            ) => self.bytes(*target, bytes),
            (Take::Scalar { field, .. }, _) => {
                if let Field::Values(target) = *field {
                    self.extend(target, 1, std::iter::empty())?;
                }
                value.put(*field, self.row)
            }
            (Take::Bytes(_) | Take::Message(_), _) => Err(wrong_wire_type()),
        }
    }

    fn bytes(&mut self, target: usize, bytes: &[u8]) -> Result<(), DecodeError> {
        self.extend(target, bytes.len(), bytes.iter().map(|&b| f64::from(b)))
    }

    /// Appends values, if there is room for `n` of them.
    fn extend(
        &mut self,
        target: usize,
        n: usize,
        more: impl Iterator<Item = f64>,
    ) -> Result<(), DecodeError> {
        let values = self.row.values(target);
        if values.len().saturating_add(n) > MAX_VECTOR_WIDTH {
            return Err(DecodeError::TooWide(self.row.label(Field::Values(target))));
        }
        values.extend(more);
        Ok(())
    }

    /// Takes what one field of the wire adds to an array, and gives its new length.
    pub(super) fn elements(
        &mut self,
        kind: Option<Scalar>,
        parts: &[(Range<usize>, Take)],
        count: usize,
        payload: Payload<'_>,
    ) -> Result<usize, Stop> {
        if let (Some(kind), Payload::Bytes(packed)) = (kind, payload)
            && kind.is_packable()
        {
            return Ok(match kind.width() {
                Some(width) => self.fixed(kind, width, parts, count, packed)?,
                None => self.varints(kind, parts, count, packed)?,
            });
        }
        match part(parts, count) {
            Some(take) => self.take(take, payload)?,
            // Not wanted, but it must be what the schema says.
            None => match (kind, payload) {
                (Some(kind), _) => {
                    kind.datum(payload)?;
                }
                (None, Payload::Bytes(_)) => {}
                (None, _) => return Err(wrong_wire_type().into()),
            },
        }
        Ok(count + 1)
    }

    /// A packed run of values of `width` bytes.
    fn fixed(
        &mut self,
        kind: Scalar,
        width: usize,
        parts: &[(Range<usize>, Take)],
        count: usize,
        packed: &[u8],
    ) -> Result<usize, DecodeError> {
        if !packed.len().is_multiple_of(width) {
            return Err(malformed("a packed run that ends in the middle of a value"));
        }
        let n = packed.len() / width;
        for (range, take) in parts {
            let start = range.start.saturating_sub(count).min(n);
            let end = range.end.saturating_sub(count).min(n);
            if start >= end {
                continue;
            }
            let run = &packed[start * width..end * width];
            match take {
                Take::Scalar {
                    field: Field::Values(target),
                    ..
                } => self.run(kind, *target, end - start, run)?,
                _ => kind.fixed(run, |value| self.put(take, value))?,
            }
        }
        Ok(count + n)
    }

    /// The one loop whose speed counts: a slice of floats, copied in one go.
    fn run(
        &mut self,
        kind: Scalar,
        target: usize,
        n: usize,
        run: &[u8],
    ) -> Result<(), DecodeError> {
        match kind {
            Scalar::Double => {
                let values = run.as_chunks().0;
                self.extend(target, n, values.iter().map(|&b| f64::from_le_bytes(b)))?;
                if may_hold_absent(run) {
                    let values = self.row.values(target).iter_mut().rev().take(n);
                    for value in values.filter(|v| is_absent(**v)) {
                        *value = f64::NAN;
                    }
                }
                Ok(())
            }
            Scalar::Float => self.extend(
                target,
                n,
                run.as_chunks()
                    .0
                    .iter()
                    .map(|&b| f64::from(f32::from_le_bytes(b))),
            ),
            _ => {
                self.extend(target, n, std::iter::empty())?;
                let row = &mut *self.row;
                kind.fixed(run, |value| value.put(Field::Values(target), row))
            }
        }
    }

    /// A packed run of varints.
    fn varints(
        &mut self,
        kind: Scalar,
        parts: &[(Range<usize>, Take)],
        mut count: usize,
        packed: &[u8],
    ) -> Result<usize, DecodeError> {
        let mut wire = Wire::new(packed);
        while !wire.is_empty() {
            let value = kind.packed(&mut wire)?;
            if let Some(take) = part(parts, count) {
                self.put(take, value)?;
            }
            count += 1;
        }
        Ok(count)
    }
}

/// Half a value of [`ABSENT`] in a run of floats: no NaN of a message must pass for a value that is absent. Apart from
/// the copy and by halves, both loops are vector instructions on any machine; a test in the copy triples its time.
fn may_hold_absent(run: &[u8]) -> bool {
    const HIGH_HALF: u32 = (ABSENT.to_bits() >> 32) as u32;
    let halves = run.as_chunks().0;
    halves.chunks(64).any(|block| {
        let is_half = |&half: &[u8; 4]| u32::from(u32::from_le_bytes(half) == HIGH_HALF);
        block.iter().map(is_half).fold(0, |any, hit| any | hit) != 0
    })
}

/// What is taken of the element `index`.
fn part(parts: &[(Range<usize>, Take)], index: usize) -> Option<&Take> {
    let at = parts.partition_point(|(range, _)| range.end <= index);
    let (range, take) = parts.get(at)?;
    range.contains(&index).then_some(take)
}
