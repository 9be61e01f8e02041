//! Tests at the boundaries: the library's public functions, files on disk, and the process as a user runs it.
#![expect(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::many_single_char_names,
    clippy::print_stderr,
    clippy::similar_names,
    clippy::type_complexity,
    clippy::too_many_lines,
    reason = "a test may panic, its numbers are small and known, a sweep tells its figures, and the naive method keeps the paper's letters"
)]

mod alignment;
mod architecture;
mod cli;
mod compare;
mod corpus;
mod diff;
mod durability;
mod episode_options;
mod events;
mod extraction_golden;
mod extraction_properties;
mod hostile;
mod hostile_files;
mod hostile_runs;
mod layouts;
mod read_ahead;
mod recording;
mod report;
mod results;
mod selectors;
#[cfg(unix)]
mod shards;
mod show;
mod support;
mod tables;
mod watch;
