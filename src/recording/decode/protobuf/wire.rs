//! The wire format: tags, varints, lengths. Every length is checked against what is left.
//!
//! <https://protobuf.dev/programming-guides/encoding/>

use super::{DecodeError, malformed};
use crate::recording::MAX_DEPTH;

/// What stands behind a tag.
#[derive(Debug, Clone, Copy)]
pub(super) enum Payload<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    Fixed32([u8; 4]),
    /// Text, bytes, a message, or packed numbers.
    Bytes(&'a [u8]),
    /// A group, skipped.
    Group,
}

/// The fields of one message, consumed from the front.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wire<'a> {
    rest: &'a [u8],
}

impl<'a> Wire<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// The next field: its number and what it holds.
    pub(super) fn field(&mut self) -> Result<Option<(u32, Payload<'a>)>, DecodeError> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let (number, wire_type) = self.tag()?;
        let payload = self.payload(number, wire_type, MAX_DEPTH)?;
        Ok(Some((number, payload)))
    }

    fn tag(&mut self) -> Result<(u32, u8), DecodeError> {
        let tag = u32::try_from(self.varint()?)
            .ok()
            .filter(|tag| tag >> 3 != 0)
            .ok_or_else(|| malformed("a tag that is none"))?;
        Ok((tag >> 3, tag.to_le_bytes()[0] & 7))
    }

    #[inline]
    fn payload(
        &mut self,
        number: u32,
        wire_type: u8,
        depth: usize,
    ) -> Result<Payload<'a>, DecodeError> {
        Ok(match wire_type {
            0 => Payload::Varint(self.varint()?),
            1 => Payload::Fixed64(self.array()?),
            2 => {
                let len = self.varint()?;
                Payload::Bytes(self.bytes(len)?)
            }
            3 => {
                self.skip_group(number, depth)?;
                Payload::Group
            }
            4 => return Err(malformed("the end of a group that did not begin")),
            5 => Payload::Fixed32(self.array()?),
            _ => return Err(malformed("an unknown wire type")),
        })
    }

    /// Groups are a thing of old: no field in them is wanted.
    fn skip_group(&mut self, group: u32, depth: usize) -> Result<(), DecodeError> {
        let depth = depth
            .checked_sub(1)
            .ok_or_else(|| malformed("it is nested too deep"))?;
        loop {
            let (number, wire_type) = self.tag()?;
            if wire_type == 4 {
                return if number == group {
                    Ok(())
                } else {
                    Err(malformed("the end of another group"))
                };
            }
            self.payload(number, wire_type, depth)?;
        }
    }

    #[inline]
    pub(super) fn varint(&mut self) -> Result<u64, DecodeError> {
        if let Some((&first, rest)) = self.rest.split_first()
            && first < 0x80
        {
            self.rest = rest;
            return Ok(u64::from(first));
        }
        self.long_varint()
    }

    fn long_varint(&mut self) -> Result<u64, DecodeError> {
        let mut value = 0u64;
        for (i, &byte) in self.rest.iter().take(10).enumerate() {
            // Of the tenth byte there is room for one bit.
            if i == 9 && byte > 1 {
                break;
            }
            value |= u64::from(byte & 0x7f) << (7 * i);
            if byte < 0x80 {
                self.rest = &self.rest[i + 1..];
                return Ok(value);
            }
        }
        Err(if self.rest.len() < 10 {
            cut()
        } else {
            malformed("a varint of more than 64 bits")
        })
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let (head, rest) = self.rest.split_first_chunk::<N>().ok_or_else(cut)?;
        self.rest = rest;
        Ok(*head)
    }

    fn bytes(&mut self, len: u64) -> Result<&'a [u8], DecodeError> {
        let (head, rest) = usize::try_from(len)
            .ok()
            .and_then(|len| self.rest.split_at_checked(len))
            .ok_or_else(cut)?;
        self.rest = rest;
        Ok(head)
    }
}

fn cut() -> DecodeError {
    malformed("it ends in the middle of a field")
}
