//! Reads one MCAP recording as episodes, a bounded amount at a time.
//!
//! ```text
//! scan ──> ingest ──> source ──> timeline ──────────> episodes ──> Episode
//! (records, (plan,     (decode:   (order of time,      (open_episode:
//!  chunks,   channels,  one Row    clock of the         order, bad steps)
//!  CRC)      counts)    a message) actions)
//! ```
//!
//! The summary and the index are never believed over the data: nothing here reads them. One chunk is the unit of loss.

mod ahead;
mod align;
mod channels;
mod chunk;
mod closed_ids;
mod columns;
mod decode;
mod decoded;
mod episodes;
mod error;
mod growth;
mod ingest;
mod inspect;
mod layout;
mod limits;
mod metadata;
mod names;
mod open;
mod open_episode;
mod options;
mod plan;
mod reader;
mod records;
mod rescue;
mod rosbag2;
mod scan;
mod segments;
mod selector;
mod sniff;
mod source;
mod step;
mod survey;
mod tally;
mod timeline;
mod wire;

pub use error::RecordingError;
pub use growth::{Growth, Start, is_whole_zst};
pub use inspect::{Choice, FieldInspection, Inspection, TopicInspection, inspect};
pub use layout::quoted;
pub use limits::{
    DEFAULT_MAX_CHUNK, DEFAULT_MAX_EPISODE, DEFAULT_MAX_OPEN_EPISODES, DEFAULT_MAX_RECORD, Limits,
    MAX_DEPTH, MAX_VECTOR_WIDTH,
};
pub use options::{
    Align, Clock, EpisodeOption, EpisodeOptionError, OnDamage, ReadOptions, format_seconds,
    parse_seconds,
};
pub use reader::RecordingReader;
pub use rosbag2::{METADATA_FILE as ROSBAG2_METADATA, files as rosbag2_files};
pub use selector::{Selector, SelectorError};
