//! Bounds on what a file may make us allocate, checked before every allocation. All have a command line flag but the
//! last three.

/// Largest record that is looked into, bytes (`--max-record`).
pub const DEFAULT_MAX_RECORD: u64 = 256 << 20;

/// Largest size of a chunk once inflated, bytes (`--max-chunk`).
pub const DEFAULT_MAX_CHUNK: u64 = 256 << 20;

/// Largest episode in memory, bytes (`--max-episode`).
pub const DEFAULT_MAX_EPISODE: u64 = 4 << 30;

/// Most episodes that are open at a time in one recording (`--max-open-episodes`).
pub const DEFAULT_MAX_OPEN_EPISODES: usize = 64;

/// Most values in the action or the state of one step.
pub const MAX_VECTOR_WIDTH: usize = 1 << 20;

/// Values of one recording that are held back to put messages in the order of time, bytes.
pub(crate) const REORDER_BYTES: u64 = 32 << 20;

/// Deepest nesting of a message that is walked; `serde_json` has the same limit built in.
pub const MAX_DEPTH: usize = 128;

/// The limits that a user can set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// See [`DEFAULT_MAX_RECORD`].
    pub max_record: u64,
    /// See [`DEFAULT_MAX_CHUNK`].
    pub max_chunk: u64,
    /// See [`DEFAULT_MAX_EPISODE`].
    pub max_episode: u64,
    /// See [`DEFAULT_MAX_OPEN_EPISODES`].
    pub max_open_episodes: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_record: DEFAULT_MAX_RECORD,
            max_chunk: DEFAULT_MAX_CHUNK,
            max_episode: DEFAULT_MAX_EPISODE,
            max_open_episodes: DEFAULT_MAX_OPEN_EPISODES,
        }
    }
}
