//! The four tables: names, types, units and meaning of their columns. This is public interface.

use std::collections::HashMap;
use std::sync::Arc;

use arrow::datatypes::{DataType, Field, Fields, Schema, SchemaRef, TimeUnit};

/// Version of the tables: raised whenever a column changes.
pub const TABLE_VERSION: u32 = 1;

/// One of the four tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Table {
    /// One row a composite action.
    Segments,
    /// One row a joint and step.
    Steps,
    /// One row an episode.
    Episodes,
    /// One row a recording.
    Recordings,
}

impl Table {
    /// All four.
    pub const ALL: [Self; 4] = [
        Self::Segments,
        Self::Steps,
        Self::Episodes,
        Self::Recordings,
    ];

    /// Name of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Segments => "segments",
            Self::Steps => "steps",
            Self::Episodes => "episodes",
            Self::Recordings => "recordings",
        }
    }

    /// Its columns.
    pub fn schema(self) -> SchemaRef {
        let fields = match self {
            Self::Segments => segments(),
            Self::Steps => steps(),
            Self::Episodes => episodes(),
            Self::Recordings => recordings(),
        };
        Arc::new(Schema::new(fields))
    }
}

/// Nanoseconds since the Unix epoch, UTC.
pub(super) fn timestamp() -> DataType {
    DataType::Timestamp(TimeUnit::Nanosecond, Some(Arc::from("UTC")))
}

/// The element of `actions`.
pub(super) fn action_item() -> Field {
    Field::new("item", DataType::Float64, false)
}

/// The fields of one cause.
pub(super) fn cause_fields() -> Fields {
    Fields::from(vec![
        field(
            "cause",
            DataType::Utf8,
            false,
            "",
            "why messages or chunks were refused",
        ),
        field("count", DataType::Int64, false, "1", "how often"),
        field(
            "first_offset",
            DataType::Int64,
            false,
            "byte",
            "where first, from the beginning of the file",
        ),
    ])
}

/// The element of `causes`.
pub(super) fn cause_item() -> Field {
    Field::new("item", DataType::Struct(cause_fields()), false)
}

fn field(name: &str, data_type: DataType, nullable: bool, unit: &str, meaning: &str) -> Field {
    let metadata = [("unit", unit), ("description", meaning)]
        .into_iter()
        .filter(|(_, text)| !text.is_empty());
    let metadata: HashMap<String, String> = metadata
        .map(|(key, text)| (key.to_owned(), text.to_owned()))
        .collect();
    Field::new(name, data_type, nullable).with_metadata(metadata)
}

const REQUIRED: bool = false;
const NULLABLE: bool = true;

#[rustfmt::skip] // one line a column: this is a table
fn episode_key() -> Vec<Field> {
    vec![
        field("recording", DataType::Utf8, REQUIRED, "", "path relative to the common ancestor of all inputs"),
        field("episode", DataType::Int64, REQUIRED, "1", "the logged id if it is an integer, else the order of appearance"),
        field("episode_id", DataType::Utf8, NULLABLE, "", "the logged id as text"),
    ]
}

#[rustfmt::skip] // one line a column: this is a table
fn joint_key() -> Vec<Field> {
    let mut fields = episode_key();
    fields.push(field("joint", DataType::Int32, REQUIRED, "1", "0, 1, …; -1 for all joints together"));
    fields.push(field("joint_name", DataType::Utf8, NULLABLE, "", "name of the joint"));
    fields
}

#[rustfmt::skip] // one line a column: this is a table
fn segments() -> Vec<Field> {
    let mut fields = joint_key();
    fields.extend([
        field("segment", DataType::Int32, REQUIRED, "1", "0, 1, … in time within the joint"),
        field("start_step", DataType::Int32, REQUIRED, "step", "first step, 0-based"),
        field("end_step", DataType::Int32, REQUIRED, "step", "one past the last step"),
        field("n_steps", DataType::Int32, REQUIRED, "step", "end_step - start_step"),
        field("start_time", timestamp(), NULLABLE, "ns", "time of the first step"),
        field("end_time", timestamp(), NULLABLE, "ns", "time of the last step in it"),
        field("state_change_sum", DataType::Float64, REQUIRED, "1", "sum of the state's change over the segment"),
        field("state_change_peak", DataType::Float64, REQUIRED, "1", "largest change of the state in the segment"),
        field("state_change_rank", DataType::Int32, REQUIRED, "1", "1 for the largest state_change_sum of the joint"),
        field("reward_sum", DataType::Float64, NULLABLE, "reward", "sum of the rewards; null where a step has none"),
        field("actions", DataType::List(Arc::new(action_item())), REQUIRED, "action", "raw values; together: row-major, steps by joints"),
    ]);
    fields
}

