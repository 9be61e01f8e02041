//! MCAP files put together record by record, so that a test can make what no writer would; and a walk over the records
//! of a file that shares nothing with the reader under test.

use std::io::Read;

use mcap::records::op;

/// Both ends of a file.
pub(crate) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Bytes of opcode and length.
pub(crate) const HEAD: usize = 9;

fn text(body: &mut Vec<u8>, text: &str) {
    body.extend((text.len() as u32).to_le_bytes());
    body.extend(text.as_bytes());
}

/// One record.
pub(crate) fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    record_saying(opcode, body.len() as u64, body)
}

/// One record that declares another length than it has.
pub(crate) fn record_saying(opcode: u8, declared: u64, body: &[u8]) -> Vec<u8> {
    let mut record = vec![opcode];
    record.extend(declared.to_le_bytes());
    record.extend(body);
    record
}

pub(crate) fn schema(id: u16, name: &str, encoding: &str, data: &[u8]) -> Vec<u8> {
    let mut body = id.to_le_bytes().to_vec();
    text(&mut body, name);
    text(&mut body, encoding);
    body.extend((data.len() as u32).to_le_bytes());
    body.extend(data);
    record(op::SCHEMA, &body)
}

pub(crate) fn channel(id: u16, schema_id: u16, topic: &str, encoding: &str) -> Vec<u8> {
    let mut body = id.to_le_bytes().to_vec();
    body.extend(schema_id.to_le_bytes());
    text(&mut body, topic);
    text(&mut body, encoding);
    body.extend(0u32.to_le_bytes());
    record(op::CHANNEL, &body)
}

/// A message; `log_time` in nanoseconds.
pub(crate) fn message(channel_id: u16, log_time: u64, data: &[u8]) -> Vec<u8> {
    let mut body = channel_id.to_le_bytes().to_vec();
    body.extend(0u32.to_le_bytes());
    body.extend(log_time.to_le_bytes());
    body.extend(log_time.to_le_bytes());
    body.extend(data);
    record(op::MESSAGE, &body)
}

pub(crate) fn metadata(name: &str, entries: &[(&str, &str)]) -> Vec<u8> {
    let mut map = Vec::new();
    for (key, value) in entries {
        text(&mut map, key);
        text(&mut map, value);
    }
    let mut body = Vec::new();
    text(&mut body, name);
    body.extend((map.len() as u32).to_le_bytes());
    body.extend(map);
    record(op::METADATA, &body)
}

/// A chunk whose every field is as given.
#[derive(Debug, Clone)]
pub(crate) struct RawChunk {
    pub(crate) uncompressed_size: u64,
    pub(crate) crc: u32,
    pub(crate) compression: &'static str,
    /// As declared; the bytes there are may be more or fewer.
    pub(crate) compressed_size: u64,
    pub(crate) compressed: Vec<u8>,
}

impl RawChunk {
    /// An honest chunk of `records`.
    pub(crate) fn of(compression: &'static str, records: &[u8]) -> Self {
        let compressed = match compression {
            "zstd" => zstd::bulk::compress(records, 3).unwrap(),
            "lz4" => lz4(records),
            _ => records.to_vec(),
        };
        Self {
            uncompressed_size: records.len() as u64,
            crc: crc32fast::hash(records),
            compression,
            compressed_size: compressed.len() as u64,
            compressed,
        }
    }

    pub(crate) fn record(&self) -> Vec<u8> {
        record(op::CHUNK, &self.body())
    }

    pub(crate) fn body(&self) -> Vec<u8> {
        let mut body = vec![0; 16];
        body.extend(self.uncompressed_size.to_le_bytes());
        body.extend(self.crc.to_le_bytes());
        text(&mut body, self.compression);
        body.extend(self.compressed_size.to_le_bytes());
        body.extend(&self.compressed);
        body
    }
}

/// An LZ4 frame.
pub(crate) fn lz4(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A whole file of these records of the data section, whose CRC is `Some` or said to be not available.
pub(crate) fn file_with(data: &[Vec<u8>], summary: &[Vec<u8>], with_crc: bool) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(data.concat());
    let crc = if with_crc { crc32fast::hash(&bytes) } else { 0 };
    bytes.extend(record(op::DATA_END, &crc.to_le_bytes()));
    bytes.extend(summary.concat());
    bytes.extend(record(op::FOOTER, &[0; 20]));
    bytes.extend(MAGIC);
    bytes
}

/// A whole file of these records of the data section, with its CRC.
pub(crate) fn file(data: &[Vec<u8>]) -> Vec<u8> {
    file_with(data, &[], true)
}

/// A record of the outer loop of a good file: its opcode, where it begins and where it ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct At {
    pub(crate) opcode: u8,
    pub(crate) start: usize,
    pub(crate) end: usize,
}

/// All records of a good file.
pub(crate) fn walk(bytes: &[u8]) -> Vec<At> {
    let (mut start, mut found) = (MAGIC.len(), Vec::new());
    while start + HEAD <= bytes.len() && !bytes[start..].starts_with(MAGIC) {
        let length = u64::from_le_bytes(bytes[start + 1..start + HEAD].try_into().unwrap());
        let end = start + HEAD + length as usize;
        found.push(At {
            opcode: bytes[start],
            start,
            end,
        });
        start = end;
    }
    found
}

/// Channel of each message that can be read of the first `cut` bytes of a good file: all of the whole records, and of
/// the record that is cut what its decompressor gives.
pub(crate) fn messages_before(bytes: &[u8], records: &[At], cut: usize) -> Vec<u16> {
    let mut found = Vec::new();
    for at in records.iter().filter(|at| at.start < cut) {
        let is_whole = at.end <= cut;
        let body = bytes
            .get(at.start + HEAD..at.end.min(cut))
            .unwrap_or_default();
        match at.opcode {
            op::MESSAGE if is_whole => found.push(u16::from_le_bytes([body[0], body[1]])),
            op::CHUNK => found.extend(messages_of_chunk(body)),
            _ => {}
        }
    }
    found
}

fn messages_of_chunk(body: &[u8]) -> Vec<u16> {
    const NAME_AT: usize = 28;
    let Some(len) = body.get(NAME_AT..NAME_AT + 4) else {
        return Vec::new();
    };
    let len = u32::from_le_bytes(len.try_into().unwrap()) as usize;
    let Some(compression) = body.get(NAME_AT + 4..NAME_AT + 4 + len) else {
        return Vec::new();
    };
    let compressed = body.get(NAME_AT + 12 + len..).unwrap_or_default();
    let mut records = Vec::new();
    match compression {
        b"zstd" => {
            let mut decoder = zstd::stream::read::Decoder::new(compressed).unwrap();
            // Ends with an error where the chunk is cut.
            let _cut = decoder.read_to_end(&mut records);
        }
        b"lz4" => {
            let mut decoder = lz4_flex::frame::FrameDecoder::new(compressed);
            let _cut = decoder.read_to_end(&mut records);
        }
        _ => records.extend(compressed),
    }
    let (mut at, mut found) = (0, Vec::new());
    while at + HEAD <= records.len() {
        let length = u64::from_le_bytes(records[at + 1..at + HEAD].try_into().unwrap()) as usize;
        let end = at + HEAD + length;
        if end > records.len() {
            break;
        }
        if records[at] == op::MESSAGE {
            found.push(u16::from_le_bytes([
                records[at + HEAD],
                records[at + HEAD + 1],
            ]));
        }
        at = end;
    }
    found
}
