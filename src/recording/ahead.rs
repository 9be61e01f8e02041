//! The records of a file on their way: one after the other, or, where there are threads for it, chunks before their
//! turn, several inflated and decoded at the same time.

use std::collections::VecDeque;

use rayon::prelude::*;

use super::chunk::{ChunkError, Inflater};
use super::decoded::{Decoded, Readers};
use super::limits::Limits;
use super::open::Stream;
use super::records::{Next, op};
use super::wire::Chunk;

/// Most chunks that are taken, and most that are made ready meanwhile: enough that each thread finds one.
const MAX_CHUNKS: usize = 8;

/// No more chunks are read once those that wait have this many bytes inflated.
const MAX_WAITING_BYTES: u64 = 8 << 20;

/// One record, and how far it is made ready.
pub(crate) struct Slot {
    pub(crate) next: Next,
    /// Bytes of the file up to its end.
    pub(crate) end: u64,
    pub(crate) body: Vec<u8>,
    pub(crate) inflater: Inflater,
    /// Whether the records of the chunk in `body` are in `inflater`; `None` before that was tried.
    inflated: Option<Result<(), ChunkError>>,
    /// What was decoded of them.
    pub(crate) decoded: Decoded,
    /// This slot's own copy of what decodes.
    readers: Option<Readers>,
}

impl Slot {
    fn new() -> Self {
        Self {
            next: Next::End { offset: 0, tail: 0 },
            end: 0,
            body: Vec::new(),
            inflater: Inflater::default(),
            inflated: None,
            decoded: Decoded::default(),
            readers: None,
        }
    }

    fn read(&mut self, stream: &mut Stream, wanted: impl Fn(u8) -> bool) {
        self.inflated = None;
        self.decoded.clear();
        self.next = stream.next(wanted, &mut self.body);
        self.end = stream.offset();
    }

    /// Bytes that its chunk says it inflates to.
    fn bytes(&self) -> u64 {
        let chunk = self.chunk_offset().map(|_| Chunk::parse(&self.body));
        let declared = chunk.map_or(0, |chunk| chunk.map_or(0, |c| c.uncompressed_size));
        declared.min(MAX_WAITING_BYTES)
    }

    /// Where a whole chunk stands, if this is one.
    pub(crate) fn chunk_offset(&self) -> Option<u64> {
        match self.next {
            Next::Record { opcode, offset } if opcode == op::CHUNK => Some(offset),
            _ => None,
        }
    }

    /// The records of a whole chunk, inflated now if that is still to be done, and what was decoded of them.
    pub(crate) fn records(&mut self, limits: &Limits) -> Result<(&[u8], &mut Decoded), ChunkError> {
        let inflated = self.inflated.take();
        inflated.unwrap_or_else(|| self.inflater.inflate(&self.body, limits.max_chunk))?;
        Ok((self.inflater.records(&self.body), &mut self.decoded))
    }

    /// Inflates a chunk before its turn, and decodes what `readers` read.
    fn make_ready(&mut self, readers: &Readers, limits: &Limits) {
        let inflated = self.inflater.inflate(&self.body, limits.max_chunk);
        let is_there = inflated.is_ok();
        self.inflated = Some(inflated);
        if is_there {
            let is_same = |own: &Readers| own.version == readers.version;
            if !self.readers.as_ref().is_some_and(is_same) {
                self.readers = Some(readers.clone());
            }
            if let Some(own) = &mut self.readers {
                self.decoded.fill(self.inflater.records(&self.body), own);
            }
        }
    }
}

/// The records of one file, in their order.
pub(crate) struct Ahead {
    pub(crate) stream: Stream,
    /// Whole chunks; only the last may be another record.
    waiting: VecDeque<Box<Slot>>,
    spare: VecDeque<Box<Slot>>,
}

impl Ahead {
    pub(crate) fn new(stream: Stream) -> Self {
        Self {
            stream,
            waiting: VecDeque::new(),
            spare: VecDeque::new(),
        }
    }

    /// The next record; its body is there if `wanted(opcode)`.
    pub(crate) fn next(&mut self, wanted: impl Fn(u8) -> bool) -> Box<Slot> {
        self.waiting.pop_front().unwrap_or_else(|| {
            let mut slot = self.spare_slot();
            slot.read(&mut self.stream, wanted);
            slot
        })
    }

    fn spare_slot(&mut self) -> Box<Slot> {
        self.spare
            .pop_back()
            .unwrap_or_else(|| Box::new(Slot::new()))
    }

    /// Takes a slot back that is done with.
    pub(crate) fn give_back(&mut self, slot: Box<Slot>) {
        self.spare.push_back(slot);
    }

    /// Must the next record be taken by itself? No chunk waits, and none may be read before it.
    pub(crate) fn is_held_up(&self) -> bool {
        self.waiting
            .front()
            .is_some_and(|slot| slot.chunk_offset().is_none())
    }

    /// The first of the chunks that wait, to be taken while others are made ready.
    pub(crate) fn chunks(&mut self) -> VecDeque<Box<Slot>> {
        let first = self.waiting.iter().take(MAX_CHUNKS);
        let n_chunks = first
            .take_while(|slot| slot.chunk_offset().is_some())
            .count();
        let rest = self.waiting.split_off(n_chunks);
        std::mem::replace(&mut self.waiting, rest)
    }

    /// Puts chunks back whose turn did not come.
    pub(crate) fn put_back(&mut self, mut chunks: VecDeque<Box<Slot>>) {
        chunks.append(&mut self.waiting);
        self.waiting = chunks;
    }

    /// Reads on until enough chunks wait, or a record comes that is no chunk; makes the chunks ready, each on whatever
    /// thread is free.
    pub(crate) fn fill(&mut self, wanted: impl Fn(u8) -> bool, readers: &Readers, limits: &Limits) {
        let n_ready = self.waiting.len();
        let mut bytes: u64 = self.waiting.iter().map(|slot| slot.bytes()).sum();
        while self.waiting.len() < MAX_CHUNKS
            && bytes < MAX_WAITING_BYTES
            && self
                .waiting
                .back()
                .is_none_or(|last| last.chunk_offset().is_some())
        {
            let mut slot = self.spare_slot();
            loop {
                slot.read(&mut self.stream, &wanted);
                match slot.next {
                    Next::Record { opcode, .. } if !wanted(opcode) => {}
                    _ => break,
                }
            }
            bytes += slot.bytes();
            self.waiting.push_back(slot);
        }
        self.waiting
            .par_iter_mut()
            .skip(n_ready)
            .with_max_len(1)
            .filter(|slot| slot.chunk_offset().is_some())
            .for_each(|slot| slot.make_ready(readers, limits));
    }
}
