//! The inside of the MCAP records that we need, read from a slice with every length checked before it is used.
//!
//! The `mcap` crate's own parser allocates what a length field declares before it looks at the data, and panics on a
//! short attachment; these few records are all that the reader wants. Layouts: <https://mcap.dev/spec>.

use std::collections::BTreeMap;

use thiserror::Error;

/// A record that does not hold what its kind must hold.
#[derive(Debug, Error, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WireError {
    #[error("ends in the middle of its {0}")]
    Short(&'static str),
    #[error("its {0} is not UTF-8")]
    NotUtf8(&'static str),
}

/// A slice that is consumed from the front.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cursor<'a> {
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], WireError> {
        let (head, rest) = self
            .rest
            .split_first_chunk::<N>()
            .ok_or(WireError::Short(what))?;
        self.rest = rest;
        Ok(*head)
    }

    pub(crate) fn u8(&mut self, what: &'static str) -> Result<u8, WireError> {
        self.array::<1>(what).map(|[b]| b)
    }

    pub(crate) fn u16(&mut self, what: &'static str) -> Result<u16, WireError> {
        self.array(what).map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self, what: &'static str) -> Result<u32, WireError> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self, what: &'static str) -> Result<u64, WireError> {
        self.array(what).map(u64::from_le_bytes)
    }

    pub(crate) fn bytes(&mut self, len: u64, what: &'static str) -> Result<&'a [u8], WireError> {
        let len = usize::try_from(len).ok().ok_or(WireError::Short(what))?;
        let (head, rest) = self
            .rest
            .split_at_checked(len)
            .ok_or(WireError::Short(what))?;
        self.rest = rest;
        Ok(head)
    }

    pub(crate) fn str(&mut self, what: &'static str) -> Result<&'a str, WireError> {
        let len = self.u32(what)?;
        std::str::from_utf8(self.bytes(u64::from(len), what)?)
            .ok()
            .ok_or(WireError::NotUtf8(what))
    }

    fn map(&mut self, what: &'static str) -> Result<BTreeMap<String, String>, WireError> {
        let len = self.u32(what)?;
        let mut inner = Cursor::new(self.bytes(u64::from(len), what)?);
        let mut map = BTreeMap::new();
        while !inner.rest.is_empty() {
            let key = inner.str(what)?.to_owned();
            map.insert(key, inner.str(what)?.to_owned());
        }
        Ok(map)
    }
}

/// A Schema record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Schema {
    pub(crate) id: u16,
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) data: Vec<u8>,
}

impl Schema {
    pub(crate) fn parse(body: &[u8]) -> Result<Self, WireError> {
        let mut c = Cursor::new(body);
        let id = c.u16("id")?;
        let name = c.str("name")?.to_owned();
        let encoding = c.str("encoding")?.to_owned();
        let len = c.u32("data length")?;
        let data = c.bytes(u64::from(len), "data")?.to_vec();
        Ok(Self {
            id,
            name,
            encoding,
            data,
        })
    }
}

/// A Channel record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Channel {
    pub(crate) id: u16,
    pub(crate) schema_id: u16,
    pub(crate) topic: String,
    pub(crate) encoding: String,
    pub(crate) metadata: BTreeMap<String, String>,
}

impl Channel {
    pub(crate) fn parse(body: &[u8]) -> Result<Self, WireError> {
        let mut c = Cursor::new(body);
        Ok(Self {
            id: c.u16("id")?,
            schema_id: c.u16("schema id")?,
            topic: c.str("topic")?.to_owned(),
            encoding: c.str("message encoding")?.to_owned(),
            metadata: c.map("metadata")?,
        })
    }
}

/// A Message record, its payload borrowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Message<'a> {
    pub(crate) channel_id: u16,
    /// Nanoseconds.
    pub(crate) log_time: u64,
    /// Nanoseconds.
    pub(crate) publish_time: u64,
    pub(crate) data: &'a [u8],
}

impl<'a> Message<'a> {
    pub(crate) fn parse(body: &'a [u8]) -> Result<Self, WireError> {
        let mut c = Cursor::new(body);
        let channel_id = c.u16("channel id")?;
        let _sequence = c.u32("sequence")?;
        Ok(Self {
            channel_id,
            log_time: c.u64("log time")?,
            publish_time: c.u64("publish time")?,
            data: c.rest,
        })
    }
}

/// The head of a Chunk record, its compressed records borrowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Chunk<'a> {
    pub(crate) uncompressed_size: u64,
    /// CRC-32 of the inflated records; 0 means that the writer made none.
    pub(crate) uncompressed_crc: u32,
    pub(crate) compression: &'a str,
    /// Less than declared if the file was cut inside this chunk.
    pub(crate) compressed: &'a [u8],
    pub(crate) is_whole: bool,
}

impl<'a> Chunk<'a> {
    pub(crate) fn parse(body: &'a [u8]) -> Result<Self, WireError> {
        let mut c = Cursor::new(body);
        let _start = c.u64("start time")?;
        let _end = c.u64("end time")?;
        let uncompressed_size = c.u64("uncompressed size")?;
        let uncompressed_crc = c.u32("crc")?;
        let compression = c.str("compression")?;
        let compressed_size = c.u64("compressed size")?;
        let available = c.rest.len() as u64;
        let is_whole = compressed_size <= available;
        let compressed = c.bytes(compressed_size.min(available), "records")?;
        Ok(Self {
            uncompressed_size,
            uncompressed_crc,
            compression,
            compressed,
            is_whole,
        })
    }
}

/// The records of an inflated chunk, opcode and body; an error is the last item.
pub(crate) fn records(chunk: &[u8]) -> impl Iterator<Item = Result<(u8, &[u8]), WireError>> {
    let mut cursor = Cursor::new(chunk);
    std::iter::from_fn(move || {
        if cursor.rest().is_empty() {
            return None;
        }
        let record = (|| {
            let opcode = cursor.u8("opcode")?;
            let length = cursor.u64("length")?;
            Ok((opcode, cursor.bytes(length, "body")?))
        })();
        if record.is_err() {
            cursor = Cursor::new(&[]);
        }
        Some(record)
    })
}

/// A Metadata record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Metadata {
    pub(crate) name: String,
    pub(crate) entries: BTreeMap<String, String>,
}

impl Metadata {
    pub(crate) fn parse(body: &[u8]) -> Result<Self, WireError> {
        let mut c = Cursor::new(body);
        Ok(Self {
            name: c.str("name")?.to_owned(),
            entries: c.map("metadata")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_that_lies_is_an_error_and_allocates_nothing() {
        let mut body = vec![7, 0];
        body.extend(u32::MAX.to_le_bytes());
        body.extend(b"name");
        assert_eq!(Schema::parse(&body), Err(WireError::Short("name")));
    }

    #[test]
    fn bytes_after_the_last_field_are_ignored() {
        let mut body = vec![1, 0, 2, 0];
        for text in ["/step", "json"] {
            body.extend(u32::try_from(text.len()).unwrap().to_le_bytes());
            body.extend(text.as_bytes());
        }
        body.extend(0u32.to_le_bytes());
        body.extend(b"future fields");
        let channel = Channel::parse(&body).unwrap();
        assert_eq!(
            (channel.id, channel.schema_id, channel.topic.as_str()),
            (1, 2, "/step")
        );
    }
}
