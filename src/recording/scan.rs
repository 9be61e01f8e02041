//! Walks all records of one file, those inside chunks too, and hands them to a sink. What is damaged is told and
//! passed over: one chunk is the unit of loss.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::ahead::{Ahead, Slot};
use super::decoded::{Decoded, Readers};
use super::error::RecordingError;
use super::growth::Growth;
use super::limits::Limits;
use super::open::{self, Fill};
use super::records::{Next, op};
use super::wire::{self, Chunk};

/// Files of fewer bytes are not read ahead: many of them are read at the same time, and each needs memory for it.
const MIN_BYTES_AHEAD: u64 = 4 << 20;

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

    /// What can decode messages before their turn, if the sink has any use for that.
    fn readers(&mut self) -> Option<Arc<Readers>> {
        None
    }

    /// A chunk begins of which `decoded` was decoded already; or it is over, and the sink gives that back.
    fn exchange(&mut self, _decoded: &mut Decoded) {}

    /// Something is wrong with the file.
    fn damage(&mut self, damage: Damage<'_>) -> Result<(), RecordingError>;
}

/// The records of one file, from front to back.
pub(crate) struct Scanner {
    path: PathBuf,
    bytes: u64,
    fill: Option<Fill>,
    ahead: Ahead,
    position: u64,
    limits: Limits,
    section: Section,
    /// A data end record came.
    ended: bool,
    /// A chunk is lost, and told of.
    has_lost_chunk: bool,
    stage: Stage,
}

/// How far the file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// It is still being written.
    Growing,
    /// It is there to its end.
    Whole,
    /// All of it was taken.
    Done,
}

/// Which section of the file is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    Data,
    Summary {
        /// The CRC in the data end record is that of the data: nothing behind it is data.
        for_sure: bool,
    },
}

impl Section {
    /// Is the body of a record with this opcode looked into?
    fn wants(self, opcode: u8) -> bool {
        match self {
            Self::Data => is_wanted(opcode),
            Self::Summary { for_sure } => is_data(opcode) && !for_sure,
        }
    }
}

impl Scanner {
    /// Opens the file at `path`.
    pub(crate) fn open(path: &Path, limits: &Limits) -> Result<Self, RecordingError> {
        let opened = open::open(path, limits)?;
        Ok(Self {
            path: path.to_owned(),
            bytes: opened.bytes,
            fill: opened.fill,
            position: opened.stream.offset(),
            ahead: Ahead::new(opened.stream),
            limits: *limits,
            section: Section::Data,
            ended: false,
            has_lost_chunk: false,
            stage: Stage::Whole,
        })
    }

    /// Begins with a file that is still being written, of which nothing is to be read yet.
    pub(crate) fn live(path: &Path, limits: &Limits) -> Self {
        let stream = open::nothing_yet(limits);
        Self {
            path: path.to_owned(),
            // Too few to be read ahead: that would go beyond what is there.
            bytes: 0,
            fill: None,
            position: stream.offset(),
            ahead: Ahead::new(stream),
            limits: *limits,
            section: Section::Data,
            ended: false,
            has_lost_chunk: false,
            stage: Stage::Growing,
        }
    }

    /// Takes the file as far as it has grown: whole records, or all of it once it is closed.
    pub(crate) fn go_on(&mut self, mut file: File, growth: &Growth) -> io::Result<()> {
        file.seek(SeekFrom::Start(self.position))?;
        let end = growth.end();
        self.ahead
            .stream
            .go_on(open::piece(file, self.position, end), end);
        if growth.is_closed() {
            self.stage = Stage::Whole;
            self.bytes = end;
        }
        Ok(())
    }

    /// Size of the file at opening.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes of the file up to the end of what was taken last.
    pub(crate) fn position(&self) -> u64 {
        self.position
    }

    /// Is there nothing more?
    pub(crate) fn is_done(&self) -> bool {
        self.stage == Stage::Done
    }

    /// Takes the next record of the outer loop: a chunk and all that is in it, or a record on its own.
    pub(crate) fn step(&mut self, sink: &mut impl Sink) -> Result<(), RecordingError> {
        let section = self.section;
        let mut slot = self.ahead.next(|opcode| section.wants(opcode));
        self.position = slot.end;
        let result = self.take(&mut slot, sink);
        self.ahead.give_back(slot);
        result
    }

