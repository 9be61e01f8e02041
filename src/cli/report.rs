//! `coact report`: a page and figures from the tables of a run.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::ByteSize;
use super::exit;
use crate::report::{DEFAULT_MAX_BYTES, Report, ReportError, ReportOptions};
use crate::results::EpisodeQuery;

const EXAMPLES: &str = "\
Examples:
  coact report out                                     report.html, to open in any browser
  coact report out --episode cartpole.mcap:2           the same with the traces of one episode alone
  coact report out --svg figures --episode 2           and figures for print

Exit codes:
  0  written
  1  the tables cannot be read, or the report cannot be written
  2  bad arguments; no such episode";

/// Arguments of `coact report`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReportArgs {
    /// Directory that coact extract has written, finished or not
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,

    /// The page
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    output: PathBuf,

    /// Episodes to show: RECORDING:EPISODE, RECORDING or EPISODE; repeatable [default: as many as fit]
    #[arg(long, value_name = "EPISODE")]
    episode: Vec<String>,

    /// Most episodes whose traces are in the page [default: as many as fit]
    #[arg(long, value_name = "N")]
    max_episodes: Option<usize>,

    /// Bytes that traces take in the page at most
    #[arg(long, value_name = "BYTES", default_value_t = ByteSize(DEFAULT_MAX_BYTES))]
    max_bytes: ByteSize,

    /// Measures side by side, as coact compare --json prints them
    #[arg(long, value_name = "FILE")]
    compare: Option<PathBuf>,

    /// Draw figures as SVG: of --episode, else of the three with most composite actions
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,

    /// Draw figures as PNG, 300 dots an inch
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,

    /// Write figures and no page
    #[arg(long)]
    no_page: bool,
}

impl ReportArgs {
    /// What is asked for.
    pub fn options(&self) -> ReportOptions {
        ReportOptions {
            page: (!self.no_page).then(|| self.output.clone()),
            episodes: self.episode.iter().map(|e| EpisodeQuery::new(e)).collect(),
            max_episodes: self.max_episodes,
            max_bytes: self.max_bytes.0,
            comparison: self.compare.clone(),
            svg: self.svg.clone(),
            png: self.png.clone(),
        }
    }

    /// What was written, for people.
    pub fn told(&self, report: &Report) -> String {
        let mut text = String::new();
        if !self.no_page {
            let _infallible = writeln!(
                text,
                "{}: {:.1} MB, traces of {} of {} episodes",
                self.output.display(),
                report.n_bytes as f64 / 1e6,
                report.n_embedded,
                report.n_episodes
            );
        }
        for figure in &report.figures {
            let _infallible = writeln!(text, "{}", figure.display());
        }
        text
    }
}

/// The exit code for what went wrong.
pub fn exit_code(error: &ReportError) -> u8 {
    match error {
        ReportError::NoEpisode { .. } | ReportError::Comparison { .. } => exit::USAGE,
        _ => exit::FAILED,
    }
}
