//! How far a file that is still being written can be read: up to the end of its last whole record.
//!
//! Only opcodes and lengths are looked at, each once. A record of which a part is there is waited for; that the file is
//! closed is known by the magic at its end.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::records::MAGIC;

/// Bytes of opcode and length in front of each body.
const HEAD: usize = 9;

/// What a file begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Too little to tell.
    Unknown,
    /// The magic of an MCAP file.
    Mcap,
    /// Something else.
    Other,
}

/// How far one file has grown.
#[derive(Debug, Clone, Copy)]
pub struct Growth {
    start: Start,
    /// Where its last whole record ends.
    end: u64,
    is_closed: bool,
}

impl Default for Growth {
    fn default() -> Self {
        Self {
            start: Start::Unknown,
            end: 0,
            is_closed: false,
        }
    }
}

impl Growth {
    /// What the file begins with.
    pub fn start(&self) -> Start {
        self.start
    }

    /// Where its last whole record ends, bytes; all of it once it is closed.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// Has it been written to its end?
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Looks at what has come.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn advance(&mut self, file: &File) -> io::Result<()> {
        let len = file.metadata()?.len();
        let mut reader = BufReader::new(file);
        if self.start == Start::Unknown {
            self.begin(&mut reader, len)?;
        }
        if self.start != Start::Mcap || self.is_closed {
            return Ok(());
        }
        reader.seek(SeekFrom::Start(self.end))?;
        loop {
            let left = len.saturating_sub(self.end);
            let mut head = [0; HEAD];
            let n = usize::try_from(left).map_or(HEAD, |left| left.min(HEAD));
            reader.read_exact(&mut head[..n])?;
            if n >= MAGIC.len() && head[..MAGIC.len()] == *MAGIC {
                self.end = len;
                self.is_closed = true;
                return Ok(());
            }
            let [opcode, length @ ..] = head;
            let length = u64::from_le_bytes(length);
            // No record has opcode 0: what stands there was made room for, and is not written yet.
            if n < HEAD || opcode == 0 || length > left - HEAD as u64 {
                return Ok(());
            }
            self.end += HEAD as u64 + length;
            let Ok(hop) = i64::try_from(length) else {
                return Ok(());
            };
            reader.seek_relative(hop)?;
        }
    }

    fn begin(&mut self, reader: &mut BufReader<&File>, len: u64) -> io::Result<()> {
        reader.rewind()?;
        let mut magic = [0; MAGIC.len()];
        if len < magic.len() as u64 {
            return Ok(());
        }
        reader.read_exact(&mut magic)?;
        if magic == *MAGIC {
            self.start = Start::Mcap;
            self.end = magic.len() as u64;
        } else if magic.iter().any(|&byte| byte != 0) {
            self.start = Start::Other;
        }
        Ok(())
    }
}

/// Is a file that is compressed as a whole there to its end? It has to be read to tell.
///
/// # Errors
/// If it cannot be opened.
pub fn is_whole_zst(path: &Path) -> io::Result<bool> {
    let mut reader = zstd::stream::read::Decoder::new(File::open(path)?)?;
    Ok(io::copy(&mut reader, &mut io::sink()).is_ok_and(|n_bytes| n_bytes > 0))
}
