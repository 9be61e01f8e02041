//! Inflates chunks: one unit of loss each, its declared size checked before memory is taken, its output bounded, its
//! CRC checked. Contexts and buffers are made once per reader and used again.

use std::io::{self, Read};

use thiserror::Error;

use super::wire::{Chunk, WireError};

/// Why a chunk is lost.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub(crate) enum ChunkError {
    #[error("chunk declares {declared} bytes inflated, beyond the limit of {limit} (--max-chunk)")]
    TooLarge { declared: u64, limit: u64 },
    #[error("chunk has unknown compression {0:?} (known: zstd, lz4, none)")]
    UnknownCompression(String),
    #[error("chunk does not inflate ({0})")]
    Corrupt(String),
    #[error("chunk inflates to {found} bytes where {declared} are declared")]
    WrongSize { declared: u64, found: u64 },
    #[error("chunk CRC is {found:08x} where {declared:08x} is declared")]
    WrongCrc { declared: u32, found: u32 },
    #[error("chunk declares more compressed bytes than its record holds")]
    Short,
    #[error("chunk {0}")]
    Unreadable(#[from] WireError),
}

impl ChunkError {
    /// The error without the numbers that differ from chunk to chunk, for counting.
    pub(crate) fn cause(&self) -> &'static str {
        match self {
            Self::TooLarge { .. } => "chunk beyond --max-chunk",
            Self::UnknownCompression(_) => "chunk with unknown compression",
            Self::Corrupt(_) => "chunk does not inflate",
            Self::WrongSize { .. } => "chunk does not have the size it declares",
            Self::WrongCrc { .. } => "chunk CRC does not match",
            Self::Short => "chunk record is short",
            Self::Unreadable(_) => "chunk record that cannot be read",
        }
    }
}

fn is_plain(compression: &str) -> bool {
    matches!(compression, "" | "none")
}

/// The decompressors of one reader and the buffer they fill.
#[derive(Default)]
pub(crate) struct Inflater {
    zstd: Option<zstd::bulk::Decompressor<'static>>,
    output: Vec<u8>,
}

impl Inflater {
    /// Inflates the whole chunk in `body`, the body of its record, to at most `limit` bytes;
    /// [`records`](Self::records) gives them.
    pub(crate) fn inflate(&mut self, body: &[u8], limit: u64) -> Result<(), ChunkError> {
        let chunk = Chunk::parse(body)?;
        let declared = chunk.uncompressed_size;
        if declared > limit {
            return Err(ChunkError::TooLarge { declared, limit });
        }
        if !chunk.is_whole {
            return Err(ChunkError::Short);
        }
        let size = usize::try_from(declared)
            .ok()
            .ok_or(ChunkError::TooLarge { declared, limit })?;
        let records = match chunk.compression {
            compression if is_plain(compression) => chunk.compressed,
            "zstd" => self.zstd(chunk.compressed, size)?,
            "lz4" => self.lz4(chunk.compressed, size)?,
            other => {
                return Err(ChunkError::UnknownCompression(
                    other.chars().take(32).collect(),
                ));
            }
        };
        let found = records.len() as u64;
        if found != declared {
            return Err(ChunkError::WrongSize { declared, found });
        }
        if chunk.uncompressed_crc != 0 {
            let found = crc32fast::hash(records);
            if found != chunk.uncompressed_crc {
                return Err(ChunkError::WrongCrc {
                    declared: chunk.uncompressed_crc,
                    found,
                });
            }
        }
        Ok(())
    }

    /// The records of the chunk in `body`, which was inflated last.
    pub(crate) fn records<'a>(&'a self, body: &'a [u8]) -> &'a [u8] {
        match Chunk::parse(body) {
            Ok(chunk) if is_plain(chunk.compression) => chunk.compressed,
            _ => &self.output,
        }
    }

    /// As much as can be inflated of a chunk that the end of the file cut: its records cannot be held against the CRC.
    pub(crate) fn inflate_cut<'a>(&'a mut self, chunk: &Chunk<'a>, limit: u64) -> &'a [u8] {
        let mut reader: Box<dyn Read + '_> = match chunk.compression {
            compression if is_plain(compression) => return chunk.compressed,
            "zstd" => match zstd::stream::read::Decoder::with_buffer(chunk.compressed) {
                Ok(decoder) => Box::new(decoder),
                Err(_) => return &[],
            },
            "lz4" => Box::new(lz4_flex::frame::FrameDecoder::new(chunk.compressed)),
            _ => return &[],
        };
        self.output.clear();
        let bound = limit.min(chunk.uncompressed_size);
        // An error here is the cut itself: what came before it is in the buffer.
        let _cut: io::Result<usize> = reader.by_ref().take(bound).read_to_end(&mut self.output);
        drop(reader);
        &self.output
    }

    fn zstd(&mut self, compressed: &[u8], size: usize) -> Result<&[u8], ChunkError> {
        let corrupt = |e: io::Error| ChunkError::Corrupt(format!("zstd: {e}"));
        let zstd = match &mut self.zstd {
            Some(zstd) => zstd,
            none => none.insert(zstd::bulk::Decompressor::new().map_err(corrupt)?),
        };
        self.output.clear();
        self.output.reserve(size);
        // The buffer's capacity bounds what a frame can write, whatever it claims.
        zstd.decompress_to_buffer(compressed, &mut self.output)
            .map_err(corrupt)?;
        Ok(&self.output)
    }

    fn lz4(&mut self, compressed: &[u8], size: usize) -> Result<&[u8], ChunkError> {
        self.output.clear();
        let mut decoder = lz4_flex::frame::FrameDecoder::new(compressed);
        let bound = size as u64 + 1;
        decoder
            .by_ref()
            .take(bound)
            .read_to_end(&mut self.output)
            .map_err(|e| ChunkError::Corrupt(format!("lz4: {e}")))?;
        Ok(&self.output)
    }
}
