//! CBOR (RFC 8949): `minicbor` reads the heads of items, the seeds of `tree.rs` walk them.
//!
//! Typed arrays (RFC 8746) are arrays of numbers, multi-dimensional ones their elements in row-major order, one after
//! the other. Other tags are skipped, unless what they mark is not what it seems to be: see `tags.rs`.

mod arrays;
mod skip;
mod tags;
#[cfg(test)]
mod tests;

use std::borrow::Cow;

use minicbor::data::Type;
use minicbor::decode::{Decoder, Error as CborError};
use serde::de::value::UnitDeserializer;
use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::forward_to_deserialize_any;

use self::skip::skip;
use self::tags::{Meaning, peel};
use super::DecodeError;
use super::plan::Node;
use super::row::Row;
use super::tree::{NodeSeed, ValueSeed};
use super::value::Value;
use super::walk_error::{Unreadable, WalkError};
use crate::recording::MAX_DEPTH;

/// Walks `data` and leaves the wanted fields in `row`.
pub(super) fn decode(node: &Node, data: &[u8], row: &mut Row) -> Result<(), DecodeError> {
    let seed = NodeSeed {
        node,
        row,
        in_array: false,
    };
    walk(data, seed, Unreadable::Refused).map_err(|e| e.into_decode_error("CBOR"))
}

/// The whole message. What no field can be taken from, a decimal fraction say, is null.
pub(super) fn value(data: &[u8]) -> Result<Value, DecodeError> {
    walk(data, ValueSeed, Unreadable::Null).map_err(|e| e.into_decode_error("CBOR"))
}

fn walk<'de, S: DeserializeSeed<'de>>(
    data: &'de [u8],
    seed: S,
    unreadable: Unreadable,
) -> Result<S::Value, WalkError> {
    let mut input = Decoder::new(data);
    let value = seed.deserialize(Item {
        input: &mut input,
        depth: MAX_DEPTH,
        unreadable,
        n_elements: None,
    })?;
    if input.position() < data.len() {
        return Err(WalkError::TRAILING);
    }
    Ok(value)
}

/// The item that comes next.
struct Item<'a, 'de> {
    input: &'a mut Decoder<'de>,
    /// How many levels may still be opened.
    depth: usize,
    unreadable: Unreadable,
    /// It must be an array of that many elements: the dimensions before it say so.
    n_elements: Option<u64>,
}

impl<'de> Item<'_, 'de> {
    /// An item whose tags are read.
    fn plain<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        let kind = self.input.datatype().map_err(malformed)?;
        if self.n_elements.is_some() && !matches!(kind, Type::Array | Type::ArrayIndef) {
            return Err(WRONG_DIMENSIONS);
        }
        let input = self.input;
        match kind {
            Type::Bool => visitor.visit_bool(input.bool().map_err(malformed)?),
            Type::U8 | Type::U16 | Type::U32 | Type::U64 => {
                visitor.visit_u64(input.u64().map_err(malformed)?)
            }
            Type::I8 | Type::I16 | Type::I32 | Type::I64 => {
                visitor.visit_i64(input.i64().map_err(malformed)?)
            }
            Type::Int => visitor.visit_i128(input.int().map_err(malformed)?.into()),
            Type::F16 => visitor.visit_f64(input.f16().map_err(malformed)?.into()),
            Type::F32 => visitor.visit_f64(input.f32().map_err(malformed)?.into()),
            Type::F64 => visitor.visit_f64(input.f64().map_err(malformed)?),
            Type::Bytes | Type::BytesIndef => match whole_bytes(input)? {
                Cow::Borrowed(bytes) => visitor.visit_borrowed_bytes(bytes),
                Cow::Owned(bytes) => visitor.visit_bytes(&bytes),
            },
            Type::String => visitor.visit_borrowed_str(input.str().map_err(malformed)?),
            Type::StringIndef => visitor.visit_str(&whole_text(input)?),
            Type::Null | Type::Undefined => {
                input.set_position(input.position() + 1);
                visitor.visit_unit()
            }
            Type::Array | Type::ArrayIndef => {
                let left = input.array().map_err(malformed)?;
                if let Some(n_elements) = self.n_elements
                    && left != Some(n_elements)
                {
                    return Err(WRONG_DIMENSIONS);
                }
                visitor.visit_seq(Members::new(input, left, self.depth, self.unreadable)?)
            }
            Type::Map | Type::MapIndef => {
                let left = input.map().map_err(malformed)?;
                visitor.visit_map(Members::new(input, left, self.depth, self.unreadable)?)
            }
            Type::Simple => {
                input.simple().map_err(malformed)?;
                self.unreadable
                    .or_null(WalkError::unsupported("a simple value"), visitor)
            }
            Type::Tag | Type::Break | Type::Unknown(_) => Err(NO_VALUE),
        }
    }
}

