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

mod balance;
mod compare;
mod config;
mod identity;
mod inputs;
mod inspect;
mod plan;
mod resume;
mod round;
mod source;
mod watch;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::Context;

pub use compare::{CompareConfig, compare};
pub use config::{Config, RunError};
pub use inputs::InputError;
pub use inspect::{Inspected, inspect};
pub use plan::{
    Finish, Finished, MAX_SHARDS, MissingRecordings, Planned, Shard, finish, plan, read_plan,
};
pub use watch::{Told, WatchConfig, watch};

pub use crate::tables::{DEFAULT_MAX_PART_ROWS, Plan};

use crate::cloud;
use crate::events::{self, EventsWriter};
use crate::summary::{RunOutcome, RunSummary};
use crate::tables::{self, OutputDirectory, TableWriter};
use inputs::Input;
use resume::InTables;
use round::Extracted;
use source::{Job, Round, Source};

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
    config.check_outputs()?;
    let inputs = match &config.shard {
        Some(shard) => shard.inputs(),
        None => inputs::find(&config.inputs)?,
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(config.threads)
        .build()
        .context("cannot start the threads")
        .map_err(RunError::Failed)?;
    let mut summary = pool.install(|| {
        if let Some(output) = &config.output {
            return written(config, output, inputs, on_progress, interrupt);
        }
        let jobs = resume::all(&inputs);
        let mut summary = RunSummary::of(config.shard.is_some());
        let mut outputs = Outputs {
            tables: None,
            events: events_writer(config, &inputs),
            in_tables: InTables::default(),
        };
        stages(
            config,
            &jobs,
            &mut outputs,
            &mut summary,
            on_progress,
            interrupt,
        )?;
        Ok(summary)
    })?;
    summary.set_elapsed(started.elapsed());
    Ok(summary)
}

/// A run with tables: goes on where an earlier process of the same run stopped.
fn written(
    config: &Config,
    output: &Path,
    inputs: Vec<Input>,
    on_progress: &(dyn Fn(Progress) + Sync),
    interrupt: &Interrupt,
) -> Result<RunSummary, RunError> {
    let options = plan::table_options(config);
    let mut directory = OutputDirectory::open(output, &options, config.overwrite)?;
    let inputs = &resume::under_known_names(inputs, &config.inputs, &directory);
    let mut work = resume::work(inputs, &mut directory)?;
    let mut summary = RunSummary::of(config.shard.is_some());
    for done in &work.before {
        summary.add_done_before(done.n_episodes, done.clean);
    }
    for job in &work.jobs {
        summary.add_begun_before(job.written.n_episodes());
    }
    let events = events_writer(config, inputs);
    let in_tables = events.as_ref().map_or_else(InTables::default, |events| {
        InTables::for_events(&mut work, inputs, events)
    });
    // Held until all is done: the directory, or its writer too.
    let needs_no_mark =
        (directory.is_complete() || config.shard.is_some()) && !directory.has_leftovers();
    let tables = if needs_no_mark && in_tables.have_all(&work.jobs) {
        None
    } else {
        Some(directory.writer()?)
    };
    let mut outputs = Outputs {
        tables,
        events,
        in_tables,
    };
    let stages = stages(
        config,
        &work.jobs,
        &mut outputs,
        &mut summary,
        on_progress,
        interrupt,
    );
    drop(directory);
    let Some(mut writer) = outputs.tables else {
        return stages.map(|()| summary);
    };
    let sync_time = writer.sync_time();
    if matches!(stages, Err(RunError::Interrupted)) {
        // What is in hand is whole up to the last episode.
        writer.commit()?;
    }
    stages?;
    if summary.outcome() == RunOutcome::Failed || config.shard.is_some() {
        writer.close()?;
    } else {
        writer.finish()?;
    }
    summary.set_sync(sync_time.get());
    Ok(summary)
}

/// Do tables at `output` go to an object store? To stop then takes as long as it takes to put there what is in hand.
pub fn is_in_store(output: &Path) -> bool {
    cloud::address(output).is_some()
}

/// What a run writes.
struct Outputs {
    tables: Option<TableWriter>,
    events: Option<EventsWriter>,
    in_tables: InTables,
}

fn events_writer(config: &Config, inputs: &[Input]) -> Option<EventsWriter> {
    let options = config.events()?;
    let own = || inputs.iter().map(|input| &input.name);
    Some(match &config.shard {
        // What a file is called depends on all recordings of the run.
        Some(shard) => EventsWriter::new(&options, shard.all_names()).only(own()),
        None => EventsWriter::new(&options, own()),
    })
}

/// Removes the unfinished files of a run that must end at once.
pub fn remove_temporaries(tables: Option<&Path>, events: Option<&Path>) {
    if let Some(directory) = tables {
        tables::remove_temporaries(directory);
    }
    if let Some(directory) = events {
        events::remove_temporaries(directory);
    }
}

/// Moves rounds through the three stages until all are through.
fn stages(
    config: &Config,
    jobs: &[Job<'_>],
    outputs: &mut Outputs,
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
    let Outputs {
        tables,
        events,
        in_tables,
    } = outputs;
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
                    || to_extract.map(|round| Extracted::of(round, config, in_tables)),
                    || {
                        to_write.map(|e| {
                            e.count(summary, &mut progress);
                            e.write(tables.as_mut(), events.as_mut())
                        })
                    },
                )
            },
        );
        (read, extracted) = (next, done);
        written.transpose()?;
        on_progress(progress);
    }
    Ok(())
}
