//! What a user types: commands, options, help. No work is done here.

mod bytes;
mod compare;
mod diff;
mod extract;
pub mod inspect;
mod plan;
mod progress;
mod reading;
pub mod report;
mod show;
mod signals;
mod watch;

use std::io::Write;

use clap::{CommandFactory, Parser, Subcommand};

pub use bytes::ByteSize;
pub use compare::CompareArgs;
pub use diff::DiffArgs;
pub use extract::{ExtractArgs, Request, SummaryFormat};
pub use inspect::InspectArgs;
pub use plan::{FinishArgs, PlanArgs, PlanRequest};
pub use progress::ProgressDisplay;
pub use report::ReportArgs;
pub use show::ShowArgs;
pub use signals::Signals;
pub use watch::{WatchArgs, WatchRequest};

/// Finds composite actions in recordings of agents.
#[derive(Debug, Parser)]
#[command(name = "coact", version, about, long_about = None, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Extract composite actions from recordings into Parquet tables
    Extract(Box<ExtractArgs>),
    /// Share recordings out to shards, which any machines extract
    Plan(Box<PlanArgs>),
    /// Check that all shards of a plan are done, and mark the run as done
    Finish(FinishArgs),
    /// Extract recordings while they are written, episode by episode
    Watch(Box<WatchArgs>),
    /// Show topics, fields and rates of recordings, and a command line that reads them
    Inspect(InspectArgs),
    /// Run the eight measures on the same recordings and show them side by side
    Compare(Box<CompareArgs>),
    /// Show episodes as strips in the terminal: actions, masks, composite actions
    Show(ShowArgs),
    /// Show what differs between the results of two runs
    Diff(DiffArgs),
    /// Write one self-contained HTML page, and figures, from an output directory
    Report(ReportArgs),
    /// Print a completion script for a shell
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

/// Writes the completion script of `shell`.
pub fn completions(shell: clap_complete::Shell, out: &mut dyn Write) {
    clap_complete::generate(shell, &mut Cli::command(), "coact", out);
}

/// Exit codes, as `--help` and the README give them.
pub mod exit {
    /// Done.
    pub const DONE: u8 = 0;
    /// No episode came out, or the output cannot be written.
    pub const FAILED: u8 = 1;
    /// `coact diff`: something differs.
    pub const DIFFERENT: u8 = 1;
    /// Bad arguments.
    pub const USAGE: u8 = 2;
    /// Done, but something was refused, recovered or incomplete.
    pub const PARTIAL: u8 = 3;
}
