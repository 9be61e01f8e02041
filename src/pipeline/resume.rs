//! What is left to do in a directory that an earlier process of the same run has written to.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;

use super::config::RunError;
use super::identity;
use super::inputs::{self, Input};
use super::source::{Event, Job};
use crate::events::EventsWriter;
use crate::model::{RecordingIdentity, RecordingStatus};
use crate::tables::{DoneRecording, OutputDirectory, Written};

/// What is left to do, and what is done.
pub(crate) struct Work<'a> {
    /// Those that were written in part come first.
    pub(crate) jobs: Vec<Job<'a>>,
    pub(crate) before: Vec<DoneRecording>,
}

/// Recordings that are read again, from their beginnings, for their events: their first episodes are in the tables.
#[derive(Default)]
pub(crate) struct InTables(BTreeMap<Arc<str>, Rows>);

/// What of a recording is in the tables.
enum Rows {
    Episodes(Written),
    All,
}

impl InTables {
    /// Makes jobs of all recordings whose events are not there. Those of a recording that is only begun never are:
    /// an events file is whole or it is not there.
    pub(crate) fn for_events<'a>(
        work: &mut Work<'a>,
        inputs: &'a [Input],
        events: &EventsWriter,
    ) -> Self {
        let mut rows = BTreeMap::new();
        for job in work.jobs.iter_mut().filter(|job| job.is_begun()) {
            let written = std::mem::take(&mut job.written);
            rows.insert(Arc::clone(&job.input.name), Rows::Episodes(written));
        }
        let without_events: BTreeSet<&str> = work
            .before
            .iter()
            .filter(|done| done.n_episodes > 0 && !events.is_current(&done.identity))
            .map(|done| &*done.identity.name)
            .collect();
        for input in inputs.iter().filter(|i| without_events.contains(&*i.name)) {
            let written = Written::default();
            work.jobs.push(Job { input, written });
            rows.insert(Arc::clone(&input.name), Rows::All);
        }
        Self(rows)
    }

    /// Is the row of this event in the tables?
    pub(crate) fn have(&self, event: &Event) -> bool {
        let (Event::Episode(identity, ..) | Event::Recording(identity, _)) = event;
        match (self.0.get(&identity.name), event) {
            (Some(Rows::All), _) => true,
            (Some(Rows::Episodes(written)), Event::Episode(_, nth, _)) => written.contains(*nth),
            _ => false,
        }
    }

    /// Are the rows of all these recordings there?
    pub(crate) fn have_all(&self, jobs: &[Job<'_>]) -> bool {
        jobs.iter()
            .all(|job| matches!(self.0.get(&job.input.name), Some(Rows::All)))
    }
}

/// All recordings, from their beginnings.
pub(crate) fn all(inputs: &[Input]) -> Vec<Job<'_>> {
    inputs
        .iter()
        .map(|input| Job {
            input,
            written: Written::default(),
        })
        .collect()
}

/// The recordings under the names that the tables have for them: a watch calls them by their paths below its folder,
/// also where they have a longer way in common.
pub(crate) fn under_known_names(
    inputs: Vec<Input>,
    arguments: &[PathBuf],
    directory: &OutputDirectory,
) -> Vec<Input> {
    let is_among = |name: &str, inputs: &[Input]| input_of(name, inputs).is_some();
    let begun = directory.begun();
    let known = directory
        .done()
        .into_keys()
        .chain(begun.keys().map(|n| &**n));
    let known: Vec<&str> = known.collect();
    match arguments {
        [folder] if folder.is_dir() && known.iter().any(|name| !is_among(name, &inputs)) => {
            let below = inputs::find_below(folder);
            let is_so_called = known.iter().all(|name| is_among(name, &below));
            if is_so_called { below } else { inputs }
        }
        _ => inputs,
    }
}

/// Takes recordings that are new, had failed, or were written in part.
pub(crate) fn work<'a>(
    inputs: &'a [Input],
    directory: &mut OutputDirectory,
) -> Result<Work<'a>, RunError> {
    let (stand, failed): (Vec<DoneRecording>, Vec<DoneRecording>) = directory
        .done()
        .into_values()
        .cloned()
        .partition(|done| done.status != RecordingStatus::Failed);
    let mut begun = directory.begun();
    let known: Vec<&RecordingIdentity> = stand
        .iter()
        .map(|done| &done.identity)
        .chain(begun.values().filter_map(|begun| begun.whole.as_ref()))
        .collect();
    let beginnings = begun.values().filter_map(|begun| begun.beginning.as_ref());
    let beginnings: Vec<&RecordingIdentity> = beginnings.collect();
    let is_gone = |done: &&DoneRecording| input_of(&done.identity.name, inputs).is_none();
    if let Some(gone) = failed.iter().find(is_gone) {
        return Err(RunError::Arguments(vanished(&gone.identity.name)));
    }
    known
        .par_iter()
        .map(|identity| check(identity, inputs, identity::of))
        .chain(
            beginnings
                .par_iter()
                .map(|known| check(known, inputs, |i| identity::of_beginning(i, known.bytes))),
        )
        .collect::<Result<(), String>>()
        .map_err(RunError::Arguments)?;
    let names: BTreeSet<&str> = stand.iter().map(|d| &*d.identity.name).collect();
    let mut jobs: Vec<Job<'a>> = inputs
        .iter()
        .filter(|input| !names.contains(&*input.name))
        .map(|input| Job {
            input,
            written: begun.remove(&input.name).unwrap_or_default().written,
        })
        .collect();
    jobs.sort_by_key(|job| !job.is_begun());
    let again: Vec<&str> = failed.iter().map(|done| &*done.identity.name).collect();
    directory.forget(&again)?;
    Ok(Work {
        jobs,
        before: stand,
    })
}

/// The input of a name, among inputs that are sorted by it.
fn input_of<'a>(name: &str, inputs: &'a [Input]) -> Option<&'a Input> {
    let found = inputs.binary_search_by(|input| (*input.name).cmp(name));
    found.ok().map(|index| &inputs[index])
}

/// How a user settles that a recording is not what it was.
pub(super) const SETTLE: &str = "give another directory, or --overwrite to start again";

fn vanished(name: &str) -> String {
    format!("{name} is in the tables and no longer among the inputs: {SETTLE}")
}

/// Is a recording, whose rows are in the tables, still there as it was?
fn check(
    known: &RecordingIdentity,
    inputs: &[Input],
    identity: impl Fn(&Input) -> RecordingIdentity,
) -> Result<(), String> {
    let name = &known.name;
    let Some(input) = input_of(name, inputs) else {
        return Err(vanished(name));
    };
    if identity(input) == *known {
        Ok(())
    } else {
        Err(format!(
            "{name} has changed since it was written to the tables: {SETTLE}"
        ))
    }
}
