//! The head of a MessagePack value: its kind, and all of it that is no other value.

use crate::recording::decode::walk_error::WalkError;

/// What stands at the front of the input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Head<'de> {
    Nil,
    Bool(bool),
    Unsigned(u64),
    Signed(i64),
    Float(f64),
    /// Not known to be UTF-8.
    Text(&'de [u8]),
    Bytes(&'de [u8]),
    /// So many values follow.
    Array(u32),
    /// So many pairs of values follow.
    Map(u32),
    Extension,
}

/// Bytes that are consumed from the front.
#[derive(Debug)]
pub(super) struct Input<'de> {
    rest: &'de [u8],
}

impl<'de> Input<'de> {
    pub(super) fn new(data: &'de [u8]) -> Self {
        Self { rest: data }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Takes the head of the next value.
    pub(super) fn head(&mut self) -> Result<Head<'de>, WalkError> {
        let [marker] = self.array()?;
        Ok(match marker {
            0x00..=0x7f => Head::Unsigned(marker.into()),
            0x80..=0x8f => Head::Map(u32::from(marker & 0x0f)),
            0x90..=0x9f => Head::Array(u32::from(marker & 0x0f)),
            0xa0..=0xbf => Head::Text(self.bytes(u32::from(marker & 0x1f))?),
            0xc0 => Head::Nil,
            0xc1 => return Err(WalkError::Malformed("a byte that starts no value")),
            0xc2 | 0xc3 => Head::Bool(marker == 0xc3),
            0xc4..=0xc6 => {
                let len = self.len(marker - 0xc4)?;
                Head::Bytes(self.bytes(len)?)
            }
            0xc7..=0xc9 => {
                let len = self.len(marker - 0xc7)?;
                self.extension(len)?
            }
            0xca => Head::Float(f32::from_be_bytes(self.array()?).into()),
            0xcb => Head::Float(f64::from_be_bytes(self.array()?)),
            0xcc => Head::Unsigned(u8::from_be_bytes(self.array()?).into()),
            0xcd => Head::Unsigned(u16::from_be_bytes(self.array()?).into()),
            0xce => Head::Unsigned(u32::from_be_bytes(self.array()?).into()),
            0xcf => Head::Unsigned(u64::from_be_bytes(self.array()?)),
            0xd0 => Head::Signed(i8::from_be_bytes(self.array()?).into()),
            0xd1 => Head::Signed(i16::from_be_bytes(self.array()?).into()),
            0xd2 => Head::Signed(i32::from_be_bytes(self.array()?).into()),
            0xd3 => Head::Signed(i64::from_be_bytes(self.array()?)),
            0xd4..=0xd8 => self.extension(1 << (marker - 0xd4))?,
            0xd9..=0xdb => {
                let len = self.len(marker - 0xd9)?;
                Head::Text(self.bytes(len)?)
            }
            0xdc | 0xdd => Head::Array(self.len(marker - 0xdb)?),
            0xde | 0xdf => Head::Map(self.len(marker - 0xdd)?),
            0xe0..=0xff => Head::Signed(marker.cast_signed().into()),
        })
    }

    /// A length of 1, 2 or 4 bytes: two to the power of `size`.
    fn len(&mut self, size: u8) -> Result<u32, WalkError> {
        Ok(match size {
            0 => u8::from_be_bytes(self.array()?).into(),
            1 => u16::from_be_bytes(self.array()?).into(),
            _ => u32::from_be_bytes(self.array()?),
        })
    }

    fn extension(&mut self, len: u32) -> Result<Head<'de>, WalkError> {
        let [_kind] = self.array()?;
        self.bytes(len)?;
        Ok(Head::Extension)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], WalkError> {
        let (head, rest) = self.rest.split_first_chunk().ok_or(WalkError::SHORT)?;
        self.rest = rest;
        Ok(*head)
    }

    fn bytes(&mut self, len: u32) -> Result<&'de [u8], WalkError> {
        let len = usize::try_from(len).ok().ok_or(WalkError::SHORT)?;
        let (head, rest) = self.rest.split_at_checked(len).ok_or(WalkError::SHORT)?;
        self.rest = rest;
        Ok(head)
    }
}
