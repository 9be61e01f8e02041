//! Rows of `episodes`.

use std::sync::Arc;

use arrow::array::{
    Float64Builder, Int32Builder, Int64Builder, RecordBatch, StringBuilder,
    TimestampNanosecondBuilder,
};

use super::super::schema::Table;
use super::columns::{EpisodeKeyColumns, batch, timestamps};
use super::{int32, int64};
use crate::model::{Episode, EpisodeStatus, JointExtraction, Outcome};

#[derive(Default)]
pub(super) struct EpisodeRows {
    key: EpisodeKeyColumns,
    env_id: StringBuilder,
    status: StringBuilder,
    reason: StringBuilder,
    n_steps: Int32Builder,
    n_joints: Int32Builder,
    n_state_dims: Int32Builder,
    start_time: TimestampNanosecondBuilder,
    end_time: TimestampNanosecondBuilder,
    episode_return: Float64Builder,
    n_segments: Int32Builder,
    mean_segment_steps: Float64Builder,
    n_dropped_steps: Int64Builder,
}

impl EpisodeRows {
    pub(super) fn append(
        &mut self,
        episode: &Episode,
        outcome: &Outcome,
        joints: &[JointExtraction],
    ) {
        self.key.append_n(&episode.key, 1);
        self.env_id.append_option(episode.env_id.as_deref());
        self.status
            .append_value(EpisodeStatus::of(episode, outcome).as_str());
        self.reason.append_option(reason(episode, outcome));
        self.n_steps.append_value(int32(episode.n_steps()));
        self.n_joints
            .append_value(int32(episode.actions.n_columns()));
        self.n_state_dims
            .append_value(int32(episode.states.n_columns()));
        let times = episode.times.as_ref();
        self.start_time
            .append_option(times.and_then(|t| t.first().copied()));
        self.end_time
            .append_option(times.and_then(|t| t.last().copied()));
        self.episode_return
            .append_option(episode.reward_sum(0..episode.n_steps()));
        let n_segments: usize = joints.iter().map(|j| j.segments.len()).sum();
        let n_steps: usize = joints
            .iter()
            .flat_map(|j| &j.segments)
            .map(|s| s.end_step - s.start_step)
            .sum();
        self.n_segments.append_value(int32(n_segments));
        self.mean_segment_steps
            .append_option((n_segments > 0).then(|| n_steps as f64 / n_segments as f64));
        self.n_dropped_steps
            .append_value(int64(episode.n_dropped_steps));
    }

    pub(super) fn finish(mut self) -> RecordBatch {
        let mut columns = self.key.finish();
        for column in [&mut self.env_id, &mut self.status, &mut self.reason] {
            columns.push(Arc::new(column.finish()));
        }
        for column in [
            &mut self.n_steps,
            &mut self.n_joints,
            &mut self.n_state_dims,
        ] {
            columns.push(Arc::new(column.finish()));
        }
        columns.push(timestamps(&mut self.start_time));
        columns.push(timestamps(&mut self.end_time));
        columns.push(Arc::new(self.episode_return.finish()));
        columns.push(Arc::new(self.n_segments.finish()));
        columns.push(Arc::new(self.mean_segment_steps.finish()));
        columns.push(Arc::new(self.n_dropped_steps.finish()));
        batch(Table::Episodes, columns)
    }
}

fn reason(episode: &Episode, outcome: &Outcome) -> Option<String> {
    match (&episode.incomplete, outcome) {
        (Some(incomplete), _) => Some(incomplete.reason.clone()),
        (None, Outcome::TooShort { min_steps }) => Some(format!(
            "{} steps, where the window needs {min_steps}",
            episode.n_steps()
        )),
        (None, Outcome::Extracted(_)) => None,
    }
}
