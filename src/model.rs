//! The vocabulary: plain data that the other modules hand to each other, without behaviour beyond its invariants.
//!
//! ```text
//! recording ──> Episode ──> extraction ──> Extraction ──> tables
//!           └─> RecordingRow ─────────────────────────────┘
//! ```

mod comparison;

use std::ops::Range;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use comparison::{AgreementRow, Comparison, MeasureRow};

/// A table of numbers held column by column: `n_rows` steps × `n_columns` joints or state dimensions.
///
/// Column-major, because every step of the method works on one column over time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    n_rows: usize,
    columns: Vec<Vec<f64>>,
}

impl Columns {
    /// Takes the columns as they are.
    ///
    /// # Panics
    /// If the columns differ in length: a bug of the caller, never of the data.
    pub fn new(n_rows: usize, columns: Vec<Vec<f64>>) -> Self {
        assert!(
            columns.iter().all(|c| c.len() == n_rows),
            "columns of one table have one length"
        );
        Self { n_rows, columns }
    }

    /// Transposes `values`, row-major of shape `(n_rows, n_columns)`.
    ///
    /// # Panics
    /// If `values` is not a whole number of rows: a bug of the caller.
    pub fn from_rows(n_columns: usize, values: &[f64]) -> Self {
        let n_rows = values.len().checked_div(n_columns).unwrap_or(0);
        assert_eq!(n_rows * n_columns, values.len(), "values are whole rows");
        let columns = (0..n_columns)
            .map(|c| values.iter().skip(c).step_by(n_columns).copied().collect())
            .collect();
        Self { n_rows, columns }
    }

    /// Number of steps.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Number of joints or state dimensions.
    pub fn n_columns(&self) -> usize {
        self.columns.len()
    }

    /// One column over time, length `n_rows`.
    pub fn column(&self, index: usize) -> &[f64] {
        &self.columns[index]
    }

    /// All columns, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.columns.iter().map(Vec::as_slice)
    }
}

/// Which episode of which recording: the key that every row of a table carries.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct EpisodeKey {
    /// Path of the recording relative to the common ancestor of all inputs, `/` between.
    pub recording: Arc<str>,
    /// The logged id if it is an integer, else the order of appearance.
    pub episode: i64,
    /// The logged id as text, if there is one.
    pub episode_id: Option<Arc<str>>,
}

/// What an episode counts to: its environment, else the folder of its recording, else the recording.
pub fn environment_of<'a>(env_id: Option<&'a str>, recording: &'a str) -> &'a str {
    env_id.unwrap_or_else(|| {
        recording
            .rsplit_once('/')
            .map_or(recording, |(folder, _)| folder)
    })
}

/// Why an episode is used only in part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Incomplete {
    /// One sentence for the `reason` column.
    pub reason: String,
}

/// One rollout, as read: `T` steps of actions and of the states they were chosen from.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Its name.
    pub key: EpisodeKey,
    /// The environment, if the recording says so.
    pub env_id: Option<Arc<str>>,
    /// Shape `(T, n_joints)`.
    pub actions: Columns,
    /// Shape `(T, n_state_dims)`.
    pub states: Columns,
    /// Name of each joint, if known; as many as joints.
    pub joint_names: Option<Arc<[Arc<str>]>>,
    /// Nanoseconds since the Unix epoch of each step, by the chosen clock; `None` where no clock ran.
    pub times: Option<Vec<i64>>,
    /// Reward of each step; NaN where a step has none. `None` if no step has one.
    pub rewards: Option<Vec<f64>>,
    /// Set if the episode is used only up to its first bad step.
    pub incomplete: Option<Incomplete>,
    /// Steps of this episode that were read and not used.
    pub n_dropped_steps: u64,
}

impl Episode {
    /// Number of steps used, `T`.
    pub fn n_steps(&self) -> usize {
        self.actions.n_rows()
    }

    /// Name of a joint, if it is known and joints are taken each on its own.
    pub fn joint_name(&self, mode: JointMode, index: usize) -> Option<&Arc<str>> {
        match mode {
            JointMode::Each => self.joint_names.as_ref()?.get(index),
            JointMode::Together => None,
        }
    }

    /// The sum of rewards over some steps, if every one of them has one.
    pub fn reward_sum(&self, steps: Range<usize>) -> Option<f64> {
        let rewards = &self.rewards.as_ref()?[steps];
        let sum = rewards.iter().fold(0.0, |sum, r| sum + r);
        (!rewards.is_empty() && !sum.is_nan()).then_some(sum)
    }
}

/// A measure over an episode and what follows from it; each of length `T`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// `E_w`, in the unit of the measure (Eq. 5–7).
    pub measure: Vec<f64>,
    /// `E_n`, the measure scaled to 0..=1 over the episode (Eq. 8).
    pub change: Vec<f64>,
    /// True where the change passes the threshold (Eq. 9).
    pub mask: Vec<bool>,
}

/// One composite action: the steps `start_step..end_step` of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// First step.
    pub start_step: usize,
    /// One past the last step.
    pub end_step: usize,
    /// Sum of the state's change (`E_n`) over the segment, added in step order.
    pub state_change_sum: f64,
    /// Largest change of the state (`E_n`) in the segment.
    pub state_change_peak: f64,
    /// 1 for the largest `state_change_sum` of the joint; equal sums: the earlier segment first.
    pub state_change_rank: usize,
}

