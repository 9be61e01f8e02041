//! Episodes and what was found in them, as four Parquet tables.
//!
//! ```text
//! Episode, Outcome ──> rows ──> Batches ──> writer ──> storage ──> DIR/{segments,steps,episodes,recordings}/part-*.parquet
//!                      (Arrow columns)      (parts, cut between episodes)
//! ```
//!
//! `schema.rs` is the public interface of the tables: names, types, units.

mod commit;
mod committed;
mod comparison;
mod directory;
mod error;
mod finish;
mod live;
mod output;
mod plan;
mod rows;
mod schema;
mod writer;

pub use crate::storage::{Faults, StorageError, SyncTime};
pub use commit::{DoneRecording, Mark, OpenRecording, Written};
pub use committed::Committed;
pub use comparison::write_comparison;
pub use directory::{holds_run, remove_temporaries};
pub use error::TableError;
pub use finish::{Finish, Finished, MissingRecordings, finish};
pub use live::LiveTables;
pub use output::{BegunRecording, OutputDirectory};
pub use plan::{Plan, PlannedRecording, PlannedShard, read_plan, write_plan};
pub use rows::{Batches, RowsBuilder};
pub use schema::{TABLE_VERSION, Table};
pub use writer::{DEFAULT_MAX_PART_ROWS, TableOptions, TableWriter};