impl<'de> Deserializer<'de> for Item<'_, 'de> {
    type Error = WalkError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        match peel(self.input)? {
            Meaning::Plain => self.plain(visitor),
            Meaning::BigNumber { is_negative } => self.big_number(is_negative, visitor),
            Meaning::TypedArray(element) => self.typed_array(element, visitor),
            Meaning::RowMajor => self.row_major(visitor),
            Meaning::Unreadable(what) => {
                skip(self.input, self.depth)?;
                self.unreadable
                    .or_null(WalkError::unsupported(what), visitor)
            }
        }
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        let is_plain = peel(self.input)? == Meaning::Plain;
        if !(is_plain && is_text(self.input)?) {
            return Err(WalkError::no_text(&visitor));
        }
        self.plain(visitor)
    }

    fn deserialize_ignored_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        skip(self.input, self.depth)?;
        visitor.visit_unit()
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map struct enum identifier
    }
}

/// What an array or a map holds.
struct Members<'a, 'de> {
    input: &'a mut Decoder<'de>,
    /// None until a break comes.
    left: Option<u64>,
    depth: usize,
    unreadable: Unreadable,
}

impl<'a, 'de> Members<'a, 'de> {
    fn new(
        input: &'a mut Decoder<'de>,
        left: Option<u64>,
        depth: usize,
        unreadable: Unreadable,
    ) -> Result<Self, WalkError> {
        Ok(Self {
            input,
            left,
            depth: depth.checked_sub(1).ok_or(WalkError::TOO_DEEP)?,
            unreadable,
        })
    }

    fn item(&mut self) -> Item<'_, 'de> {
        Item {
            input: self.input,
            depth: self.depth,
            unreadable: self.unreadable,
            n_elements: None,
        }
    }
}

impl<'de> SeqAccess<'de> for Members<'_, 'de> {
    type Error = WalkError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, WalkError> {
        if !has_more(self.input, &mut self.left)? {
            return Ok(None);
        }
        seed.deserialize(self.item()).map(Some)
    }
}

impl<'de> MapAccess<'de> for Members<'_, 'de> {
    type Error = WalkError;

    fn next_key_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, WalkError> {
        if !has_more(self.input, &mut self.left)? {
            return Ok(None);
        }
        match peel(self.input)? {
            Meaning::Plain if is_text(self.input)? => seed.deserialize(self.item()).map(Some),
            // A reference to an earlier text may well be the wanted key.
            Meaning::Unreadable(what) if self.unreadable == Unreadable::Refused => {
                Err(WalkError::unsupported(what))
            }
            _ => {
                skip(self.input, self.depth)?;
                seed.deserialize(UnitDeserializer::new()).map(Some)
            }
        }
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, WalkError> {
        seed.deserialize(self.item())
    }
}

const NO_VALUE: WalkError = WalkError::Malformed("a byte that starts no value");
const WRONG_DIMENSIONS: WalkError =
    WalkError::Malformed("the dimensions of an array are not those of its elements");

/// Does another member come? Takes the break of an indefinite length.
fn has_more(input: &mut Decoder, left: &mut Option<u64>) -> Result<bool, WalkError> {
    if let Some(left) = left {
        let has_more = *left > 0;
        *left = left.saturating_sub(1);
        return Ok(has_more);
    }
    let is_break = input.datatype().map_err(malformed)? == Type::Break;
    if is_break {
        input.set_position(input.position() + 1);
    }
    Ok(!is_break)
}

fn is_text(input: &Decoder) -> Result<bool, WalkError> {
    let kind = input.datatype().map_err(malformed)?;
    Ok(matches!(kind, Type::String | Type::StringIndef))
}

/// A byte string; one in pieces is put together.
fn whole_bytes<'de>(input: &mut Decoder<'de>) -> Result<Cow<'de, [u8]>, WalkError> {
    if input.datatype().map_err(malformed)? == Type::Bytes {
        return input.bytes().map(Cow::Borrowed).map_err(malformed);
    }
    let mut whole = Vec::new();
    for piece in input.bytes_iter().map_err(malformed)? {
        whole.extend_from_slice(piece.map_err(malformed)?);
    }
    Ok(Cow::Owned(whole))
}

fn whole_text(input: &mut Decoder) -> Result<String, WalkError> {
    let mut whole = String::new();
    for piece in input.str_iter().map_err(malformed)? {
        whole.push_str(piece.map_err(malformed)?);
    }
    Ok(whole)
}

/// `minicbor`'s reason without the place in the message.
#[expect(
    clippy::needless_pass_by_value,
    reason = "it is the argument of many a `map_err`"
)]
fn malformed(e: CborError) -> WalkError {
    if e.is_end_of_input() {
        WalkError::SHORT
    } else if e.is_type_mismatch() {
        NO_VALUE
    } else {
        // The types are looked at before they are read, so that nothing else can be wrong.
        WalkError::NOT_UTF8
    }
}
