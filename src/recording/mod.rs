//! Reads one MCAP recording as episodes, a bounded amount at a time.
//!
//! ```text
//! open ──> records ──> chunk ──> ingest ──> decode ──> episodes ──> Episode
//!          (offsets,   (inflate, (channels, (one Row   (open_episode:
//!           limits)     CRC)      counts)    a step)    order, bad steps)
//! ```
//!
//! The summary and the index are never believed over the data: nothing here reads them. One chunk is the unit of loss.

mod channels;
mod chunk;
mod columns;
mod decode;
mod episodes;
mod error;
mod ingest;
mod limits;
mod metadata;
mod open;
mod open_episode;
mod reader;
mod records;
mod sniff;
mod tally;
mod wire;

pub use error::RecordingError;
pub use limits::{
    DEFAULT_MAX_CHUNK, DEFAULT_MAX_EPISODE, DEFAULT_MAX_OPEN_EPISODES, DEFAULT_MAX_RECORD, Limits,
    MAX_DEPTH, MAX_VECTOR_WIDTH,
};
pub use reader::{ReadOptions, RecordingReader};