/// What the method finds for one joint, or for all joints together.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointExtraction {
    /// Measure, change and mask of the actions.
    pub action: Series,
    /// True where actions and states both change nearby (Eq. 10–11), length `T`.
    pub correlated: Vec<bool>,
    /// Last step of each run of correlated steps, rising.
    pub boundaries: Vec<usize>,
    /// The composite actions, in time, disjoint.
    pub segments: Vec<Segment>,
}

/// Whether joints are cut each on its own or all as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointMode {
    /// One series and one partition per joint.
    #[default]
    Each,
    /// One series and one partition for the whole action.
    Together,
}

impl JointMode {
    /// What a joint is called in tables: its index, −1 for all together.
    pub fn joint_number(self, index: usize) -> i32 {
        match self {
            Self::Each => i32::try_from(index).unwrap_or(i32::MAX),
            Self::Together => -1,
        }
    }
}

/// All that the method finds in one episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Extraction {
    /// How the joints were taken; with [`JointMode::Together`] there is one entry in `joints`.
    pub mode: JointMode,
    /// Measure, change and mask of the states.
    pub state: Series,
    /// One entry per joint, or one for all.
    pub joints: Vec<JointExtraction>,
}

/// What became of one episode.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The method ran.
    Extracted(Extraction),
    /// Fewer steps than two windows and one (spec: `T ≥ 2·W + 1`); carries that minimum.
    TooShort {
        /// The least number of steps the window needs.
        min_steps: usize,
    },
}

/// What a column of `status` says of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EpisodeStatus {
    /// Used from its first to its last step.
    Ok,
    /// Used up to its first bad step.
    Incomplete,
    /// Fewer steps than the window needs.
    TooShort,
}

impl EpisodeStatus {
    /// Of an episode and what became of it; incomplete wins.
    pub fn of(episode: &Episode, outcome: &Outcome) -> Self {
        match (&episode.incomplete, outcome) {
            (Some(_), _) => Self::Incomplete,
            (None, Outcome::TooShort { .. }) => Self::TooShort,
            (None, Outcome::Extracted(_)) => Self::Ok,
        }
    }

    /// All of them.
    pub const ALL: [Self; 3] = [Self::Ok, Self::Incomplete, Self::TooShort];

    /// As it stands in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Incomplete => "incomplete",
            Self::TooShort => "too_short",
        }
    }
}

/// A layout that was found out, not asked for.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct ChosenLayout {
    /// The flags that ask for it.
    pub flags: String,
    /// Why it was chosen.
    pub why: String,
    /// It is the native convention, which needs no telling.
    pub is_native: bool,
}

impl RecordingRow {
    /// Was nothing of it refused, recovered or failed, but what is to be expected?
    pub fn is_clean(&self) -> bool {
        self.status == RecordingStatus::Ok && self.causes.iter().all(|c| c.expected)
    }
}

/// By what a recording is known from one run to the next.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingIdentity {
    /// Its name, as in [`EpisodeKey::recording`].
    pub name: Arc<str>,
    /// Size of its files.
    pub bytes: u64,
    /// Hash of the beginning and the end of each file.
    pub hash: Arc<str>,
}

/// What a column of `status` says of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordingStatus {
    /// Read to its end; messages may still have been refused.
    Ok,
    /// Damaged; what was whole is in the tables.
    Recovered,
    /// Nothing could be used, or its damage was not to be tolerated.
    Failed,
}

impl RecordingStatus {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Ok, Self::Recovered, Self::Failed];

    /// As it stands in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Recovered => "recovered",
            Self::Failed => "failed",
        }
    }
}

/// One reason for which messages or chunks were refused, and how often.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cause {
    /// The reason, without numbers that change from message to message.
    pub cause: String,
    /// How often.
    pub count: u64,
    /// Where first: bytes from the beginning of the file.
    pub first_offset: u64,
    /// It is to be expected, such as a step before the first state: no reason for another exit code.
    pub expected: bool,
}

/// One row of the `recordings` table: how a recording was read and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingRow {
    /// Its name, as in [`EpisodeKey::recording`].
    pub recording: Arc<str>,
    /// Size of the file.
    pub bytes: u64,
    /// How it ended.
    pub status: RecordingStatus,
    /// Why it failed or what was recovered.
    pub reason: Option<String>,
    /// The environment, if the recording says so.
    pub env_id: Option<Arc<str>>,
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
    /// What was found out about the layout; `None` if it was asked for. Not in the tables.
    pub chosen: Option<ChosenLayout>,
    /// Messages on the chosen topics; always `n_messages_used + n_messages_refused`.
    pub n_messages: u64,
    /// Messages that became steps, or could have.
    pub n_messages_used: u64,
    /// Messages that did not.
    pub n_messages_refused: u64,
    /// Why messages were refused and chunks lost.
    pub causes: Vec<Cause>,
    /// Episodes in the tables.
    pub n_episodes: u64,
}
