//! Scalars: what the schema calls them, what the wire holds, what a row takes.

use prost_reflect::{FieldDescriptor, Kind, Value as Reflected};

use super::wire::{Payload, Wire};
use super::{DecodeError, malformed};
use crate::recording::decode::plan::Field;
use crate::recording::decode::row::Row;

/// The type of a field, messages left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    Double,
    Float,
    Int32,
    Int64,
    Uint32,
    Uint64,
    Sint32,
    Sint64,
    Fixed32,
    Fixed64,
    Sfixed32,
    Sfixed64,
    Bool,
    Enum,
    String,
    Bytes,
}

/// One value of a scalar field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Datum<'a> {
    Integer(i64),
    Unsigned(u64),
    Float(f64),
    Bool(bool),
    Text(&'a str),
    Bytes(&'a [u8]),
}

impl Scalar {
    /// `None` for messages.
    pub(super) fn of(kind: &Kind) -> Option<Self> {
        Some(match kind {
            Kind::Double => Self::Double,
            Kind::Float => Self::Float,
            Kind::Int32 => Self::Int32,
            Kind::Int64 => Self::Int64,
            Kind::Uint32 => Self::Uint32,
            Kind::Uint64 => Self::Uint64,
            Kind::Sint32 => Self::Sint32,
            Kind::Sint64 => Self::Sint64,
            Kind::Fixed32 => Self::Fixed32,
            Kind::Fixed64 => Self::Fixed64,
            Kind::Sfixed32 => Self::Sfixed32,
            Kind::Sfixed64 => Self::Sfixed64,
            Kind::Bool => Self::Bool,
            Kind::Enum(_) => Self::Enum,
            Kind::String => Self::String,
            Kind::Bytes => Self::Bytes,
            Kind::Message(_) => return None,
        })
    }

    /// May a field of this type be given what it is wanted for? `is_element`: of an array.
    pub(super) fn fits(self, field: Field, is_element: bool) -> bool {
        let is_float = matches!(self, Self::Double | Self::Float);
        let is_integer = !is_float && !matches!(self, Self::Bool | Self::String | Self::Bytes);
        match field {
            Field::Values(_) => self != Self::String,
            Field::Names(_) => self == Self::String && is_element,
            Field::Episode { .. } => is_integer || self == Self::String,
            Field::Step | Field::StampSeconds | Field::StampNanos => is_integer,
            Field::Reward => is_integer || is_float,
            Field::EndFlag => is_integer || is_float || self == Self::Bool,
        }
    }

    /// Bytes of one value, if all have as many.
    pub(super) fn width(self) -> Option<usize> {
        match self {
            Self::Double | Self::Fixed64 | Self::Sfixed64 => Some(8),
            Self::Float | Self::Fixed32 | Self::Sfixed32 => Some(4),
            _ => None,
        }
    }

    /// May several values stand in one run of bytes?
    pub(super) fn is_packable(self) -> bool {
        !matches!(self, Self::String | Self::Bytes)
    }

    /// Reads the payload of one value.
    #[inline]
    pub(super) fn datum(self, payload: Payload<'_>) -> Result<Datum<'_>, DecodeError> {
        Ok(match (self, payload) {
            (Self::Double, Payload::Fixed64(b)) => Datum::Float(f64::from_le_bytes(b)),
            (Self::Fixed64, Payload::Fixed64(b)) => Datum::Unsigned(u64::from_le_bytes(b)),
            (Self::Sfixed64, Payload::Fixed64(b)) => Datum::Integer(i64::from_le_bytes(b)),
            (Self::Float, Payload::Fixed32(b)) => Datum::Float(f32::from_le_bytes(b).into()),
            (Self::Fixed32, Payload::Fixed32(b)) => Datum::Unsigned(u32::from_le_bytes(b).into()),
            (Self::Sfixed32, Payload::Fixed32(b)) => Datum::Integer(i32::from_le_bytes(b).into()),
            (Self::String, Payload::Bytes(b)) => {
                let text = std::str::from_utf8(b).ok();
                Datum::Text(text.ok_or_else(|| malformed("a text that is not UTF-8"))?)
            }
            (Self::Bytes, Payload::Bytes(b)) => Datum::Bytes(b),
            (_, Payload::Varint(bits)) => self.varint(bits).ok_or_else(wrong_wire_type)?,
            _ => return Err(wrong_wire_type()),
        })
    }

    fn varint(self, bits: u64) -> Option<Datum<'static>> {
        Some(match self {
            Self::Int32 | Self::Enum => Datum::Integer(low(bits).cast_signed().into()),
            Self::Int64 => Datum::Integer(bits.cast_signed()),
            Self::Uint32 => Datum::Unsigned(low(bits).into()),
            Self::Uint64 => Datum::Unsigned(bits),
            Self::Sint32 => {
                let bits = low(bits);
                let sign = (bits & 1).cast_signed();
                Datum::Integer(((bits >> 1).cast_signed() ^ -sign).into())
            }
            Self::Sint64 => {
                let sign = (bits & 1).cast_signed();
                Datum::Integer((bits >> 1).cast_signed() ^ -sign)
            }
            Self::Bool => Datum::Bool(bits != 0),
            _ => return None,
        })
    }

    /// Reads one value of a packed run.
    pub(super) fn packed<'a>(self, wire: &mut Wire<'a>) -> Result<Datum<'a>, DecodeError> {
        let bits = wire.varint()?;
        self.varint(bits).ok_or_else(wrong_wire_type)
    }

    /// Reads `bytes`, a run of values of equal width.
    pub(super) fn fixed(
        self,
        bytes: &[u8],
        mut take: impl FnMut(Datum<'_>) -> Result<(), DecodeError>,
    ) -> Result<(), DecodeError> {
        if self.width() == Some(8) {
            let (values, _) = bytes.as_chunks();
            values
                .iter()
                .try_for_each(|&b| take(self.datum(Payload::Fixed64(b))?))
        } else {
            let (values, _) = bytes.as_chunks();
            values
                .iter()
                .try_for_each(|&b| take(self.datum(Payload::Fixed32(b))?))
        }
    }
}

