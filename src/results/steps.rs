//! The steps of one episode, found by where they stand.
//!
//! Parts of one position hold the same episodes in each table, in the same order. So the rows of `episodes` before an
//! episode say how many rows of `steps` come before its own, and only its pages are read, however many there are.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use arrow::array::{Array, AsArray, RecordBatch};
use arrow::datatypes::{Float64Type, Int32Type, TimestampNanosecondType};
use parquet::arrow::arrow_reader::RowSelection;

use super::columns::Columns;
use super::error::ResultsError;
use super::part::Part;
use super::rows::EpisodeRow;
use crate::model::Series;
use crate::tables::Table;

/// Rows that are read at a time.
const BATCH_ROWS: usize = 8192;

/// What stands before an episode: its part, and the steps of the episodes before it in that part.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct StepsBefore {
    part: usize,
    steps: u64,
    joint_steps: u64,
}

impl StepsBefore {
    pub(super) fn begin_part(&mut self, part: usize) {
        *self = Self {
            part,
            steps: 0,
            joint_steps: 0,
        };
    }

    pub(super) fn add(&mut self, episode: &EpisodeRow) {
        let n_steps = episode.n_steps as u64;
        self.steps = self.steps.saturating_add(n_steps);
        let joint_steps = n_steps.saturating_mul(episode.n_joints as u64);
        self.joint_steps = self.joint_steps.saturating_add(joint_steps);
    }
}

/// The steps of one episode, each series of length `n_steps`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EpisodeSteps {
    /// Number of steps.
    pub n_steps: usize,
    /// Nanoseconds since the Unix epoch; `None` where no clock ran.
    pub times: Option<Vec<i64>>,
    /// Of the state; measure and change are empty for an episode that is too short.
    pub state: Series,
    /// One entry a joint, or one for all together.
    pub joints: Vec<JointSteps>,
}

/// The steps of one joint.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointSteps {
    /// 0, 1, …; −1 for all together.
    pub joint: i32,
    /// Its name.
    pub joint_name: Option<Arc<str>>,
    /// Raw values; empty for joints together.
    pub actions: Vec<f64>,
    /// Of the action; measure and change are empty for an episode that is too short.
    pub action: Series,
    /// True where action and state change nearby.
    pub correlated: Vec<bool>,
    /// True at the last step of each run of correlated steps.
    pub boundary: Vec<bool>,
    /// The composite action that a step is in; −1 outside.
    pub segment: Vec<i32>,
}

/// Reads the steps of episodes; fastest in the order of the table.
pub struct StepsReader {
    parts: Vec<PathBuf>,
    is_together: bool,
    open: Option<(usize, Part)>,
}

impl StepsReader {
    pub(super) fn new(parts: Vec<PathBuf>, is_together: bool) -> Self {
        Self {
            parts,
            is_together,
            open: None,
        }
    }

    /// The steps of an episode of the same results; `None` if there is no per-step table.
    ///
    /// # Errors
    /// If they cannot be read, or are not where they must be.
    pub fn read(&mut self, episode: &EpisodeRow) -> Result<Option<EpisodeSteps>, ResultsError> {
        let before = episode.before;
        let Some(path) = self.parts.get(before.part) else {
            return Ok(None);
        };
        let part = match &mut self.open {
            Some((index, part)) if *index == before.part => part,
            open => {
                let part = Part::open(Table::Steps, path, true)?;
                &mut open.insert((before.part, part)).1
            }
        };
        let (first, n_joints) = if self.is_together {
            (before.steps, 1)
        } else {
            (before.joint_steps, episode.n_joints)
        };
        let n_rows = (episode.n_steps as u64).saturating_mul(n_joints as u64);
        let missing = || {
            let what = format!(
                "it has {} rows, where the steps of {} end with row {}",
                part.n_rows(),
                name_of(episode),
                first.saturating_add(n_rows)
            );
            ResultsError::unexpected(part.path(), what)
        };
        let range = first..first.checked_add(n_rows).ok_or_else(missing)?;
        if range.end > part.n_rows() {
            return Err(missing());
        }
        read_rows(part, &range, episode, n_joints).map(Some)
    }
}

fn name_of(episode: &EpisodeRow) -> String {
    let key = &episode.key;
    format!("episode {} of {}", key.episode, key.recording)
}

