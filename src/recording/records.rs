//! The outer record loop: one opcode, one length, one body after the other, each at a known offset.
//!
//! Nothing here believes the summary or the index. A length is held against what is left of the file and against the
//! limit before anything is allocated, and a body that is not wanted is passed over without being kept.

use std::io::{self, Read};

use super::limits::Limits;

/// Opcodes of the MCAP format that the reader acts on.
pub(crate) mod op {
    pub(crate) use mcap::records::op::*;
}

/// The bytes at both ends of a file.
pub(crate) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Bytes of opcode and length in front of each body.
const HEAD: usize = 9;

/// Memory a body is read in steps of, so that a length that lies costs no more than the file holds.
const READ_STEP: u64 = 4 << 20;

/// What comes next in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Next {
    /// A whole record; its body is in the caller's buffer if its opcode was wanted.
    Record { opcode: u8, offset: u64 },
    /// The file ends inside this record; what there is of the body is in the buffer if its opcode was wanted.
    Cut {
        opcode: u8,
        offset: u64,
        declared: u64,
        available: u64,
    },
    /// Wanted, but larger than the limit; passed over.
    TooLarge {
        opcode: u8,
        offset: u64,
        declared: u64,
    },
    /// The closing magic, and as many bytes after it.
    ClosingMagic { junk: u64 },
    /// The file ends between two records, without the closing magic; `tail` bytes are no record.
    End { offset: u64, tail: u64 },
    /// What stands here is no record: no record has opcode 0, and where the next begins is not known.
    NoRecord { offset: u64 },
}

/// Reads records from the front of a stream to its end.
pub(crate) struct RecordSource<R> {
    reader: R,
    offset: u64,
    /// Bytes of the file at opening; unknown for a compressed file.
    len: Option<u64>,
    max_record: u64,
    /// Why the stream ended where it did, if reading failed there.
    error: Option<io::Error>,
    crc: crc32fast::Hasher,
    crc_before_last: crc32fast::Hasher,
}

impl<R: Read> RecordSource<R> {
    /// `reader` stands just behind the opening magic.
    pub(crate) fn new(reader: R, len: Option<u64>, limits: &Limits) -> Self {
        let mut crc = crc32fast::Hasher::new();
        crc.update(MAGIC);
        let crc_before_last = crc.clone();
        Self {
            reader,
            offset: MAGIC.len() as u64,
            len,
            max_record: limits.max_record,
            error: None,
            crc,
            crc_before_last,
        }
    }

    /// Reads on from `reader`, which stands where this one ended; the file is `len` bytes now.
    pub(crate) fn go_on(&mut self, reader: R, len: u64) {
        self.reader = reader;
        self.len = Some(len);
    }

    /// CRC-32 of all bytes in front of the record that came last: what a `DataEnd` record holds.
    pub(crate) fn crc_before_last(&self) -> u32 {
        self.crc_before_last.clone().finalize()
    }

    /// Bytes from the beginning of the file.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    /// The error that ended the stream, if one did: to its reader a file that cannot be read on is a file that is cut.
    pub(crate) fn take_error(&mut self) -> Option<io::Error> {
        self.error.take()
    }

    /// Reads on by one record. The body lands in `body` if `wanted(opcode)`, else it is passed over.
    pub(crate) fn next(&mut self, wanted: impl Fn(u8) -> bool, body: &mut Vec<u8>) -> Next {
        body.clear();
        self.crc_before_last = self.crc.clone();
        let offset = self.offset;
        let mut head = [0; HEAD];
        let got = self.fill(&mut head);
        if got >= MAGIC.len() && head[..MAGIC.len()] == *MAGIC {
            let junk = (got - MAGIC.len()) as u64 + self.skip(u64::MAX);
            return Next::ClosingMagic { junk };
        }
        if got < HEAD {
            return Next::End {
                offset,
                tail: got as u64,
            };
        }
        let opcode = head[0];
        if opcode == 0 {
            self.skip(u64::MAX);
            return Next::NoRecord { offset };
        }
        let [_, length @ ..] = head;
        let declared = u64::from_le_bytes(length);
        if let Some(available) = self.left().filter(|&left| declared > left) {
            return self.cut(opcode, offset, declared, available, wanted(opcode), body);
        }
        let is_wanted = wanted(opcode);
        let is_large = declared > self.max_record;
        let available = if is_wanted && !is_large {
            self.read_body(declared, body)
        } else {
            self.skip(declared)
        };
        if available < declared {
            Next::Cut {
                opcode,
                offset,
                declared,
                available,
            }
        } else if is_wanted && is_large {
            Next::TooLarge {
                opcode,
                offset,
                declared,
            }
        } else {
            Next::Record { opcode, offset }
        }
    }

    /// The record that the end of the file falls into.
    fn cut(
        &mut self,
        opcode: u8,
        offset: u64,
        declared: u64,
        available: u64,
        wanted: bool,
        body: &mut Vec<u8>,
    ) -> Next {
        if wanted && available <= self.max_record {
            self.read_body(available, body);
        } else {
            self.skip(available);
        }
        Next::Cut {
            opcode,
            offset,
            declared,
            available,
        }
    }

    fn left(&self) -> Option<u64> {
        self.len.map(|len| len.saturating_sub(self.offset))
    }

    /// Reads until `buffer` is full or the stream ends; how many bytes came.
    fn fill(&mut self, buffer: &mut [u8]) -> usize {
        let limit = self.left().map_or(buffer.len(), |left| {
            usize::try_from(left).map_or(buffer.len(), |left| left.min(buffer.len()))
        });
        let mut got = 0;
        while got < limit && self.error.is_none() {
            match self.reader.read(&mut buffer[got..limit]) {
                Ok(0) => break,
                Ok(n) => got += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => self.error = Some(e),
            }
        }
        self.crc.update(&buffer[..got]);
        self.offset += got as u64;
        got
    }

    /// Reads up to `len` bytes into `body`, which grows only as bytes really come.
    fn read_body(&mut self, len: u64, body: &mut Vec<u8>) -> u64 {
        let mut missing = len;
        while missing > 0 {
            let step = usize::try_from(missing.min(READ_STEP)).unwrap_or(usize::MAX);
            let start = body.len();
            body.resize(start + step, 0);
            let got = self.fill(&mut body[start..]);
            body.truncate(start + got);
            missing -= got as u64;
            if got < step {
                break;
            }
        }
        len - missing
    }

    /// Passes over up to `len` bytes; how many there were.
    fn skip(&mut self, len: u64) -> u64 {
        let mut buffer = [0; 16 << 10];
        let mut skipped = 0;
        while skipped < len {
            let step =
                usize::try_from((len - skipped).min(buffer.len() as u64)).unwrap_or(buffer.len());
            let got = self.fill(&mut buffer[..step]);
            skipped += got as u64;
            if got < step {
                break;
            }
        }
        skipped
    }
}
