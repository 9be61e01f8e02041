//! `coact diff`: what it takes.

use std::path::PathBuf;

use clap::Args;

use crate::diff::DiffOptions;

const EXAMPLES: &str = "\
Examples:
  coact diff stored new                 what differs between two output directories
  coact diff stored new --tolerance 0   a segment that moved by a step has vanished, and another appeared
  coact diff stored new --allow-moved   only what appeared or vanished counts

Segments of one joint of one episode are the same if they have the same steps. Of the others, in the order of time, two
are one that moved if their starts and their ends are at most --tolerance steps apart.

Exit codes:
  0  no episode and no segment differs; parameters may
  1  some do
  2  bad arguments, or a directory that cannot be read";

/// Arguments of `coact diff`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct DiffArgs {
    /// Output directory of the one run
    #[arg(value_name = "A")]
    pub a: PathBuf,

    /// Output directory of the other
    #[arg(value_name = "B")]
    pub b: PathBuf,

    /// Steps within which a segment has moved and not vanished
    #[arg(long, value_name = "STEPS", default_value_t = 3)]
    tolerance: usize,

    /// Segments that moved are told and make no difference
    #[arg(long)]
    allow_moved: bool,

    /// As one JSON object
    #[arg(long)]
    pub json: bool,
}

impl DiffArgs {
    /// How the runs are held against each other.
    pub fn options(&self) -> DiffOptions {
        DiffOptions {
            tolerance_steps: self.tolerance,
            allow_moved: self.allow_moved,
        }
    }
}
