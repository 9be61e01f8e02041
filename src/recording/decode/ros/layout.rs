//! How a message lies in its bytes: ROS 1, or one of the representations of CDR.

use super::super::DecodeError;

/// The rules that differ between representations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// No number is aligned to more.
    pub(super) max_align: usize,
    /// Texts end on a NUL.
    pub(super) is_terminated: bool,
    /// Before an array or a sequence of texts or structs stands its size in bytes; wide texts are UTF-16.
    pub(super) is_xcdr2: bool,
    /// Before a struct stands its size in bytes.
    pub(super) has_struct_sizes: bool,
    /// Most bytes that may be left behind the last field.
    pub(super) max_left: usize,
    encoding: &'static str,
}

/// ROS 1: fields without any padding.
pub(super) const ROS1: Layout = Layout {
    max_align: 1,
    is_terminated: false,
    is_xcdr2: false,
    has_struct_sizes: false,
    max_left: 0,
    encoding: "a ROS 1 message",
};

/// Plain CDR, version 1: what ROS 2 writes.
pub(super) const XCDR1: Layout = Layout {
    max_align: 8,
    is_terminated: true,
    is_xcdr2: false,
    has_struct_sizes: false,
    // Writers pad the payload to a multiple of 4 or 8. More is a sign of another schema.
    max_left: 7,
    encoding: "CDR",
};

/// Plain CDR, version 2.
pub(super) const XCDR2: Layout = Layout {
    max_align: 4,
    is_xcdr2: true,
    ..XCDR1
};

/// CDR, version 2, of types that may grow.
pub(super) const DELIMITED: Layout = Layout {
    has_struct_sizes: true,
    ..XCDR2
};

impl Layout {
    pub(super) fn malformed(&self, what: &str) -> DecodeError {
        DecodeError::Malformed {
            encoding: self.encoding,
            what: what.to_owned(),
        }
    }
}

/// What the four bytes before a CDR message say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Encapsulation {
    /// Which of [`XCDR1`], [`XCDR2`] and [`DELIMITED`].
    pub(super) variant: usize,
    pub(super) is_big_endian: bool,
}

/// The layouts of CDR, as [`Encapsulation::variant`] counts them.
pub(super) const CDR: [Layout; 3] = [XCDR1, XCDR2, DELIMITED];

impl Encapsulation {
    /// Takes the header off a message.
    pub(super) fn split(data: &[u8]) -> Result<(Self, &[u8]), DecodeError> {
        let Some(([high, low, _, _], body)) = data.split_first_chunk::<4>() else {
            return Err(XCDR1.malformed("it is shorter than its header"));
        };
        let variant = match (*high, *low) {
            (0, 0x00 | 0x01) => 0,
            (0, 0x06 | 0x07) => 1,
            (0, 0x08 | 0x09) => 2,
            (0, 0x02 | 0x03 | 0x0a | 0x0b) => {
                return Err(DecodeError::WrongType(
                    "CDR of parameter lists (PL_CDR) is not supported".to_owned(),
                ));
            }
            _ => return Err(XCDR1.malformed("its header names no representation that is known")),
        };
        let encapsulation = Self {
            variant,
            is_big_endian: low & 1 == 0,
        };
        Ok((encapsulation, body))
    }
}
