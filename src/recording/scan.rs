//! Walks all records of one file, those inside chunks too, and hands them to a sink. What is damaged is told and
//! passed over: one chunk is the unit of loss.

use std::path::Path;

use super::chunk::Inflater;
use super::error::RecordingError;
use super::limits::Limits;
use super::open::{self, Stream};
use super::records::{Next, op};
use super::wire::{Chunk, Cursor, WireError};

/// Something that is wrong with the file itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Damage<'a> {
    /// Under which it is counted.
    pub(crate) cause: &'a str,
    /// As a sentence, without the offset.
    pub(crate) what: &'a str,
    /// Bytes from the beginning of the file.
    pub(crate) offset: u64,
    /// Messages may have been lost by it.
    pub(crate) loses_messages: bool,
}

/// Takes what a scan finds.
pub(crate) trait Sink {
    /// One record of the data section, on its own or out of a chunk; `offset` is that of the chunk then.
    fn record(&mut self, opcode: u8, body: &[u8], offset: u64) -> Result<(), RecordingError>;

    /// Something is wrong with the file.
    fn damage(&mut self, damage: Damage<'_>) -> Result<(), RecordingError>;
}

/// The records of one file, from front to back.
pub(crate) struct Scanner {
    bytes: u64,
    stream: Stream,
    inflater: Inflater,
    body: Vec<u8>,
    limits: Limits,
    in_summary: bool,
    /// A chunk is lost, and told of.
    has_lost_chunk: bool,
    done: bool,
}

impl Scanner {
    /// Opens the file at `path`.
    pub(crate) fn open(path: &Path, limits: &Limits) -> Result<Self, RecordingError> {
        let opened = open::open(path, limits)?;
        Ok(Self {
            bytes: opened.bytes,
            stream: opened.stream,
            inflater: Inflater::default(),
            body: Vec::new(),
            limits: *limits,
            in_summary: false,
            has_lost_chunk: false,
            done: false,
        })
    }

    /// Size of the file at opening.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes read so far.
    pub(crate) fn position(&self) -> u64 {
        self.stream.offset()
    }

    /// Is there nothing more?
    pub(crate) fn is_done(&self) -> bool {
        self.done
    }

    /// Takes the next record of the outer loop: a chunk and all that is in it, or a record on its own.
    pub(crate) fn step(&mut self, sink: &mut impl Sink) -> Result<(), RecordingError> {
        let in_summary = self.in_summary;
        let wanted = |opcode| !in_summary && is_wanted(opcode);
        let next = self.stream.next(wanted, &mut self.body)?;
        match next {
            Next::Record { .. } if in_summary => Ok(()),
            Next::Record {
                opcode: op::DATA_END,
                offset,
            } => self.data_end(offset, sink),
            Next::Record {
                opcode: op::CHUNK,
                offset,
            } => self.chunk(offset, true, sink),
            Next::Record { opcode, offset } => sink.record(opcode, &self.body, offset),
            Next::TooLarge {
                opcode,
                offset,
                declared,
            } => self.too_large(opcode, offset, declared, sink),
            Next::Cut {
                opcode,
                offset,
                declared,
                available,
            } => self.cut(opcode, offset, declared, available, sink),
            Next::ClosingMagic { junk } => self.closing_magic(junk, sink),
            Next::End { offset, tail } => {
                self.done = true;
                sink.damage(Damage {
                    cause: "file is cut",
                    what: &format!(
                        "the file is cut: no closing magic ({tail} bytes are no record)"
                    ),
                    offset,
                    loses_messages: !in_summary,
                })
            }
        }
    }

    fn cut(
        &mut self,
        opcode: u8,
        offset: u64,
        declared: u64,
        available: u64,
        sink: &mut impl Sink,
    ) -> Result<(), RecordingError> {
        self.done = true;
        if !self.in_summary && opcode == op::CHUNK {
            self.chunk(offset, false, sink)?;
        }
        sink.damage(Damage {
            cause: "file is cut",
            what: &format!(
                "the file is cut: its last record declares {declared} bytes, and {available} are left"
            ),
            offset,
            loses_messages: !self.in_summary,
        })
    }

