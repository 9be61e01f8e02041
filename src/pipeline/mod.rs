//! Joins reading, the method and writing: the only place where files and algorithm meet.
//!
//! Three stages run at the same time, each on another round of episodes: one is read, the one before is extracted, the
//! one before that is written. Each stage is parallel inside (rayon), so that no core waits for a stage that is slow.
//!
//! ```text
//! round k+1: read   ─┐
//! round k:   extract ├─ rayon::join
//! round k−1: write  ─┘
//! ```

mod config;
mod inputs;
mod inspect;
mod source;

use std::time::Instant;

use anyhow::Context;
use rayon::prelude::*;

pub use config::{Config, RunError};
pub use inputs::InputError;
pub use inspect::{Inspected, inspect};

use crate::extraction::{self, ExtractionParams};
use crate::model::{Episode, Outcome};
use crate::report::RunSummary;
use crate::tables::{Batches, RowsBuilder, TableOptions, TableWriter};
use inputs::Input;
use source::{Event, Round, Source};

/// How far a run is, for a progress display.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Progress {
    /// Recordings done.
    pub n_recordings: u64,
    /// Recordings in all.
    pub n_recordings_total: u64,
    /// Episodes done.
    pub n_episodes: u64,
    /// Steps done.
    pub n_steps: u64,
    /// Bytes of input read.
    pub bytes: u64,
    /// Bytes of input in all.
    pub bytes_total: u64,
}

/// Step rows that are made into one batch: enough for the writer to work on whole columns.
const BATCH_ROWS: usize = 64 << 10;

/// Reads all recordings, extracts their composite actions, writes the tables.
///
/// # Errors
/// [`RunError`] tells bad arguments (exit 2) from failures (exit 1). A bad recording is no error: it is in the summary.
pub fn run(
    config: &Config,
    on_progress: &(dyn Fn(Progress) + Sync),
) -> Result<RunSummary, RunError> {
    let started = Instant::now();
    let inputs = inputs::find(&config.inputs)?;
    let mut writer = match &config.output {
        Some(output) => Some(open_output(output, config)?),
        None => None,
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(config.threads)
        .build()
        .context("cannot start the threads")
        .map_err(RunError::Failed)?;
    let mut summary = pool.install(|| stages(config, &inputs, writer.as_mut(), on_progress))?;
    if let Some(writer) = writer {
        writer.finish().map_err(|e| RunError::Failed(e.into()))?;
    }
    summary.set_elapsed(started.elapsed());
    Ok(summary)
}

fn open_output(output: &std::path::Path, config: &Config) -> Result<TableWriter, RunError> {
    let failed = |e: crate::tables::TableError| RunError::Failed(e.into());
    if crate::tables::holds_run(output).map_err(failed)? {
        if !config.overwrite {
            return Err(RunError::Arguments(format!(
                "{} already holds a run: give another directory, or --overwrite to start again",
                output.display()
            )));
        }
        crate::tables::clear_own_files(output).map_err(failed)?;
    }
    let options = TableOptions {
        steps: config.steps,
        metadata: config.metadata(),
        ..TableOptions::default()
    };
    TableWriter::create(output, &options).map_err(failed)
}

/// Moves rounds through the three stages until all are through.
fn stages(
    config: &Config,
    inputs: &[Input],
    mut writer: Option<&mut TableWriter>,
    on_progress: &(dyn Fn(Progress) + Sync),
) -> Result<RunSummary, RunError> {
    let mut source = Source::new(inputs, &config.read);
    let mut progress = Progress {
        n_recordings_total: inputs.len() as u64,
        bytes_total: inputs.iter().map(Input::bytes).sum(),
        ..Progress::default()
    };
    let mut summary = RunSummary::default();
    let mut read: Option<Round> = source.next_round();
    let mut extracted: Option<Extracted> = None;
    while read.is_some() || extracted.is_some() {
        let to_extract = read.take();
        let more = to_extract.is_some();
        let to_write = extracted.take();
        let (next, (done, written)) = rayon::join(
            || more.then(|| source.next_round()).flatten(),
            || {
                rayon::join(
                    || to_extract.map(|round| extract(round, config)),
                    || {
                        to_write
                            .map(|e| write(e, writer.as_deref_mut(), &mut summary, &mut progress))
                    },
                )
            },
        );
        (read, extracted) = (next, done);
        written.transpose().map_err(RunError::Failed)?;
        on_progress(progress);
    }
    Ok(summary)
}

/// A round after extraction: batches of rows to write, and what the summary needs.
struct Extracted {
    batches: Vec<Batches>,
    events: Vec<Counted>,
    bytes: u64,
}

/// An event whose bulk has gone into the batches.
enum Counted {
    Episode(Box<Episode>, Box<Outcome>),
    Recording(Box<crate::model::RecordingRow>),
}

/// Runs the method on every episode of a round and makes rows of the results.
fn extract(round: Round, config: &Config) -> Extracted {
    let Round { events, bytes } = round;
    let params: &ExtractionParams = &config.params;
    let events: Vec<Counted> = events
        .into_par_iter()
        .with_max_len(1)
        .map(|event| match event {
            Event::Episode(episode) => {
                let outcome = extraction::extract(&episode, params);
                Counted::Episode(episode, Box::new(outcome))
            }
            Event::Recording(row) => Counted::Recording(row),
        })
        .collect();
    let batches = groups(&events)
        .into_par_iter()
        .map(|group| rows(group, config))
        .collect();
    Extracted {
        batches,
        events,
        bytes,
    }
}

/// Cuts events into runs of about [`BATCH_ROWS`] step rows.
fn groups(events: &[Counted]) -> Vec<&[Counted]> {
    let mut groups = Vec::new();
    let (mut start, mut n_rows) = (0, 0);
    for (i, event) in events.iter().enumerate() {
        if let Counted::Episode(episode, _) = event {
            n_rows += episode.n_steps() * episode.actions.n_columns();
        }
        if n_rows >= BATCH_ROWS {
            groups.push(&events[start..=i]);
            (start, n_rows) = (i + 1, 0);
        }
    }
    if start < events.len() {
        groups.push(&events[start..]);
    }
    groups
}

fn rows(events: &[Counted], config: &Config) -> Batches {
    let mut rows = RowsBuilder::new(config.params.joints(), config.steps);
    for event in events {
        match event {
            Counted::Episode(episode, outcome) => rows.append_episode(episode, outcome),
            Counted::Recording(row) => rows.append_recording(row),
        }
    }
    rows.finish()
}

/// Writes a round and counts it.
fn write(
    extracted: Extracted,
    writer: Option<&mut TableWriter>,
    summary: &mut RunSummary,
    progress: &mut Progress,
) -> anyhow::Result<()> {
    for event in &extracted.events {
        match event {
            Counted::Episode(episode, outcome) => {
                summary.add_episode(episode, outcome);
                progress.n_episodes += 1;
                progress.n_steps += episode.n_steps() as u64;
            }
            Counted::Recording(row) => {
                summary.add_recording(row);
                progress.n_recordings += 1;
            }
        }
    }
    progress.bytes += extracted.bytes;
    if let Some(writer) = writer {
        for batches in extracted.batches {
            writer.write(&batches)?;
        }
    }
    Ok(())
}
