//! Rows of the small tables, as they stand there.

use std::sync::Arc;

use super::columns::{Columns, Interner};
use super::steps::StepsBefore;
use crate::model::{EpisodeKey, EpisodeStatus, RecordingStatus, environment_of};

/// A cause for which messages were refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CauseRow {
    /// The reason.
    pub cause: String,
    /// How often.
    pub count: u64,
    /// Where first: bytes from the beginning of the file.
    pub first_offset: u64,
}

/// A row of `recordings`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingRow {
    /// Its name.
    pub recording: Arc<str>,
    /// Size of the file.
    pub bytes: u64,
    /// How it ended.
    pub status: RecordingStatus,
    /// Why it failed, or what was recovered.
    pub reason: Option<String>,
    /// The environment, if the recording says so.
    pub env_id: Option<String>,
    /// Encodings of the chosen topics.
    pub encoding: Option<String>,
    /// Where the actions were taken from.
    pub action_selector: Option<String>,
    /// Where the states were taken from.
    pub state_selector: Option<String>,
    /// Where episodes began and ended.
    pub episode_rule: Option<String>,
    /// Which time was used.
    pub clock: Option<String>,
    /// How states were put on the action's clock.
    pub align: Option<String>,
    /// Messages on the chosen topics.
    pub n_messages: u64,
    /// Those that were used.
    pub n_messages_used: u64,
    /// Those that were not.
    pub n_messages_refused: u64,
    /// Why they were not.
    pub causes: Vec<CauseRow>,
    /// Its episodes.
    pub n_episodes: u64,
}

/// A row of `episodes`.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeRow {
    /// Which.
    pub key: EpisodeKey,
    /// The environment, if the recording says so.
    pub env_id: Option<Arc<str>>,
    /// How far it was used.
    pub status: EpisodeStatus,
    /// Why it is incomplete or too short.
    pub reason: Option<String>,
    /// Steps used.
    pub n_steps: usize,
    /// Width of the action.
    pub n_joints: usize,
    /// Width of the state.
    pub n_state_dims: usize,
    /// Of the first step, nanoseconds since the Unix epoch.
    pub start_time: Option<i64>,
    /// Of the last step, nanoseconds since the Unix epoch.
    pub end_time: Option<i64>,
    /// Sum of the rewards.
    pub episode_return: Option<f64>,
    /// Composite actions, over all joints.
    pub n_segments: usize,
    /// Their mean length, steps.
    pub mean_segment_steps: Option<f64>,
    /// Steps read and not used.
    pub n_dropped_steps: u64,
    /// Where its rows in `steps` begin.
    pub(super) before: StepsBefore,
}

impl EpisodeRow {
    /// Its environment, else the folder of its recording, else the recording.
    pub fn environment(&self) -> &str {
        environment_of(self.env_id.as_deref(), &self.key.recording)
    }
}

/// A row of `segments`: a composite action.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentRow {
    /// Of which episode.
    pub key: EpisodeKey,
    /// 0, 1, …; −1 for all together.
    pub joint: i32,
    /// Its name.
    pub joint_name: Option<Arc<str>>,
    /// 0, 1, … in time within the joint.
    pub segment: usize,
    /// First step.
    pub start_step: usize,
    /// One past the last step.
    pub end_step: usize,
    /// Of the first step, nanoseconds since the Unix epoch.
    pub start_time: Option<i64>,
    /// Of the last step in it, nanoseconds since the Unix epoch.
    pub end_time: Option<i64>,
    /// Sum of the state's change over it.
    pub state_change_sum: f64,
    /// Largest change of the state in it.
    pub state_change_peak: f64,
    /// 1 for the largest sum of its joint in its episode.
    pub state_change_rank: usize,
    /// Sum of the rewards.
    pub reward_sum: Option<f64>,
    /// The joint's raw values; together: row-major, steps × joints. Empty where they were not asked for.
    pub actions: Vec<f64>,
}

impl SegmentRow {
    /// Its length in steps.
    pub fn n_steps(&self) -> usize {
        self.end_step - self.start_step
    }
}

/// What is carried from one row of a part to the next.
#[derive(Debug, Default)]
pub(super) struct Context {
    pub(super) recordings: Interner,
    pub(super) episode_ids: Interner,
    pub(super) names: Interner,
    pub(super) before: StepsBefore,
}

