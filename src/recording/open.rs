//! Opens a file as a stream of MCAP records, or says what it is instead.

use std::fs::{self, File};
use std::io::{self, BufReader, Read};
use std::path::Path;

use super::error::RecordingError;
use super::limits::Limits;
use super::records::{MAGIC, RecordSource};
use super::sniff;

/// Bytes read from a file at a time.
const BUFFER: usize = 256 << 10;

/// A stream behind the opening magic.
pub(crate) type Stream = RecordSource<Box<dyn Read + Send>>;

/// An open recording.
pub(crate) struct Opened {
    pub(crate) stream: Stream,
    /// Size of the file at opening.
    pub(crate) bytes: u64,
}

/// Opens `path`, which may be compressed as a whole (`.mcap.zst`).
pub(crate) fn open(path: &Path, limits: &Limits) -> Result<Opened, RecordingError> {
    let about = fs::metadata(path)?;
    if !about.is_file() {
        let what = if about.is_dir() {
            "a folder"
        } else {
            "a pipe, socket or device"
        };
        return Err(RecordingError::NotAFile(what));
    }
    let bytes = about.len();
    let file = File::open(path)?;
    let is_compressed = is_compressed(path);
    let mut reader: Box<dyn Read + Send> = if is_compressed {
        Box::new(zstd::stream::read::Decoder::new(file)?)
    } else {
        let capacity = usize::try_from(bytes).map_or(BUFFER, |n| n.clamp(512, BUFFER));
        Box::new(BufReader::with_capacity(capacity, file.take(bytes)))
    };
    let head = read_head(&mut reader)?;
    if let Some(what) = sniff::foreign(&head) {
        return Err(RecordingError::NotMcap(what));
    }
    let rest: Box<dyn Read + Send> =
        Box::new(io::Cursor::new(head[MAGIC.len()..].to_vec()).chain(reader));
    let stream = RecordSource::new(rest, (!is_compressed).then_some(bytes), limits);
    Ok(Opened { stream, bytes })
}

/// Is this the name of a recording that is compressed as a whole? rosbag2 writes `.mcap.zstd`.
pub(crate) fn is_compressed(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("zst") || e.eq_ignore_ascii_case("zstd"))
}

fn read_head(reader: &mut dyn Read) -> io::Result<Vec<u8>> {
    let mut head = Vec::with_capacity(sniff::SNIFF_LEN);
    reader
        .take(sniff::SNIFF_LEN as u64)
        .read_to_end(&mut head)?;
    Ok(head)
}
