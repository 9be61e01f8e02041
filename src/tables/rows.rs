//! Episodes and recordings to Arrow columns. Pure; any thread may build a batch.

use std::sync::Arc;

use arrow::array::RecordBatch;

use super::schema::Table;
use crate::model::{Episode, JointExtraction, JointMode, Outcome, RecordingRow, Series};

mod columns;
mod episodes;
mod recordings;
mod segments;
mod steps;

/// Rows of the four tables that belong together.
#[derive(Debug, Clone)]
pub struct Batches {
    pub(super) segments: RecordBatch,
    pub(super) steps: Option<RecordBatch>,
    pub(super) episodes: RecordBatch,
    pub(super) recordings: RecordBatch,
    n_steps: u64,
}

impl Batches {
    /// Steps of its episodes.
    pub(super) fn n_steps(&self) -> u64 {
        self.n_steps
    }

    /// The rows of one table; `None` for steps that are not written.
    pub fn table(&self, table: Table) -> Option<&RecordBatch> {
        match table {
            Table::Segments => Some(&self.segments),
            Table::Steps => self.steps.as_ref(),
            Table::Episodes => Some(&self.episodes),
            Table::Recordings => Some(&self.recordings),
        }
    }
}

/// Collects the rows of consecutive episodes and recordings, in the order in which they are to stand.
pub struct RowsBuilder {
    mode: JointMode,
    segments: segments::SegmentRows,
    steps: Option<steps::StepRows>,
    episodes: episodes::EpisodeRows,
    recordings: recordings::RecordingRows,
    n_steps: u64,
}

impl RowsBuilder {
    /// Without `with_steps`, no per-step rows are made.
    pub fn new(mode: JointMode, with_steps: bool) -> Self {
        Self {
            mode,
            segments: segments::SegmentRows::default(),
            steps: with_steps.then(steps::StepRows::default),
            episodes: episodes::EpisodeRows::default(),
            recordings: recordings::RecordingRows::default(),
            n_steps: 0,
        }
    }

    /// Appends all rows of one episode.
    pub fn append_episode(&mut self, episode: &Episode, outcome: &Outcome) {
        let joints: &[JointExtraction] = match outcome {
            Outcome::Extracted(extraction) => &extraction.joints,
            Outcome::TooShort { .. } => &[],
        };
        for (index, joint) in joints.iter().enumerate() {
            self.segments
                .append(episode, &JointKey::new(self.mode, episode, index), joint);
        }
        if let Some(steps) = &mut self.steps {
            let n_joints = match self.mode {
                JointMode::Each => episode.actions.n_columns(),
                JointMode::Together => 1,
            };
            let state: Option<&Series> = match outcome {
                Outcome::Extracted(extraction) => Some(&extraction.state),
                Outcome::TooShort { .. } => None,
            };
            for index in 0..n_joints {
                steps.append(
                    episode,
                    &JointKey::new(self.mode, episode, index),
                    joints.get(index).zip(state),
                );
            }
        }
        self.episodes.append(episode, outcome, joints);
        self.n_steps += episode.n_steps() as u64;
    }

    /// Appends the row of one recording.
    pub fn append_recording(&mut self, row: &RecordingRow) {
        self.recordings.append(row);
    }

    /// The columns.
    pub fn finish(self) -> Batches {
        Batches {
            segments: self.segments.finish(),
            steps: self.steps.map(steps::StepRows::finish),
            episodes: self.episodes.finish(),
            recordings: self.recordings.finish(),
            n_steps: self.n_steps,
        }
    }
}

/// Which joint a row is about.
struct JointKey {
    mode: JointMode,
    index: usize,
    /// −1 for all together.
    number: i32,
    name: Option<Arc<str>>,
}

impl JointKey {
    fn new(mode: JointMode, episode: &Episode, index: usize) -> Self {
        Self {
            mode,
            index,
            number: mode.joint_number(index),
            name: episode.joint_name(mode, index).cloned(),
        }
    }
}

/// Counts and indices of an episode: more than 2^31 steps do not fit in memory.
fn int32(n: usize) -> i32 {
    i32::try_from(n).unwrap_or(i32::MAX)
}

fn int64(n: u64) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}