/// Makes a row of a table; an error says what is wrong with it.
pub(super) type MakeRow<R> = fn(&Columns<'_>, usize, &mut Context) -> Result<R, String>;

pub(super) fn recording(
    columns: &Columns<'_>,
    row: usize,
    _: &mut Context,
) -> Result<RecordingRow, String> {
    let text = |name| columns.text(name, row).map(ToOwned::to_owned);
    let count = |name| count(columns, name, row);
    let status = columns.text("status", row).unwrap_or_default();
    Ok(RecordingRow {
        recording: Arc::from(columns.text("recording", row).unwrap_or_default()),
        bytes: count("bytes")?,
        status: RecordingStatus::ALL
            .into_iter()
            .find(|s| s.as_str() == status)
            .ok_or_else(|| format!("a recording has the unknown status {status:?}"))?,
        reason: text("reason"),
        env_id: text("env_id"),
        encoding: text("encoding"),
        action_selector: text("action_selector"),
        state_selector: text("state_selector"),
        episode_rule: text("episode_rule"),
        clock: text("clock"),
        align: text("align"),
        n_messages: count("n_messages")?,
        n_messages_used: count("n_messages_used")?,
        n_messages_refused: count("n_messages_refused")?,
        causes: causes(columns, row)?,
        n_episodes: count("n_episodes")?,
    })
}

fn causes(columns: &Columns<'_>, row: usize) -> Result<Vec<CauseRow>, String> {
    let Some(batch) = columns.structs("causes", row) else {
        return Ok(Vec::new());
    };
    let causes = Columns(&batch);
    (0..batch.num_rows())
        .map(|i| {
            Ok(CauseRow {
                cause: causes.text("cause", i).unwrap_or_default().to_owned(),
                count: count(&causes, "count", i)?,
                first_offset: count(&causes, "first_offset", i)?,
            })
        })
        .collect()
}

pub(super) fn episode(
    columns: &Columns<'_>,
    row: usize,
    context: &mut Context,
) -> Result<EpisodeRow, String> {
    let size = |name| size(columns, name, row);
    let status = columns.text("status", row).unwrap_or_default();
    let episode = EpisodeRow {
        key: key(columns, row, context),
        env_id: columns
            .text("env_id", row)
            .map(|env_id| context.names.share(env_id)),
        status: EpisodeStatus::ALL
            .into_iter()
            .find(|s| s.as_str() == status)
            .ok_or_else(|| format!("an episode has the unknown status {status:?}"))?,
        reason: columns.text("reason", row).map(ToOwned::to_owned),
        n_steps: size("n_steps")?,
        n_joints: size("n_joints")?,
        n_state_dims: size("n_state_dims")?,
        start_time: columns.time("start_time", row),
        end_time: columns.time("end_time", row),
        episode_return: columns.float("episode_return", row),
        n_segments: size("n_segments")?,
        mean_segment_steps: columns.float("mean_segment_steps", row),
        n_dropped_steps: count(columns, "n_dropped_steps", row)?,
        before: context.before,
    };
    context.before.add(&episode);
    Ok(episode)
}

pub(super) fn segment(
    columns: &Columns<'_>,
    row: usize,
    context: &mut Context,
) -> Result<SegmentRow, String> {
    let size = |name| size(columns, name, row);
    let (start_step, end_step) = (size("start_step")?, size("end_step")?);
    if end_step < start_step {
        return Err(format!(
            "a segment ends at step {end_step}, before it starts at {start_step}"
        ));
    }
    Ok(SegmentRow {
        key: key(columns, row, context),
        joint: columns.int32("joint", row),
        joint_name: columns
            .text("joint_name", row)
            .map(|name| context.names.share(name)),
        segment: size("segment")?,
        start_step,
        end_step,
        start_time: columns.time("start_time", row),
        end_time: columns.time("end_time", row),
        state_change_sum: columns.float("state_change_sum", row).unwrap_or_default(),
        state_change_peak: columns.float("state_change_peak", row).unwrap_or_default(),
        state_change_rank: size("state_change_rank")?,
        reward_sum: columns.float("reward_sum", row),
        actions: columns.floats("actions", row).unwrap_or_default(),
    })
}

fn key(columns: &Columns<'_>, row: usize, context: &mut Context) -> EpisodeKey {
    EpisodeKey {
        recording: context
            .recordings
            .share(columns.text("recording", row).unwrap_or_default()),
        episode: columns.int64("episode", row),
        episode_id: columns
            .text("episode_id", row)
            .map(|id| context.episode_ids.share(id)),
    }
}

fn count(columns: &Columns<'_>, name: &str, row: usize) -> Result<u64, String> {
    let n = columns.int64(name, row);
    u64::try_from(n).map_err(|_negative| format!("{name} is {n}, where a count is expected"))
}

fn size(columns: &Columns<'_>, name: &str, row: usize) -> Result<usize, String> {
    let n = columns.int32(name, row);
    usize::try_from(n).map_err(|_negative| format!("{name} is {n}, where a count is expected"))
}
