//! An object as a file: `Read` and `Seek` for a thread that knows nothing of requests.

use std::io::{self, Read, Seek, SeekFrom};

use futures_util::{StreamExt, stream};
use tokio::sync::mpsc::{Receiver, channel};

use super::store::{Location, first_range, locate, range, runtime, wait};

/// Bytes that are asked for at a time: a small recording comes in one piece.
const RANGE: u64 = 4 << 20;

/// Ranges that are under way at a time; one more may wait to be taken, and one is being read.
const UNDER_WAY: usize = 3;

/// An object that is being read.
pub(crate) struct RemoteFile {
    location: Location,
    bytes: u64,
    tag: String,
    /// The first range, which came with opening.
    head: Vec<u8>,
    position: u64,
    ahead: Option<Ahead>,
}

/// Ranges on their way, from where the last read ended.
struct Ahead {
    ranges: Receiver<io::Result<Vec<u8>>>,
    /// The range in hand, and how much of it has been taken.
    range: Vec<u8>,
    taken: usize,
}

impl RemoteFile {
    pub(crate) fn open(address: &str) -> io::Result<Self> {
        let location = locate(address)?;
        let (about, head) = wait(first_range(&location, RANGE))??;
        Ok(Self {
            location,
            bytes: about.bytes,
            tag: about.tag,
            head,
            position: 0,
            ahead: None,
        })
    }

    /// Its size at opening.
    pub(crate) fn size(&self) -> u64 {
        self.bytes
    }

    /// Begins to fetch what follows the position.
    fn begin(&self) -> io::Result<Ahead> {
        let (sender, ranges) = channel(1);
        let (location, tag, end) = (self.location.clone(), self.tag.clone(), self.bytes);
        let starts = (self.position..end).step_by(usize::try_from(RANGE).unwrap_or(usize::MAX));
        let requests = starts.map(move |start| {
            let (location, tag) = (location.clone(), tag.clone());
            async move { range(&location, &tag, start..end.min(start + RANGE)).await }
        });
        runtime()?.spawn(async move {
            let mut ranges = stream::iter(requests).buffered(UNDER_WAY);
            while let Some(range) = ranges.next().await {
                // Nobody reads on.
                if sender.send(range).await.is_err() {
                    break;
                }
            }
        });
        Ok(Ahead {
            ranges,
            range: Vec::new(),
            taken: 0,
        })
    }
}

impl Read for RemoteFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.position >= self.bytes || buffer.is_empty() {
            return Ok(0);
        }
        let in_head = usize::try_from(self.position).ok();
        let n = if let Some(rest) = in_head
            .and_then(|at| self.head.get(at..))
            .filter(|r| !r.is_empty())
        {
            copy(rest, buffer)
        } else {
            let mut ahead = match self.ahead.take() {
                Some(ahead) => ahead,
                None => self.begin()?,
            };
            if ahead.taken == ahead.range.len() {
                ahead.range = ahead
                    .ranges
                    .blocking_recv()
                    .unwrap_or_else(|| Err(io::ErrorKind::UnexpectedEof.into()))?;
                ahead.taken = 0;
            }
            let n = copy(&ahead.range[ahead.taken..], buffer);
            ahead.taken += n;
            self.ahead = Some(ahead);
            n
        };
        self.position += n as u64;
        Ok(n)
    }
}

fn copy(from: &[u8], to: &mut [u8]) -> usize {
    let n = from.len().min(to.len());
    to[..n].copy_from_slice(&from[..n]);
    n
}

impl Seek for RemoteFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let target = match to {
            SeekFrom::Start(n) => Some(n),
            SeekFrom::End(n) => self.bytes.checked_add_signed(n),
            SeekFrom::Current(n) => self.position.checked_add_signed(n),
        };
        let target = target.ok_or(io::ErrorKind::InvalidInput)?;
        if target != self.position {
            self.ahead = None;
            self.position = target;
        }
        Ok(target)
    }
}