    fn closing_magic(&mut self, junk: u64, sink: &mut impl Sink) -> Result<(), RecordingError> {
        self.done = true;
        if junk == 0 {
            return Ok(());
        }
        sink.damage(Damage {
            cause: "bytes after the end of the file",
            what: &format!("{junk} bytes follow the closing magic"),
            offset: self.stream.offset() - junk,
            loses_messages: false,
        })
    }

    fn too_large(
        &mut self,
        opcode: u8,
        offset: u64,
        declared: u64,
        sink: &mut impl Sink,
    ) -> Result<(), RecordingError> {
        sink.damage(Damage {
            cause: "record beyond --max-record",
            what: &format!(
                "record with opcode {opcode:#04x} of {declared} bytes is beyond the limit of {} (--max-record)",
                self.limits.max_record
            ),
            offset,
            loses_messages: matches!(opcode, op::CHUNK | op::MESSAGE),
        })
    }

    /// The data section ends here; what follows is the summary.
    fn data_end(&mut self, offset: u64, sink: &mut impl Sink) -> Result<(), RecordingError> {
        self.in_summary = true;
        let declared = self
            .body
            .first_chunk::<4>()
            .map_or(0, |bytes| u32::from_le_bytes(*bytes));
        let found = self.stream.crc_before_last();
        if declared == 0 || found == declared {
            return Ok(());
        }
        sink.damage(Damage {
            cause: "data section CRC does not match",
            what: &format!("data section CRC is {found:08x} where {declared:08x} is declared"),
            offset,
            // A chunk that is lost explains it, and has been reckoned with.
            loses_messages: !self.has_lost_chunk,
        })
    }

    /// Takes a chunk; `is_whole` is false where the end of the file cut it.
    fn chunk(
        &mut self,
        offset: u64,
        is_whole: bool,
        sink: &mut impl Sink,
    ) -> Result<(), RecordingError> {
        let chunk = match Chunk::parse(&self.body) {
            Ok(chunk) => chunk,
            Err(_) if !is_whole => return Ok(()),
            Err(e) => {
                self.has_lost_chunk = true;
                let what = format!("chunk {e}");
                return sink.damage(lost_chunk(
                    "chunk record that cannot be read",
                    &what,
                    offset,
                ));
            }
        };
        if !is_whole {
            let records = self.inflater.inflate_cut(&chunk, self.limits.max_chunk);
            return records_of_chunk(records, offset, false, sink);
        }
        match self.inflater.inflate(&chunk, self.limits.max_chunk) {
            Ok(records) => records_of_chunk(records, offset, true, sink),
            Err(e) => {
                self.has_lost_chunk = true;
                sink.damage(lost_chunk(e.cause(), &e.to_string(), offset))
            }
        }
    }
}

/// Opcodes of the data section that are looked into.
fn is_wanted(opcode: u8) -> bool {
    matches!(
        opcode,
        op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK | op::METADATA | op::DATA_END
    )
}

fn lost_chunk<'a>(cause: &'a str, what: &'a str, offset: u64) -> Damage<'a> {
    Damage {
        cause,
        what,
        offset,
        loses_messages: true,
    }
}

fn records_of_chunk(
    records: &[u8],
    offset: u64,
    is_whole: bool,
    sink: &mut impl Sink,
) -> Result<(), RecordingError> {
    let mut cursor = Cursor::new(records);
    while !cursor.rest().is_empty() {
        let record = (|| {
            let opcode = cursor.u8("opcode")?;
            let length = cursor.u64("length")?;
            Ok::<_, WireError>((opcode, cursor.bytes(length, "body")?))
        })();
        match record {
            Ok((op::CHUNK, _)) => sink.damage(lost_chunk(
                "chunk inside a chunk",
                "chunk inside the chunk",
                offset,
            ))?,
            Ok((opcode, body)) => sink.record(opcode, body, offset)?,
            Err(_) if !is_whole => break,
            Err(e) => {
                sink.damage(lost_chunk(
                    "chunk whose records do not fit it",
                    &format!("a record {e} in the chunk"),
                    offset,
                ))?;
                break;
            }
        }
    }
    Ok(())
}
