//! Recordings that are extracted while they are written: looked at again and again, each episode taken as soon as it is
//! complete, and committed with those of the same moment.
//!
//! What is known of a recording is in the tables: how it begins, and which of its episodes are there. So a process that
//! ends, however it ends, is followed by one that reads the same file from its beginning and passes over those.

mod files;
mod recording;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use rayon::prelude::*;

use super::config::{Config, RunError, check_is_file};
use super::inputs::{self, Input};
use super::resume::InTables;
use super::round::Extracted;
use super::source::Round;
use super::{Interrupt, Progress};
use crate::summary::{RunSummary, WatchSummary};
use crate::tables::{LiveTables, OutputDirectory, TableOptions};
use recording::{Turn, Watched};

/// Recordings that are read at the same time: what they give is in memory until it is committed.
const MAX_AT_ONCE: usize = 8;

/// Bytes of values after which a commit does not wait for the other recordings.
const COMMIT_BYTES: u64 = 16 << 20;

/// Between two looks at whether to stop.
const MAX_SLEEP: Duration = Duration::from_millis(20);

/// Something to be told while recordings are watched.
#[derive(Debug, Clone)]
pub enum Told {
    /// A recording is not read as could be expected: one sentence that begins with its name.
    Remark(String),
    /// This was added to the tables.
    Committed(Box<RunSummary>),
}

/// What is watched, and how.
#[derive(Debug, Clone)]
pub struct WatchConfig {
    /// As for a run; its one input is the folder that is watched.
    pub run: Config,
    /// Between two looks at the folder.
    pub interval: Duration,
    /// Part groups of one size after which they are merged.
    pub merge_after: usize,
}

/// Watches a folder until `interrupt` is raised; all that is complete then is committed.
///
/// # Errors
/// [`RunError`] tells bad arguments (exit 2) from failures (exit 1). A bad recording is no error: it is told of.
pub fn watch(
    config: &WatchConfig,
    tell: &(dyn Fn(&Told) + Sync),
    interrupt: &Interrupt,
) -> Result<WatchSummary, RunError> {
    let run = &config.run;
    let (Some(folder), Some(output)) = (run.inputs.first(), &run.output) else {
        let missing = "a folder to watch and an output directory are needed";
        return Err(RunError::Arguments(missing.to_owned()));
    };
    check_is_file(Some(output), "tables that grow")?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(run.threads)
        .build()
        .context("cannot start the threads")
        .map_err(RunError::Failed)?;
    pool.install(|| {
        let options = TableOptions {
            steps: run.steps,
            metadata: run.metadata(),
            // A group is cut where it is committed.
            max_part_rows: usize::MAX,
            faults: run.faults.clone(),
            ..TableOptions::default()
        };
        let directory = OutputDirectory::open(output, &options, run.overwrite)?;
        let mut watch = Watch {
            config: run,
            folder,
            tables: LiveTables::new(directory, config.merge_after)?,
            recordings: BTreeMap::new(),
            summary: WatchSummary::default(),
            tell,
        };
        loop {
            let started = Instant::now();
            // Asked before the look: what was complete when it was raised is still taken.
            let is_last = interrupt.is_raised();
            let has_more = watch.look()?;
            if is_last {
                return watch.finish();
            }
            while !has_more && !interrupt.is_raised() && started.elapsed() < config.interval {
                let left = config.interval.saturating_sub(started.elapsed());
                thread::sleep(left.min(MAX_SLEEP));
            }
        }
    })
}

struct Watch<'a> {
    config: &'a Config,
    folder: &'a Path,
    tables: LiveTables,
    /// Those that are in the folder, by name.
    recordings: BTreeMap<Arc<str>, Watched>,
    summary: WatchSummary,
    tell: &'a (dyn Fn(&Told) + Sync),
}

impl Watch<'_> {
    /// Reads what has come, up to a bound for each recording, and commits it; true if there is more already.
    fn look(&mut self) -> Result<bool, RunError> {
        self.meet(inputs::find_below(self.folder));
        let mut recordings = std::mem::take(&mut self.recordings);
        let mut due: Vec<&mut Watched> = recordings
            .values_mut()
            .filter_map(|watched| watched.is_due().then_some(watched))
            .collect();
        let mut round = Round::default();
        let mut n_bytes = 0;
        let mut has_more = false;
        for some in due.chunks_mut(MAX_AT_ONCE) {
            let turns: Vec<Turn> = some
                .par_iter_mut()
                .with_max_len(1)
                .map(|watched| watched.turn(&self.config.read))
                .collect();
            for turn in turns {
                has_more |= turn.has_more;
                turn.told.iter().for_each(self.tell);
                if let Some(name) = &turn.forget {
                    self.tables.forget(name)?;
                }
                n_bytes += turn.bytes;
                round.events.extend(turn.events);
            }
            if n_bytes >= COMMIT_BYTES {
                self.commit(std::mem::take(&mut round))?;
                n_bytes = 0;
            }
        }
        self.commit(round)?;
        self.recordings = recordings;
        Ok(has_more)
    }

    /// Takes in recordings that are new, and lets go of those that are gone.
    fn meet(&mut self, inputs: Vec<Input>) {
        let mut before = std::mem::take(&mut self.recordings);
        for input in inputs {
            let name = Arc::clone(&input.name);
            let watched = before.remove(&name).filter(|w| w.is_of(&input));
            let watched = watched.unwrap_or_else(|| {
                Watched::new(input, self.tables.done(&name), self.tables.begun(&name))
            });
            self.recordings.insert(name, watched);
        }
        for gone in before.values() {
            if let Some(told) = gone.farewell() {
                (self.tell)(&told);
            }
        }
    }

    fn commit(&mut self, round: Round) -> Result<(), RunError> {
        if round.events.is_empty() {
            return Ok(());
        }
        let extracted = Extracted::of(round, self.config, &InTables::default());
        self.tables.commit(extracted.batches())?;
        let mut summary = RunSummary::default();
        extracted.count(&mut summary, &mut Progress::default());
        self.summary.add(&summary);
        (self.tell)(&Told::Committed(Box::new(summary)));
        Ok(())
    }

    fn finish(mut self) -> Result<WatchSummary, RunError> {
        let count = |is: &dyn Fn(&Watched) -> bool| {
            let recordings = self.recordings.values();
            recordings.filter(|watched| is(watched)).count() as u64
        };
        self.summary.n_complete = count(&Watched::is_done);
        self.summary.n_growing = count(&|watched| !watched.is_done());
        let is_whole = self.summary.n_complete > 0 && self.summary.n_growing == 0;
        self.tables.finish(is_whole)?;
        Ok(self.summary)
    }
}