    /// Takes records up to `until` bytes of the file, or until `is_enough` of what the sink has; always at least one.
    /// Where there are threads for it, the chunks after those that are taken are made ready at the same time.
    pub(crate) fn run<S: Sink + Send>(
        &mut self,
        sink: &mut S,
        until: u64,
        is_enough: &mut (dyn FnMut(&mut S) -> bool + Send),
    ) -> Result<(), RecordingError> {
        let is_parallel = self.bytes >= MIN_BYTES_AHEAD
            && self.section == Section::Data
            && !self.ahead.is_held_up()
            && rayon::current_num_threads() > 1;
        let Some(readers) = is_parallel.then(|| sink.readers()).flatten() else {
            let result = self.step(sink);
            is_enough(sink);
            return result;
        };
        let mut chunks = self.ahead.chunks();
        let (section, limits) = (self.section, self.limits);
        let (ahead, position) = (&mut self.ahead, &mut self.position);
        let mut done = Vec::with_capacity(chunks.len());
        let has_lost_chunk = &mut self.has_lost_chunk;
        let take = || {
            let is_next = |chunk: &mut Box<Slot>| chunk.chunk_offset().is_some_and(|at| at < until);
            while let Some(mut chunk) = chunks.pop_front_if(is_next) {
                *position = chunk.end;
                let result = chunk_records(&mut chunk, &limits, has_lost_chunk, sink);
                done.push(chunk);
                let is_enough = is_enough(sink);
                result?;
                if is_enough {
                    break;
                }
            }
            Ok(())
        };
        let wanted = |opcode| section.wants(opcode);
        let (result, ()) = rayon::join(take, || ahead.fill(wanted, &readers, &limits));
        for chunk in done {
            ahead.give_back(chunk);
        }
        ahead.put_back(chunks);
        result
    }

    fn take(&mut self, slot: &mut Slot, sink: &mut impl Sink) -> Result<(), RecordingError> {
        let section = self.section;
        match slot.next {
            Next::Record { opcode, offset } if section != Section::Data => {
                if !section.wants(opcode) {
                    return Ok(());
                }
                self.go_on_with_data(offset, sink)?;
                self.record(opcode, offset, slot, sink)
            }
            Next::Record { opcode, offset } => self.record(opcode, offset, slot, sink),
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
            } => {
                if section == Section::Data
                    && opcode == op::CHUNK
                    && let Ok(chunk) = Chunk::parse(&slot.body)
                {
                    let records = slot.inflater.inflate_cut(&chunk, self.limits.max_chunk);
                    records_of_chunk(records, offset, false, sink)?;
                }
                let what =
                    format!("its last record declares {declared} bytes, and {available} are left");
                self.cut(&what, offset, sink)
            }
            Next::End { offset, tail } => {
                let what = format!("no closing magic ({tail} bytes are no record)");
                self.cut(&what, offset, sink)
            }
            Next::NoRecord { offset } => self.cut("there is no record, but opcode 0", offset, sink),
            Next::ClosingMagic { junk } => self.closing_magic(junk, sink),
        }
    }

    fn record(
        &mut self,
        opcode: u8,
        offset: u64,
        slot: &mut Slot,
        sink: &mut impl Sink,
    ) -> Result<(), RecordingError> {
        match opcode {
            op::DATA_END => self.data_end(offset, &slot.body, sink),
            op::CHUNK => chunk_records(slot, &self.limits, &mut self.has_lost_chunk, sink),
            opcode => sink.record(opcode, &slot.body, offset),
        }
    }

    /// The file ends before its closing magic, or cannot be read on.
    fn cut(&mut self, what: &str, offset: u64, sink: &mut impl Sink) -> Result<(), RecordingError> {
        if self.stage == Stage::Growing {
            // What was there a moment ago is not: it is to be looked at again.
            return Err(RecordingError::NotYet);
        }
        self.stage = Stage::Done;
        let mut what = format!("the file is cut: {what}");
        if let Some(Fill { value, n_bytes }) = self.fill {
            let _infallible = write!(what, ", then {n_bytes} bytes of {value:#04x}");
        }
        let mut cause = "file is cut";
        if let Some(e) = self.ahead.stream.take_error() {
            cause = "file cannot be read on";
            let _infallible = write!(what, "; it cannot be read on ({e})");
        }
        sink.damage(Damage {
            cause,
            what: &what,
            offset,
            loses_messages: self.section == Section::Data,
        })?;
        self.changed(sink)
    }

    fn closing_magic(&mut self, junk: u64, sink: &mut impl Sink) -> Result<(), RecordingError> {
        self.stage = Stage::Done;
        let offset = self.ahead.stream.offset() - junk;
        if !self.ended {
            // Without it a record that swallowed the rest of the data would not be noticed.
            sink.damage(Damage {
                cause: "no data end record",
                what: "there is no data end record in front of the closing magic",
                offset,
                loses_messages: true,
            })?;
        }
        let junk = junk + self.fill.map_or(0, |fill| fill.n_bytes);
        let what = match self.ahead.stream.take_error() {
            Some(e) => format!("what follows the closing magic cannot be read ({e})"),
            None if junk == 0 => return self.changed(sink),
            None => format!("{junk} bytes follow the closing magic"),
        };
        sink.damage(Damage {
            cause: "bytes after the end of the file",
            what: &what,
            offset,
            loses_messages: false,
        })?;
        self.changed(sink)
    }

    /// Tells of a file that is not what it was at opening: what was there then is what was read.
    fn changed(&self, sink: &mut impl Sink) -> Result<(), RecordingError> {
        let now = fs::metadata(&self.path).map_or(self.bytes, |about| about.len());
        let (cause, how) = match now.cmp(&self.bytes) {
            std::cmp::Ordering::Equal => return Ok(()),
            std::cmp::Ordering::Greater => ("file grew while it was read", "grew"),
            std::cmp::Ordering::Less => ("file shrank while it was read", "shrank"),
        };
        sink.damage(Damage {
            cause,
            what: &format!(
                "the file {how} while it was read, from {} bytes to {now},",
                self.bytes
            ),
            offset: now.min(self.bytes),
            loses_messages: false,
        })
    }

    /// Data behind a data end record that was none, or whose CRC does not vouch for it.
    fn go_on_with_data(&mut self, offset: u64, sink: &mut impl Sink) -> Result<(), RecordingError> {
        self.section = Section::Data;
        sink.damage(Damage {
            cause: "data behind the end of the data",
            what: "there is data behind the end of the data section",
            offset,
            loses_messages: true,
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
            loses_messages: is_data(opcode),
        })
    }

    /// The data section ends here; what follows is the summary.
    fn data_end(
        &mut self,
        offset: u64,
        body: &[u8],
        sink: &mut impl Sink,
    ) -> Result<(), RecordingError> {
        self.ended = true;
        let declared = body
            .first_chunk::<4>()
            .map_or(0, |bytes| u32::from_le_bytes(*bytes));
        let found = self.ahead.stream.crc_before_last();
        self.section = Section::Summary {
            for_sure: found == declared,
        };
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
}

