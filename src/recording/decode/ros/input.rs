//! The bytes of one message, read from the front with every length checked against what is left.

use super::super::DecodeError;
use super::layout::Layout;

/// Why the bytes are no message of the type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    Short,
    WideText,
}

impl Fault {
    pub(super) fn error(self, layout: &Layout) -> DecodeError {
        layout.malformed(match self {
            Self::Short => "it ends inside a field, or its schema is another",
            Self::WideText => "a wstring is not of the characters that its writer should use",
        })
    }
}

/// Bytes with a place in them; alignment counts from the first. `BIG` is their byte order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Input<'d, const BIG: bool> {
    bytes: &'d [u8],
    /// May be behind the end after padding; then nothing more can be taken.
    at: usize,
}

impl<'d, const BIG: bool> Input<'d, BIG> {
    pub(super) fn new(bytes: &'d [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Bytes that are left.
    pub(super) fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    pub(super) fn rest(&self) -> &'d [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// Where the next byte is; behind the end if padding would reach beyond it.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    /// The bytes from `start` to here.
    pub(super) fn since(&self, start: usize) -> &'d [u8] {
        self.bytes.get(start..self.at).unwrap_or_default()
    }

    /// Goes on at the next multiple of a power of two, given as it less one.
    #[inline]
    pub(super) fn align(&mut self, mask: usize) {
        // No slice is so long that this could overflow.
        self.at = (self.at + mask) & !mask;
    }

    #[inline]
    pub(super) fn take(&mut self, n: usize) -> Result<&'d [u8], Fault> {
        let rest = self.bytes.get(self.at..).ok_or(Fault::Short)?;
        let taken = rest.get(..n).ok_or(Fault::Short)?;
        self.at += n;
        Ok(taken)
    }

    #[inline]
    pub(super) fn skip(&mut self, n: usize) -> Result<(), Fault> {
        self.take(n).map(|_| ())
    }

    #[inline]
    pub(super) fn u32(&mut self) -> Result<u32, Fault> {
        let rest = self.bytes.get(self.at..).ok_or(Fault::Short)?;
        let bytes = rest.first_chunk::<4>().ok_or(Fault::Short)?;
        self.at += 4;
        Ok(if BIG {
            u32::from_be_bytes(*bytes)
        } else {
            u32::from_le_bytes(*bytes)
        })
    }

    /// A length or a count.
    #[inline]
    pub(super) fn len(&mut self) -> Result<usize, Fault> {
        usize::try_from(self.u32()?).or(Err(Fault::Short))
    }

    /// The next `n` bytes as an input of its own, whose alignment still counts from the first byte of this one.
    pub(super) fn split(&mut self, n: usize) -> Result<Self, Fault> {
        let start = self.at;
        self.skip(n)?;
        Ok(Self {
            bytes: &self.bytes[..self.at],
            at: start,
        })
    }

    /// The bytes of a text; the length must be next. ROS 2 counts and writes a NUL at the end.
    #[inline]
    pub(super) fn text(&mut self, is_terminated: bool) -> Result<&'d [u8], Fault> {
        let n = self.len()?;
        let bytes = self.take(n)?;
        Ok(match bytes.split_last() {
            Some((0, text)) if is_terminated => text,
            _ => bytes,
        })
    }

    /// The bytes of a wide text, its length next.
    ///
    /// Writers differ. In XCDR2 it is UTF-16 with its length in bytes (DDS-XTypes 1.3). In XCDR1, which no specification
    /// settles, Fast DDS and Cyclone on Linux write a count and four bytes a character; text of two-byte characters
    /// is refused where it can be told by units that are no character.
    pub(super) fn wide_text(&mut self, layout: &Layout) -> Result<&'d [u8], Fault> {
        let n = self.len()?;
        if layout.is_xcdr2 {
            return if n.is_multiple_of(2) {
                self.take(n)
            } else {
                Err(Fault::WideText)
            };
        }
        let bytes = self.take(n.checked_mul(4).ok_or(Fault::Short)?)?;
        let is_text = bytes
            .as_chunks::<4>()
            .0
            .iter()
            .all(|unit| char::from_u32(Self::order(*unit, u32::from_le_bytes)).is_some());
        if is_text {
            Ok(bytes)
        } else {
            Err(Fault::WideText)
        }
    }

    /// Makes a number of its bytes; `of` takes them in little-endian order.
    #[inline]
    pub(super) fn order<const N: usize, T>(mut bytes: [u8; N], of: impl Fn([u8; N]) -> T) -> T {
        if BIG {
            bytes.reverse();
        }
        of(bytes)
    }
}
