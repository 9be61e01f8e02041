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
mod identity;
mod inputs;
mod inspect;
mod resume;
mod source;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::Context;
use rayon::prelude::*;

pub use config::{Config, RunError};
pub use inputs::InputError;
pub use inspect::{Inspected, inspect};

pub use crate::tables::{DEFAULT_MAX_PART_ROWS, remove_temporaries};

use crate::extraction::{self, ExtractionParams};
use crate::model::{Episode, Outcome, RecordingIdentity, RecordingRow};
use crate::summary::{RunOutcome, RunSummary};
use crate::tables::{
    Batches, DoneRecording, Mark, OutputDirectory, RowsBuilder, TableError, TableOptions,
    TableWriter,
};
use inputs::Input;
use source::{Event, Job, Round, Source};

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

/// Asks a run to stop, from another thread.
#[derive(Debug, Default)]
pub struct Interrupt(AtomicBool);

impl Interrupt {
    /// Asks; the run stops at the next round.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Reads all recordings, extracts their composite actions, writes the tables.
///
/// # Errors
/// [`RunError`] tells bad arguments (exit 2) from failures (exit 1). A bad recording is no error: it is in the summary.
pub fn run(
    config: &Config,
    on_progress: &(dyn Fn(Progress) + Sync),
    interrupt: &Interrupt,
) -> Result<RunSummary, RunError> {
    let started = Instant::now();
    let inputs = inputs::find(&config.inputs)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(config.threads)
        .build()
        .context("cannot start the threads")
        .map_err(RunError::Failed)?;
    let mut summary = pool.install(|| {
        if let Some(output) = &config.output {
            return written(config, output, &inputs, on_progress, interrupt);
        }
        let jobs = resume::all(&inputs);
        let mut summary = RunSummary::default();
        stages(config, &jobs, None, &mut summary, on_progress, interrupt)?;
        Ok(summary)
    })?;
    summary.set_elapsed(started.elapsed());
    Ok(summary)
}

/// A run with tables: goes on where an earlier process of the same run stopped.
fn written(
    config: &Config,
    output: &Path,
    inputs: &[Input],
    on_progress: &(dyn Fn(Progress) + Sync),
    interrupt: &Interrupt,
) -> Result<RunSummary, RunError> {
    let options = TableOptions {
        steps: config.steps,
        metadata: config.metadata(),
        max_part_rows: config.max_part_rows,
        faults: config.faults.clone(),
        ..TableOptions::default()
    };
    let mut directory = OutputDirectory::open(output, &options, config.overwrite)?;
    let resume::Work { jobs, before } = resume::work(inputs, &mut directory)?;
    let mut summary = RunSummary::default();
    for done in &before {
        summary.add_done_before(done.n_episodes, done.clean);
    }
    for job in &jobs {
        summary.add_begun_before(job.n_written);
    }
    if jobs.is_empty() && directory.is_complete() {
        return Ok(summary);
    }
    let mut writer = directory.writer()?;
    let stages = stages(
        config,
        &jobs,
        Some(&mut writer),
        &mut summary,
        on_progress,
        interrupt,
    );
    if matches!(stages, Err(RunError::Interrupted)) {
        // What is in hand is whole up to the last episode.
        writer.commit()?;
    }
    stages?;
    if summary.outcome() == RunOutcome::Failed {
        writer.close()?;
    } else {
        writer.finish()?;
    }
    Ok(summary)
}

/// Moves rounds through the three stages until all are through.
fn stages(
    config: &Config,
    jobs: &[Job<'_>],
    mut writer: Option<&mut TableWriter>,
    summary: &mut RunSummary,
    on_progress: &(dyn Fn(Progress) + Sync),
    interrupt: &Interrupt,
) -> Result<(), RunError> {
    let mut source = Source::new(jobs, &config.read);
    let mut progress = Progress {
        n_recordings_total: jobs.len() as u64,
        bytes_total: jobs.iter().map(|job| job.input.bytes()).sum(),
        ..Progress::default()
    };
    let mut read: Option<Round> = source.next_round();
    let mut extracted: Option<Extracted> = None;
    while read.is_some() || extracted.is_some() {
        if interrupt.is_raised() {
            return Err(RunError::Interrupted);
        }
        let to_extract = read.take();
        let more = to_extract.is_some();
        let to_write = extracted.take();
        let (next, (done, written)) = rayon::join(
            || more.then(|| source.next_round()).flatten(),
            || {
                rayon::join(
                    || to_extract.map(|round| extract(round, config)),
                    || to_write.map(|e| write(e, writer.as_deref_mut(), summary, &mut progress)),
                )
            },
        );
        (read, extracted) = (next, done);
        written.transpose()?;
        on_progress(progress);
    }
    Ok(())
}

/// A round after extraction: batches of rows to write, and what the summary needs.
struct Extracted {
    batches: Vec<(Batches, Vec<Mark>)>,
    events: Vec<Counted>,
    bytes: u64,
}

/// An event whose bulk has gone into the batches.
enum Counted {
    Episode(Arc<RecordingIdentity>, Box<Episode>, Box<Outcome>),
    Recording(Arc<RecordingIdentity>, Box<RecordingRow>),
}

/// Runs the method on every episode of a round and makes rows of the results.
fn extract(round: Round, config: &Config) -> Extracted {
    let Round { events, bytes } = round;
    let params: &ExtractionParams = &config.params;
    let events: Vec<Counted> = events
        .into_par_iter()
        .with_max_len(1)
        .map(|event| match event {
            Event::Episode(identity, episode) => {
                let outcome = extraction::extract(&episode, params);
                Counted::Episode(identity, episode, Box::new(outcome))
            }
            Event::Recording(identity, row) => Counted::Recording(identity, row),
        })
        .collect();
    let batches = groups(&events, config.max_part_rows.min(BATCH_ROWS))
        .into_par_iter()
        .map(|group| rows(group, config))
        .collect();
    Extracted {
        batches,
        events,
        bytes,
    }
}

/// Cuts events into runs of about `batch_rows` step rows.
fn groups(events: &[Counted], batch_rows: usize) -> Vec<&[Counted]> {
    let mut groups = Vec::new();
    let (mut start, mut n_rows) = (0, 0);
    for (i, event) in events.iter().enumerate() {
        if let Counted::Episode(_, episode, _) = event {
            n_rows += episode.n_steps() * episode.actions.n_columns();
        }
        if n_rows >= batch_rows {
            groups.push(&events[start..=i]);
            (start, n_rows) = (i + 1, 0);
        }
    }
    if start < events.len() {
        groups.push(&events[start..]);
    }
    groups
}

fn rows(events: &[Counted], config: &Config) -> (Batches, Vec<Mark>) {
    let mut rows = RowsBuilder::new(config.params.joints(), config.steps);
    let mut marks = Vec::with_capacity(events.len());
    for event in events {
        match event {
            Counted::Episode(identity, episode, outcome) => {
                rows.append_episode(episode, outcome);
                marks.push(Mark::Episode(RecordingIdentity::clone(identity)));
            }
            Counted::Recording(identity, row) => {
                rows.append_recording(row);
                marks.push(Mark::Recording(DoneRecording {
                    identity: RecordingIdentity::clone(identity),
                    status: row.status,
                    n_episodes: row.n_episodes,
                    clean: row.is_clean(),
                }));
            }
        }
    }
    (rows.finish(), marks)
}

/// Writes a round and counts it.
fn write(
    extracted: Extracted,
    writer: Option<&mut TableWriter>,
    summary: &mut RunSummary,
    progress: &mut Progress,
) -> Result<(), TableError> {
    for event in &extracted.events {
        match event {
            Counted::Episode(_, episode, outcome) => {
                summary.add_episode(episode, outcome);
                progress.n_episodes += 1;
                progress.n_steps += episode.n_steps() as u64;
            }
            Counted::Recording(_, row) => {
                summary.add_recording(row);
                progress.n_recordings += 1;
            }
        }
    }
    progress.bytes += extracted.bytes;
    if let Some(writer) = writer {
        for (batches, marks) in extracted.batches {
            writer.write(&batches, &marks)?;
        }
    }
    Ok(())
}
