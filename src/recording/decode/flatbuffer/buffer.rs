//! Reads a FlatBuffer with every offset held against the bytes that are there.
//! Layout: <https://flatbuffers.dev/internals>.

use crate::recording::decode::DecodeError;

/// The bytes of a message or of a binary schema.
#[derive(Debug, Clone, Copy)]
pub(super) struct Buffer<'b>(pub(super) &'b [u8]);

/// A table: its fields lie where its own list of offsets says.
#[derive(Debug, Clone, Copy)]
pub(super) struct Table<'b> {
    buffer: Buffer<'b>,
    at: usize,
    /// Where the list of offsets is, and its bytes.
    vtable: usize,
    vtable_len: usize,
}

/// Where the elements of a vector begin, and how many there are. Their bytes are there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Elements {
    pub(super) at: usize,
    pub(super) n: usize,
}

/// What a walk may still do. Offsets may lead to the same place as often as they like, so that a small message could
/// keep us busy, and fill the memory, for as long as it likes; one that is written by a FlatBuffers library needs no more
/// than its bytes.
#[derive(Debug)]
pub(super) struct Budget {
    left: usize,
}

impl Budget {
    pub(super) fn of(data: &[u8]) -> Self {
        Self {
            left: data.len().saturating_mul(4).saturating_add(1 << 16),
        }
    }

    /// Takes `n` elements or bytes of text from it.
    pub(super) fn charge(&mut self, n: usize) -> Result<(), DecodeError> {
        self.left = self
            .left
            .checked_sub(n)
            .ok_or_else(|| malformed("its offsets lead to the same places again and again"))?;
        Ok(())
    }
}

pub(super) fn malformed(what: &str) -> DecodeError {
    DecodeError::Malformed {
        encoding: "FlatBuffers",
        what: what.to_owned(),
    }
}

impl<'b> Buffer<'b> {
    pub(super) fn root(self) -> Result<Table<'b>, DecodeError> {
        self.table(0)
    }

    pub(super) fn array<const N: usize>(self, at: usize) -> Result<[u8; N], DecodeError> {
        self.0
            .get(at..)
            .and_then(|rest| rest.first_chunk())
            .copied()
            .ok_or_else(|| malformed("an offset leads out of the message"))
    }

    pub(super) fn bytes(self, at: usize, len: usize) -> Result<&'b [u8], DecodeError> {
        at.checked_add(len)
            .and_then(|end| self.0.get(at..end))
            .ok_or_else(|| malformed("an offset leads out of the message"))
    }

    fn u16(self, at: usize) -> Result<usize, DecodeError> {
        self.array(at).map(u16::from_le_bytes).map(usize::from)
    }

    fn u32(self, at: usize) -> Result<usize, DecodeError> {
        usize::try_from(self.array(at).map(u32::from_le_bytes)?)
            .ok()
            .ok_or_else(|| malformed("an offset leads out of the message"))
    }

    /// Where the offset at `at` leads.
    fn follow(self, at: usize) -> Result<usize, DecodeError> {
        at.checked_add(self.u32(at)?)
            .filter(|&to| to < self.0.len())
            .ok_or_else(|| malformed("an offset leads out of the message"))
    }

    /// The table that the offset at `at` leads to.
    pub(super) fn table(self, at: usize) -> Result<Table<'b>, DecodeError> {
        let at = self.follow(at)?;
        let back = i64::from(self.array(at).map(i32::from_le_bytes)?);
        let vtable = i64::try_from(at)
            .ok()
            .and_then(|at| usize::try_from(at - back).ok())
            .ok_or_else(|| malformed("an offset leads out of the message"))?;
        Ok(Table {
            buffer: self,
            at,
            vtable,
            vtable_len: self.u16(vtable)?,
        })
    }

    /// The vector of elements of `size` bytes that the offset at `at` leads to.
    pub(super) fn elements(self, at: usize, size: usize) -> Result<Elements, DecodeError> {
        let vector = self.follow(at)?;
        let n = self.u32(vector)?;
        let elements = Elements { at: vector + 4, n };
        let len = n
            .checked_mul(size)
            .ok_or_else(|| malformed("a vector is longer than the message"))?;
        self.bytes(elements.at, len)
            .ok()
            .ok_or_else(|| malformed("a vector is longer than the message"))?;
        Ok(elements)
    }

    /// The text that the offset at `at` leads to.
    pub(super) fn text(self, at: usize) -> Result<&'b str, DecodeError> {
        let Elements { at, n } = self.elements(at, 1)?;
        std::str::from_utf8(self.bytes(at, n)?)
            .ok()
            .ok_or_else(|| malformed("a text is not UTF-8"))
    }
}

impl<'b> Table<'b> {
    pub(super) fn buffer(&self) -> Buffer<'b> {
        self.buffer
    }

    /// Where a field lies, if it is set. `slot` is its place in the list of offsets, bytes.
    pub(super) fn field(&self, slot: u16) -> Result<Option<usize>, DecodeError> {
        let slot = usize::from(slot);
        if slot < 4 || slot + 2 > self.vtable_len {
            return Ok(None);
        }
        let offset = self.buffer.u16(self.vtable + slot)?;
        Ok((offset != 0).then_some(self.at + offset))
    }
}
