//! Rows of `steps`, a whole column of a joint at a time.

use std::sync::Arc;

use arrow::array::{
    BooleanBuilder, Float64Builder, Int32Builder, RecordBatch, TimestampNanosecondBuilder,
};

use super::super::schema::Table;
use super::columns::{JointKeyColumns, batch, timestamps};
use super::{JointKey, int32};
use crate::model::{Episode, JointExtraction, JointMode, Series};

/// Segment of a step that is in none.
const OUTSIDE: i32 = -1;

#[derive(Default)]
pub(super) struct StepRows {
    key: JointKeyColumns,
    step: Int32Builder,
    time: TimestampNanosecondBuilder,
    action: Float64Builder,
    action_series: SeriesColumns,
    state_series: SeriesColumns,
    correlated: BooleanBuilder,
    boundary: BooleanBuilder,
    segment: Int32Builder,
}

/// Measure, change and mask of one side.
#[derive(Default)]
struct SeriesColumns {
    measure: Float64Builder,
    change: Float64Builder,
    mask: BooleanBuilder,
}

impl SeriesColumns {
    fn append(&mut self, series: Option<&Series>, n: usize) {
        if let Some(series) = series {
            self.measure.append_slice(&series.measure);
            self.change.append_slice(&series.change);
            self.mask.append_slice(&series.mask);
        } else {
            self.measure.append_nulls(n);
            self.change.append_nulls(n);
            self.mask.append_n(n, false);
        }
    }
}

impl StepRows {
    /// Appends the steps of one joint; `found` is `None` for an episode that is too short.
    pub(super) fn append(
        &mut self,
        episode: &Episode,
        joint: &JointKey,
        found: Option<(&JointExtraction, &Series)>,
    ) {
        let n = episode.n_steps();
        self.key.append_n(&episode.key, joint, n);
        self.step.extend((0..n).map(|t| Some(int32(t))));
        match &episode.times {
            Some(times) => self.time.append_slice(times),
            None => self.time.append_nulls(n),
        }
        match joint.mode {
            JointMode::Each => self
                .action
                .append_slice(episode.actions.column(joint.index)),
            JointMode::Together => self.action.append_nulls(n),
        }
        self.action_series
            .append(found.map(|(joint, _)| &joint.action), n);
        self.state_series.append(found.map(|(_, state)| state), n);
        if let Some((joint, _)) = found {
            self.marks(joint, n);
        } else {
            self.correlated.append_n(n, false);
            self.boundary.append_n(n, false);
            self.segment.append_value_n(OUTSIDE, n);
        }
    }

    fn marks(&mut self, joint: &JointExtraction, n: usize) {
        self.correlated.append_slice(&joint.correlated);
        let mut step = 0;
        for &boundary in &joint.boundaries {
            self.boundary.append_n(boundary - step, false);
            self.boundary.append_value(true);
            step = boundary + 1;
        }
        self.boundary.append_n(n - step, false);
        let mut step = 0;
        for (number, segment) in joint.segments.iter().enumerate() {
            self.segment
                .append_value_n(OUTSIDE, segment.start_step - step);
            self.segment
                .append_value_n(int32(number), segment.end_step - segment.start_step);
            step = segment.end_step;
        }
        self.segment.append_value_n(OUTSIDE, n - step);
    }

    pub(super) fn finish(mut self) -> RecordBatch {
        let mut columns = self.key.finish();
        columns.push(Arc::new(self.step.finish()));
        columns.push(timestamps(&mut self.time));
        columns.push(Arc::new(self.action.finish()));
        for mut series in [self.action_series, self.state_series] {
            columns.push(Arc::new(series.measure.finish()));
            columns.push(Arc::new(series.change.finish()));
            columns.push(Arc::new(series.mask.finish()));
        }
        columns.push(Arc::new(self.correlated.finish()));
        columns.push(Arc::new(self.boundary.finish()));
        columns.push(Arc::new(self.segment.finish()));
        batch(Table::Steps, columns)
    }
}
