//! Why a recording cannot be read at all. What is wrong with single messages is counted instead (see `tally.rs`).

use std::io;

use thiserror::Error;

/// A recording that gives nothing.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be opened or read.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// Not a regular file.
    #[error("is {0}, not a file")]
    NotAFile(&'static str),
    /// Something else under the name of a recording.
    #[error("is not an MCAP recording: it is {0}")]
    NotMcap(String),
    /// An MCAP file without the topics or fields that are needed.
    #[error("{wanted}; {found}")]
    NothingToRead {
        /// What was looked for.
        wanted: String,
        /// The topics with encodings and message counts.
        found: String,
    },
    /// A topic in an encoding that is not decoded.
    #[error("topic {topic:?} has encoding {encoding:?}, which is not supported ({supported} are)")]
    Encoding {
        /// The topic.
        topic: String,
        /// Its message encoding.
        encoding: String,
        /// What is.
        supported: &'static str,
    },
    /// A selector that does not fit the messages of its topic, or a schema that cannot be used.
    #[error("topic {topic:?}: {what}")]
    Plan {
        /// The topic.
        topic: String,
        /// What is wrong, and what there is.
        what: String,
    },
    /// More than one way to read it; the text holds the flags of each.
    #[error("several readings are possible; say which:\n{0}")]
    Ambiguous(String),
    /// Messages of one topic carry different names: the reader begins again, knowing them all.
    #[error("messages of one topic carry different names")]
    OtherNames,
    /// It is still being written, and must be read from beginning to end to tell how.
    #[error("how it is to be read shows only when it is complete")]
    NotYet,
    /// `--on-damage fail`.
    #[error("is damaged: {0}")]
    Damaged(String),
    /// One episode alone is more than may be held in memory.
    #[error("episode {episode} is larger than {limit} bytes (--max-episode)")]
    EpisodeTooLarge {
        /// The logged id, or the order of appearance.
        episode: String,
        /// The limit, bytes.
        limit: u64,
    },
}
