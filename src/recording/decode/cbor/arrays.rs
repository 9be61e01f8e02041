//! Numbers inside byte strings: typed arrays, arrays with dimensions (both RFC 8746) and integers of any size.

use std::borrow::Cow;

use half::f16;
use minicbor::data::Type;
use minicbor::decode::Decoder;
use serde::Deserializer;
use serde::de::{DeserializeSeed, IntoDeserializer, SeqAccess, Visitor};

use super::{Item, WRONG_DIMENSIONS, has_more, malformed, whole_bytes};
use crate::recording::decode::walk_error::WalkError;

/// The numbers of a typed array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Element {
    kind: Kind,
    /// Bytes of a number.
    size: usize,
    is_little_endian: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Unsigned,
    Signed,
    Float,
}

enum Number {
    Unsigned(u64),
    Signed(i64),
    Float(f64),
}

impl Element {
    /// A tag of a typed array has it all in its bits, `010fsell`: a float or not, signed or not, little endian or
    /// not, and the length. Floats of 128 bits are refused before.
    pub(super) fn of_tag(tag: u64) -> Self {
        let bit = |n: u32| tag & (1 << n) != 0;
        let kind = match (bit(4), bit(3)) {
            (true, _) => Kind::Float,
            (false, true) => Kind::Signed,
            (false, false) => Kind::Unsigned,
        };
        let size = match (tag & 3, kind) {
            (length, Kind::Float) => 2usize << length,
            (length, _) => 1 << length,
        };
        Self {
            kind,
            size: size.min(8),
            is_little_endian: bit(2),
        }
    }

    /// The number whose bytes these are, `size` of them.
    fn read(self, bytes: &[u8]) -> Number {
        let mut big_endian = [0; 8];
        let unused = 8 - self.size;
        for (to, from) in big_endian[unused..].iter_mut().zip(bytes) {
            *to = *from;
        }
        if self.is_little_endian {
            big_endian[unused..].reverse();
        }
        let bits = u64::from_be_bytes(big_endian);
        let unused_bits = 8 * unused;
        match (self.kind, bits, self.size) {
            (Kind::Unsigned, ..) => Number::Unsigned(bits),
            (Kind::Signed, ..) => {
                Number::Signed((bits << unused_bits).cast_signed() >> unused_bits)
            }
            #[expect(
                clippy::cast_possible_truncation,
                reason = "no more bits than the size says"
            )]
            (Kind::Float, bits, 2) => Number::Float(f16::from_bits(bits as u16).to_f64()),
            #[expect(
                clippy::cast_possible_truncation,
                reason = "no more bits than the size says"
            )]
            (Kind::Float, bits, 4) => Number::Float(f32::from_bits(bits as u32).into()),
            (Kind::Float, ..) => Number::Float(f64::from_bits(bits)),
        }
    }
}

impl<'de> Item<'_, 'de> {
    pub(super) fn typed_array<V: Visitor<'de>>(
        mut self,
        element: Element,
        visitor: V,
    ) -> Result<V::Value, WalkError> {
        let bytes = self.tagged_bytes()?;
        if bytes.len() % element.size != 0 {
            return Err(WalkError::Malformed(
                "a typed array that ends inside a number",
            ));
        }
        let n_found = (bytes.len() / element.size) as u64;
        if self.n_elements.is_some_and(|wanted| wanted != n_found) {
            return Err(WRONG_DIMENSIONS);
        }
        visitor.visit_seq(Numbers {
            rest: &bytes,
            element,
        })
    }

    /// An array of two items: the dimensions, and an array or a typed array with as many elements.
    pub(super) fn row_major<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, WalkError> {
        let Self {
            input, unreadable, ..
        } = self;
        let depth = self.depth.checked_sub(1).ok_or(WalkError::TOO_DEEP)?;
        let mut left = open_array(input)?;
        if self.n_elements.is_some() || left.is_some_and(|n| n != 2) {
            return Err(NO_DIMENSIONS);
        }
        has_more(input, &mut left)?;
        let n_elements = take_dimensions(input)?;
        if !has_more(input, &mut left)? {
            return Err(NO_DIMENSIONS);
        }
        let value = Item {
            input: &mut *input,
            depth,
            unreadable,
            n_elements: Some(n_elements),
        }
        .deserialize_any(visitor)?;
        if has_more(input, &mut left)? {
            return Err(NO_DIMENSIONS);
        }
        Ok(value)
    }

    /// A byte string of any size as an integer, or the nearest float where it is beyond i128.
    pub(super) fn big_number<V: Visitor<'de>>(
        mut self,
        is_negative: bool,
        visitor: V,
    ) -> Result<V::Value, WalkError> {
        let bytes = self.tagged_bytes()?;
        let n_zeros = bytes.iter().take_while(|&&b| b == 0).count();
        let mut big_endian = [0; 16];
        let Some(unused) = big_endian.len().checked_sub(bytes.len() - n_zeros) else {
            let refusal = WalkError::unsupported("an integer beyond 128 bits");
            return self.unreadable.or_null(refusal, visitor);
        };
        big_endian[unused..].copy_from_slice(&bytes[n_zeros..]);
        let magnitude = u128::from_be_bytes(big_endian);
        match (i128::try_from(magnitude), is_negative) {
            // The bytes of a negative number say how far it is below -1.
            (Ok(n), true) => visitor.visit_i128(-1 - n),
            (Ok(n), false) => visitor.visit_i128(n),
            (Err(_), true) => visitor.visit_f64(-1.0 - magnitude as f64),
            (Err(_), false) => visitor.visit_f64(magnitude as f64),
        }
    }

    fn tagged_bytes(&mut self) -> Result<Cow<'de, [u8]>, WalkError> {
        match self.input.datatype().map_err(malformed)? {
            Type::Bytes | Type::BytesIndef => whole_bytes(self.input),
            _ => Err(WalkError::Malformed(
                "a tag of byte strings before another value",
            )),
        }
    }
}

const NO_DIMENSIONS: WalkError =
    WalkError::Malformed("a tag of arrays with dimensions before another value");

fn open_array(input: &mut Decoder) -> Result<Option<u64>, WalkError> {
    match input.datatype().map_err(malformed)? {
        Type::Array | Type::ArrayIndef => input.array().map_err(malformed),
        _ => Err(NO_DIMENSIONS),
    }
}

/// Reads an array of dimensions; the number of elements that they make.
fn take_dimensions(input: &mut Decoder) -> Result<u64, WalkError> {
    let mut left = open_array(input)?;
    let mut n_elements = 1u64;
    while has_more(input, &mut left)? {
        let dimension = match input.datatype().map_err(malformed)? {
            Type::U8 | Type::U16 | Type::U32 | Type::U64 => input.u64().map_err(malformed)?,
            _ => return Err(NO_DIMENSIONS),
        };
        n_elements = n_elements.checked_mul(dimension).ok_or(WRONG_DIMENSIONS)?;
    }
    Ok(n_elements)
}

/// The rest of a typed array.
struct Numbers<'b> {
    rest: &'b [u8],
    element: Element,
}

impl<'de> SeqAccess<'de> for Numbers<'_> {
    type Error = WalkError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, WalkError> {
        let Some((bytes, rest)) = self.rest.split_at_checked(self.element.size) else {
            return Ok(None);
        };
        self.rest = rest;
        match self.element.read(bytes) {
            Number::Unsigned(n) => seed.deserialize(n.into_deserializer()),
            Number::Signed(n) => seed.deserialize(n.into_deserializer()),
            Number::Float(n) => seed.deserialize(n.into_deserializer()),
        }
        .map(Some)
    }
}
