//! Rows of `recordings`.

use std::sync::Arc;

use arrow::array::{
    ArrayRef, Int64Builder, ListBuilder, RecordBatch, StringBuilder, StructBuilder,
};

use super::super::schema::{Table, cause_fields, cause_item};
use super::columns::batch;
use super::int64;
use crate::model::{Cause, RecordingRow};

pub(super) struct RecordingRows {
    recording: StringBuilder,
    bytes: Int64Builder,
    status: StringBuilder,
    /// reason, `env_id`, encoding, `action_selector`, `state_selector`, `episode_rule`, clock, align
    texts: [StringBuilder; 8],
    /// `n_messages`, used, refused
    messages: [Int64Builder; 3],
    causes: ListBuilder<StructBuilder>,
    n_episodes: Int64Builder,
}

impl Default for RecordingRows {
    fn default() -> Self {
        Self {
            recording: StringBuilder::new(),
            bytes: Int64Builder::new(),
            status: StringBuilder::new(),
            texts: std::array::from_fn(|_| StringBuilder::new()),
            messages: std::array::from_fn(|_| Int64Builder::new()),
            causes: ListBuilder::new(StructBuilder::from_fields(cause_fields(), 0))
                .with_field(cause_item()),
            n_episodes: Int64Builder::new(),
        }
    }
}

impl RecordingRows {
    pub(super) fn append(&mut self, row: &RecordingRow) {
        self.recording.append_value(&*row.recording);
        self.bytes.append_value(int64(row.bytes));
        self.status.append_value(row.status.as_str());
        let texts = [
            row.reason.as_deref(),
            row.env_id.as_deref(),
            row.encoding.as_deref(),
            row.action_selector.as_deref(),
            row.state_selector.as_deref(),
            row.episode_rule.as_deref(),
            row.clock.as_deref(),
            row.align.as_deref(),
        ];
        for (builder, text) in self.texts.iter_mut().zip(texts) {
            builder.append_option(text);
        }
        for (builder, n) in self.messages.iter_mut().zip([
            row.n_messages,
            row.n_messages_used,
            row.n_messages_refused,
        ]) {
            builder.append_value(int64(n));
        }
        for cause in &row.causes {
            self.cause(cause);
        }
        self.causes.append(true);
        self.n_episodes.append_value(int64(row.n_episodes));
    }

    fn cause(&mut self, cause: &Cause) {
        let builder = self.causes.values();
        if let Some(text) = builder.field_builder::<StringBuilder>(0) {
            text.append_value(&cause.cause);
        }
        for (index, n) in [(1, cause.count), (2, cause.first_offset)] {
            if let Some(number) = builder.field_builder::<Int64Builder>(index) {
                number.append_value(int64(n));
            }
        }
        builder.append(true);
    }

    pub(super) fn finish(mut self) -> RecordBatch {
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.recording.finish()),
            Arc::new(self.bytes.finish()),
            Arc::new(self.status.finish()),
        ];
        columns.extend(
            self.texts
                .iter_mut()
                .map(|text| Arc::new(text.finish()) as ArrayRef),
        );
        columns.extend(
            self.messages
                .iter_mut()
                .map(|n| Arc::new(n.finish()) as ArrayRef),
        );
        columns.push(Arc::new(self.causes.finish()));
        columns.push(Arc::new(self.n_episodes.finish()));
        batch(Table::Recordings, columns)
    }
}