/// The lower half: what parsers take of a varint where 32 bits are wanted.
#[expect(
    clippy::cast_possible_truncation,
    reason = "it is what the format asks for"
)]
fn low(bits: u64) -> u32 {
    bits as u32
}

/// What a field holds that the message leaves out.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Default {
    Integer(i64),
    Unsigned(u64),
    Float(f64),
    Bool(bool),
    Text(String),
    Bytes(Vec<u8>),
}

impl Default {
    /// As declared (proto2), or zero, false, nothing.
    pub(super) fn of(field: &FieldDescriptor) -> Self {
        match field.default_value() {
            Reflected::Bool(v) => Self::Bool(v),
            Reflected::I32(v) | Reflected::EnumNumber(v) => Self::Integer(v.into()),
            Reflected::I64(v) => Self::Integer(v),
            Reflected::U32(v) => Self::Unsigned(v.into()),
            Reflected::U64(v) => Self::Unsigned(v),
            Reflected::F32(v) => Self::Float(v.into()),
            Reflected::F64(v) => Self::Float(v),
            Reflected::String(v) => Self::Text(v),
            Reflected::Bytes(v) => Self::Bytes(v.to_vec()),
            Reflected::Message(_) | Reflected::List(_) | Reflected::Map(_) => {
                Self::Bytes(Vec::new())
            }
        }
    }

    pub(super) fn datum(&self) -> Datum<'_> {
        match self {
            Self::Integer(v) => Datum::Integer(*v),
            Self::Unsigned(v) => Datum::Unsigned(*v),
            Self::Float(v) => Datum::Float(*v),
            Self::Bool(v) => Datum::Bool(*v),
            Self::Text(v) => Datum::Text(v),
            Self::Bytes(v) => Datum::Bytes(v),
        }
    }
}

impl Datum<'_> {
    /// Leaves the value in `row`.
    pub(super) fn put(self, field: Field, row: &mut Row) -> Result<(), DecodeError> {
        match self {
            Self::Integer(v) => row.integer(field, v),
            Self::Unsigned(v) => row.unsigned(field, v),
            // A NaN of a message must not pass for a value that is absent.
            Self::Float(v) => row.float(field, if v.is_nan() { f64::NAN } else { v }),
            Self::Bool(v) => row.boolean(field, v),
            Self::Text(v) => row.text(field, v),
            Self::Bytes(_) => Err(DecodeError::wrong_type("bytes", field, row)),
        }
    }
}

pub(super) fn wrong_wire_type() -> DecodeError {
    malformed("a field has another wire type than its schema says")
}
