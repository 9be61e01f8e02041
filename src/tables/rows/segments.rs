//! Rows of `segments`.

use std::sync::Arc;

use arrow::array::{
    Float64Builder, Int32Builder, ListBuilder, RecordBatch, TimestampNanosecondBuilder,
};

use super::super::schema::{Table, action_item};
use super::columns::{JointKeyColumns, batch, timestamps};
use super::{JointKey, int32};
use crate::model::{Episode, JointExtraction, JointMode, Segment};

pub(super) struct SegmentRows {
    key: JointKeyColumns,
    segment: Int32Builder,
    start_step: Int32Builder,
    end_step: Int32Builder,
    n_steps: Int32Builder,
    start_time: TimestampNanosecondBuilder,
    end_time: TimestampNanosecondBuilder,
    state_change_sum: Float64Builder,
    state_change_peak: Float64Builder,
    state_change_rank: Int32Builder,
    reward_sum: Float64Builder,
    actions: ListBuilder<Float64Builder>,
}

impl Default for SegmentRows {
    fn default() -> Self {
        Self {
            key: JointKeyColumns::default(),
            segment: Int32Builder::new(),
            start_step: Int32Builder::new(),
            end_step: Int32Builder::new(),
            n_steps: Int32Builder::new(),
            start_time: TimestampNanosecondBuilder::new(),
            end_time: TimestampNanosecondBuilder::new(),
            state_change_sum: Float64Builder::new(),
            state_change_peak: Float64Builder::new(),
            state_change_rank: Int32Builder::new(),
            reward_sum: Float64Builder::new(),
            actions: ListBuilder::new(Float64Builder::new()).with_field(action_item()),
        }
    }
}

impl SegmentRows {
    pub(super) fn append(&mut self, episode: &Episode, joint: &JointKey, found: &JointExtraction) {
        self.key.append_n(&episode.key, joint, found.segments.len());
        for (number, segment) in found.segments.iter().enumerate() {
            let Segment {
                start_step,
                end_step,
                state_change_sum,
                state_change_peak,
                state_change_rank,
            } = *segment;
            self.segment.append_value(int32(number));
            self.start_step.append_value(int32(start_step));
            self.end_step.append_value(int32(end_step));
            self.n_steps.append_value(int32(end_step - start_step));
            self.start_time
                .append_option(episode.times.as_ref().map(|t| t[start_step]));
            self.end_time
                .append_option(episode.times.as_ref().map(|t| t[end_step - 1]));
            self.state_change_sum.append_value(state_change_sum);
            self.state_change_peak.append_value(state_change_peak);
            self.state_change_rank
                .append_value(int32(state_change_rank));
            self.reward_sum
                .append_option(episode.reward_sum(start_step..end_step));
            self.actions(episode, joint, start_step, end_step);
        }
    }

    fn actions(&mut self, episode: &Episode, joint: &JointKey, start_step: usize, end_step: usize) {
        let values = self.actions.values();
        match joint.mode {
            JointMode::Each => {
                values.append_slice(&episode.actions.column(joint.index)[start_step..end_step]);
            }
            JointMode::Together => {
                for step in start_step..end_step {
                    for column in episode.actions.iter() {
                        values.append_value(column[step]);
                    }
                }
            }
        }
        self.actions.append(true);
    }

    pub(super) fn finish(mut self) -> RecordBatch {
        let mut columns = self.key.finish();
        for column in [
            &mut self.segment,
            &mut self.start_step,
            &mut self.end_step,
            &mut self.n_steps,
        ] {
            columns.push(Arc::new(column.finish()));
        }
        columns.push(timestamps(&mut self.start_time));
        columns.push(timestamps(&mut self.end_time));
        columns.push(Arc::new(self.state_change_sum.finish()));
        columns.push(Arc::new(self.state_change_peak.finish()));
        columns.push(Arc::new(self.state_change_rank.finish()));
        columns.push(Arc::new(self.reward_sum.finish()));
        columns.push(Arc::new(self.actions.finish()));
        batch(Table::Segments, columns)
    }
}