#[rustfmt::skip] // one line a column: this is a table
fn steps() -> Vec<Field> {
    let mut fields = joint_key();
    fields.extend([
        field("step", DataType::Int32, REQUIRED, "step", "0-based index in the episode"),
        field("time", timestamp(), NULLABLE, "ns", "time of the step by the chosen clock"),
        field("action", DataType::Float64, NULLABLE, "action", "raw value; null for joints together"),
        field("action_measure", DataType::Float64, NULLABLE, "see coact.measure", "E_w of the action; null for episodes too short"),
        field("action_change", DataType::Float64, NULLABLE, "1", "E_n of the action, 0 to 1"),
        field("action_mask", DataType::Boolean, REQUIRED, "", "true where action_change passes the threshold"),
        field("state_measure", DataType::Float64, NULLABLE, "see coact.measure", "E_w of the state, mean over its columns"),
        field("state_change", DataType::Float64, NULLABLE, "1", "E_n of the state, 0 to 1"),
        field("state_mask", DataType::Boolean, REQUIRED, "", "true where state_change passes the threshold"),
        field("correlated", DataType::Boolean, REQUIRED, "", "true where action and state change nearby"),
        field("boundary", DataType::Boolean, REQUIRED, "", "last step of a run of correlated steps"),
        field("segment", DataType::Int32, REQUIRED, "1", "composite action that the step is in; -1 outside"),
    ]);
    fields
}

#[rustfmt::skip] // one line a column: this is a table
fn episodes() -> Vec<Field> {
    let mut fields = episode_key();
    fields.extend([
        field("env_id", DataType::Utf8, NULLABLE, "", "environment"),
        field("status", DataType::Utf8, REQUIRED, "", "ok, incomplete or too_short"),
        field("reason", DataType::Utf8, NULLABLE, "", "why it is incomplete or too short"),
        field("n_steps", DataType::Int32, REQUIRED, "step", "steps used"),
        field("n_joints", DataType::Int32, REQUIRED, "1", "width of the action"),
        field("n_state_dims", DataType::Int32, REQUIRED, "1", "width of the state"),
        field("start_time", timestamp(), NULLABLE, "ns", "time of the first step"),
        field("end_time", timestamp(), NULLABLE, "ns", "time of the last step"),
        field("episode_return", DataType::Float64, NULLABLE, "reward", "sum of the rewards; null where a step has none"),
        field("n_segments", DataType::Int32, REQUIRED, "1", "composite actions over all joints"),
        field("mean_segment_steps", DataType::Float64, NULLABLE, "step", "mean length of a composite action over all joints"),
        field("n_dropped_steps", DataType::Int64, REQUIRED, "step", "steps read and not used"),
    ]);
    fields
}

#[rustfmt::skip] // one line a column: this is a table
fn recordings() -> Vec<Field> {
    vec![
        field("recording", DataType::Utf8, REQUIRED, "", "path relative to the common ancestor of all inputs"),
        field("bytes", DataType::Int64, REQUIRED, "byte", "size of the file"),
        field("status", DataType::Utf8, REQUIRED, "", "ok, recovered or failed"),
        field("reason", DataType::Utf8, NULLABLE, "", "why it failed or what was recovered"),
        field("env_id", DataType::Utf8, NULLABLE, "", "environment"),
        field("encoding", DataType::Utf8, NULLABLE, "", "message encodings of the chosen topics"),
        field("action_selector", DataType::Utf8, NULLABLE, "", "where the actions were taken from"),
        field("state_selector", DataType::Utf8, NULLABLE, "", "where the states were taken from"),
        field("episode_rule", DataType::Utf8, NULLABLE, "", "where episodes begin and end"),
        field("clock", DataType::Utf8, NULLABLE, "", "which time was used"),
        field("align", DataType::Utf8, NULLABLE, "", "how states were put on the action's clock"),
        field("n_messages", DataType::Int64, REQUIRED, "message", "messages on the chosen topics"),
        field("n_messages_used", DataType::Int64, REQUIRED, "message", "those that were used"),
        field("n_messages_refused", DataType::Int64, REQUIRED, "message", "those that were not"),
        field("causes", DataType::List(Arc::new(cause_item())), REQUIRED, "", "what was refused, by cause"),
        field("n_episodes", DataType::Int64, REQUIRED, "1", "episodes in the tables"),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_says_what_it_means() {
        for table in Table::ALL {
            for field in table.schema().fields() {
                assert!(
                    field.metadata().contains_key("description"),
                    "{}.{}",
                    table.name(),
                    field.name()
                );
            }
        }
    }
}