/// Opcodes of the data section that are looked into.
fn is_wanted(opcode: u8) -> bool {
    matches!(
        opcode,
        op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK | op::METADATA | op::DATA_END
    )
}

/// Opcodes of records that hold messages.
fn is_data(opcode: u8) -> bool {
    matches!(opcode, op::CHUNK | op::MESSAGE)
}

fn lost_chunk<'a>(cause: &'a str, what: &'a str, offset: u64) -> Damage<'a> {
    Damage {
        cause,
        what,
        offset,
        loses_messages: true,
    }
}

/// Takes a whole chunk; one that is lost is told of.
fn chunk_records(
    slot: &mut Slot,
    limits: &Limits,
    has_lost_chunk: &mut bool,
    sink: &mut impl Sink,
) -> Result<(), RecordingError> {
    let offset = slot.chunk_offset().unwrap_or(0);
    match slot.records(limits) {
        Ok((records, decoded)) => {
            sink.exchange(decoded);
            let result = records_of_chunk(records, offset, true, sink);
            sink.exchange(decoded);
            result
        }
        Err(e) => {
            *has_lost_chunk = true;
            sink.damage(lost_chunk(e.cause(), &e.to_string(), offset))
        }
    }
}

fn records_of_chunk(
    records: &[u8],
    offset: u64,
    is_whole: bool,
    sink: &mut impl Sink,
) -> Result<(), RecordingError> {
    for record in wire::records(records) {
        match record {
            Ok((op::CHUNK, _)) => sink.damage(lost_chunk(
                "chunk inside a chunk",
                "chunk inside the chunk",
                offset,
            ))?,
            Ok((opcode, body)) => sink.record(opcode, body, offset)?,
            Err(_) if !is_whole => {}
            Err(e) => sink.damage(lost_chunk(
                "chunk whose records do not fit it",
                &format!("a record {e} in the chunk"),
                offset,
            ))?,
        }
    }
    Ok(())
}
