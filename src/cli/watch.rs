//! `coact watch`: the options of `extract` that make sense while recordings grow, and its own.

use std::time::Duration;

use clap::Args;

use super::extract::{ExtractArgs, Request, SummaryFormat};
use crate::pipeline::WatchConfig;

const EXAMPLES: &str = "\
Examples:
  coact watch runs -o out                      every recording below a folder, while it is written
  coact watch runs -o out -v                   tell of every commit
  coact watch runs -o out --measure shannon --steps none
  coact watch bags -o out --action /command:data --state /joint_states:position

It goes on until Ctrl-C or SIGTERM: then what is complete is committed. The same command goes on where it stopped,
whatever stopped it, and so does `coact extract` with the same options, which reads to their ends recordings that were
never closed.

Exit codes:
  0  stopped by a signal
  1  failed: the output cannot be written
  2  bad arguments";

/// Looks at the folder in this many seconds, at the least and at the most.
const INTERVALS: std::ops::RangeInclusive<f64> = 0.01..=3600.0;

/// Arguments of `coact watch`.
#[derive(Debug, Args)]
#[command(
    after_help = EXAMPLES,
    mut_arg("inputs", |a| a.value_name("DIR").help("Folder of the recordings; it may be made later").num_args(1)),
    mut_arg("events", |a| a.hide(true)),
    mut_arg("dry_run", |a| a.hide(true)),
    mut_arg("progress", |a| a.hide(true)),
    mut_arg("verbose", |a| a.help("Say more: every commit, and what is in it")),
)]
pub struct WatchArgs {
    #[command(flatten)]
    extract: ExtractArgs,

    /// Time between two looks at the folder
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 0.2,
        help_heading = "Running"
    )]
    interval: f64,

    /// Small parts after which they are merged into one
    #[arg(long, value_name = "N", default_value_t = 64, help_heading = "Output",
          value_parser = clap::value_parser!(u32).range(2..=100_000))]
    merge_after: u32,
}

/// What is to be done.
#[derive(Debug)]
pub enum WatchRequest {
    /// Print this configuration and stop.
    PrintConfig(String),
    /// Watch.
    Watch {
        /// What.
        config: Box<WatchConfig>,
        /// How the summary is printed.
        summary: SummaryFormat,
        /// No summary, and only errors.
        quiet: bool,
        /// Tell of every commit.
        verbose: bool,
    },
}

impl WatchArgs {
    /// Joins command line, configuration file and defaults, and checks what comes out.
    ///
    /// # Errors
    /// One line that says which option is wrong and what it must be.
    pub fn request(self) -> Result<WatchRequest, String> {
        let (interval, merge_after) = (self.interval, self.merge_after);
        if !INTERVALS.contains(&interval) {
            return Err(format!(
                "interval is {interval}: expected {} to {} seconds",
                INTERVALS.start(),
                INTERVALS.end()
            ));
        }
        let (config, summary, quiet, verbose) = match self.extract.request()? {
            Request::PrintConfig(text) => return Ok(WatchRequest::PrintConfig(text)),
            Request::Run {
                config,
                summary,
                quiet,
                verbose,
                ..
            } => (config, summary, quiet, verbose),
        };
        if config.events.is_some() {
            return Err(
                "--events is not for watch: events are written of complete recordings, by extract"
                    .to_owned(),
            );
        }
        if config.output.is_none() {
            return Err("no output directory given: --output DIR".to_owned());
        }
        match config.inputs.as_slice() {
            [folder] if folder.is_dir() || !folder.exists() => {}
            [other] => return Err(format!("{} is no folder: watch takes one", other.display())),
            _ => return Err("watch takes one folder".to_owned()),
        }
        Ok(WatchRequest::Watch {
            config: Box::new(WatchConfig {
                run: *config,
                interval: Duration::from_secs_f64(interval),
                merge_after: usize::try_from(merge_after).unwrap_or(usize::MAX),
            }),
            summary,
            quiet,
            verbose,
        })
    }
}
