//! The metadata record `recording`: which environment this is and what its joints are called.
//!
//! Writers put it in front or behind the messages. It is looked for in the data itself, by hopping from record to
//! record, so that a file without an index gives the same names.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use super::limits::Limits;
use super::open;
use super::records::{MAGIC, Next, RecordSource, op};
use super::wire::Metadata;

/// Name of the metadata record, and of the keys in it.
const RECORD: &str = "recording";

/// What the metadata says that the tables carry.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Names {
    pub(crate) env_id: Option<Arc<str>>,
    pub(crate) joint_names: Option<Arc<[Arc<str>]>>,
}

impl Names {
    /// Takes the names out of a metadata record; `None` if it is another record.
    pub(crate) fn of(record: &Metadata) -> Option<Self> {
        (record.name == RECORD).then(|| Self {
            env_id: record.entries.get("env_id").map(|s| Arc::from(s.as_str())),
            joint_names: record.entries.get("action_names").and_then(|s| names(s)),
        })
    }
}

/// A JSON array of strings.
fn names(json: &str) -> Option<Arc<[Arc<str>]>> {
    let names: Vec<String> = serde_json::from_str(json).ok()?;
    Some(names.into_iter().map(Arc::from).collect())
}

/// The metadata record `recording`, wherever it stands in the file.
pub(crate) fn find(path: &Path, limits: &Limits) -> io::Result<Option<Names>> {
    let mut file = File::open(path)?;
    if open::is_compressed(path) {
        let mut reader = zstd::stream::read::Decoder::new(file)?;
        reader.read_exact(&mut [0; MAGIC.len()])?;
        find_in_stream(reader, limits)
    } else {
        let len = file.seek(SeekFrom::End(0))?;
        file.rewind()?;
        find_in_file(file, len, limits)
    }
}

/// Hops over the records of a file for the metadata record `recording`.
fn find_in_file(file: File, len: u64, limits: &Limits) -> io::Result<Option<Names>> {
    let mut reader = BufReader::new(file);
    let mut offset = MAGIC.len() as u64;
    reader.read_exact(&mut [0; MAGIC.len()])?;
    loop {
        let mut head = [0; 9];
        if len.saturating_sub(offset) < head.len() as u64 {
            return Ok(None);
        }
        reader.read_exact(&mut head)?;
        offset += head.len() as u64;
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if length > len - offset || opcode == op::DATA_END || opcode == 0 {
            return Ok(None);
        }
        offset += length;
        if opcode == op::METADATA && length <= limits.max_record {
            let mut body = Vec::new();
            reader.by_ref().take(length).read_to_end(&mut body)?;
            if let Some(names) = Metadata::parse(&body).ok().as_ref().and_then(Names::of) {
                return Ok(Some(names));
            }
        } else if let Ok(hop) = i64::try_from(length) {
            reader.seek_relative(hop)?;
        } else {
            return Ok(None);
        }
    }
}

/// The same over a stream that cannot hop, standing behind the magic.
fn find_in_stream(reader: impl Read, limits: &Limits) -> io::Result<Option<Names>> {
    let mut source = RecordSource::new(reader, None, limits);
    let mut body = Vec::new();
    loop {
        match source.next(|opcode| opcode == op::METADATA, &mut body) {
            Next::Record {
                opcode: op::METADATA,
                ..
            } => {
                if let Some(names) = Metadata::parse(&body).ok().as_ref().and_then(Names::of) {
                    return Ok(Some(names));
                }
            }
            Next::Record {
                opcode: op::DATA_END,
                ..
            }
            | Next::Cut { .. }
            | Next::ClosingMagic { .. }
            | Next::End { .. }
            | Next::NoRecord { .. } => {
                return Ok(None);
            }
            Next::Record { .. } | Next::TooLarge { .. } => {}
        }
    }
}
