//! What becomes of a round: the method is run on its episodes, then the results are counted and written.

use std::sync::Arc;

use rayon::prelude::*;

use super::Progress;
use super::config::{Config, RunError};
use super::resume::InTables;
use super::source::{Event, Round};
use crate::events::{EventsWriter, Item};
use crate::extraction::{self, ExtractionParams};
use crate::model::{Episode, Outcome, RecordingIdentity, RecordingRow};
use crate::summary::RunSummary;
use crate::tables::{Batches, DoneRecording, Mark, RowsBuilder, TableWriter};

/// Step rows that are made into one batch: enough for the writer to work on whole columns.
const BATCH_ROWS: usize = 64 << 10;

/// A round after extraction: batches of rows to write, and what the summary needs.
pub(super) struct Extracted {
    batches: Vec<(Batches, Vec<Mark>)>,
    events: Vec<Counted>,
    bytes: u64,
}

/// An event whose bulk has gone into the batches.
struct Counted {
    identity: Arc<RecordingIdentity>,
    /// Its rows are there already: it counts for nothing but its events.
    in_tables: bool,
    what: What,
}

enum What {
    Episode(u64, Box<Episode>, Box<Outcome>),
    Recording(Box<RecordingRow>),
}

impl Extracted {
    /// Runs the method on every episode of a round and makes rows of the results.
    pub(super) fn of(round: Round, config: &Config, in_tables: &InTables) -> Self {
        let Round { events, bytes } = round;
        let params: &ExtractionParams = &config.params;
        let events: Vec<(bool, Event)> = events
            .into_iter()
            .map(|event| (in_tables.have(&event), event))
            .collect();
        let events: Vec<Counted> = events
            .into_par_iter()
            .with_max_len(1)
            .map(|(in_tables, event)| match event {
                Event::Episode(identity, nth, episode) => {
                    let outcome = extraction::extract(&episode, params);
                    Counted {
                        identity,
                        in_tables,
                        what: What::Episode(nth, episode, Box::new(outcome)),
                    }
                }
                Event::Recording(identity, row) => Counted {
                    identity,
                    in_tables,
                    what: What::Recording(row),
                },
            })
            .collect();
        let batches = groups(&events, config.max_part_rows.min(BATCH_ROWS))
            .into_par_iter()
            .map(|group| rows(group, config))
            .collect();
        Self {
            batches,
            events,
            bytes,
        }
    }

    /// Counts a round.
    pub(super) fn count(&self, summary: &mut RunSummary, progress: &mut Progress) {
        for event in &self.events {
            match &event.what {
                What::Episode(_, episode, outcome) => {
                    if !event.in_tables {
                        summary.add_episode(episode, outcome);
                    }
                    progress.n_episodes += 1;
                    progress.n_steps += episode.n_steps() as u64;
                }
                What::Recording(row) => {
                    if !event.in_tables {
                        summary.add_recording(row);
                    }
                    progress.n_recordings += 1;
                }
            }
        }
        progress.bytes += self.bytes;
    }

    /// Its rows.
    pub(super) fn batches(&self) -> &[(Batches, Vec<Mark>)] {
        &self.batches
    }

    /// Writes a round: tables and events side by side.
    pub(super) fn write(
        &self,
        tables: Option<&mut TableWriter>,
        events: Option<&mut EventsWriter>,
    ) -> Result<(), RunError> {
        let (tables, events) = rayon::join(
            || {
                tables.map_or(Ok(()), |writer| {
                    let mut batches = self.batches.iter();
                    batches.try_for_each(|(batches, marks)| writer.write(batches, marks))
                })
            },
            || {
                events.map_or(Ok(()), |writer| {
                    let items: Vec<Item<'_>> = self.events.iter().map(item).collect();
                    writer.write(&items)
                })
            },
        );
        tables?;
        events?;
        Ok(())
    }
}

/// Cuts events into runs of about `batch_rows` step rows.
fn groups(events: &[Counted], batch_rows: usize) -> Vec<&[Counted]> {
    let mut groups = Vec::new();
    let (mut start, mut n_rows) = (0, 0);
    for (i, event) in events.iter().enumerate() {
        if let What::Episode(_, episode, _) = &event.what {
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
    for event in events.iter().filter(|event| !event.in_tables) {
        let identity = RecordingIdentity::clone(&event.identity);
        match &event.what {
            What::Episode(nth, episode, outcome) => {
                rows.append_episode(episode, outcome);
                marks.push(Mark::Episode(identity, *nth));
            }
            What::Recording(row) => {
                rows.append_recording(row);
                marks.push(Mark::Recording(DoneRecording {
                    identity,
                    status: row.status,
                    n_episodes: row.n_episodes,
                    clean: row.is_clean(),
                }));
            }
        }
    }
    (rows.finish(), marks)
}

fn item(event: &Counted) -> Item<'_> {
    match &event.what {
        What::Episode(_, episode, outcome) => Item::Episode(&event.identity, episode, outcome),
        What::Recording(_) => Item::End(&event.identity),
    }
}
