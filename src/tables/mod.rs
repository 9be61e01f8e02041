//! Episodes and what was found in them, as four Parquet tables.
//!
//! ```text
//! Episode, Outcome ──> rows ──> Batches ──> writer ──> storage ──> DIR/{segments,steps,episodes,recordings}/part-*.parquet
//!                      (Arrow columns)      (parts, cut between episodes)
//! ```
//!
//! `schema.rs` is the public interface of the tables: names, types, units.

mod directory;
mod error;
mod rows;
mod schema;
mod storage;
mod writer;

pub use directory::{clear_own_files, holds_run};
pub use error::TableError;
pub use rows::{Batches, RowsBuilder};
pub use schema::{TABLE_VERSION, Table};
pub use writer::{DEFAULT_MAX_PART_ROWS, TableOptions, TableWriter};
