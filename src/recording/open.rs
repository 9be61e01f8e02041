//! Opens a file as a stream of MCAP records, or says what it is instead.

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::error::RecordingError;
use super::limits::Limits;
use super::records::{MAGIC, RecordSource};
use super::sniff;
use crate::cloud::{self, RemoteFile};

/// Bytes read from a file at a time.
const BUFFER: usize = 256 << 10;

/// Bytes of one value at the end of a file that are no data but what a file system leaves where writing stopped: at
/// least a sector. A message may well end in a few zeros.
const MIN_FILL: usize = 512;

/// A stream behind the opening magic.
pub(crate) type Stream = RecordSource<Box<dyn Read + Send>>;

/// An open recording.
pub(crate) struct Opened {
    pub(crate) stream: Stream,
    /// Size of the file at opening.
    pub(crate) bytes: u64,
    /// What follows the data, if the file was filled up.
    pub(crate) fill: Option<Fill>,
}

/// The end of a file that holds one value and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Fill {
    pub(crate) value: u8,
    pub(crate) n_bytes: u64,
}

/// Opens `path`, which may be compressed as a whole (`.mcap.zst`).
pub(crate) fn open(path: &Path, limits: &Limits) -> Result<Opened, RecordingError> {
    if let Some(address) = cloud::address(path) {
        let file = RemoteFile::open(address)?;
        let bytes = file.size();
        return opened(path, file, bytes, limits);
    }
    let about = fs::metadata(path)?;
    if !about.is_file() {
        let what = if about.is_dir() {
            "a folder"
        } else {
            "a pipe, socket or device"
        };
        return Err(RecordingError::NotAFile(what));
    }
    opened(path, File::open(path)?, about.len(), limits)
}

fn opened(
    path: &Path,
    mut file: impl Read + Seek + Send + 'static,
    bytes: u64,
    limits: &Limits,
) -> Result<Opened, RecordingError> {
    let is_compressed = is_compressed(path);
    let filled = if is_compressed {
        None
    } else {
        fill(&mut file, bytes)?
    };
    let n_data = bytes - filled.map_or(0, |fill| fill.n_bytes);
    let mut reader: Box<dyn Read + Send> = if is_compressed {
        Box::new(zstd::stream::read::Decoder::new(file.take(bytes))?)
    } else {
        let capacity = usize::try_from(bytes).map_or(BUFFER, |n| n.clamp(512, BUFFER));
        Box::new(BufReader::with_capacity(capacity, file.take(n_data)))
    };
    let (head, error) = read_head(&mut reader)?;
    if let Some(e) = error {
        reader = Box::new(Failing(Some(e)));
    }
    if let Some(what) = sniff::foreign(&head) {
        return Err(RecordingError::NotMcap(what));
    }
    let rest: Box<dyn Read + Send> =
        Box::new(io::Cursor::new(head[MAGIC.len()..].to_vec()).chain(reader));
    let stream = RecordSource::new(rest, (!is_compressed).then_some(n_data), limits);
    Ok(Opened {
        stream,
        bytes,
        fill: filled,
    })
}

/// A stream behind the opening magic, of a file that is still being written: nothing of it is there yet.
pub(crate) fn nothing_yet(limits: &Limits) -> Stream {
    RecordSource::new(Box::new(io::empty()), Some(MAGIC.len() as u64), limits)
}

/// The bytes of `file` from where it stands, `start`, to `end`.
pub(crate) fn piece(file: File, start: u64, end: u64) -> Box<dyn Read + Send> {
    let bytes = end.saturating_sub(start);
    let capacity = usize::try_from(bytes).map_or(BUFFER, |n| n.clamp(512, BUFFER));
    Box::new(BufReader::with_capacity(capacity, file.take(bytes)))
}

/// Is this the name of a recording that is compressed as a whole? rosbag2 writes `.mcap.zstd`.
pub(crate) fn is_compressed(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("zst") || e.eq_ignore_ascii_case("zstd"))
}

/// The first bytes, and what stopped them short.
fn read_head(reader: &mut dyn Read) -> io::Result<(Vec<u8>, Option<io::Error>)> {
    let mut head = Vec::with_capacity(sniff::SNIFF_LEN);
    match reader.take(sniff::SNIFF_LEN as u64).read_to_end(&mut head) {
        Ok(_) => Ok((head, None)),
        Err(e) if head.len() < MAGIC.len() => Err(e),
        Err(e) => Ok((head, Some(e))),
    }
}

/// Stands for a reader that failed, which need not fail again.
struct Failing(Option<io::Error>);

impl Read for Failing {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        self.0.take().map_or(Ok(0), Err)
    }
}

/// Finds out whether a file of `len` bytes was filled up where writing it stopped. `file` then stands at its beginning.
fn fill(file: &mut (impl Read + Seek), len: u64) -> io::Result<Option<Fill>> {
    let found = fill_before(file, len);
    file.rewind()?;
    found
}

fn fill_before(file: &mut (impl Read + Seek), len: u64) -> io::Result<Option<Fill>> {
    const BLOCK: u64 = 64 << 10;
    if len < (MAGIC.len() + MIN_FILL) as u64 {
        return Ok(None);
    }
    let mut end = len;
    let mut block = vec![0; MIN_FILL];
    file.seek(SeekFrom::Start(len - MIN_FILL as u64))?;
    file.read_exact(&mut block)?;
    let value = block[0];
    if !matches!(value, 0 | 0xff) || block.iter().any(|&b| b != value) {
        return Ok(None);
    }
    while end > MAGIC.len() as u64 {
        let start = end.saturating_sub(BLOCK).max(MAGIC.len() as u64);
        block.resize(usize::try_from(end - start).unwrap_or(0), 0);
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(&mut block)?;
        let n_data = block.iter().rposition(|&b| b != value).map_or(0, |i| i + 1);
        end = start + n_data as u64;
        if n_data > 0 {
            break;
        }
    }
    Ok(Some(Fill {
        value,
        n_bytes: len - end,
    }))
}
