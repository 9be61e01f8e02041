//! Builders of the columns that several tables share.

use std::sync::Arc;

use arrow::array::{
    ArrayRef, Int32Builder, Int64Builder, RecordBatch, StringBuilder, TimestampNanosecondBuilder,
};

use super::super::schema::Table;
use super::JointKey;
use crate::model::EpisodeKey;

/// `recording`, `episode`, `episode_id`.
#[derive(Default)]
pub(super) struct EpisodeKeyColumns {
    recording: StringBuilder,
    episode: Int64Builder,
    episode_id: StringBuilder,
}

impl EpisodeKeyColumns {
    pub(super) fn append_n(&mut self, key: &EpisodeKey, n: usize) {
        for _ in 0..n {
            self.recording.append_value(&*key.recording);
            self.episode_id.append_option(key.episode_id.as_deref());
        }
        self.episode.append_value_n(key.episode, n);
    }

    pub(super) fn finish(&mut self) -> Vec<ArrayRef> {
        vec![
            Arc::new(self.recording.finish()),
            Arc::new(self.episode.finish()),
            Arc::new(self.episode_id.finish()),
        ]
    }
}

/// The key of an episode, then `joint`, `joint_name`.
#[derive(Default)]
pub(super) struct JointKeyColumns {
    episode: EpisodeKeyColumns,
    joint: Int32Builder,
    joint_name: StringBuilder,
}

impl JointKeyColumns {
    pub(super) fn append_n(&mut self, key: &EpisodeKey, joint: &JointKey, n: usize) {
        self.episode.append_n(key, n);
        self.joint.append_value_n(joint.number, n);
        for _ in 0..n {
            self.joint_name.append_option(joint.name.as_deref());
        }
    }

    pub(super) fn finish(&mut self) -> Vec<ArrayRef> {
        let mut columns = self.episode.finish();
        columns.push(Arc::new(self.joint.finish()));
        columns.push(Arc::new(self.joint_name.finish()));
        columns
    }
}

/// A timestamp column, in UTC.
pub(super) fn timestamps(builder: &mut TimestampNanosecondBuilder) -> ArrayRef {
    Arc::new(builder.finish().with_timezone("UTC"))
}

/// Columns of one table under its schema.
pub(super) fn batch(table: Table, columns: Vec<ArrayRef>) -> RecordBatch {
    match RecordBatch::try_new(table.schema(), columns) {
        Ok(batch) => batch,
        // Only a column that does not fit the schema beside it could do this: a bug that the first test would show.
        Err(e) => unreachable!("the columns of {} fit its schema: {e}", table.name()),
    }
}