fn read_rows(
    part: &Part,
    range: &Range<u64>,
    episode: &EpisodeRow,
    n_joints: usize,
) -> Result<EpisodeSteps, ResultsError> {
    let parquet = || ResultsError::parquet(part.path());
    let row = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
    let selection = RowSelection::from_consecutive_ranges(
        std::iter::once(row(range.start)..row(range.end)),
        row(part.n_rows()),
    );
    let batches = part
        .reader(&[])?
        .with_row_selection(selection)
        .with_batch_size(BATCH_ROWS)
        .build()
        .map_err(parquet())?;
    let mut steps = EpisodeSteps {
        n_steps: episode.n_steps,
        ..EpisodeSteps::default()
    };
    let mut n_rows = 0;
    for batch in batches {
        let batch = batch.map_err(|e| parquet()(e.into()))?;
        // A batch may hold the end of one joint and the beginning of the next.
        let mut start = 0;
        while start < batch.num_rows() {
            let in_joint = n_rows % episode.n_steps;
            let n = (episode.n_steps - in_joint).min(batch.num_rows() - start);
            append(&mut steps, &batch.slice(start, n), episode, in_joint)
                .map_err(|what| ResultsError::unexpected(part.path(), what))?;
            start += n;
            n_rows += n;
        }
    }
    if n_rows != episode.n_steps * n_joints {
        let what = format!("the steps of {} end early", name_of(episode));
        return Err(ResultsError::unexpected(part.path(), what));
    }
    Ok(steps)
}

/// Appends rows of one joint, of which `in_joint` rows are there.
fn append(
    steps: &mut EpisodeSteps,
    rows: &RecordBatch,
    episode: &EpisodeRow,
    in_joint: usize,
) -> Result<(), String> {
    let columns = Columns(rows);
    for row in [0, rows.num_rows() - 1] {
        check(&columns, row, episode, in_joint + row)?;
    }
    if in_joint == 0 {
        steps.joints.push(JointSteps {
            joint: columns.int32("joint", 0),
            joint_name: columns.text("joint_name", 0).map(Arc::from),
            ..JointSteps::default()
        });
    }
    if steps.joints.len() == 1 {
        append_times(&mut steps.times, rows, in_joint == 0);
        append_floats(&mut steps.state.measure, rows, "state_measure");
        append_floats(&mut steps.state.change, rows, "state_change");
        append_flags(&mut steps.state.mask, rows, "state_mask");
    }
    let Some(joint) = steps.joints.last_mut() else {
        return Ok(());
    };
    append_floats(&mut joint.actions, rows, "action");
    append_floats(&mut joint.action.measure, rows, "action_measure");
    append_floats(&mut joint.action.change, rows, "action_change");
    append_flags(&mut joint.action.mask, rows, "action_mask");
    append_flags(&mut joint.correlated, rows, "correlated");
    append_flags(&mut joint.boundary, rows, "boundary");
    if let Some(segment) = rows
        .column_by_name("segment")
        .and_then(|c| c.as_primitive_opt::<Int32Type>())
    {
        joint.segment.extend_from_slice(segment.values());
    }
    Ok(())
}

/// Is a row the one that it must be by its place?
fn check(
    columns: &Columns<'_>,
    row: usize,
    episode: &EpisodeRow,
    step: usize,
) -> Result<(), String> {
    let key = &episode.key;
    let found = columns.int32("step", row);
    let is_it = columns.text("recording", row) == Some(&*key.recording)
        && columns.int64("episode", row) == key.episode
        && columns.text("episode_id", row) == key.episode_id.as_deref()
        && usize::try_from(found) == Ok(step);
    if is_it {
        return Ok(());
    }
    Err(format!(
        "step {found} of episode {} of {} stands where step {step} of {} is expected",
        columns.int64("episode", row),
        columns.text("recording", row).unwrap_or_default(),
        name_of(episode)
    ))
}

/// Appends numbers; nothing where they are null, as they are for a whole episode.
fn append_floats(values: &mut Vec<f64>, rows: &RecordBatch, name: &str) {
    let column = rows
        .column_by_name(name)
        .and_then(|c| c.as_primitive_opt::<Float64Type>());
    if let Some(column) = column.filter(|c| c.null_count() == 0) {
        values.extend_from_slice(column.values());
    }
}

fn append_flags(flags: &mut Vec<bool>, rows: &RecordBatch, name: &str) {
    if let Some(column) = rows.column_by_name(name).and_then(|c| c.as_boolean_opt()) {
        flags.extend(column.values().iter());
    }
}

fn append_times(times: &mut Option<Vec<i64>>, rows: &RecordBatch, is_first: bool) {
    let column = rows
        .column_by_name("time")
        .and_then(|c| c.as_primitive_opt::<TimestampNanosecondType>())
        .filter(|c| c.null_count() == 0);
    match column {
        Some(column) if is_first || times.is_some() => times
            .get_or_insert_default()
            .extend_from_slice(column.values()),
        _ => *times = None,
    }
}
