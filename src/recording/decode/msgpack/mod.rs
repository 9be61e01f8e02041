//! MessagePack: a `serde` deserializer over a slice, walked by the seeds of `tree.rs`.
//!
//! Our own rather than `rmp-serde`'s, which gives text that is not UTF-8 to the visitor as bytes: a leaf would take
//! them for numbers, in one message and not in the next. Tests hold it against `rmp-serde`.
//! Layouts: <https://github.com/msgpack/msgpack/blob/master/spec.md>.

mod head;
#[cfg(test)]
mod tests;

use serde::de::value::{BorrowedStrDeserializer, UnitDeserializer};
use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::forward_to_deserialize_any;

use self::head::{Head, Input};
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
    walk(data, seed, Unreadable::Refused).map_err(|e| e.into_decode_error("MessagePack"))
}

/// The whole message, with null for extension types and for text that is not UTF-8.
pub(super) fn value(data: &[u8]) -> Result<Value, DecodeError> {
    walk(data, ValueSeed, Unreadable::Null).map_err(|e| e.into_decode_error("MessagePack"))
}

fn walk<'de, S: DeserializeSeed<'de>>(
    data: &'de [u8],
    seed: S,
    unreadable: Unreadable,
) -> Result<S::Value, WalkError> {
    let mut input = Input::new(data);
    let value = seed.deserialize(Item {
        input: &mut input,
        depth: MAX_DEPTH,
        unreadable,
    })?;
    if input.is_empty() {
        Ok(value)
    } else {
        Err(WalkError::TRAILING)
    }
}

/// The value that comes next.
struct Item<'a, 'de> {
    input: &'a mut Input<'de>,
    /// How many levels may still be opened.
    depth: usize,
    unreadable: Unreadable,
}

impl<'de> Item<'_, 'de> {
    fn visit<V: Visitor<'de>>(self, head: Head<'de>, visitor: V) -> Result<V::Value, WalkError> {
        match head {
            Head::Nil => visitor.visit_unit(),
            Head::Bool(value) => visitor.visit_bool(value),
            Head::Unsigned(value) => visitor.visit_u64(value),
            Head::Signed(value) => visitor.visit_i64(value),
            Head::Float(value) => visitor.visit_f64(value),
            Head::Text(bytes) => match std::str::from_utf8(bytes) {
                Ok(text) => visitor.visit_borrowed_str(text),
                Err(_) => self.unreadable.or_null(WalkError::NOT_UTF8, visitor),
            },
            Head::Bytes(bytes) => visitor.visit_borrowed_bytes(bytes),
            Head::Array(len) => visitor.visit_seq(Members::new(self, len)?),
            Head::Map(len) => visitor.visit_map(Members::new(self, len)?),
            Head::Extension => {
                let refusal = WalkError::unsupported("an extension type");
                self.unreadable.or_null(refusal, visitor)
            }
        }
    }
}

impl<'de> Deserializer<'de> for Item<'_, 'de> {
    type Error = WalkError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        let head = self.input.head()?;
        self.visit(head, visitor)
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        match self.input.head()? {
            head @ Head::Text(_) => self.visit(head, visitor),
            _ => Err(WalkError::no_text(&visitor)),
        }
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
    input: &'a mut Input<'de>,
    left: u32,
    depth: usize,
    unreadable: Unreadable,
}

impl<'a, 'de> Members<'a, 'de> {
    fn new(item: Item<'a, 'de>, len: u32) -> Result<Self, WalkError> {
        let Item {
            input,
            depth,
            unreadable,
        } = item;
        Ok(Self {
            input,
            left: len,
            depth: depth.checked_sub(1).ok_or(WalkError::TOO_DEEP)?,
            unreadable,
        })
    }

    fn has_more(&mut self) -> bool {
        let has_more = self.left > 0;
        self.left = self.left.saturating_sub(1);
        has_more
    }

    fn item(&mut self) -> Item<'_, 'de> {
        Item {
            input: self.input,
            depth: self.depth,
            unreadable: self.unreadable,
        }
    }
}

impl<'de> SeqAccess<'de> for Members<'_, 'de> {
    type Error = WalkError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, WalkError> {
        if !self.has_more() {
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
        if !self.has_more() {
            return Ok(None);
        }
        match self.input.head()? {
            Head::Text(bytes) if let Ok(key) = std::str::from_utf8(bytes) => {
                seed.deserialize(BorrowedStrDeserializer::new(key))
            }
            other => {
                skip_members(self.input, &other, self.depth)?;
                seed.deserialize(UnitDeserializer::new())
            }
        }
        .map(Some)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, WalkError> {
        seed.deserialize(self.item())
    }
}

/// Skips a value that nobody wants.
fn skip(input: &mut Input, depth: usize) -> Result<(), WalkError> {
    let head = input.head()?;
    skip_members(input, &head, depth)
}

/// Skips what follows the head of a value.
fn skip_members(input: &mut Input, head: &Head, depth: usize) -> Result<(), WalkError> {
    let n_values = match head {
        Head::Array(len) => u64::from(*len),
        Head::Map(len) => 2 * u64::from(*len),
        _ => return Ok(()),
    };
    let depth = depth.checked_sub(1).ok_or(WalkError::TOO_DEEP)?;
    (0..n_values).try_for_each(|_| skip(input, depth))
}
